//! New principal points in the user's own rig file: everything else stays as it stands there, comments included.

use std::path::Path;

use toml_edit::{Array, DocumentMut, Item, TableLike, Value};

use crate::error::InputError;
use crate::rig_file::RigFile;

/// Decimals of a principal point, px: far below what can be measured.
const DECIMALS: f64 = 1e4;

/// `text`, a rig file, with other principal points: name of the camera, px. `file` is what errors name.
///
/// # Errors
/// If the text is no rig file, or the result would be none.
pub fn with_principal_points(
    file: &Path,
    text: &str,
    points: &[(&str, [f64; 2])],
) -> Result<String, InputError> {
    let mut document: DocumentMut = text.parse().map_err(|error: toml_edit::TomlError| {
        InputError::file(file, format!("not valid TOML: {}", error.message()))
    })?;
    for (name, principal_px) in points {
        let rounded = principal_px.map(|p| (p * DECIMALS).round() / DECIMALS);
        let found = document
            .get_mut("camera")
            .and_then(|cameras| principal_of(cameras, name));
        let Some(array) = found else {
            return Err(InputError::file(
                file,
                format!("camera `{name}` has no principal_px"),
            ));
        };
        for (i, value) in rounded.into_iter().enumerate() {
            if let Some(old) = array.get_mut(i) {
                let around = old.decor().clone();
                *old = Value::from(value);
                *old.decor_mut() = around;
            }
        }
    }
    let text = document.to_string();
    // A principal point outside the image is refused here, with its line.
    RigFile::parse(file, &text)?;
    Ok(text)
}

/// The `principal_px` of a camera, whichever way the file writes its list of cameras.
fn principal_of<'a>(cameras: &'a mut Item, name: &str) -> Option<&'a mut Array> {
    let is_named = |table: &dyn TableLike| table.get("name").and_then(Item::as_str) == Some(name);
    match cameras {
        Item::ArrayOfTables(tables) => tables
            .iter_mut()
            .find(|table| is_named(*table))?
            .get_mut("principal_px")?
            .as_array_mut(),
        Item::Value(Value::Array(tables)) => tables
            .iter_mut()
            .filter_map(Value::as_inline_table_mut)
            .find(|table| is_named(*table))?
            .get_mut("principal_px")?
            .as_array_mut(),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: &str = "\
# our bench, spring
image_size_px = [320, 240]

[[camera]]
name = \"left\"   # the old one
focal_px = [533.16, 529.12]
principal_px = [154.43, 123]  # as calibrated
offset_mm = [-70.0, 0.0]

[[camera]]
offset_mm = [68.0, 0.0]
principal_px = [
    160.48, # x
    117.76,
]
focal_px = [534.55, 530.76]
name = \"right\"
";

    fn rewrite(text: &str, points: &[(&str, [f64; 2])]) -> Result<String, InputError> {
        with_principal_points(Path::new("rig.toml"), text, points)
    }

    #[test]
    fn only_the_principal_points_change() {
        let new = rewrite(
            RIG,
            &[("right", [158.412_34, 117.331]), ("left", [1.0, 2.5])],
        )
        .unwrap();
        let expected = RIG
            .replace("154.43, 123]", "1.0, 2.5]")
            .replace("160.48,", "158.4123,")
            .replace("117.76,", "117.331,");
        assert_eq!(new, expected);
    }

    #[test]
    fn cameras_in_braces_are_found_too() {
        let text = "\
image_size_px = [320, 240]
camera = [
    { name = \"a\", focal_px = [500, 500], principal_px = [160, 120], offset_mm = [0, 0] },
    { name = \"b\", focal_px = [500, 500], principal_px = [161, 121], offset_mm = [9, 0] }, # new
]
";
        let new = rewrite(text, &[("b", [159.5, 120.25])]).unwrap();
        assert_eq!(new, text.replace("[161, 121]", "[159.5, 120.25]"));
    }

    #[test]
    fn what_would_be_no_rig_file_is_refused() {
        let error = rewrite(RIG, &[("right", [400.0, 117.0])]).unwrap_err();
        assert!(error.to_string().contains("outside the image"), "{error}");
        assert_eq!(error.line, Some(13));
        assert!(rewrite(RIG, &[("middle", [160.0, 120.0])]).is_err());
        assert!(rewrite("[[camera", &[]).is_err());
    }
}
