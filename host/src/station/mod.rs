//! The station from the host's side: commands out, reports in, over any byte link.
//!
//! [`client`] speaks the protocol and does no input or output. [`twin`] is a station without hardware: the very code of the board on virtual
//! time, with a simulated stage at the step pins. [`serial`] is a station on a serial line, [`ports`] says which lines there are, [`clock`] keeps
//! the station's time, [`diagnosis`] says what its states and faults mean. [`tape`] records a twin's life for comparison. [`stage`] turns the rig file's stage into a configuration.

pub mod bound;
pub mod client;
pub mod clock;
pub mod diagnosis;
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
    #[error("the link to the station garbles: {0:?}")]
    Garbled(Rejects),
    /// The serial port cannot be used.
    #[error("{path}: {reason}")]
    Port {
        /// The port.
        path: String,
        /// What happened.
        reason: String,
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
