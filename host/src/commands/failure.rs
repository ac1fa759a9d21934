//! Failures of commands, and their exit codes.
//!
//! | code | meaning |
//! |---|---|
//! | 0 | done |
//! | 1 | the input was bad: the message names file, line and field; or nothing could be measured |
//! | 2 | the command line was wrong |
//! | 3 | the station refused, faulted or is in use, or a signal ended a run that moves a stage |
//! | 130, 143 | SIGINT (Ctrl-C), SIGTERM ended the run; any other signal: 128 and its number |

use std::error::Error;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use trinocular::servo::ServoError;
use trinocular_client::StationError;
use trinocular_live::LiveError;
use trinocular_rig::error::InputError;
use trinocular_rig::printable::{printable, printable_up_to};

/// Characters of a message that are printed.
const LONGEST_MESSAGE: usize = 4_000;

/// Reason why a command did not end well.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// A file or folder was bad.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The input was read, but some of its frames allow no estimate; each has been reported where
    /// it stood.
    #[error("{}: {refused} of {frames} frames refused", printable(.file.display()))]
    Refused {
        /// The file or folder the frames came from.
        file: PathBuf,
        /// Frames without an estimate.
        refused: usize,
        /// All frames.
        frames: usize,
    },
    /// The command line was wrong.
    #[error("{0}")]
    Usage(String),
    /// The images show nothing that can be measured.
    #[error("{0}")]
    Images(String),
    /// An estimator refused its numbers.
    #[error(transparent)]
    Estimate(#[from] trinocular_core::estimate::Refusal),
    /// A study found claims of the documentation that do not hold.
    #[error("claims that do not hold: {}", .0.join("; "))]
    Claims(Vec<String>),
    /// The live page cannot be served.
    #[error(transparent)]
    Page(LiveError),
    /// The system does not let the program watch for signals.
    #[error("{0}")]
    Signals(io::Error),
    /// A signal of this number ended a run that reads on until a signal comes.
    #[error("ended by signal {0}")]
    Interrupted(i32),
    /// The station refused or faulted.
    #[error("station: {0}")]
    Station(StationFailure),
    /// A stop was not confirmed, for this reason.
    #[error(
        "{}; the stop is not confirmed: if the stage moves, press the emergency stop or the board's \
         button",
        .0.chain()
    )]
    Unstopped(Box<Failure>),
    /// Standard output could not be written.
    #[error("standard output")]
    Output(#[from] io::Error),
}

impl Failure {
    /// Returns the exit code of the process.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_)
            | Self::Refused { .. }
            | Self::Images(_)
            | Self::Estimate(_)
            | Self::Claims(_)
            | Self::Page(_)
            | Self::Signals(_)
            | Self::Output(_) => 1,
            Self::Usage(_) => 2,
            // As shells report a program that a signal has ended.
            Self::Interrupted(signal) => 128_u8.saturating_add((*signal).try_into().unwrap_or(127)),
            Self::Station(_) => 3,
            Self::Unstopped(failure) => failure.exit_code(),
        }
    }

    /// Makes the failure of a station on `port`, or of the twin. A port that cannot be used is bad
    /// input; any other error is a failure of the station.
    pub fn of_station(port: Option<&str>, error: StationError) -> Self {
        match error {
            StationError::Port { path, reason } => {
                InputError::file(Path::new(&path), reason).into()
            }
            error => Self::Station(StationFailure {
                port: port.map(str::to_owned),
                reason: StationReason::Error(Box::new(error)),
                next: None,
            }),
        }
    }

    /// Makes the failure of a live page. An address that needs another option is a wrong command
    /// line.
    pub fn of_page(error: LiveError) -> Self {
        match error {
            LiveError::Open(_) | LiveError::Reachable(_) => Self::Usage(error.to_string()),
            error => Self::Page(error),
        }
    }

    /// Makes the failure of a closed loop: a bad scene is the user's fault, a station has its port.
    pub fn of_servo(port: Option<&str>, error: ServoError) -> Self {
        match error {
            ServoError::Scene(scene) => Self::Usage(super::scene::reason(&scene)),
            ServoError::Station(station) => Self::of_station(port, station),
            ServoError::Images(error) => error.into(),
            ServoError::Reference(refusal) => Self::Images(refusal.to_string()),
        }
    }

    /// Returns true if the reader of standard output has closed it (`trinocular ... | head -1`),
    /// which is no failure.
    pub fn is_closed_output(&self) -> bool {
        matches!(self, Self::Output(cause) if cause.kind() == io::ErrorKind::BrokenPipe)
    }

    /// Returns the message and all its causes, in one line.
    pub fn chain(&self) -> String {
        let mut text = self.to_string();
        let mut cause = self.source();
        while let Some(inner) = cause {
            text.push_str(": ");
            text.push_str(&inner.to_string());
            cause = inner.source();
        }
        printable_up_to(LONGEST_MESSAGE, text.replace(['\n', '\r'], " "))
    }
}

