//! Replaces numbers in the text of a rig file; all other text stays unchanged, comments included.

use std::path::Path;

use toml_edit::{Array, DocumentMut, Item, TableLike, Value};
use trinocular_core::rig::Rotation;

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
    let text = written_like(text, &document.to_string());
    // Refuses invalid values with their line.
    RigFile::parse(file, &text)?;
    Ok(text)
}

/// Returns `new` with the line ends of `old`, and with its byte order mark if it has one: TOML's
/// editor writes neither.
fn written_like(old: &str, new: &str) -> String {
    const MARK: char = '\u{feff}';
    let mut text = new.trim_start_matches(MARK).replace("\r\n", "\n");
    if old.contains("\r\n") {
        text = text.replace('\n', "\r\n");
    }
    match old.starts_with(MARK) {
        true => format!("{MARK}{text}"),
        false => text,
    }
}

/// Rounds `number` to a multiple of `1/parts`. Adding zero turns -0 into 0.
pub fn rounded(number: f64, parts: f64) -> f64 {
    (number * parts).round() / parts + 0.0
}

/// Replaces a value, which keeps the whitespace and comments around it.
pub fn put(old: &mut Value, new: impl Into<Value>) {
    let mut new = new.into();
    *new.decor_mut() = old.decor().clone();
    *old = new;
}

/// Replaces the numbers of an array; each keeps the whitespace and comments of its predecessor.
pub fn replace(array: &mut Array, numbers: impl Iterator<Item = f64>) {
    for (old, number) in array.iter_mut().zip(numbers) {
        put(old, number);
    }
}

/// Returns a camera's table, for either form of the list of cameras.
pub fn camera<'a>(document: &'a mut DocumentMut, name: &str) -> Option<&'a mut dyn TableLike> {
    let is_named = |table: &dyn TableLike| table.get("name").and_then(Item::as_str) == Some(name);
    match document.get_mut("camera")? {
        Item::ArrayOfTables(tables) => {
            let table = tables.iter_mut().find(|table| is_named(*table))?;
            Some(table)
        }
        Item::Value(Value::Array(tables)) => {
            let mut inline = tables.iter_mut().filter_map(Value::as_inline_table_mut);
            let table = inline.find(|table| is_named(*table))?;
            Some(table)
        }
        _ => None,
    }
}

/// Replaces the numbers of `key`, or appends them to the table.
pub fn write(table: &mut dyn TableLike, key: &str, numbers: impl ExactSizeIterator<Item = f64>) {
    let known = table.get_mut(key).and_then(Item::as_array_mut);
    let Some(array) = known.filter(|array| array.len() == numbers.len()) else {
        let array = numbers.collect::<Array>();
        table.insert(key, Item::Value(Value::Array(array)));
        return;
    };
    replace(array, numbers);
}

/// Writes cameras and image size of `rig` into `text`, a rig file with cameras of the same names.
/// Everything else stays, comments and the stage included. Errors name `file`.
///
/// ```
/// use std::path::Path;
/// use trinocular_rig::rig_file::RigFile;
/// use trinocular_rig::rig_file::edit::with_cameras;
///
/// let mut rig = RigFile::paper();
/// let text = format!("# our bench\n{}", rig.to_toml());
/// rig.rig.cameras[0].focal_px = [540.5, 541.5];
/// let text = with_cameras(Path::new("rig.toml"), &text, &rig)?;
/// assert!(text.starts_with("# our bench\n") && text.contains("540.5"));
/// # Ok::<(), trinocular_rig::error::InputError>(())
/// ```
///
/// # Errors
/// If the text is no rig file, or has other cameras.
pub fn with_cameras(file: &Path, text: &str, rig: &RigFile) -> Result<String, InputError> {
    let other = || InputError::file(file, "has other cameras");
    let sorted = |rig: &RigFile| {
        let mut names = rig.names.clone();
        names.sort_unstable();
        names
    };
    if sorted(&RigFile::parse(file, text)?) != sorted(rig) {
        return Err(other());
    }
    let new = edited(file, text, |document| {
        let size = document
            .get_mut("image_size_px")
            .and_then(Item::as_array_mut);
        let sides = size.into_iter().flat_map(Array::iter_mut);
        for (old, side) in sides.zip(rig.rig.image_size_px) {
            put(old, i64::from(side));
        }
        for (name, camera) in rig.names.iter().zip(&rig.rig.cameras) {
            let table = self::camera(document, name).ok_or_else(other)?;
            write(table, "focal_px", camera.focal_px.into_iter());
            write(table, "principal_px", camera.principal_px.into_iter());
            write(table, "offset_mm", camera.offset_mm.into_iter());
            if camera.coefficients() != [0.0; 5] || table.contains_key("distortion") {
                write(table, "distortion", camera.coefficients().into_iter());
            }
            if camera.rotation != Rotation::NONE || table.contains_key("rotation_deg") {
                write(table, "rotation_deg", camera.rotation.degrees().into_iter());
            }
        }
        Ok(())
    })?;
    Ok(new)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As editors on Windows write them.
    #[test]
    fn line_ends_and_byte_order_mark_stay() {
        let file = Path::new("rig.toml");
        let rig = RigFile::paper();
        for (mark, end) in [
            ("", "\n"),
            ("", "\r\n"),
            ("\u{feff}", "\r\n"),
            ("\u{feff}", "\n"),
        ] {
            let text = format!("{mark}# bench{end}{}", rig.to_toml().replace('\n', end));
            let written = with_cameras(file, &text, &rig).expect("the same cameras");
            assert_eq!(written, text);
        }
    }

    #[test]
    fn cameras_change_and_comments_stay() {
        let file = Path::new("rig.toml");
        let old = RigFile::paper();
        let text = old.to_toml();
        let text = format!("# bench 3\n{text}").replacen("focal_px", "# lens of May\nfocal_px", 1);
        let mut new = old.clone();
        new.rig.image_size_px = [640, 480];
        new.rig.cameras[1].focal_px = [900.25, 901.5];
        new.rig.cameras[2].distortion = [0.1, 0.0, 0.0, 0.0, 0.0];
        let written = with_cameras(file, &text, &new).expect("the same cameras");
        assert_eq!(RigFile::parse(file, &written).expect("a rig"), new);
        assert!(written.contains("# bench 3\n") && written.contains("# lens of May\n"));
        new.names[0] = "west".to_owned();
        assert!(with_cameras(file, &text, &new).is_err());
    }
}
