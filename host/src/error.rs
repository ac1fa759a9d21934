//! What can go wrong between the command line and the result, and the exit code that says so.
//!
//! | code | meaning |
//! |---|---|
//! | 0 | done |
//! | 1 | the input was bad: the message names file, line and field |
//! | 2 | the command line was wrong |
//! | 3 | the station refused, faulted or is in use, or a signal ended the run |

use std::error::Error;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::printable::{printable, printable_up_to};

/// Characters of a field's name and of a reason that are printed.
const LONGEST_FIELD: usize = 120;
const LONGEST_REASON: usize = 4_000;

/// A fault in a file the user gave: where it is and what is wrong there.
///
/// Reads `FILE:LINE: field `NAME`: reason`; line and field are left out where there is none (a file
/// that does not exist has no line).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputError {
    /// The file or folder at fault.
    pub file: PathBuf,
    /// Line in that file, counted from 1.
    pub line: Option<usize>,
    /// Column or key at fault, such as `x1` or `camera[1].focal_px[0]`.
    pub field: Option<String>,
    /// What is wrong, and what would be right.
    pub reason: String,
}

impl InputError {
    /// A fault of the file as a whole.
    pub fn file(file: &Path, reason: impl Into<String>) -> Self {
        Self {
            file: file.to_owned(),
            line: None,
            field: None,
            reason: reason.into(),
        }
    }

    /// A fault of one line, counted from 1.
    pub fn line(file: &Path, line: usize, reason: impl Into<String>) -> Self {
        Self {
            line: Some(line),
            ..Self::file(file, reason)
        }
    }

    /// A fault of one field in one line, counted from 1.
    pub fn field(
        file: &Path,
        line: usize,
        field: impl Into<String>,
        reason: impl Into<String>,
    ) -> Self {
        Self {
            field: Some(field.into()),
            ..Self::line(file, line, reason)
        }
    }

    /// The operating system would not let us read or write the file.
    pub fn io(file: &Path, action: &str, cause: &io::Error) -> Self {
        Self::file(file, format!("cannot {action}: {cause}"))
    }
}

/// Names of files and what is in them come from others: they are printed without control
/// characters, and not at any length.
impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&printable(self.file.display()))?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        f.write_str(": ")?;
        if let Some(field) = &self.field {
            write!(f, "field `{}`: ", printable_up_to(LONGEST_FIELD, field))?;
        }
        f.write_str(&printable_up_to(LONGEST_REASON, &self.reason))
    }
}

impl Error for InputError {}

/// Why a command did not end well.
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
    /// The options contradict each other.
    #[error("{0}")]
    Usage(String),
    /// The pictures show nothing that could be followed, or the report cannot be written.
    #[error("{0}")]
    Scene(String),
    /// The station refused or faulted.
    #[error("station: {0}")]
    Station(String),
    /// Standard output could not be written.
    #[error("standard output")]
    Output(#[from] io::Error),
}

impl Failure {
    /// The process's exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_) | Self::Refused { .. } | Self::Scene(_) | Self::Output(_) => 1,
            Self::Usage(_) => 2,
            Self::Station(_) => 3,
        }
    }

    /// The reader of standard output has seen enough (`trinocular ... | head -1`): no fault of
    /// anybody's.
    pub fn is_closed_output(&self) -> bool {
        matches!(self, Self::Output(cause) if cause.kind() == io::ErrorKind::BrokenPipe)
    }

    /// The message and all its causes, in one line.
    pub fn chain(&self) -> String {
        let mut text = self.to_string();
        let mut cause = self.source();
        while let Some(inner) = cause {
            text.push_str(": ");
            text.push_str(&inner.to_string());
            cause = inner.source();
        }
        printable_up_to(LONGEST_REASON, text.replace(['\n', '\r'], " "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_error_names_file_line_and_field() {
        let error = InputError::field(Path::new("points.csv"), 3, "x1", "`abc` is not a number");
        assert_eq!(
            error.to_string(),
            "points.csv:3: field `x1`: `abc` is not a number"
        );
        let error = InputError::file(Path::new("views"), "no such folder");
        assert_eq!(error.to_string(), "views: no such folder");
    }

    #[test]
    fn foreign_text_in_an_error_is_printable() {
        let (file, key) = (Path::new("a\x1b[2J.csv"), "k\u{202e}".repeat(1000));
        let error = InputError::field(file, 3, key, "`\u{7}` is not a number\nerror: forged");
        let text = error.to_string();
        assert!(
            text.starts_with(r"a\u{1b}[2J.csv:3: field `k\u{202e}k"),
            "{text}"
        );
        assert!(
            text.ends_with(r"`\u{7}` is not a number\nerror: forged"),
            "{text}"
        );
        assert!(text.len() < 1000, "{text}");
    }

    #[test]
    fn a_chain_is_one_line() {
        let failure = Failure::from(io::Error::other("two\nlines"));
        assert_eq!(failure.chain(), "standard output: two lines");
    }

    #[test]
    fn exit_codes_are_the_documented_ones() {
        let input = InputError::file(Path::new("a"), "b");
        assert_eq!(Failure::from(input).exit_code(), 1);
        assert_eq!(Failure::Usage(String::new()).exit_code(), 2);
        assert_eq!(Failure::Station(String::new()).exit_code(), 3);
    }
}
