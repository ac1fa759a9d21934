//! All that the views of one point say about its place.

use crate::sums::View;
use crate::sums::centred::Geometry;
use nalgebra::Vector3;

/// One point at both instants, reduced from its views.
///
/// Cameras in a plane see a point at `ξ_k = (α, β) - ρ c_k`, with `c_k` the camera's position about
/// the mean camera. This is linear in `a = (α, β, ρ) = (X/Z, Y/Z, 1/Z)`, so the fit of `a` to the
/// `2 K` coordinates is a sufficient statistic. With `σ²` the variance of one coordinate and
/// `S = Σ |c_k|²`, its covariance is:
///
/// ```text
/// Cov(a) = σ² diag(1/K, 1/K, 1/S)
/// ```
///
/// The other `2 K - 3` directions contain noise alone: the *misfit*.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// `(α, β, ρ)` at the keyframe: two dimensionless directions, and inverse depth, 1/mm.
    pub start: [f64; 3],
    /// `(α, β, ρ)` now.
    pub end: [f64; 3],
    /// Sum of squares of the misfit at the keyframe, dimensionless.
    pub start_misfit: f64,
    /// Sum of squares of the misfit now.
    pub end_misfit: f64,
    /// Sum of products of the two misfits.
    pub common_misfit: f64,
    /// Sum of cross products of the two misfits: the sum of products after a quarter turn.
    pub cross_misfit: f64,
}

impl Observation {
    /// Reduces the views of one point, which are in the rig's order.
    ///
    /// Returns `None` if the point is not in front of the cameras at both instants, is not finite,
    /// or does not have exactly one view per camera.
    pub fn new(geometry: &Geometry, views: &[View]) -> Option<Self> {
        if views.len() != geometry.cameras() {
            return None;
        }
        let (before, start) = geometry.fit(views.iter().map(|v| v.start));
        let (after, end) = geometry.fit(views.iter().map(|v| v.end));
        let mut misfit = [0.0; 4];
        for (arm, view) in geometry.arms_mm().iter().zip(views) {
            let first = [0, 1].map(|i| view.start[i] - start[i] + arm[i] * before);
            let last = [0, 1].map(|i| view.end[i] - end[i] + arm[i] * after);
            for axis in 0..2 {
                misfit[0] += first[axis] * first[axis];
                misfit[1] += last[axis] * last[axis];
                misfit[2] += first[axis] * last[axis];
            }
            misfit[3] += first[0] * last[1] - first[1] * last[0];
        }
        let in_front = before > 0.0 && after > 0.0;
        let finite = misfit
            .iter()
            .chain(&start)
            .chain(&end)
            .all(|n| n.is_finite());
        (in_front && finite).then_some(Self {
            start: [start[0], start[1], before],
            end: [end[0], end[1], after],
            start_misfit: misfit[0],
            end_misfit: misfit[1],
            common_misfit: misfit[2],
            cross_misfit: misfit[3],
        })
    }

    /// Returns the position at the keyframe about the mean camera, mm.
    pub fn start_mm(&self) -> Vector3<f64> {
        position(self.start)
    }

    /// Returns the position now about the mean camera, mm.
    pub fn end_mm(&self) -> Vector3<f64> {
        position(self.end)
    }
}

fn position([alpha, beta, rho]: [f64; 3]) -> Vector3<f64> {
    Vector3::new(alpha, beta, 1.0) / rho
}
