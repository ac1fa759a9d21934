//! The pose of a target that does not turn, from the points of its displacement.
//!
//! Most targets do not turn most of the time. Then the windows of the keyframe are found as they
//! were, and the points that agree on a displacement determine the rotation, too: none, with its
//! standard deviation. No window has to be drawn anew.

use super::PoseMeasurement;
use super::errors::Errors;
use super::offered::is_significant;
use crate::flow::active_cameras::ActiveCameras;
use crate::flow::rigidity::Rigidity;
use crate::flow::variance_inflation::VarianceInflation;
use crate::flow::{FilteredFrameSet, Flow, FlowRefusal, Measurement, RejectedPoint};
use crate::matching::Reject;
use trinocular_core::estimate::pose::{self, Observation};

/// Least share of the points in view that must agree.
const LEAST_SHARE: f64 = 0.8;

impl Flow {
    /// Measures the displacement of a target that may not have turned.
    pub(super) fn displacement_if_still(
        &self,
        now: &FilteredFrameSet,
    ) -> Option<Result<Measurement, FlowRefusal>> {
        let may_be_still = self.last_pose.is_none_or(|last| last.is_still());
        may_be_still.then(|| self.measure_filtered(now, &mut ()))
    }

    /// Returns the pose of a target whose rotation is not more than noise, from the points of its
    /// displacement; `None` if it turns.
    pub(super) fn still_pose(&self, seen: &Measurement) -> Option<PoseMeasurement> {
        // Windows that turn decide where many points disagree.
        let in_view = |point: &&RejectedPoint| point.reason != Reject::OutOfView;
        let lost = seen.rejected_points.iter().filter(in_view).count();
        let inliers = &seen.correspondences;
        if (inliers.len() as f64) < LEAST_SHARE * (inliers.len() + lost) as f64 {
            return None;
        }
        let active = ActiveCameras::of(&self.geometry.rig, |k| seen.cameras.contains(&k))?;
        let geometry = &active.geometry;
        let observed = (inliers.iter()).filter_map(|p| Observation::new(&geometry.arms, &p.views));
        let pose = pose::solve(&geometry.arms, &observed.collect::<Vec<_>>()).ok()?;
        let errors = Errors::of(geometry, inliers, &pose);
        let rigidity = Rigidity::of_still(geometry, inliers, errors.inflation.of_windows);
        if rigidity.is_broken() {
            return None;
        }
        let of_halves = rigidity.variance_inflation();
        let factor = errors.factor(geometry, inliers, &pose, of_halves);
        let pose = pose.inflated(factor);
        (!is_significant(&pose)).then_some(PoseMeasurement {
            pose,
            correspondences: inliers.clone(),
            cameras: seen.cameras.clone(),
            refused_cameras: seen.refused_cameras.clone(),
            rejected: seen.rejected,
            rejected_points: seen.rejected_points.clone(),
            variance_inflation: VarianceInflation {
                factor,
                ..errors.inflation
            },
        })
    }
}
