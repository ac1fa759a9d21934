//! Synchronisation of the cameras: finds a camera whose images are of another instant.
//!
//! A camera whose shutter opens later sees a moving target further on: its residuals `r_ik` are
//! parallel to the flow `u_i` of their points, which is nearly the same for all points if the
//! target does not turn. The motion fitted to all `K` cameras absorbs `1/K` of it, so
//!
//! ```text
//! share_k = K/(K-1) Σ r_ik·u_i / Σ |u_i|²         of the motion between the two instants
//! ```
//!
//! A wrong focal length or a camera that is not exactly where the rig file says has the same
//! effect, by a percent or two; images taken from a rail show it. A camera is therefore left out
//! only for more than 2.5 %. Below, sigma grows by the bias that it may have caused,
//! `share |u|/K`.
//!
//! With a skew of more than half a pixel, points fail the tests between cameras, or scatter too
//! much for a consensus. Then each camera tracks on its own, and the same share is computed before
//! the frame set is refused.

use super::Correspondence;
use super::active_cameras::ActiveCameras;
use crate::matching::geometry::RigGeometry;
use trinocular_core::sums::View;

/// Least deviation that is tested, px.
const MIN_DEVIATION_PX: f64 = 0.03;
/// Least deviation that is tested, in its standard deviations.
const MIN_SIGMAS: f64 = 6.0;

/// Least excess share of the motion of an unsynchronised camera.
const MIN_SHARE: f64 = 0.025;

/// Camera with the largest excess or deficit of motion against the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnsynchronisedCamera {
    /// Index among the active cameras.
    pub index: usize,
    /// Share of the motion that the camera saw in excess of the others; negative for less.
    pub share: f64,
    /// Factor by which the displacement's variance must grow to contain the camera's bias.
    pub variance_inflation: f64,
}

impl UnsynchronisedCamera {
    /// Finds the camera with the largest significant excess of motion, for a target that does not
    /// turn. `factor` is the variance inflation factor of the inliers.
    pub fn find(
        geometry: &RigGeometry,
        inliers: &[Correspondence],
        displacement_mm: [f64; 3],
        factor: f64,
    ) -> Option<Self> {
        let residuals = |inlier: &Correspondence| -> Option<Vec<[f64; 2]>> {
            let fit = geometry.arms.point(&inlier.views)?;
            let residual = |(k, view): (usize, &View)| {
                let (seen, expected) = (view.flow(), fit.flow(k, displacement_mm));
                [0, 1].map(|axis| seen[axis] - expected[axis])
            };
            Some(inlier.views.iter().enumerate().map(residual).collect())
        };
        let residuals = inliers.iter().map(residuals).collect::<Option<Vec<_>>>()?;
        // All points move nearly alike, and their mean has less noise.
        let count = inliers.len() as f64;
        let flows = inliers.iter().map(mean_flow);
        let mean = flows.fold([0.0; 2], |sum, u| [0, 1].map(|i| sum[i] + u[i] / count));
        Self::of_residuals(&residuals, &vec![mean; inliers.len()], factor, geometry)
    }

