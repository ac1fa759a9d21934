#![doc = include_str!("../README.md")]
//!
//! # Modules
//!
//! [`conversation`] speaks the protocol and does no input or output. [`twin`] is a station without
//! hardware: the very code of the board on virtual time, with a simulated stage at the step pins.
//! [`serial`] is a station on a serial line, [`ports`] says which lines there are, [`owner`] lets
//! several programs reach one station, [`clock`] keeps the station's time, [`plausible`] says which
//! of its numbers can be true, [`diagnosis`] says what its states and faults mean. [`rest`] waits for
//! the end of a motion, at most as long as its [`allowance`]. [`observer`] sees every byte on the
//! line; [`tape`] records a twin's life for comparison. [`stage`] turns the rig file's stage into a
//! configuration, [`shortened`] says where its soft limits shorten a jog,
//! [`below_step`] refuses one that is too short.

pub mod allowance;
pub mod below_step;
pub mod bound;
pub mod clock;
pub mod conversation;
pub mod diagnosis;
mod motion;
pub mod observer;
pub mod owner;
pub mod plant;
pub mod plausible;
pub mod ports;
mod positions;
pub mod rest;
pub mod serial;
pub mod shortened;
pub mod stage;
pub mod tape;
pub mod travel;
pub mod twin;

use trinocular_core::frame::message::{Denial, Mismatch, ResetCause, Status};
use trinocular_core::frame::receive::Rejects;
use trinocular_core::safety::Fault;

/// Errors between host and station.
#[derive(Debug, thiserror::Error)]
pub enum StationError {
    /// The station did not answer in time.
    #[error(
        "the station did not answer {command} within {waited_ms} ms{}",
        first_contact(.command)
    )]
    Silent {
        /// Command that was sent.
        command: &'static str,
        /// Time waited, ms.
        waited_ms: u64,
    },
    /// The station did not answer a command, but reported its status.
    #[error("the station did not answer {command} within {waited_ms} ms; {known}")]
    Unanswered {
        /// Command that was sent.
        command: &'static str,
        /// Time waited, ms.
        waited_ms: u64,
        /// Conclusion from the status about the command, in words.
        known: String,
    },
    /// The station answered none of the stops.
    #[error(
        "the station answered none of {sent} stops; the heartbeat has been ended, so it stops by \
         itself if it still hears this computer: see that the stage stands"
    )]
    Unstopped {
        /// Number of stops sent.
        sent: u32,
    },
    /// The station answered a stop, but still reports that the stage moves.
    #[error(
        "the station answered the stop, but after {waited_s} s it still says that the stage moves: \
         see that the stage stands"
    )]
    Restless {
        /// Time waited, s.
        waited_s: u64,
    },
    /// A motion took longer than its profile can take; the stage was stopped.
    #[error(
        "after {waited_s} s the station still said that the stage moves, which is longer than this \
         motion takes; the stage was stopped and stands"
    )]
    Overdue {
        /// Time waited, s.
        waited_s: u64,
    },
    /// The station answered a stop, but its hello has an implausible number.
    #[error("the station answered the stop, but see that the stage stands: {0}")]
    StoppedDoubtful(plausible::Implausible),
    /// Another program stopped the stage through this one.
    #[error("the stage was stopped by {by}")]
    StoppedByOther {
        /// Program that asked for the stop, with its process number.
        by: String,
    },
    /// A signal asked the program to end.
    #[error("interrupted")]
    Cancelled,
    /// The station sent an implausible number.
    #[error(transparent)]
    Implausible(#[from] plausible::Implausible),
    /// The station speaks another protocol.
    #[error("the station's firmware does not fit this program: {}", mismatches(.0))]
    Mismatch(Vec<Mismatch>),
    /// The station denied a command.
    #[error("the station refused {command}: {}", bound::denial(*.denial))]
    Denied {
        /// Command that was sent.
        command: &'static str,
        /// Reason of the denial.
        denial: Denial,
    },
    /// The station latched a fault.
    #[error("the station stopped with fault {}: {}", .0.number(), diagnosis::explain(*.0))]
    Faulted(Fault),
    /// The bytes on the line are not reports of a station.
    #[error(
        "what comes from the line is no station's or is garbled: {}; see that it is the right \
         port, and the cable",
        rejects(.0)
    )]
    Garbled(Rejects),
    /// The serial port cannot be used.
    #[error("{path}: {reason}")]
    Port {
        /// Path of the port.
        path: String,
        /// Cause, in words.
        reason: String,
    },
    /// Another program has the serial port.
    #[error("{path}: cannot open: {}", in_use(.holder.as_ref()))]
    Busy {
        /// Path of the port.
        path: String,
        /// Program that has the port, if the system reports it.
        holder: Option<serial::Holder>,
    },
    /// Another program has the serial port and does not let this one in or refuse it.
    #[error("{path}: {}", silent_owner(.holder.as_ref()))]
    OwnerSilent {
        /// Path of the port.
        path: String,
        /// Program that has the port, if the system reports it.
        holder: Option<serial::Holder>,
    },
    /// The line broke, and no station has answered on it since.
    #[error(
        "{path}: the line is lost: {reason}; the station stops by itself when it hears no host"
    )]
    Lost {
        /// Path of the port.
        path: String,
        /// Cause, in words.
        reason: String,
    },
    /// The line broke and is back; the station kept its position.
    #[error(
        "{path}: the line was lost for {away_ms} ms ({reason}); the station kept its position; \
         nothing moves until the next command to move"
    )]
    Interrupted {
        /// Path of the port.
        path: String,
        /// Cause, in words.
        reason: String,
        /// Duration of the interruption, ms.
        away_ms: u64,
    },
    /// The station restarted.
    #[error(
        "{path}: the station restarted ({cause}): its position is unknown and its configuration \
         gone; see that the stage stands right, then start again (`trinocular hello` shows what it \
         remembers)"
    )]
    Restarted {
        /// Path of the port.
        path: String,
        /// Cause of the restart as the station reports it, or when it happened.
        cause: &'static str,
    },
    /// The stage of the rig file cannot be put into a configuration.
    #[error("{field} of the stage is out of the station's range")]
    Stage {
        /// Field of the rig file.
        field: String,
    },
}

