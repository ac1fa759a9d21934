//! Calibration from photographs of a chessboard.

use crate::errors::value;
use crate::interruption::interruptible;
use crate::pictures::picture;
use crate::rig::Rig;
use pyo3::prelude::*;
use std::path::PathBuf;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::calibration::board::Board;
use trinocular_vision::calibration::check::{doubt_square, obedient, refuse_same_camera};
use trinocular_vision::calibration::folder::{CalibrationSettings, calibrate_listed};
use trinocular_vision::calibration::photographs::list_paired;
use trinocular_vision::calibration::result_json::objects;
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::folder;
use trinocular_vision::images::series::pairing::Rule;

/// Reads the rule by which files are of one instant.
///
/// # Errors
/// `ValueError` with the choices.
pub fn rule(pair: Option<&str>) -> PyResult<Option<Rule>> {
    match pair {
        None => Ok(None),
        Some("name") => Ok(Some(Rule::Name)),
        Some("order") => Ok(Some(Rule::Order)),
        Some("time") => Ok(Some(Rule::Time)),
        Some(other) => Err(value(format!(
            "pair {other:?} is unknown; use \"name\", \"order\" or \"time\""
        ))),
    }
}

/// Calibrates from a folder; returns the rig, the objects of `--json` and the warnings.
#[pyfunction]
pub fn calibrate(
    py: Python<'_>,
    dir: PathBuf,
    corners: [usize; 2],
    square_mm: f64,
    outlier: f64,
    half_window: Option<usize>,
    pair: Option<&str>,
) -> PyResult<(Option<Rig>, String, Vec<String>)> {
    let pair = rule(pair)?;
    let settings = CalibrationSettings {
        half_window,
        outlier,
        ..CalibrationSettings::new(Board { corners, square_mm })
    };
    let calibrated = interruptible(py, |progress| {
        let photographs = list_paired(&dir, pair)?;
        let unread = photographs.warnings.iter().map(ToString::to_string);
        let mut warnings: Vec<String> = unread.collect();
        warnings.extend(doubt_square(square_mm));
        let result = calibrate_listed(&dir, &photographs, &settings, &mut |share| progress(share))?;
        refuse_same_camera(&dir, &result, square_mm)?;
        let rig = obedient(&dir, &result)?;
        let mut of_result = result.warnings();
        of_result.extend(rig.iter().flat_map(RigFile::doubts));
        let json = serde_json::Value::Array(objects(&result, &of_result));
        warnings.extend(of_result);
        Ok((rig.map(|file| Rig { file }), json.to_string(), warnings))
    })?;
    calibrated.map_err(|error: InputError| value(error))
}

/// Writes an image as number `index` of a camera into a folder, scaled to 8 bits by its own bits in
/// use, as `calibrate` does with files.
#[pyfunction]
pub fn save(
    py: Python<'_>,
    dir: PathBuf,
    camera: String,
    index: usize,
    image: Bound<'_, PyAny>,
) -> PyResult<()> {
    let picture = picture(&image)?;
    let written = py.detach(|| {
        let bits = picture.bits_in_use();
        let images = vec![picture.scaled(bits)];
        folder::save(&dir, &[camera], index, &FrameSet { time_us: 0, images })
    });
    written.map_err(value)
}
