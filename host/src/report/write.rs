//! A text as a file that is there in full or not at all.

use std::path::Path;

use super::Error;
use crate::output::{Output, Replace};

/// Writes `text` to the file at `path`, replacing whatever regular file is there
/// ([`output`](crate::output)).
///
/// # Errors
/// If the file cannot be written; then it is as it was.
pub fn write_atomically(path: &Path, text: &str) -> Result<(), Error> {
    Output::open(path, Replace::Anything)?.write(text)?;
    Ok(())
}
