//! Errors of the library as exceptions of Python.

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use trinocular_client::diagnosis::{self, remedy};
use trinocular_core::safety::State;

pyo3::create_exception!(
    _trinocular,
    StationError,
    PyRuntimeError,
    "The station refused, faulted, or does not answer; the text says what to do next."
);

/// Returns a `ValueError` with these words.
pub fn value(reason: impl ToString) -> PyErr {
    PyValueError::new_err(reason.to_string())
}

/// Returns a `StationError` with the cause and the operator's next action.
pub fn station(error: &trinocular_client::StationError) -> PyErr {
    let next = match error {
        trinocular_client::StationError::Denied { denial, .. } => remedy(*denial),
        _ => None,
    };
    let words = match next {
        Some(next) => format!("{error}; next: {next}"),
        None => error.to_string(),
    };
    let words = words.replace("give --port PATH", "name its path");
    StationError::new_err(words.replace("--rig RIG.toml", "rig=Rig.load(path)"))
}

/// Returns the `StationError` of a stage that another command has stopped.
pub fn stopped() -> PyErr {
    let next = diagnosis::state(State::Stopped).action;
    StationError::new_err(format!("stopped by another command; next: {next}"))
}
