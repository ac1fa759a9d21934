//! Consensus of the points that move as one rigid target.

use crate::flow::Correspondence;
use crate::flow::consensus::Agreement;
use crate::flow::tracks::Tracks;
use crate::matching::geometry::RigGeometry;
use trinocular_core::estimate::pose::{self, Estimate, Observation};

/// Pose on which most points agree, and its inliers.
pub(super) type RigidConsensus = Agreement<Estimate>;

/// Finds the inliers of the tracks from the pose `start` on. Residuals up to `least_px` never make
/// an outlier.
pub(super) fn rigid_consensus(
    geometry: &RigGeometry,
    tracks: &Tracks,
    start: Estimate,
    least_px: f64,
) -> Option<RigidConsensus> {
    let observe = |point: &Correspondence| Observation::new(&geometry.arms, &point.views);
    let observed: Vec<Option<Observation>> = tracks.points.iter().map(observe).collect();
    let residuals_px = |pose: Option<&Estimate>| {
        let pose = pose.unwrap_or(&start);
        let residuals = observed.iter().map(|observed| {
            let residual = observed.map(|o| residual_px(geometry, pose, &o));
            residual
                .filter(|px| px.is_finite())
                .unwrap_or(f64::INFINITY)
        });
        residuals.collect()
    };
    let solve = |inliers: &[bool]| {
        let kept = observed.iter().zip(inliers);
        let kept = kept.filter_map(|(observed, is_inlier)| observed.filter(|_| *is_inlier));
        pose::solve(&geometry.arms, &kept.collect::<Vec<_>>()).ok()
    };
    Agreement::of(residuals_px, solve, least_px)
}

/// Computes the residual of a point against a pose: root mean square over cameras and axes, px.
fn residual_px(geometry: &RigGeometry, pose: &Estimate, observed: &Observation) -> f64 {
    let Some(expected) = pose.moved(&geometry.arms, observed.start) else {
        return f64::INFINITY;
    };
    let [x, y, rho] = [0, 1, 2].map(|i| observed.end[i] - expected[i]);
    let count = geometry.cameras() as f64;
    let squares = count * (x * x + y * y) + geometry.arms.arms_squared_mm2() * rho * rho;
    geometry.focal_px * (squares / (2.0 * count)).sqrt()
}
