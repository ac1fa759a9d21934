//! What the errors of a pose's inliers have in common, and by how much its variance must grow.

use crate::flow::Correspondence;
use crate::flow::consensus;
use crate::flow::rigidity::parts::TwoParts;
use crate::flow::sync::{self, UnsynchronisedCamera};
use crate::flow::variance_inflation::{VarianceInflation, with_common_error};
use crate::matching::geometry::RigGeometry;
use trinocular_core::estimate::pose::{Estimate, Observation};

/// Number of unknowns of a pose.
const UNKNOWNS: f64 = 6.0;

/// Common errors of the inliers of a pose.
pub(super) struct Errors {
    /// Errors of overlapping windows and of the cameras of a point.
    pub(super) inflation: VarianceInflation,
    /// Camera with the largest significant excess of motion.
    pub(super) skewed: Option<UnsynchronisedCamera>,
    /// Comparison of the rotation with two displacements, for small rotations.
    pub(super) parts: Option<TwoParts>,
}

impl Errors {
    /// Measures the common errors of the inliers.
    pub(super) fn of(geometry: &RigGeometry, inliers: &[Correspondence], pose: &Estimate) -> Self {
        let inflation = inflation(geometry, inliers, pose);
        Self {
            inflation,
            skewed: unsynchronised(geometry, inliers, pose, inflation.factor),
            parts: two_parts(geometry, inliers, inflation.factor),
        }
    }

    /// Returns the factor by which the variance of the pose grows. `of_halves` is what the
    /// differences between the halves of the target demand.
    pub(super) fn factor(
        &self,
        geometry: &RigGeometry,
        inliers: &[Correspondence],
        pose: &Estimate,
        of_halves: f64,
    ) -> f64 {
        // Small skews and small differences stay in the measurement; sigma contains their bias.
        let skewed = self.skewed.map_or(1.0, |s| s.variance_inflation);
        let apart = self.parts.as_ref();
        let apart = apart.map_or(1.0, TwoParts::inflation_of_pose);
        // The pose takes its noise from the residuals, which contain what the cameras of a point
        // have in common.
        let factor = self.inflation.of_windows * skewed.max(of_halves).max(apart);
        let sigma_px = geometry.focal_px * pose.sigma;
        let components = (2 * inliers.len() * geometry.cameras()) as f64;
        with_common_error(factor, sigma_px, components)
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
