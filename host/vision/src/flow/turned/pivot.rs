//! The pivot of a target in images: its place at the keyframe.

use crate::flow::{Flow, FlowRefusal};
use crate::matching::geometry::RigGeometry;
use crate::matching::stereo::StereoMatch;
use crate::spot;
use nalgebra::Vector3;
use trinocular_rig::pivot::Pivot;
use trinocular_rig::rig_file::Laser;

impl Flow {
    /// Returns the place of the pivot at the keyframe, in the rig's axes, mm. It stays the same
    /// while the keyframe does.
    ///
    /// # Errors
    /// [`FlowRefusal::NoKeyframe`], and [`FlowRefusal::NoSpot`] for a laser whose ray meets no
    /// point of the target.
    pub fn keyframe_pivot_mm(&self, pivot: Pivot) -> Result<[f64; 3], FlowRefusal> {
        self.check_keyframe()?;
        match pivot {
            Pivot::Centroid => self.keyframe_centroid_mm().ok_or(FlowRefusal::NoKeyframe),
            Pivot::Place(place_mm) => Ok(place_mm),
            Pivot::Spot(laser) => self.keyframe_spot_mm(&laser),
        }
    }

    /// Returns the mean of the keyframe's points in the rig's axes, mm. It stays the same while the
    /// keyframe does, whichever points are found later.
    pub fn keyframe_centroid_mm(&self) -> Option<[f64; 3]> {
        if let Some(reduced) = &self.reduced {
            return reduced.keyframe_centroid_mm();
        }
        let keyframe = self.keyframe.as_ref()?;
        Some(centroid_mm(&keyframe.active.geometry, &keyframe.matches))
    }

    fn keyframe_spot_mm(&self, laser: &Laser) -> Result<[f64; 3], FlowRefusal> {
        if let Some(reduced) = &self.reduced {
            return reduced.keyframe_spot_mm(laser);
        }
        let keyframe = self.keyframe.as_ref().ok_or(FlowRefusal::NoKeyframe)?;
        let point = |StereoMatch { ray, .. }: &StereoMatch| {
            let [alpha, beta] = ray.direction;
            [alpha, beta, ray.inverse_depth]
        };
        let points: Vec<[f64; 3]> = keyframe.matches.iter().map(point).collect();
        let centre_mm = keyframe.active.geometry.arms.centre_mm();
        spot::meet(&points, centre_mm, laser).map_err(FlowRefusal::NoSpot)
    }
}

/// Returns the mean of matched points in the rig's axes, mm.
pub(super) fn centroid_mm(geometry: &RigGeometry, matches: &[StereoMatch]) -> [f64; 3] {
    let [cx, cy] = geometry.arms.centre_mm();
    let place = |matched: &StereoMatch| {
        let z = 1.0 / matched.ray.inverse_depth;
        let [alpha, beta] = matched.ray.direction;
        Vector3::new(alpha * z + cx, beta * z + cy, z)
    };
    let sum: Vector3<f64> = matches.iter().map(place).sum();
    (sum / matches.len() as f64).into()
}

#[cfg(test)]
mod tests;
