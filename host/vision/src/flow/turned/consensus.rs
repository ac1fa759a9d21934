//! Consensus of the points that move as one rigid target.

use super::Tracks;
use crate::flow::Correspondence;
use crate::matching::geometry::RigGeometry;
use trinocular_core::estimate::pose::{self, Estimate, Observation};

/// Rounds of a consensus.
const MAX_ROUNDS: usize = 8;
/// Ratio of the inlier limit to the median residual.
const INLIER_MEDIANS: f64 = 3.0;

/// Points that move as one rigid target.
pub(super) struct RigidConsensus {
    pub pose: Estimate,
    /// Flags of the tracks that are inliers.
    pub inliers: Vec<bool>,
    /// Median residual of all tracks, px.
    pub median_px: f64,
}

impl RigidConsensus {
    /// Finds the inliers from the pose `start` on. Residuals up to `least_px` never make an
    /// outlier.
    pub fn of(
        geometry: &RigGeometry,
        tracks: &Tracks,
        start: Estimate,
        least_px: f64,
    ) -> Option<Self> {
        let observe = |point: &Correspondence| Observation::new(&geometry.arms, &point.views);
        let observed: Vec<Option<Observation>> = tracks.points.iter().map(observe).collect();
        let mut pose = start;
        let mut consensus: Option<Self> = None;
        for _ in 0..MAX_ROUNDS {
            let residuals = observed.iter().map(|observed| {
                let residual = observed.map(|o| residual_px(geometry, &pose, &o));
                residual
                    .filter(|px| px.is_finite())
                    .unwrap_or(f64::INFINITY)
            });
            let residuals: Vec<f64> = residuals.collect();
            let mut sorted = residuals.clone();
            let middle = sorted.len() / 2;
            let (_, median_px, _) = sorted.select_nth_unstable_by(middle, f64::total_cmp);
            let median_px = *median_px;
            let limit = (INLIER_MEDIANS * median_px).max(least_px);
            let inliers: Vec<bool> = residuals.iter().map(|px| *px <= limit).collect();
            if let Some(converged) = consensus.as_mut().filter(|c| c.inliers == inliers) {
                converged.median_px = median_px;
                break;
            }
            let kept = observed.iter().zip(&inliers);
            let kept = kept.filter_map(|(observed, is_inlier)| observed.filter(|_| *is_inlier));
            pose = pose::solve(&geometry.arms, &kept.collect::<Vec<_>>()).ok()?;
            consensus = Some(Self {
                pose,
                inliers,
                median_px,
            });
        }
        consensus
    }
}

/// Computes the residual of a point against a pose: root mean square over cameras and axes, px.
fn residual_px(geometry: &RigGeometry, pose: &Estimate, observed: &Observation) -> f64 {
    let Some(expected) = moved(geometry, pose, observed.start) else {
        return f64::INFINITY;
    };
    let [x, y, rho] = [0, 1, 2].map(|i| observed.end[i] - expected[i]);
    let count = geometry.cameras() as f64;
    let squares = count * (x * x + y * y) + geometry.arms.arms_squared_mm2() * rho * rho;
    geometry.focal_px * (squares / (2.0 * count)).sqrt()
}

/// Returns where the pose puts a point: direction and inverse depth about the mean camera. `None`
/// if it is not in front of the cameras.
pub(super) fn moved(
    geometry: &RigGeometry,
    pose: &Estimate,
    [x, y, rho]: [f64; 3],
) -> Option<[f64; 3]> {
    let [cx, cy] = geometry.arms.centre_mm();
    let [x, y, z] = pose.apply([x / rho + cx, y / rho + cy, 1.0 / rho]);
    (z > 0.0).then(|| [(x - cx) / z, (y - cy) / z, 1.0 / z])
}
