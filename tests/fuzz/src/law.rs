//! Laws of every reader's errors.

use std::path::Path;
use trinocular_rig::error::InputError;

/// Checks that the error names one of `files`, in one printable line of bounded length.
///
/// # Panics
/// If it does not.
pub fn check_error(error: &InputError, files: &[&Path]) {
    assert!(files.contains(&error.file.as_path()), "{error:?}");
    check_message(&error.to_string());
}

/// Checks that the message is one printable line of bounded length.
///
/// # Panics
/// If it is not.
pub fn check_message(message: &str) {
    let turns = |c: char| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let is_bad = |c: char| c.is_control() || turns(c);
    assert!(!message.contains(is_bad), "{message:?}");
    assert!(message.len() < 20_000, "{} bytes", message.len());
}
