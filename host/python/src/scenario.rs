//! Simulated runs, and rendered frame sets.

use crate::errors::value;
use crate::interruption::interruptible;
use crate::recording::arrays;
use crate::rig::Rig;
use numpy::PyArray1;
use numpy::prelude::*;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};
use trinocular::scenario::figures::Figures;
use trinocular::scenario::file::Scenario;
use trinocular::scenario::run::{self, ScenarioOptions};
use trinocular::scenario::trace::{Sample, Trace};
use trinocular::servo::ServoError;
use trinocular_client::diagnosis;
use trinocular_rig::error::InputError;
use trinocular_vision::images::{self, SceneSettings, Texture};

/// Trace, figures and missed expectations of a scenario.
struct Simulated {
    trace: Trace,
    figures: Figures,
    without: Option<Figures>,
    missed: Vec<String>,
}

fn simulated(
    scenario: &Scenario,
    prediction: bool,
    progress: &mut dyn FnMut(f64),
) -> Result<Simulated, ServoError> {
    let mut run = |prediction| -> Result<Trace, ServoError> {
        let options = ScenarioOptions {
            prediction,
            ..ScenarioOptions::default()
        };
        let run = run::run_recorded(scenario, options, None, Vec::new(), &mut *progress)?;
        Ok(run.trace)
    };
    let trace = run(prediction)?;
    let figures = Figures::of(scenario, &trace);
    let is_compared = prediction && scenario.expect.prediction_gain.is_some();
    let without = match is_compared {
        true => Some(Figures::of(scenario, &run(false)?)),
        false => None,
    };
    let missed = match prediction {
        true => scenario.missed(&trace, &figures, without.as_ref()),
        false => Vec::new(),
    };
    Ok(Simulated {
        trace,
        figures,
        without,
        missed,
    })
}

/// Runs a scenario: the text of a file, or its path.
#[pyfunction]
pub fn simulate(
    py: Python<'_>,
    text: Option<&str>,
    path: Option<PathBuf>,
    points: bool,
    prediction: bool,
) -> PyResult<Py<PyDict>> {
    let read = match (text, &path) {
        (Some(json), _) => {
            let object: serde_json::Value = serde_json::from_str(json).map_err(value)?;
            let text = toml::to_string(&object).map_err(value)?;
            Scenario::parse(Path::new("scenario"), &text).map_err(|error| InputError {
                // Lines are those of a text that the caller has not seen.
                line: None,
                ..error
            })
        }
        (None, Some(path)) => Scenario::read(path),
        (None, None) => return Err(value("a scenario is a dict or a path")),
    };
    let scenario = read.map_err(value)?;
    let scenario = match points {
        true => scenario.with_points(),
        false => scenario,
    };
    let Simulated {
        trace,
        figures,
        without,
        missed,
    } = interruptible(py, |progress| simulated(&scenario, prediction, progress))?.map_err(value)?;
    let json = |figures: &Figures| serde_json::to_string(figures).map_err(value);
    let dict = PyDict::new(py);
    let vectors = |of: fn(&Sample) -> [f64; 3]| {
        let flat: Vec<f64> = trace.samples.iter().flat_map(of).collect();
        PyArray1::from_vec(py, flat).reshape([trace.samples.len(), 3])
    };
    let times = trace.samples.iter().map(|sample| sample.time_s).collect();
    dict.set_item("time_s", PyArray1::from_vec(py, times))?;
    dict.set_item("target_mm", vectors(|sample| sample.target_mm)?)?;
    dict.set_item("camera_mm", vectors(|sample| sample.camera_mm)?)?;
    let states = trace.samples.iter();
    let states: Vec<&str> = states
        .map(|sample| diagnosis::state(sample.state).name)
        .collect();
    dict.set_item("states", states)?;
    dict.set_item("figures", json(&figures)?)?;
    dict.set_item(
        "without_prediction",
        without.as_ref().map(json).transpose()?,
    )?;
    dict.set_item("missed", missed)?;
    Ok(dict.unbind())
}

/// Native renderer of a poster.
#[pyclass(frozen, module = "trinocular._trinocular")]
pub struct Scene {
    scene: images::Scene,
}

#[pymethods]
impl Scene {
    #[new]
    fn new(py: Python<'_>, rig: &Rig, seed: u64, depth_mm: f64, noise_grey: f64) -> PyResult<Self> {
        let settings = SceneSettings {
            depth_mm,
            noise_grey,
            ..SceneSettings::default()
        };
        let rig = &rig.file.rig;
        let scene = py.detach(|| images::Scene::new(rig, &Texture::natural(seed), settings));
        Ok(Self {
            scene: scene.map_err(value)?,
        })
    }

    /// Renders the poster at a displacement, mm.
    fn render<'py>(
        &self,
        py: Python<'py>,
        displacement_mm: [f64; 3],
        seed: u64,
    ) -> PyResult<Vec<Option<Bound<'py, PyAny>>>> {
        let rendered = py.detach(|| self.scene.render(displacement_mm, 0, seed));
        arrays(py, rendered.images)
    }
}
