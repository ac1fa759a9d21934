//! Consensus: the displacement on which most points agree, and its inliers.
//!
//! Every point must obey the midpoint model (`trinocular_core::sums::centred`): with `g` the
//! harmonic mean of its inverse depths at both instants,
//!
//! ```text
//! v_k = g (T_xy - ξ̄_k T_z)        residual in px: focal length times the difference
//! ```
//!
//! [`Agreement`] starts from a model that is roughly right: a displacement, or the pose of a target
//! that turns. Points whose residual is within three times the median are inliers; the model is
//! solved again from the inliers, until they stay the same.
//!
//! [`fit`] serves the displacement search, where only one camera's flow is known: least median of
//! squares (P. J. Rousseeuw, *Least Median of Squares Regression*, JASA 79, 1984), then weights of
//! Tukey's biweight (1974).

use trinocular_core::estimate::midpoint::{self, Estimate};
use trinocular_core::rig::Rig;
use trinocular_core::sums::View;
use trinocular_core::sums::centred::{CentredSums, PointFit};

use super::Correspondence;
use crate::matching::geometry::RigGeometry;
use trinocular_rig::random::Random;

/// Largest number of rounds; three are usual.
const MAX_ROUNDS: usize = 12;

/// Ratio of the inlier limit to the median residual.
const INLIER_MEDIANS: f64 = 3.0;

/// Model on which most points agree, and its inliers.
#[derive(Clone, Debug)]
pub struct Agreement<M> {
    /// Model of the inliers.
    pub model: M,
    /// Flags of the points that are inliers.
    pub inliers: Vec<bool>,
    /// Median over all points of the residual per axis, px.
    pub median_px: f64,
}

impl<M> Agreement<M> {
    /// Finds the inliers. `residuals_px` computes the residuals of all points against a model, or
    /// against the start if there is none yet; `solve` computes the model of the flagged points.
    /// Residuals up to `min_inlier_px` never make an outlier. Returns `None` if the points
    /// determine no model.
    pub(super) fn of(
        residuals_px: impl Fn(Option<&M>) -> Vec<f64>,
        solve: impl Fn(&[bool]) -> Option<M>,
        min_inlier_px: f64,
    ) -> Option<Self> {
        let mut agreement: Option<Self> = None;
        for _ in 0..MAX_ROUNDS {
            let residuals = residuals_px(agreement.as_ref().map(|agreed| &agreed.model));
            let median_px = median(&mut residuals.clone())?;
            let limit = (INLIER_MEDIANS * median_px).max(min_inlier_px);
            let inliers: Vec<bool> = residuals.iter().map(|r| *r <= limit).collect();
            // The same inliers would give the same model: the iteration has converged.
            if let Some(converged) = agreement.as_mut().filter(|a| a.inliers == inliers) {
                converged.median_px = median_px;
                break;
            }
            agreement = Some(Self {
                model: solve(&inliers)?,
                inliers,
                median_px,
            });
        }
        agreement
    }

    /// Returns the limit of an inlier's residual that the median sets, px.
    pub(super) fn limit_px(&self) -> f64 {
        INLIER_MEDIANS * self.median_px
    }

    /// Returns the number of inliers.
    pub fn count(&self) -> usize {
        self.inliers.iter().filter(|is| **is).count()
    }

    /// Returns the outliers of `points`, the points of this agreement.
    pub fn outliers_of<'a>(
        &'a self,
        points: &'a [Correspondence],
    ) -> impl Iterator<Item = &'a Correspondence> {
        let points = points.iter().zip(&self.inliers);
        points.filter_map(|(point, is_inlier)| (!is_inlier).then_some(point))
    }

    /// Keeps the inliers of `points`, the points of this agreement.
    pub fn inliers_of(&self, points: Vec<Correspondence>) -> Vec<Correspondence> {
        let points = points.into_iter().zip(&self.inliers);
        points
            .filter_map(|(point, is_inlier)| is_inlier.then_some(point))
            .collect()
    }
}

/// Displacement of the inliers.
#[derive(Clone, Copy, Debug)]
pub struct Displaced {
    /// Displacement, with the covariance of independent observations.
    pub estimate: Estimate,
    /// Number of point-camera observations behind the estimate.
    observations: u32,
}

impl Displaced {
    /// Returns the number of flow components (x and y of every observation) behind the estimate.
    pub fn components(&self) -> f64 {
        f64::from(2 * self.observations)
    }
}

/// Displacement on which most points agree, and its inliers.
pub type Consensus = Agreement<Displaced>;

impl Consensus {
    /// Finds the inliers among `points`, from the displacement `start_mm` on. Residuals up to
    /// `min_inlier_px` never make an outlier. Returns `None` if the points determine no
    /// displacement.
    pub fn of_points(
        geometry: &RigGeometry,
        points: &[Correspondence],
        start_mm: [f64; 3],
        min_inlier_px: f64,
    ) -> Option<Self> {
        let fits: Vec<Option<PointFit>> = (points.iter())
            .map(|point| geometry.arms.point(&point.views))
            .collect();
        let residuals_px = |model: Option<&Displaced>| {
            let moved_mm = model.map_or(start_mm, |model| model.estimate.displacement_mm);
            (points.iter().zip(&fits))
                .map(|(p, fit)| residual_px(geometry, &p.views, fit.as_ref(), moved_mm))
                .collect()
        };
        let solve = |inliers: &[bool]| solve(&geometry.rig, points, inliers);
        Self::of(residuals_px, solve, min_inlier_px)
    }
}

