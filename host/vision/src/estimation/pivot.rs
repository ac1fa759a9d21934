//! The pivot of matched points: its place at the reference instant.

use crate::flow::Correspondence;
use crate::spot::{self, NoSpot};
use trinocular_core::estimate::pose::{Estimate, Observation};
use trinocular_core::rig::Rig;
use trinocular_core::sums::centred::Geometry;
use trinocular_rig::pivot::Pivot;

/// Returns the place of the pivot of points whose pose is known, in the rig's axes, mm.
///
/// # Errors
/// [`NoSpot`] for a laser whose ray meets no point of the target.
pub(super) fn place_mm(
    pivot: Pivot,
    pose: &Estimate,
    rig: &Rig,
    points: &[Correspondence],
) -> Result<[f64; 3], NoSpot> {
    let laser = match pivot {
        Pivot::Centroid => return Ok(pose.centroid_mm),
        Pivot::Place(place_mm) => return Ok(place_mm),
        Pivot::Spot(laser) => laser,
    };
    let geometry = Geometry::new(rig).map_err(|_| NoSpot { beside_mm: None })?;
    let observed = points.iter();
    let observed = observed.filter_map(|point| Observation::new(&geometry, &point.views));
    let starts: Vec<[f64; 3]> = observed.map(|observation| observation.start).collect();
    spot::meet(&starts, geometry.centre_mm(), &laser)
}