/// A station that refused, faulted or cannot be reached.
#[derive(Debug)]
pub struct StationFailure {
    /// The serial port; `None` for the twin.
    port: Option<String>,
    reason: StationReason,
    /// Next action of the operator.
    next: Option<String>,
}

#[derive(Debug)]
enum StationReason {
    Error(Box<StationError>),
    Text(String),
}

impl StationFailure {
    /// Adds the operator's next action, if there is one.
    #[must_use]
    pub fn with_next(self, next: Option<&str>) -> Self {
        Self {
            next: next.map(str::to_owned),
            ..self
        }
    }
}

impl From<StationFailure> for Failure {
    fn from(failure: StationFailure) -> Self {
        Self::Station(failure)
    }
}

impl From<String> for StationFailure {
    fn from(text: String) -> Self {
        Self {
            port: None,
            reason: StationReason::Text(text),
            next: None,
        }
    }
}

/// Names the port unless the error does so itself.
impl fmt::Display for StationFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.port, &self.reason) {
            (Some(port), StationReason::Error(error)) if error.port().is_none() => {
                write!(f, "{port}: {error}")?;
            }
            (_, StationReason::Error(error)) => write!(f, "{error}")?,
            (_, StationReason::Text(text)) => f.write_str(text)?,
        }
        match &self.next {
            Some(next) => write!(f, "; {next}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_core::estimate::Refusal;

    #[test]
    fn chain_is_one_line() {
        let failure = Failure::from(io::Error::other("two\nlines"));
        assert_eq!(failure.chain(), "standard output: two lines");
    }

    #[test]
    fn exit_codes_match_documentation() {
        let input = InputError::file(Path::new("a"), "b");
        assert_eq!(Failure::from(input).exit_code(), 1);
        assert_eq!(Failure::from(Refusal::TooFewPoints).exit_code(), 1);
        assert_eq!(Failure::Usage(String::new()).exit_code(), 2);
        assert_eq!(Failure::Interrupted(2).exit_code(), 130);
        assert_eq!(Failure::Interrupted(15).exit_code(), 143);
        let refused = StationFailure::from("it is in motion".to_owned());
        assert_eq!(Failure::from(refused).exit_code(), 3);
        let port = StationError::Port {
            path: "/dev/null".to_owned(),
            reason: "is no serial port".to_owned(),
        };
        assert_eq!(Failure::of_station(None, port).exit_code(), 1);
    }

    #[test]
    fn station_failure_names_port_once() {
        let at = |error| Failure::of_station(Some("/dev/ttyACM0"), error).chain();
        let silent = StationError::Silent {
            command: "hello",
            waited_ms: 100,
        };
        assert!(at(silent).starts_with("station: /dev/ttyACM0: the station did not answer hello"));
        let busy = StationError::Busy {
            path: "/dev/ttyACM0".to_owned(),
            holder: None,
        };
        assert!(at(busy).starts_with("station: /dev/ttyACM0: cannot open"));
    }
}
