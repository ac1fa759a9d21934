//! INI file of ROS's camera calibration (`ost.ini`, `ost.txt`): one camera's values, each name on a
//! line of its own and its numbers below it.
//!
//! ```text
//! [image]
//! width
//! 640
//! height
//! 480
//! [narrow_stereo/left]
//! camera matrix
//! 533.0 0.0 320.0
//! ...
//! ```

use std::path::Path;

use super::yaml::{Document, Entry};
use trinocular_rig::error::InputError;

/// Names in the file, names of the values, rows and columns. A single value has neither, a list no
/// columns.
const NAMES: [(&str, &str, [&str; 2]); 6] = [
    ("width", "image_width", ["", ""]),
    ("height", "image_height", ["", ""]),
    ("camera matrix", "camera_matrix", ["3", "3"]),
    ("distortion", "distortion_coefficients", ["1", ""]),
    ("rectification", "rectification_matrix", ["3", "3"]),
    ("projection", "projection_matrix", ["3", "4"]),
];

/// Returns true if the text is an INI file of ROS.
pub(super) fn is_ini(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim);
    lines.any(|line| line == "[image]" || line == "# oST version 5.0 parameters")
}

/// Reads the values.
///
/// # Errors
/// [`InputError`] if the file holds more than one camera.
pub(super) fn parse<'a>(file: &'a Path, text: &'a str) -> Result<Document<'a>, InputError> {
    type Found<'a> = (&'a str, usize, [&'a str; 2], Vec<(usize, &'a str)>);
    let mut found: Vec<Found<'a>> = Vec::new();
    let mut camera = None;
    let mut is_known = false;
    for (line, number) in text.lines().map(str::trim).zip(1..) {
        if let Some(section) = line.strip_prefix('[') {
            is_known = false;
            if section != "image]" && camera.replace(section).is_some() {
                let reason = "a second camera; write each camera's section into its own file, each \
                              with [image]";
                return Err(InputError::line(file, number, reason));
            }
        } else if let Some((_, name, size)) = NAMES.iter().find(|(known, ..)| *known == line) {
            found.push((name, number, *size, Vec::new()));
            is_known = true;
        } else if line.starts_with(|c: char| c.is_ascii_alphabetic()) {
            is_known = false;
        } else if let (true, Some((.., numbers))) = (is_known, found.last_mut())
            && !line.starts_with('#')
        {
            let more = line.split_ascii_whitespace();
            numbers.extend(more.map(|value| (number, value)));
        }
    }
    let entry = |(name, line, [rows, cols], data): Found<'a>| {
        let single = data.first().map_or("", |(_, value)| *value);
        let entry = match rows {
            "" => Entry::Scalar(single),
            _ if cols.is_empty() => Entry::List(data),
            rows => Entry::Matrix { rows, cols, data },
        };
        (name, line, entry)
    };
    let entries = found.into_iter().map(entry).collect();
    Ok(Document::of_entries(file, entries))
}
