//! Acceptance of the points that agree on a pose.

use super::PoseMeasurement;
use super::consensus::RigidConsensus;
use super::errors::Errors;
use crate::flow::accept::Tracking;
use crate::flow::active_cameras::ActiveCameras;
use crate::flow::rigidity::Rigidity;
use crate::flow::rigidity::parts::TwoParts;
use crate::flow::sync::UnsynchronisedCamera;
use crate::flow::tracks::Tracks;
use crate::flow::variance_inflation::VarianceInflation;
use crate::flow::{Flow, RejectedPoint};
use crate::matching::Reject;

impl Flow {
    /// Keeps the inliers of `tracks`, which must be most of the points in view and of one rigid
    /// target. Also finds a camera that is not synchronised. `rejected_points` were not found.
    pub(super) fn accept_pose(
        &self,
        active: &ActiveCameras,
        tracks: Tracks,
        found: &RigidConsensus,
        mut rejected_points: Vec<RejectedPoint>,
    ) -> Tracking<PoseMeasurement> {
        if let Err(refused) = self.agreed(&tracks, found) {
            return Tracking::refused(refused);
        }
        let geometry = &active.geometry;
        let mut rejected = tracks.rejected;
        for outlier in found.outliers_of(&tracks.points) {
            rejected.add(Reject::Outlier);
            rejected_points.push(RejectedPoint::outlier(outlier));
        }
        let refused = tracks.no_agreement(found.count() / 2, found.median_px);
        let inliers = found.inliers_of(tracks.points);

        // Variance inflation: correlated errors of overlapping windows.
        let errors = Errors::of(geometry, &inliers, &found.model);
        let unsynchronised = errors
            .skewed
            .filter(UnsynchronisedCamera::is_unsynchronised);
        // An unsynchronised camera bends a target, so it is left out first.
        let of_windows = errors.inflation.of_windows;
        let rigidity = Rigidity::of(geometry, &inliers, found.model.first, of_windows);
        let are_parts = (errors.parts.as_ref()).is_some_and(TwoParts::are_certain);
        if unsynchronised.is_none() && (rigidity.is_broken() || are_parts) {
            return Tracking::refused(refused);
        }
        let of_halves = rigidity.variance_inflation();
        let factor = errors.factor(geometry, &inliers, &found.model, of_halves);
        let measurement = PoseMeasurement {
            pose: found.model.inflated(factor),
            correspondences: inliers,
            cameras: active.cameras.clone(),
            refused_cameras: Vec::new(),
            rejected,
            rejected_points,
            variance_inflation: VarianceInflation {
                factor,
                ..errors.inflation
            },
        };
        Tracking {
            result: Ok(measurement),
            unsynchronised: unsynchronised.and_then(|camera| camera.in_rig(active)),
        }
    }
}
