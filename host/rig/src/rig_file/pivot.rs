//! The fields `rotation` and `pivot`: whether and about which point a target may turn.

use std::fmt::Write as _;

use super::Laser;
use super::field::Field;
use crate::error::InputError;
use crate::pivot::{Pivot, PivotChoice};

/// Largest coordinate of a pivot, mm.
const LIMIT_MM: f64 = 1e5;
/// Treatments of a target that turns.
const ROTATIONS: [&str; 2] = ["refuse", "estimate"];

/// Reads the pivot if the rotation of the target is estimated, as by default; `None` if it is
/// refused.
pub(super) fn read(root: &Field<'_>, laser: Option<Laser>) -> Result<Option<Pivot>, InputError> {
    let is_estimated = match root.optional("rotation")? {
        None => true,
        Some(field) => match field.text()? {
            "refuse" => false,
            "estimate" => true,
            _ => return Err(field.unknown("rotation", &ROTATIONS)),
        },
    };
    let Some(field) = root.optional("pivot")? else {
        return Ok(is_estimated.then(Pivot::default));
    };
    let pivot = match field.text() {
        Ok("centroid") => PivotChoice::Centroid,
        Ok("spot") => PivotChoice::Spot,
        Ok(_) => return Err(field.unknown("pivot", &["centroid", "spot"])),
        Err(_) => PivotChoice::Place(field.each(|axis| axis.number(LIMIT_MM))?),
    };
    let pivot = pivot.in_rig(laser);
    let pivot = pivot.map_err(|no_laser| field.fault(no_laser.to_string()))?;
    if is_estimated {
        return Ok(Some(pivot));
    }
    Err(field.fault(
        "without a rotation all points of the target move alike; leave out `rotation = \"refuse\"`",
    ))
}

/// Writes what is not the default.
pub(super) fn write_toml(pivot: Option<Pivot>, text: &mut String) {
    let _ = match pivot {
        None => writeln!(text, "rotation = \"refuse\""),
        Some(Pivot::Centroid) => Ok(()),
        Some(Pivot::Place(place)) => writeln!(text, "pivot = {place:?}"),
        Some(Pivot::Spot(_)) => writeln!(text, "pivot = \"spot\""),
    };
}
