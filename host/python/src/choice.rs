//! Choice of the estimate: method, treatment of a target that turns, and pivot.

use crate::errors::value;
use pyo3::prelude::*;
use std::path::Path;
use trinocular_rig::pivot::PivotChoice;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::{Choice, Method, Rotation, Rule};

/// Pivot as Python gives it: "centroid", "spot", or x, y, z in mm.
#[derive(Clone, FromPyObject)]
pub enum PyPivot {
    Name(String),
    Place([f64; 3]),
}

fn method(name: &str) -> PyResult<Method> {
    let methods = [Method::Midpoint, Method::ClosedForm, Method::LeastSquares];
    let found = methods.into_iter().find(|method| method.name() == name);
    found.ok_or_else(|| {
        value(format!(
            "method {name:?} is unknown; use \"midpoint\", \"closed-form\" or \"least-squares\""
        ))
    })
}

fn treatment(name: &str) -> PyResult<Rotation> {
    match name {
        "refuse" => Ok(Rotation::Refuse),
        "estimate" => Ok(Rotation::Estimate),
        other => Err(value(format!(
            "rotation {other:?} is unknown; use \"refuse\" or \"estimate\""
        ))),
    }
}

fn chosen(pivot: PyPivot) -> PyResult<PivotChoice> {
    match pivot {
        PyPivot::Name(name) => name.parse().map_err(value),
        PyPivot::Place(mm) if mm.iter().all(|mm| mm.is_finite()) => Ok(PivotChoice::Place(mm)),
        PyPivot::Place(mm) => Err(value(format!(
            "pivot_mm {mm:?} must be three finite numbers"
        ))),
    }
}

/// Returns the rule of the estimate: what is not chosen is as the rig file says.
///
/// # Errors
/// `ValueError` for an unknown name, choices that contradict each other, and a rig that does not
/// suit the method.
pub fn rule(
    rig: &RigFile,
    chosen_method: Option<&str>,
    rotation: Option<&str>,
    pivot: Option<PyPivot>,
) -> PyResult<Rule> {
    let pivot = pivot.map(chosen).transpose()?;
    let pivot = pivot.map(|pivot| pivot.in_rig(rig.laser)).transpose();
    let choice = Choice {
        method: chosen_method.map(method).transpose()?,
        rotation: rotation.map(treatment).transpose()?,
        pivot: pivot.map_err(|no_laser| value(format!("--pivot spot: {no_laser}")))?,
    };
    let rule = choice.rule(rig).map_err(value)?;
    let method = rule.method.unwrap_or_default();
    method.check_rig(Path::new("rig"), rig).map_err(value)?;
    Ok(rule)
}
