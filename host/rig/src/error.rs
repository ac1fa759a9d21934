//! Errors in files that the user gave.

use std::error::Error;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::printable::{printable, printable_up_to};

/// Largest number of characters of a field's name and of a reason that are printed.
const LONGEST_FIELD: usize = 120;
const LONGEST_REASON: usize = 4_000;

/// Error in a file that the user gave, with its place and reason.
///
/// Formatted as `FILE:LINE: field `NAME`: reason`. Line and field are left out if there are none,
/// as for a file that does not exist.
///
/// ```
/// use std::path::Path;
/// use trinocular_rig::error::InputError;
///
/// let error = InputError::field(Path::new("rig.toml"), 12, "name", "must not be empty");
/// assert_eq!(error.to_string(), "rig.toml:12: field `name`: must not be empty");
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputError {
    /// File or folder with the error.
    pub file: PathBuf,
    /// Line in that file, counted from 1.
    pub line: Option<usize>,
    /// Column or key at fault, such as `x1` or `camera[1].focal_px[0]`.
    pub field: Option<String>,
    /// Reason: the error, and the values that are allowed.
    pub reason: String,
}

impl InputError {
    /// Creates an error of the file as a whole.
    pub fn file(file: &Path, reason: impl Into<String>) -> Self {
        Self {
            file: file.to_owned(),
            line: None,
            field: None,
            reason: reason.into(),
        }
    }

    /// Creates an error of one line, counted from 1.
    pub fn line(file: &Path, line: usize, reason: impl Into<String>) -> Self {
        Self {
            line: Some(line),
            ..Self::file(file, reason)
        }
    }

    /// Creates an error of one field in one line, counted from 1.
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

    /// Creates an error of the operating system on reading or writing the file.
    pub fn io(file: &Path, action: &str, cause: &io::Error) -> Self {
        Self::file(file, format!("cannot {action}: {cause}"))
    }
}

/// Formats the error without control characters and with limited length, because names of files and
/// their content are foreign text.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_names_file_line_and_field() {
        let error = InputError::field(Path::new("points.csv"), 3, "x1", "`abc` is not a number");
        assert_eq!(
            error.to_string(),
            "points.csv:3: field `x1`: `abc` is not a number"
        );
        let error = InputError::file(Path::new("views"), "no such folder");
        assert_eq!(error.to_string(), "views: no such folder");
    }

    #[test]
    fn foreign_text_is_printable() {
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
}
