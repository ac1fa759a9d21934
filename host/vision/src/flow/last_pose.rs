//! The last pose of a target that turns, from which the next search begins.

use super::Flow;
use super::offered::is_significant;
use crate::matching::geometry::RigGeometry;
use trinocular_core::estimate::pose::Estimate;

/// Least rotation of the last pose for which the search begins there, degrees.
const NEAR_DEG: f64 = 4.0;
/// Largest rotation of the last pose after which the target may still not turn, degrees.
const STILL_DEG: f64 = 0.3;

/// Displacement and rotation of the target since the keyframe, from which the next search begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LastPose {
    /// Rotation vector about the cameras' axes, degrees.
    pub rotation_deg: [f64; 3],
    /// A point of the target at the keyframe, mm.
    pub pivot_mm: [f64; 3],
    /// Displacement of this point, mm.
    pub displacement_mm: [f64; 3],
}

impl LastPose {
    pub(super) fn of(pose: &Estimate) -> Self {
        let pivot_mm = pose.centroid_mm;
        Self {
            // No search begins at what may be noise.
            rotation_deg: match is_significant(pose) {
                true => pose.rotation_deg(),
                false => [0.0; 3],
            },
            pivot_mm,
            displacement_mm: pose.displacement_of(pivot_mm).displacement_mm,
        }
    }

    /// Returns true if the target may not have turned since the keyframe.
    pub(super) fn is_still(&self) -> bool {
        self.squared_deg() < STILL_DEG * STILL_DEG
    }

    fn squared_deg(&self) -> f64 {
        self.rotation_deg.iter().map(|deg| deg * deg).sum()
    }

    /// Returns true if the search begins at this pose.
    pub(super) fn is_far(&self) -> bool {
        self.squared_deg() >= NEAR_DEG * NEAR_DEG
    }

    /// Returns the pose; `None` for half a turn about an axis across z.
    pub(super) fn pose(&self, geometry: &RigGeometry) -> Option<Estimate> {
        let radians = self.rotation_deg.map(f64::to_radians);
        Estimate::turned(&geometry.arms, radians, self.pivot_mm, self.displacement_mm)
    }
}

impl Flow {
    /// Returns the last pose that was measured against the keyframe.
    pub fn last_pose(&self) -> Option<LastPose> {
        match &self.reduced {
            Some(reduced) => reduced.last_pose(),
            None => self.last_pose,
        }
    }

    /// Lets the next search begin as if this pose had been measured last.
    pub fn set_last_pose(&mut self, last_pose: Option<LastPose>) {
        match &mut self.reduced {
            Some(reduced) => reduced.set_last_pose(last_pose),
            None => self.last_pose = last_pose,
        }
    }
}
