//! Replaces numbers in the text of a rig file; all other text stays unchanged, comments included.

use std::path::Path;

use toml_edit::{Array, DocumentMut, Value};

use super::RigFile;
use crate::error::InputError;

/// Returns `text`, a rig file, after `change`. Errors name `file`.
///
/// # Errors
/// If `change` fails, the text is not TOML, or the result is not a valid rig file.
pub fn edited(
    file: &Path,
    text: &str,
    change: impl FnOnce(&mut DocumentMut) -> Result<(), InputError>,
) -> Result<String, InputError> {
    let mut document: DocumentMut = text.parse().map_err(|error: toml_edit::TomlError| {
        InputError::file(file, format!("not valid TOML: {}", error.message()))
    })?;
    change(&mut document)?;
    let text = document.to_string();
    // Refuses invalid values with their line.
    RigFile::parse(file, &text)?;
    Ok(text)
}

/// Rounds `number` to a multiple of `1/parts`. Adding zero turns -0 into 0.
pub fn rounded(number: f64, parts: f64) -> f64 {
    (number * parts).round() / parts + 0.0
}

/// Replaces the numbers of an array; each keeps the whitespace and comments of its predecessor.
pub fn replace(array: &mut Array, numbers: impl Iterator<Item = f64>) {
    for (old, number) in array.iter_mut().zip(numbers) {
        let around = old.decor().clone();
        *old = Value::from(number);
        *old.decor_mut() = around;
    }
}
