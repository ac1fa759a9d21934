//! Matched points with their pose, and the place of their pivot at the reference instant.

use crate::flow::Correspondence;
use crate::spot::{self, NoSpot};
use trinocular_core::estimate::pose::{self, Estimate, Observation};
use trinocular_core::rig::Rig;
use trinocular_core::sums::centred::Geometry;
use trinocular_rig::pivot::Pivot;

/// Matched points in front of the cameras, and their pose.
pub(super) struct PosedPoints {
    pub(super) pose: Estimate,
    pub(super) observed: Vec<Observation>,
    geometry: Geometry,
}

impl PosedPoints {
    /// Estimates the pose of the points that are in front of the cameras.
    pub(super) fn of(rig: &Rig, points: &[Correspondence]) -> Result<Self, pose::Refusal> {
        let geometry = Geometry::new(rig).map_err(|_| pose::Refusal::Degenerate)?;
        let observed = points.iter();
        let observed = observed.filter_map(|point| Observation::new(&geometry, &point.views));
        let observed: Vec<Observation> = observed.collect();
        Ok(Self {
            pose: pose::solve(&geometry, &observed)?,
            observed,
            geometry,
        })
    }

    /// Returns the place of the pivot in the rig's axes, mm.
    pub(super) fn place_mm(&self, pivot: Pivot) -> Result<[f64; 3], NoSpot> {
        match pivot {
            Pivot::Centroid => Ok(self.pose.centroid_mm),
            Pivot::Place(place_mm) => Ok(place_mm),
            Pivot::Spot(laser) => {
                let starts: Vec<[f64; 3]> = self.observed.iter().map(|o| o.start).collect();
                spot::meet(&starts, self.geometry.centre_mm(), &laser)
            }
        }
    }
}
