//! The station from the host's side: commands out, reports in, over any byte link.
//!
//! [`client`] speaks the protocol and does no input or output. [`twin`] is a station without
//! hardware: the very code of the board on virtual time, with a simulated stage at the step pins.
//! [`serial`] is a station on a serial line, [`ports`] says which lines there are, [`clock`] keeps
//! the station's time, [`plausible`] says which of its numbers can be true, [`diagnosis`] says what
//! its states and faults mean. [`tape`] records a twin's life for comparison. [`stage`] turns the
//! rig file's stage into a configuration.

pub mod allowance;
pub mod bound;
pub mod client;
pub mod clock;
pub mod diagnosis;
mod motion;
pub mod plausible;
pub mod ports;
pub mod serial;
pub mod stage;
pub mod tape;
pub mod twin;

use shared::frame::message::{Denial, Mismatch, ResetCause};
use shared::frame::receive::Rejects;
use shared::safety::Fault;

/// What can go wrong between host and station.
#[derive(Debug, thiserror::Error)]
pub enum StationError {
    /// It did not answer in time.
    #[error("the station did not answer {command} within {waited_ms} ms")]
    Silent {
        /// What was asked.
        command: &'static str,
        /// How long was waited, ms.
        waited_ms: u64,
    },
    /// It did not answer a command, but told how it is.
    #[error("the station did not answer {command} within {waited_ms} ms; {known}")]
    Unanswered {
        /// What was asked.
        command: &'static str,
        /// How long was waited, ms.
        waited_ms: u64,
        /// What its status says of the command.
        known: String,
    },
    /// It answered none of the stops.
    #[error(
        "the station answered none of {sent} stops; the heartbeat has been ended, so it stops by itself if it still hears this computer: see that the stage stands"
    )]
    Unstopped {
        /// How many were sent.
        sent: u32,
    },
    /// It answered a stop, but still says that the stage moves.
    #[error(
        "the station answered the stop, but after {waited_s} s it still says that the stage moves: see that the stage stands"
    )]
    Restless {
        /// How long was waited, s.
        waited_s: u64,
    },
    /// A motion took longer than its profile can; it was stopped.
    #[error(
        "after {waited_s} s the station still said that the stage moves, which is longer than this motion takes; the stage was stopped and stands"
    )]
    Overdue {
        /// How long was waited, s.
        waited_s: u64,
    },
    /// It answered a stop, but its hello cannot be true.
    #[error("the station answered the stop, but see that the stage stands: {0}")]
    StoppedDoubtful(plausible::Implausible),
    /// A signal came: the program is to end.
    #[error("interrupted")]
    Cancelled,
    /// A number that cannot be true.
    #[error(transparent)]
    Implausible(#[from] plausible::Implausible),
    /// It speaks another protocol.
    #[error("the station's firmware does not fit this program: {}", mismatches(.0))]
    Mismatch(Vec<Mismatch>),
    /// It refused.
    #[error("the station refused {command}: {}", bound::denial(*.denial))]
    Denied {
        /// What was asked.
        command: &'static str,
        /// Why not.
        denial: Denial,
    },
    /// It latched a fault.
    #[error("the station stopped with fault {}: {}", .0.number(), diagnosis::explain(*.0))]
    Faulted(Fault),
    /// Its bytes were not understood.
    #[error(
        "what comes from the line is no station's or is garbled: {}; see that it is the right port, and the cable",
        rejects(.0)
    )]
    Garbled(Rejects),
    /// The serial port cannot be used.
    #[error("{path}: {reason}")]
    Port {
        /// The port.
        path: String,
        /// What happened.
        reason: String,
    },
    /// Another program has the serial port.
    #[error("{path}: cannot open: {}", in_use(.holder.as_ref()))]
    Busy {
        /// The port.
        path: String,
        /// That program, if the system tells.
        holder: Option<serial::Holder>,
    },
    /// The line broke, and nobody answered on it since.
    #[error(
        "{path}: the line is lost: {reason}; the station stops by itself when it hears no host"
    )]
    Lost {
        /// The port.
        path: String,
        /// What happened.
        reason: String,
    },
    /// The line broke and is back; the station kept its position.
    #[error(
        "{path}: the line was lost for {away_ms} ms ({reason}); the station kept its position; nothing moves until it is told to again"
    )]
    Interrupted {
        /// The port.
        path: String,
        /// What happened.
        reason: String,
        /// For how long, ms.
        away_ms: u64,
    },
    /// The station started anew.
    #[error(
        "{path}: the station restarted ({cause}): its position is unknown and its configuration gone; see that the stage stands right, then start again (`trinocular hello` shows what it remembers)"
    )]
    Restarted {
        /// The port.
        path: String,
        /// Why it started, as it says.
        cause: &'static str,
    },
    /// The stage of the rig file cannot be put into a configuration.
    #[error("{field} of the stage is out of the station's range")]
    Stage {
        /// The rig file's field.
        field: String,
    },
}

fn mismatches(list: &[Mismatch]) -> String {
    let one = |m: &Mismatch| format!("{} is {} there and {} here", m.field, m.station, m.host);
    list.iter().map(one).collect::<Vec<_>>().join(", ")
}

fn in_use(holder: Option<&serial::Holder>) -> String {
    match holder {
        Some(serial::Holder { pid, command }) => {
            format!(
                "in use by `{command}` (process {pid}); end it with Ctrl-C there, or run `trinocular stop`, which does the same to a run of this program"
            )
        }
        None => "in use by another program; end that program first".to_owned(),
    }
}

/// Bytes that were no report, in words.
pub fn rejects(rejects: &Rejects) -> String {
    let kinds = [
        (rejects.framing, "broken"),
        (rejects.checksum, "with a wrong checksum"),
        (rejects.malformed, "of no known kind"),
        (rejects.too_long, "too long"),
    ];
    let seen = kinds.iter().filter(|(count, _)| *count > 0);
    let seen: Vec<String> = seen
        .map(|(count, kind)| format!("{count} {kind}"))
        .collect();
    match seen.is_empty() {
        true => "no packet at all".to_owned(),
        false => format!("packets that are {}", seen.join(", ")),
    }
}

/// Why a station started, in words.
pub const fn reset_cause(cause: ResetCause) -> &'static str {
    match cause {
        ResetCause::PowerOn => "power on",
        ResetCause::BrownOut => "brown out",
        ResetCause::Pin => "pin",
        ResetCause::Software => "software",
        ResetCause::Watchdog => "watchdog",
    }
}
