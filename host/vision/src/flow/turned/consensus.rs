//! Consensus of the points that move as one rigid target.

use crate::flow::Correspondence;
use crate::flow::consensus::Agreement;
use crate::matching::geometry::RigGeometry;
use crate::rigid;
use trinocular_core::estimate::pose::{self, Estimate, Observation};

/// Pose on which most points agree, and its inliers.
pub(super) type RigidConsensus = Agreement<Estimate>;

/// Finds the inliers of tracked points from the pose `start` on. Residuals up to `least_px` never
/// make an outlier.
pub(super) fn rigid_consensus(
    geometry: &RigGeometry,
    points: &[Correspondence],
    start: Estimate,
    least_px: f64,
) -> Option<RigidConsensus> {
    agreement(geometry, &observed(geometry, points), start, least_px)
}

/// Finds the inliers of tracked points as [`rigid_consensus`] does, without a start. A point off by
/// more than `far_px` counts as simply wrong in its search.
pub(super) fn from_nothing(
    geometry: &RigGeometry,
    points: &[Correspondence],
    far_px: f64,
    least_px: f64,
) -> Option<RigidConsensus> {
    let observed = observed(geometry, points);
    let seen: Vec<Observation> = observed.iter().flatten().copied().collect();
    let start = rigid::motion(&geometry.arms, &seen, far_px / geometry.focal_px)?;
    agreement(geometry, &observed, start, least_px)
}

/// Returns what the estimator sees of the points; `None` for one behind the cameras.
fn observed(geometry: &RigGeometry, points: &[Correspondence]) -> Vec<Option<Observation>> {
    let observe = |point: &Correspondence| Observation::new(&geometry.arms, &point.views);
    points.iter().map(observe).collect()
}

fn agreement(
    geometry: &RigGeometry,
    observed: &[Option<Observation>],
    start: Estimate,
    least_px: f64,
) -> Option<RigidConsensus> {
    let residuals_px = |pose: &Estimate| -> Vec<f64> {
        let residuals = observed.iter().map(|observed| {
            let residual = observed.map(|o| residual_px(geometry, pose, &o));
            residual
                .filter(|px| px.is_finite())
                .unwrap_or(f64::INFINITY)
        });
        residuals.collect()
    };
    let kept = |inliers: &[bool]| -> Vec<Observation> {
        let kept = observed.iter().zip(inliers);
        kept.filter_map(|(observed, is_inlier)| observed.filter(|_| *is_inlier))
            .collect()
    };
    // The inliers first, by the fastest stage of the estimator.
    let plain = Agreement::of(
        |pose: Option<&Estimate>| residuals_px(pose.unwrap_or(&start)),
        |inliers| pose::plain(&geometry.arms, &kept(inliers)).ok(),
        least_px,
    )?;
    Agreement::of(
        |pose: Option<&Estimate>| residuals_px(pose.unwrap_or(&plain.model)),
        |inliers| pose::solve(&geometry.arms, &kept(inliers)).ok(),
        least_px,
    )
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