/// Computes the residual of a point's views against `displacement_mm`: root mean square over
/// cameras and axes, px. Infinite for a point that is not in front of the cameras (no fit).
fn residual_px(
    geometry: &RigGeometry,
    views: &[View],
    fit: Option<&PointFit>,
    displacement_mm: [f64; 3],
) -> f64 {
    let Some(fit) = fit else {
        return f64::INFINITY;
    };
    let mut squares = 0.0;
    for (k, view) in views.iter().enumerate() {
        let (seen, expected) = (view.flow(), fit.flow(k, displacement_mm));
        squares += (seen[0] - expected[0]).powi(2) + (seen[1] - expected[1]).powi(2);
    }
    geometry.focal_px * (squares / (2.0 * views.len() as f64)).sqrt()
}

/// Computes the midpoint estimate from the inliers.
pub(super) fn solve(rig: &Rig, points: &[Correspondence], inliers: &[bool]) -> Option<Displaced> {
    let mut sums = CentredSums::new(rig).ok()?;
    for (point, _) in points.iter().zip(inliers).filter(|(_, is)| **is) {
        sums.add(&point.views);
    }
    Some(Displaced {
        estimate: midpoint::solve(&sums).ok()?,
        observations: sums.observations(),
    })
}

/// Motion of one point in one camera, with its inverse depth known.
#[derive(Clone, Copy, Debug)]
pub struct PointFlow {
    /// Normalised position at the keyframe.
    pub before: [f64; 2],
    /// Normalised position now.
    pub now: [f64; 2],
    /// Inverse depth at the keyframe, 1/mm.
    pub inverse_depth: f64,
}

impl PointFlow {
    /// Predicts the normalised position after the displacement.
    pub fn predicted(before: [f64; 2], inverse_depth: f64, [tx, ty, tz]: [f64; 3]) -> [f64; 2] {
        let shrink = 1.0 / (1.0 + inverse_depth * tz);
        [
            (before[0] + inverse_depth * tx) * shrink,
            (before[1] + inverse_depth * ty) * shrink,
        ]
    }

    /// Returns the distance between the position now and the one that the displacement predicts,
    /// normalised.
    pub fn residual(&self, displacement_mm: [f64; 3]) -> f64 {
        let expected = Self::predicted(self.before, self.inverse_depth, displacement_mm);
        let off = [self.now[0] - expected[0], self.now[1] - expected[1]];
        (off[0] * off[0] + off[1] * off[1]).sqrt()
    }
}

/// Fits a displacement to the flow of one camera, robust against nearly half of the points.
///
/// `ξ' - ξ = ρ Tx - ρ ξ' Tz` is linear in the displacement. Iteratively reweighted least squares
/// with Tukey's biweight, zero at four times the median residual and never below `least`.
pub fn fit(point_flows: &[PointFlow], start_mm: [f64; 3], least: f64) -> Option<[f64; 3]> {
    let mut displacement = least_median(point_flows, start_mm)?;
    for _ in 0..8 {
        let limit = (4.0 * median_residual(point_flows, displacement)?).max(least);
        displacement = least_squares(point_flows.iter().map(|s| {
            let off = s.residual(displacement) / limit;
            (s, (1.0 - off * off).max(0.0).powi(2))
        }))?;
    }
    Some(displacement)
}

/// Number of random pairs. With 60 % right points, every pair holds a wrong one with a probability
/// of 1e-9.
const PAIRS: u64 = 48;

/// Returns the displacement with the least median of squares, among the start and the displacements
/// that random pairs determine. Reweighting alone, started between two motions, may converge to a
/// blend of both.
fn least_median(point_flows: &[PointFlow], start_mm: [f64; 3]) -> Option<[f64; 3]> {
    let mut best = (median_residual(point_flows, start_mm)?, start_mm);
    let mut random = Random::seeded(0);
    for _ in 0..PAIRS {
        let pair = [(); 2].map(|()| &point_flows[random.below(point_flows.len())]);
        let Some(displacement) = least_squares(pair.into_iter().map(|s| (s, 1.0))) else {
            continue;
        };
        let median = median_residual(point_flows, displacement)?;
        if median < best.0 {
            best = (median, displacement);
        }
    }
    Some(best.1)
}

fn median_residual(point_flows: &[PointFlow], displacement_mm: [f64; 3]) -> Option<f64> {
    let residual = |s: &PointFlow| s.residual(displacement_mm);
    median(&mut point_flows.iter().map(residual).collect::<Vec<f64>>())
}

/// Returns the median; of an even number of values, the larger of the middle two.
fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Solves the weighted least squares. Returns `None` if the points do not determine a displacement.
fn least_squares<'a>(point_flows: impl Iterator<Item = (&'a PointFlow, f64)>) -> Option<[f64; 3]> {
    // Normal equations of Tx, Ty and Tz. Tx and Ty are not coupled, so Tz comes by elimination.
    let (mut n, mut sx, mut sy, mut sr) = (0.0, 0.0, 0.0, 0.0);
    let (mut rx, mut ry, mut rz) = (0.0, 0.0, 0.0);
    for (s, weight) in point_flows {
        let g = s.inverse_depth;
        let [x, y] = s.now;
        let (vx, vy) = (s.now[0] - s.before[0], s.now[1] - s.before[1]);
        n += weight * g * g;
        sx += weight * g * g * x;
        sy += weight * g * g * y;
        sr += weight * g * g * (x * x + y * y);
        rx += weight * g * vx;
        ry += weight * g * vy;
        rz -= weight * g * (x * vx + y * vy);
    }
    // Schur complement of Tx and Ty.
    let spread = sr - (sx * sx + sy * sy) / n;
    let tz = (rz + (sx * rx + sy * ry) / n) / spread;
    let displacement = [(rx + sx * tz) / n, (ry + sy * tz) / n, tz];
    displacement
        .iter()
        .all(|t| t.is_finite())
        .then_some(displacement)
}
