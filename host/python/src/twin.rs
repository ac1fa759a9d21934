//! The built-in twin: the station's own code with a simulated stage, behind a pseudo-terminal.

use crate::errors::station;
use crate::rig::Rig;
use crate::station::stage_of;
use pyo3::prelude::*;
use trinocular_client::twin::TwinOnPort;

/// Native twin.
#[pyclass(frozen, module = "trinocular._trinocular")]
pub struct Twin {
    twin: TwinOnPort,
    steps_per_mm: [f64; 3],
    matrix: [[f64; 3]; 3],
}

#[pymethods]
impl Twin {
    #[new]
    fn new(rig: &Rig) -> PyResult<Self> {
        let stage = stage_of(rig)?;
        Ok(Self {
            twin: TwinOnPort::start(&stage).map_err(|error| station(&error))?,
            steps_per_mm: stage.steps_per_mm,
            matrix: stage.matrix,
        })
    }

    #[getter]
    fn path(&self) -> &str {
        self.twin.path()
    }

    /// Steps that the pins made since the start, backward ones subtracted.
    #[getter]
    fn steps(&self) -> [i64; 3] {
        self.twin.steps()
    }

    /// Matrix from the axes of the cameras to those of the stage.
    #[getter]
    fn matrix(&self) -> [[f64; 3]; 3] {
        self.matrix
    }

    /// Position of the stage, mm from where it stood at the start, by the edges at the pins, and
    /// how long ago it stood there, s.
    fn position(&self) -> ([f64; 3], f64) {
        let (steps, at) = self.twin.steps_at();
        let mm = [0, 1, 2].map(|axis| steps[axis] as f64 / self.steps_per_mm[axis]);
        (mm, at.elapsed().as_secs_f64())
    }
}