    /// Finds the camera with the largest significant excess of motion. `residuals` are those of
    /// every point in each camera against the motion that all cameras agree on, `flows` the motion
    /// of every point, both normalised. It takes three cameras: of two, either could be wrong.
    pub(super) fn of_residuals(
        residuals: &[Vec<[f64; 2]>],
        flows: &[[f64; 2]],
        factor: f64,
        geometry: &RigGeometry,
    ) -> Option<Self> {
        let cameras = geometry.cameras();
        let count = residuals.len() as f64;
        if cameras < 3 || residuals.is_empty() {
            return None;
        }

        // Share of the motion in every camera's residuals, and the sum of squared residuals.
        let mut along = vec![0.0; cameras];
        let (mut squares, mut motion) = (0.0, 0.0);
        for (residuals, u) in residuals.iter().zip(flows) {
            motion += (u[0] * u[0] + u[1] * u[1]) / count;
            for (k, r) in residuals.iter().enumerate() {
                along[k] += (r[0] * u[0] + r[1] * u[1]) / count;
                squares += r[0] * r[0] + r[1] * r[1];
            }
        }

        // Excess of each camera along the flow: K/(K-1) mean(r_k·u)/|u|.
        let size = motion.sqrt();
        let all = cameras as f64 / (cameras as f64 - 1.0);
        let deviations: Vec<f64> = along.iter().map(|mean| all * mean / size).collect();
        let (worst, deviation) = (deviations.iter().copied().enumerate())
            .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;

        // Significance: the scatter that remains without each camera's own excess.
        let explained: f64 = deviations.iter().map(|d| count * (d / all).powi(2)).sum();
        let scatter = (squares - explained).max(0.0) / (2.0 * count * cameras as f64);
        let sigma = (factor * scatter * all / count).sqrt();
        let is_significant = deviation.abs() > MIN_SIGMAS * sigma
            && geometry.focal_px * deviation.abs() > MIN_DEVIATION_PX;

        // Bias of the displacement, against the variance of the mean flow.
        let observations = count * cameras as f64;
        let of_mean = factor * squares / (2.0 * observations) / observations;
        (is_significant && size > 0.0).then_some(Self {
            index: worst,
            share: deviation / size,
            variance_inflation: 1.0 + (deviation / cameras as f64).powi(2) / of_mean,
        })
    }

    /// Returns true if the excess is too large for errors of the calibration.
    pub fn is_unsynchronised(&self) -> bool {
        self.share.abs() > MIN_SHARE
    }

    /// Returns the camera's index in the rig, and its excess share of the motion.
    pub(super) fn in_rig(&self, active: &ActiveCameras) -> Option<(usize, f64)> {
        Some((*active.cameras.get(self.index)?, self.share))
    }
}

/// Returns the mean over the cameras of a point's flow, normalised.
pub(super) fn mean_flow(point: &Correspondence) -> [f64; 2] {
    let count = point.views.len() as f64;
    let flows = point.views.iter().map(View::flow);
    flows.fold([0.0; 2], |sum, flow| {
        [0, 1].map(|i| sum[i] + flow[i] / count)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::cloud::{Cloud, independent};
    use trinocular_core::estimate::midpoint;
    use trinocular_core::sums::centred::CentredSums;

    const MOVED: [f64; 3] = [9.0, -6.0, 2.0];

    fn judged(late: Option<(usize, f64)>, seed: u64) -> Option<UnsynchronisedCamera> {
        let cloud = Cloud::new();
        let motion = |k: usize, place: [f64; 3]| {
            let share = late
                .filter(|(camera, _)| *camera == k)
                .map_or(0.0, |(_, share)| share);
            core::array::from_fn(|i| place[i] + (1.0 + share) * MOVED[i])
        };
        let points = cloud.points(motion, independent(0.02, seed));
        let mut sums = CentredSums::new(&cloud.geometry.rig).unwrap();
        for point in &points {
            assert!(sums.add(&point.views));
        }
        let measured = midpoint::solve(&sums).unwrap().displacement_mm;
        UnsynchronisedCamera::find(&cloud.geometry, &points, measured, 3.0)
    }

    #[test]
    fn unsynchronised_camera_is_found() {
        for camera in 0..3 {
            for share in [0.06, -0.06] {
                let found = judged(Some((camera, share)), 5).unwrap();
                assert!(found.index == camera && found.is_unsynchronised());
                assert!((found.share - share).abs() < 0.02, "{found:?}, not {share}");
            }
        }
    }

    #[test]
    fn small_skew_only_inflates_sigma() {
        let found = judged(Some((0, 0.012)), 6).unwrap();
        assert!(
            !found.is_unsynchronised() && found.variance_inflation > 2.0,
            "{found:?}"
        );
    }

    #[test]
    fn synchronised_cameras_pass() {
        assert!((0..40).all(|seed| judged(None, seed).is_none()));
    }
}
