//! `Calib_Results.m` of the camera calibration toolbox for MATLAB (J.-Y. Bouguet): one camera.
//!
//! ```text
//! fc = [ 657.395 ; 657.763 ];                        focal lengths, px
//! cc = [ 302.984 ; 242.617 ];                        principal point, from the centre of a pixel
//! alpha_c = 0.000;                                   skew
//! kc = [ -0.256 ; 0.131 ; -0.0002 ; 0.00003 ; 0 ];   k1 k2 p1 p2 k3
//! nx = 640;
//! ny = 480;
//! ```

use std::path::Path;

use super::yaml::{Document, Entry};
use trinocular_rig::error::InputError;

/// Returns true if the text assigns the toolbox's values.
pub(super) fn is_matlab(text: &str) -> bool {
    ["fc", "cc", "kc"]
        .iter()
        .all(|name| value(text, name).is_some())
}

/// Reads the values.
///
/// # Errors
/// [`InputError`] if a value is missing or has another number of elements.
pub(super) fn parse<'a>(file: &'a Path, text: &'a str) -> Result<Document<'a>, InputError> {
    let known = |name: &'static str, count: Option<usize>| {
        let missing = || InputError::file(file, format!("the value {name} is missing"));
        let (line, elements) = value(text, name).ok_or_else(missing)?;
        match count {
            Some(count) if elements.len() != count => {
                let reason = format!("expected {count} numbers, found {}", elements.len());
                Err(InputError::field(file, line, name, reason))
            }
            _ => Ok((line, elements)),
        }
    };
    let (line, focal) = known("fc", Some(2))?;
    let (_, centre) = known("cc", Some(2))?;
    let (kc_line, coefficients) = known("kc", None)?;
    if let Some((line, skew)) = value(text, "alpha_c") {
        let is_zero = |number: &&str| number.parse::<f64>().is_ok_and(|skew| skew == 0.0);
        if !skew.iter().all(is_zero) {
            let reason = "must be 0: a lens model with skewed pixels is not read; calibrate without \
                          est_alpha";
            return Err(InputError::field(file, line, "alpha_c", reason));
        }
    }
    let matrix = [
        focal[0], "0", centre[0], "0", focal[1], centre[1], "0", "0", "1",
    ];
    let mut entries = vec![
        (
            "camera_matrix",
            line,
            Entry::Matrix {
                rows: "3",
                cols: "3",
                data: matrix.map(|number| (line, number)).to_vec(),
            },
        ),
        (
            "distortion_coefficients",
            kc_line,
            Entry::List(
                coefficients
                    .iter()
                    .map(|number| (kc_line, *number))
                    .collect(),
            ),
        ),
    ];
    for (name, key) in [("nx", "image_width"), ("ny", "image_height")] {
        let (line, side) = known(name, Some(1))?;
        entries.push((key, line, Entry::Scalar(side[0])));
    }
    Ok(Document::of_entries(file, entries))
}

/// Returns the line and the numbers of the assignment to `name`.
fn value<'a>(text: &'a str, name: &str) -> Option<(usize, Vec<&'a str>)> {
    let mut at = 0;
    for (line, content) in text
        .split_inclusive('\n')
        .zip(1..)
        .map(|(text, line)| (line, text))
    {
        let rest = content.trim_start().strip_prefix(name).map(str::trim_start);
        if rest.is_some_and(|rest| rest.starts_with('=')) {
            let (_, rest) = text[at..].split_once('=')?;
            let rest = rest.trim_start();
            let list = match rest.strip_prefix('[') {
                Some(list) => list.split(']').next()?,
                None => rest.split([';', '\n', '%']).next()?,
            };
            let numbers = list.split([';', ',', ' ', '\t', '\r', '\n']);
            return Some((line, numbers.filter(|number| !number.is_empty()).collect()));
        }
        at += content.len();
    }
    None
}