impl StationError {
    /// Returns true for a refusal that passes by itself: a ramp or the report of a fault is still
    /// under way.
    pub const fn is_passing(&self) -> bool {
        matches!(
            self,
            Self::Denied {
                denial: Denial::Moving | Denial::FaultUnread,
                ..
            }
        )
    }

    /// Returns true if a reset that was refused so may be sent again: the ramp of a stop or a fault
    /// is under way or has ended, as `status` from after the refusal says, or the report of a fault
    /// is. A reset does not wait for the end of any other motion, because a stop may come meanwhile,
    /// which it must not undo.
    pub fn reset_may_wait(&self, status: Option<&Status>) -> bool {
        let is_on_its_way = status.is_none_or(|status| {
            use trinocular_core::safety::State::{Following, Homing, Moving};
            matches!(status.state, Moving | Following | Homing)
        });
        match self {
            Self::Denied {
                denial: Denial::Moving,
                ..
            } => !is_on_its_way,
            error => error.is_passing(),
        }
    }

    /// Returns the serial port that the message names, if it names one.
    pub fn port(&self) -> Option<&str> {
        match self {
            Self::Port { path, .. }
            | Self::Busy { path, .. }
            | Self::OwnerSilent { path, .. }
            | Self::Lost { path, .. }
            | Self::Interrupted { path, .. }
            | Self::Restarted { path, .. } => Some(path),
            Self::Silent { .. }
            | Self::Unanswered { .. }
            | Self::Unstopped { .. }
            | Self::Restless { .. }
            | Self::Overdue { .. }
            | Self::StoppedDoubtful(_)
            | Self::StoppedByOther { .. }
            | Self::Cancelled
            | Self::Implausible(_)
            | Self::Mismatch(_)
            | Self::Denied { .. }
            | Self::Faulted(_)
            | Self::Garbled(_)
            | Self::Stage { .. } => None,
        }
    }
}

/// Returns the way out if a station never answered; later silences have other causes.
fn first_contact(command: &str) -> &'static str {
    match command {
        "hello" => {
            "; see that this is the station's port (`trinocular ports` marks it with a star), that \
             its firmware is flashed (its LED flashes), and that a UART runs at 921600 baud"
        }
        _ => "",
    }
}

fn mismatches(list: &[Mismatch]) -> String {
    let one = |m: &Mismatch| format!("{} is {} there and {} here", m.field, m.station, m.host);
    list.iter().map(one).collect::<Vec<_>>().join(", ")
}

fn in_use(holder: Option<&serial::Holder>) -> String {
    match holder {
        Some(serial::Holder { pid, command }) => {
            format!(
                "in use by `{command}` (process {pid}); end it with Ctrl-C there, or run \
                 `trinocular stop`, which ends a run of this program, or the following of `serve`"
            )
        }
        None => {
            "in use by another program, perhaps of another user (`sudo lsof` names it); end that \
                 program first"
                .to_owned()
        }
    }
}

fn silent_owner(holder: Option<&serial::Holder>) -> String {
    match holder {
        Some(serial::Holder { pid, command }) => format!(
            "process {pid} (`{command}`) has the port and does not answer; it may be suspended: \
             continue it (`fg` in its terminal, or `kill -CONT {pid}`) or end it (`kill -9 {pid}`)"
        ),
        None => "a program that has the port does not answer; it may be suspended: continue it \
                 (`fg` in its terminal) or end it"
            .to_owned(),
    }
}

/// Returns the counts of rejected packets in words.
///
/// ```
/// use trinocular_core::frame::receive::Rejects;
///
/// let counts = Rejects { checksum: 2, ..Rejects::default() };
/// assert_eq!(trinocular_client::rejects(&counts), "2 packets with a wrong checksum");
/// ```
pub fn rejects(rejects: &Rejects) -> String {
    let kinds = [
        (rejects.framing, "with broken framing"),
        (rejects.checksum, "with a wrong checksum"),
        (rejects.malformed, "of no known kind"),
        (rejects.too_long, "of too many bytes"),
    ];
    let seen = kinds.iter().filter(|(count, _)| *count > 0);
    let said = seen.enumerate().map(|(index, (count, kind))| match index {
        0 if *count == 1 => format!("1 packet {kind}"),
        0 => format!("{count} packets {kind}"),
        _ => format!("{count} {kind}"),
    });
    let said: Vec<String> = said.collect();
    match said.is_empty() {
        true => "no packet at all".to_owned(),
        false => said.join(", "),
    }
}

/// Returns the name of a reset cause.
pub const fn reset_cause(cause: ResetCause) -> &'static str {
    match cause {
        ResetCause::PowerOn => "power on",
        ResetCause::BrownOut => "brown out",
        ResetCause::Pin => "pin",
        ResetCause::Software => "software",
        ResetCause::Watchdog => "watchdog",
    }
}
