//! The fields `rotation` and `pivot`: whether and about which point a target may turn.

use std::fmt::Write as _;

use super::Laser;
use super::field::Field;
use crate::error::InputError;
use crate::pivot::{Pivot, PivotChoice, Rotation};

/// Largest coordinate of a pivot, mm.
const LIMIT_MM: f64 = 1e5;
/// Treatments of a target that turns.
const ROTATIONS: [&str; 2] = ["refuse", "estimate"];

/// Reads the treatment of a target that turns.
pub(super) fn rotation(root: &Field<'_>) -> Result<Option<Rotation>, InputError> {
    let Some(field) = root.optional("rotation")? else {
        return Ok(None);
    };
    match field.text()? {
        "refuse" => Ok(Some(Rotation::Refuse)),
        "estimate" => Ok(Some(Rotation::Estimate)),
        _ => Err(field.unknown("rotation", &ROTATIONS)),
    }
}

/// Reads the pivot, which a file that refuses rotations must not have.
pub(super) fn read(
    root: &Field<'_>,
    rotation: Option<Rotation>,
    laser: Option<Laser>,
) -> Result<Pivot, InputError> {
    let Some(field) = root.optional("pivot")? else {
        return Ok(Pivot::default());
    };
    let pivot = match field.text() {
        Ok("centroid") => PivotChoice::Centroid,
        Ok("spot") => PivotChoice::Spot,
        Ok(_) => return Err(field.unknown("pivot", &["centroid", "spot"])),
        Err(_) => PivotChoice::Place(field.each(|axis| axis.number(LIMIT_MM))?),
    };
    let pivot = pivot.in_rig(laser);
    let pivot = pivot.map_err(|no_laser| field.fault(no_laser.to_string()))?;
    if rotation != Some(Rotation::Refuse) {
        return Ok(pivot);
    }
    Err(field.fault(
        "without a rotation all points of the target move alike; leave out `rotation = \"refuse\"`",
    ))
}

/// Writes what is not the default.
pub(super) fn write_toml(rotation: Option<Rotation>, pivot: Pivot, text: &mut String) {
    match rotation {
        None => {}
        // Without a rotation there is no pivot.
        Some(Rotation::Refuse) => return text.push_str("rotation = \"refuse\"\n"),
        Some(Rotation::Estimate) => text.push_str("rotation = \"estimate\"\n"),
    }
    let _ = match pivot {
        Pivot::Centroid => Ok(()),
        Pivot::Place(place) => writeln!(text, "pivot = {place:?}"),
        Pivot::Spot(_) => writeln!(text, "pivot = \"spot\""),
    };
}
