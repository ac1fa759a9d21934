//! Messages for people on standard error. No other module writes there.
//!
//! Standard error may be closed, full, or a pipe without a reader. `eprintln!` then panics, and a
//! panic in mid-run ends a motion. This module drops a message that cannot be written; its content
//! is also in the exit code or in the next report.

use crate::printable::printable_up_to;
use std::fmt::Arguments;
use std::io::{self, Write as _};

/// Longest message, characters.
const LONGEST: usize = 4_000;

/// Writes one line to standard error. Takes what `eprintln!` takes, and never panics.
///
/// Control characters become escapes, so that no quoted text reaches the terminal raw.
#[macro_export]
macro_rules! notice {
    ($($message:tt)*) => {
        $crate::notice::write(format_args!($($message)*))
    };
}

/// Writes the message and a line feed to standard error; see [`notice!`](crate::notice!).
pub fn write(message: Arguments<'_>) {
    let mut line = printable_up_to(LONGEST, message);
    line.push('\n');
    // A failure cannot be reported elsewhere.
    let _ = io::stderr().write_all(line.as_bytes());
}
