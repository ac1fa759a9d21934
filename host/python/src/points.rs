//! Estimates from matched points.

use crate::choice::{PyPivot, rule};
use crate::errors::value;
use crate::result::Outcome;
use crate::rig::Rig;
use numpy::PyReadonlyArray4;
use numpy::PyUntypedArrayMethods;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::{Rule, counted};
use trinocular_vision::points::{self, HEADER, Points};

fn outcome(points: Points, rig: &RigFile, rule: &Rule) -> Outcome {
    let mut warnings = points.warnings();
    let solution = rule.of_points(&rig.rig, &points, &mut warnings);
    let count = points.correspondences.len();
    Outcome {
        solution: Some(counted(solution, count, points.rejected)),
        points: points.correspondences,
        cameras: (0..rig.names.len()).collect(),
        warnings,
    }
}

/// Estimates the displacement of the points of a CSV file.
#[pyfunction]
pub fn estimate_file<'py>(
    py: Python<'py>,
    path: PathBuf,
    rig: &Rig,
    method: Option<&str>,
    rotation: Option<&str>,
    pivot_mm: Option<PyPivot>,
) -> PyResult<Bound<'py, PyDict>> {
    let rig = &rig.file;
    let rule = rule(rig, method, rotation, pivot_mm)?;
    let read = py.detach(|| -> Result<Outcome, InputError> {
        Ok(outcome(points::read(&path, rig)?, rig, &rule))
    });
    read.map_err(value)?.to_dict(py, &rig.rig)
}

/// Estimates the displacement of points (point, camera, instant, axis) of the rig's cameras.
///
/// The points take the way of a CSV file, so that one set of rules checks both.
#[pyfunction]
pub fn estimate<'py>(
    py: Python<'py>,
    pixels: PyReadonlyArray4<'py, f64>,
    rig: &Rig,
    method: Option<&str>,
    rotation: Option<&str>,
    pivot_mm: Option<PyPivot>,
) -> PyResult<Bound<'py, PyDict>> {
    let rig = &rig.file;
    let rule = rule(rig, method, rotation, pivot_mm)?;
    let cameras = pixels.shape()[1];
    let numbers = pixels.as_slice().map_err(value)?.to_vec();
    let read = py.detach(|| {
        let mut text = HEADER.join(",") + "\n";
        for (row, [x0, y0, x1, y1]) in numbers.as_chunks::<4>().0.iter().enumerate() {
            // A camera that has not seen the point.
            if [x0, y0, x1, y1].iter().all(|number| number.is_nan()) {
                continue;
            }
            let (point, name) = (row / cameras, &rig.names[row % cameras]);
            let _ = writeln!(text, "{point},{name},{x0:?},{y0:?},{x1:?},{y1:?}");
        }
        points::parse(Path::new("points"), text.as_bytes(), rig)
            .map(|points| outcome(points, rig, &rule))
    });
    read.map_err(value)?.to_dict(py, &rig.rig)
}
