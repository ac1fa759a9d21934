//! Errors of the library as exceptions of Python.

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use trinocular_client::diagnosis::remedy;

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
    StationError::new_err(words.replace("give --port PATH", "name its path"))
}
