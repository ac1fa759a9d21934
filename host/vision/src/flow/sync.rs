//! Synchronisation of the cameras: finds a camera whose images are of another instant.
//!
//! A camera whose shutter opens later sees a moving target further on, at all points alike: its
//! mean residual `m_k` is parallel to the mean flow `u`. The displacement fitted to all `K` cameras
//! absorbs `1/K` of it, so
//!
//! ```text
//! share_k = K/(K-1) m_k·u / |u|²         of the motion between the two instants
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
    /// Finds the camera with the largest significant excess of motion. It takes three cameras: of
    /// two, either could be wrong. `factor` is the variance inflation factor of the inliers.
    pub fn find(
        geometry: &RigGeometry,
        inliers: &[Correspondence],
        displacement_mm: [f64; 3],
        factor: f64,
    ) -> Option<Self> {
        let cameras = geometry.cameras();
        let count = inliers.len() as f64;
        if cameras < 3 || inliers.is_empty() {
            return None;
        }

        // Mean residual m_k of every camera, mean flow u, and the sum of squared residuals.
        let mut means = vec![[0.0; 2]; cameras];
        let mut flow = [0.0; 2];
        let mut squares = 0.0;
        for inlier in inliers {
            let fit = geometry.arms.point(&inlier.views)?;
            for (k, view) in inlier.views.iter().enumerate() {
                let (seen, expected) = (view.flow(), fit.flow(k, displacement_mm));
                for axis in 0..2 {
                    let residual = seen[axis] - expected[axis];
                    means[k][axis] += residual / count;
                    flow[axis] += seen[axis] / (count * cameras as f64);
                    squares += residual * residual;
                }
            }
        }

        // Excess of each camera along the flow: K/(K-1) m_k·u/|u|.
        let size = flow[0].hypot(flow[1]);
        let all = cameras as f64 / (cameras as f64 - 1.0);
        let excess = |mean: &[f64; 2]| all * (mean[0] * flow[0] + mean[1] * flow[1]) / size;
        let deviations: Vec<f64> = means.iter().map(excess).collect();
        let (worst, deviation) = (deviations.iter().copied().enumerate())
            .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;

        // Significance: the scatter that remains without each camera's own mean.
        let explained: f64 = means
            .iter()
            .map(|m| count * (m[0] * m[0] + m[1] * m[1]))
            .sum();
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
