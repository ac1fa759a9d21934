//! Other numbers in the text of a rig file: everything else stays as it stands there, comments
//! included.

use std::path::Path;

use toml_edit::{Array, DocumentMut, Value};

use super::RigFile;
use crate::error::InputError;

/// `text`, a rig file, after `change`. `file` is what errors name.
///
/// # Errors
/// That of `change`; or if the text is no TOML, or the result would be no rig file.
pub(crate) fn edited(
    file: &Path,
    text: &str,
    change: impl FnOnce(&mut DocumentMut) -> Result<(), InputError>,
) -> Result<String, InputError> {
    let mut document: DocumentMut = text.parse().map_err(|error: toml_edit::TomlError| {
        InputError::file(file, format!("not valid TOML: {}", error.message()))
    })?;
    change(&mut document)?;
    let text = document.to_string();
    // A value that no rig can have is refused here, with its line.
    RigFile::parse(file, &text)?;
    Ok(text)
}

/// Rounded, `parts` to the unit. Adding zero to what is left turns -0 into 0.
pub(crate) fn rounded(number: f64, parts: f64) -> f64 {
    (number * parts).round() / parts + 0.0
}

/// Numbers in the place of an array's, each with what stood around its predecessor.
pub(crate) fn replace(array: &mut Array, numbers: impl Iterator<Item = f64>) {
    for (old, number) in array.iter_mut().zip(numbers) {
        let around = old.decor().clone();
        *old = Value::from(number);
        *old.decor_mut() = around;
    }
}
