//! The native half of the Python package `trinocular`.
//!
//! The Python half (`python/trinocular`) checks and converts arrays and wraps results in data
//! classes; this half calls the same library functions as the program, so that results are equal
//! to the last bit.
//!
//! | module | holds |
//! |---|---|
//! | [`rig`] | `Rig` |
//! | [`choice`] | method, rotation and pivot |
//! | [`flow`], [`pictures`], [`result`] | keyframe and measurements from arrays |
//! | [`points`] | estimates from matched points |
//! | [`recording`] | frame sets and tables of recordings and folders |
//! | [`calibration`] | calibration from photographs |
//! | [`scenario`] | simulated runs |
//! | [`station`], [`twin`] | the stage, and the simulated one |
//! | [`follow`] | the closed loop |
//! | [`interruption`] | Ctrl-C in long work |
//!
//! *Invariant:* work that takes longer than a millisecond releases the interpreter's lock, and work
//! that takes longer than a second looks for Ctrl-C.

mod calibration;
mod choice;
mod errors;
mod flow;
mod follow;
mod interruption;
mod pictures;
mod points;
mod recording;
mod result;
mod rig;
mod scenario;
mod station;
mod twin;

use pyo3::prelude::*;

/// Native half of the package `trinocular`.
#[pymodule]
fn _trinocular(module: &Bound<'_, PyModule>) -> PyResult<()> {
    // Python has handlers of its own: a second Ctrl-C must not end the interpreter.
    trinocular_rig::interruption::leave_to_caller();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add(
        "StationError",
        module.py().get_type::<errors::StationError>(),
    )?;
    module.add_class::<rig::Rig>()?;
    module.add_class::<flow::Flow>()?;
    module.add_class::<recording::Source>()?;
    module.add_class::<recording::FrameSets>()?;
    module.add_class::<scenario::Scene>()?;
    module.add_class::<station::Station>()?;
    module.add_class::<twin::Twin>()?;
    module.add_class::<follow::Follower>()?;
    module.add_function(wrap_pyfunction!(points::estimate, module)?)?;
    module.add_function(wrap_pyfunction!(points::estimate_file, module)?)?;
    module.add_function(wrap_pyfunction!(calibration::calibrate, module)?)?;
    module.add_function(wrap_pyfunction!(calibration::save, module)?)?;
    module.add_function(wrap_pyfunction!(scenario::simulate, module)?)?;
    Ok(())
}
