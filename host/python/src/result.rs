//! Results of measurements as dictionaries, which the Python half wraps.

use numpy::PyArray1;
use numpy::prelude::*;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use trinocular_core::estimate::pose::Observation;
use trinocular_core::rig::Rig;
use trinocular_core::sums::centred::Geometry;
use trinocular_vision::estimation::Solution;
use trinocular_vision::flow::Correspondence;

/// A measurement, or the reason why there is none.
#[derive(Default)]
pub struct Outcome {
    /// Solution and number of rejected points, or the refusal in words.
    pub solution: Option<Result<(Solution, usize), String>>,
    /// Points that were used.
    pub points: Vec<Correspondence>,
    /// Cameras of each point, as indices into the rig's cameras.
    pub cameras: Vec<usize>,
    /// Warnings, in sentences.
    pub warnings: Vec<String>,
}

impl Outcome {
    /// Creates the outcome of a refusal.
    pub fn refused(reason: String) -> Self {
        Self {
            solution: Some(Err(reason)),
            ..Self::default()
        }
    }

    /// Converts the outcome for Python. `whole` is the rig of all cameras.
    ///
    /// # Errors
    /// Those of Python, such as a lack of memory.
    pub fn to_dict<'py>(&self, py: Python<'py>, whole: &Rig) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        dict.set_item("warnings", &self.warnings)?;
        match &self.solution {
            Some(Ok((solution, rejected))) => {
                let turn = solution.turn.unwrap_or_default();
                dict.set_item("displacement_mm", solution.displacement_mm)?;
                dict.set_item("sigma_mm", solution.sigma_mm)?;
                dict.set_item("covariance_mm2", solution.covariance_mm2)?;
                dict.set_item("rotation_deg", turn.rotation_deg)?;
                dict.set_item("rotation_sigma_deg", turn.rotation_sigma_deg)?;
                dict.set_item("pivot_mm", turn.pivot_mm)?;
                dict.set_item("used", solution.points)?;
                dict.set_item("rejected", rejected)?;
            }
            Some(Err(reason)) => dict.set_item("refused", reason)?,
            None => {}
        }
        let cameras = whole.cameras.len();
        let (mut pixels, mut places) = (Vec::new(), Vec::new());
        let geometry = geometry(whole, &self.cameras);
        for point in &self.points {
            let mut row = vec![[[f64::NAN; 2]; 2]; cameras];
            for (camera, seen) in self.cameras.iter().zip(&point.pixels) {
                row[*camera] = *seen;
            }
            pixels.extend(row.into_iter().flatten().flatten());
            places.extend(place_mm(geometry.as_ref(), point));
        }
        let count = self.points.len();
        let pixels = PyArray1::from_vec(py, pixels).reshape([count, cameras, 2, 2])?;
        let places = PyArray1::from_vec(py, places).reshape([count, 3])?;
        dict.set_item("pixels", pixels)?;
        dict.set_item("places_mm", places)?;
        Ok(dict)
    }
}

/// Returns the geometry of the active cameras, with their centre, mm.
fn geometry(whole: &Rig, cameras: &[usize]) -> Option<Geometry> {
    let all = cameras
        .iter()
        .filter_map(|k| whole.cameras.get(*k).cloned());
    let active = Rig {
        image_size_px: whole.image_size_px,
        cameras: all.collect(),
    };
    Geometry::new(&active).ok()
}

/// Returns the place of a point at the keyframe in the rig's axes, mm; NaN if its rays do not meet.
fn place_mm(geometry: Option<&Geometry>, point: &Correspondence) -> [f64; 3] {
    let found = geometry.and_then(|geometry| {
        let [alpha, beta, rho] = Observation::new(geometry, &point.views)?.start;
        let [cx, cy] = geometry.centre_mm();
        let z = 1.0 / rho;
        Some([alpha * z + cx, beta * z + cy, z])
    });
    found.unwrap_or([f64::NAN; 3])
}
