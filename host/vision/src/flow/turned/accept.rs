//! Acceptance of the points that agree on a pose.

use super::PoseMeasurement;
use super::consensus::RigidConsensus;
use crate::flow::accept::Tracking;
use crate::flow::active_cameras::ActiveCameras;
use crate::flow::consensus;
use crate::flow::rigidity::Rigidity;
use crate::flow::rigidity::parts::TwoParts;
use crate::flow::sync::{self, UnsynchronisedCamera};
use crate::flow::tracks::Tracks;
use crate::flow::variance_inflation::{VarianceInflation, with_common_error};
use crate::flow::{Correspondence, Flow, RejectedPoint};
use crate::matching::Reject;
use crate::matching::geometry::RigGeometry;
use trinocular_core::estimate::pose::{Estimate, Observation};

/// Number of unknowns of a pose.
const UNKNOWNS: f64 = 6.0;

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
        let inflation = inflation(geometry, &inliers, &found.model);
        // The pose takes its noise from the residuals, which contain what the cameras of a point
        // have in common.
        let factor = inflation.of_windows;
        let skewed = unsynchronised(geometry, &inliers, &found.model, inflation.factor);
        let unsynchronised = skewed.filter(UnsynchronisedCamera::is_unsynchronised);
        // An unsynchronised camera bends a target, so it is left out first.
        let rigidity = Rigidity::of(geometry, &inliers, found.model.first, factor);
        let parts = two_parts(geometry, &inliers, inflation.factor);
        let are_parts = parts.as_ref().is_some_and(TwoParts::are_certain);
        if unsynchronised.is_none() && (rigidity.is_broken() || are_parts) {
            return Tracking::refused(refused);
        }
        // Small skews and small differences stay in the measurement; sigma contains their bias.
        let bias = skewed.map_or(1.0, |s| s.variance_inflation);
        let apart = parts.map_or(1.0, |parts| parts.inflation_of_pose());
        let factor = factor * bias.max(rigidity.variance_inflation()).max(apart);
        let sigma_px = geometry.focal_px * found.model.sigma;
        let components = (2 * inliers.len() * geometry.cameras()) as f64;
        let factor = with_common_error(factor, sigma_px, components);
        let measurement = PoseMeasurement {
            pose: found.model.inflated(factor),
            correspondences: inliers,
            cameras: active.cameras.clone(),
            refused_cameras: Vec::new(),
            rejected,
            rejected_points,
            variance_inflation: VarianceInflation {
                factor,
                ..inflation
            },
        };
        Tracking {
            result: Ok(measurement),
            unsynchronised: unsynchronised.and_then(|camera| camera.in_rig(active)),
        }
    }
}

/// Compares the rotation with two displacements; `None` if the rotation is too large for that.
fn two_parts(geometry: &RigGeometry, inliers: &[Correspondence], factor: f64) -> Option<TwoParts> {
    let all: Vec<bool> = vec![true; inliers.len()];
    let displaced = consensus::solve(&geometry.rig, inliers, &all)?;
    let moved_mm = displaced.estimate.displacement_mm;
    Some(TwoParts::of(geometry, inliers, moved_mm, factor)).filter(TwoParts::are_linear)
}

/// Measures the variance inflation of the inliers.
pub(super) fn inflation(
    geometry: &RigGeometry,
    inliers: &[Correspondence],
    pose: &Estimate,
) -> VarianceInflation {
    VarianceInflation::of_residuals(geometry, inliers, UNKNOWNS, |inlier| {
        Some(residuals(geometry, pose, inlier)?.into_iter())
    })
}

/// Finds the camera with the largest significant excess of motion against the pose.
pub(super) fn unsynchronised(
    geometry: &RigGeometry,
    inliers: &[Correspondence],
    pose: &Estimate,
    factor: f64,
) -> Option<UnsynchronisedCamera> {
    let of_points = inliers
        .iter()
        .map(|inlier| residuals(geometry, pose, inlier));
    let of_points = of_points.collect::<Option<Vec<_>>>()?;
    // The points of a target that turns do not move alike.
    let flows: Vec<[f64; 2]> = inliers.iter().map(sync::mean_flow).collect();
    UnsynchronisedCamera::of_residuals(&of_points, &flows, factor, geometry)
}

/// Returns the residuals of a point against the pose in each camera, normalised.
fn residuals(
    geometry: &RigGeometry,
    pose: &Estimate,
    inlier: &Correspondence,
) -> Option<Vec<[f64; 2]>> {
    let observed = Observation::new(&geometry.arms, &inlier.views)?;
    let start = observed.start;
    let end = pose.moved(&geometry.arms, start)?;
    let arms = geometry.arms.arms_mm().iter().zip(&inlier.views);
    let residual = arms.map(|(arm, view)| {
        let flow = view.flow();
        [0, 1].map(|axis| {
            let place = |at: [f64; 3]| at[axis] - arm[axis] * at[2];
            flow[axis] - (place(end) - place(start))
        })
    });
    Some(residual.collect())
}
