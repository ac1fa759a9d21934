//! The displacement most points agree on, and which points those are.
//!
//! Every point must obey the midpoint model (`shared::sums::centred`): with `g` the harmonic mean
//! of its inverse depths at both instants,
//!
//! ```text
//! v_k = g (T_xy - ξ̄_k T_z)        residual in px: focal times the difference
//! ```
//!
//! Starting from a displacement that is roughly right, points are kept whose residual is within
//! three times the median (at least [`super::Settings::agree_px`]), the displacement is solved
//! again from those, and so on until the set stays the same.

use shared::estimate::midpoint;
use shared::rig::Rig;
use shared::sums::View;
use shared::sums::centred::{CentredSums, PointFit};

use crate::matching::geometry::Geometry;
use crate::random::Random;

/// Rounds at most; three are usual.
const ROUNDS: usize = 12;

/// What the points agree on.
#[derive(Clone, Debug)]
pub struct Consensus {
    /// The displacement, mm.
    pub displacement_mm: [f64; 3],
    /// Per point: whether it agrees.
    pub agrees: Vec<bool>,
    /// Median over all points of the residual per axis, px.
    pub median_px: f64,
}

/// Residual of a point's views against `displacement_mm`: root mean square over cameras and axes,
/// px. Infinite for a point that is not in front of the cameras (`None`).
fn residual_px(
    geometry: &Geometry,
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

/// The set of points that agree, from `start_mm` on. `None` if no solution exists.
pub fn agree(
    geometry: &Geometry,
    points: &[Vec<View>],
    start_mm: [f64; 3],
    least_px: f64,
) -> Option<Consensus> {
    let fits: Vec<Option<PointFit>> = points.iter().map(|p| geometry.arms.point(p)).collect();
    let mut displacement_mm = start_mm;
    let mut agrees = vec![false; points.len()];
    let mut median_px = f64::INFINITY;
    for _ in 0..ROUNDS {
        let residuals: Vec<f64> = (points.iter().zip(&fits))
            .map(|(views, fit)| residual_px(geometry, views, fit.as_ref(), displacement_mm))
            .collect();
        median_px = median(&mut residuals.clone())?;
        let limit = (3.0 * median_px).max(least_px);
        let now: Vec<bool> = residuals.iter().map(|r| *r <= limit).collect();
        let settled = now == agrees;
        agrees = now;
        if settled {
            break;
        }
        displacement_mm = solve(&geometry.rig, points, &agrees)?;
    }
    Some(Consensus {
        displacement_mm,
        agrees,
        median_px,
    })
}

fn solve(rig: &Rig, points: &[Vec<View>], agrees: &[bool]) -> Option<[f64; 3]> {
    let mut sums = CentredSums::new(rig).ok()?;
    for (views, _) in points.iter().zip(agrees).filter(|(_, agrees)| **agrees) {
        sums.add(views);
    }
    midpoint::solve(&sums).ok().map(|e| e.displacement_mm)
}

/// One point's motion in one camera, with its inverse depth known.
#[derive(Clone, Copy, Debug)]
pub struct Sighting {
    /// Normalised, at the reference instant.
    pub before: [f64; 2],
    /// Normalised, now.
    pub now: [f64; 2],
    /// At the reference instant, 1/mm.
    pub inverse_depth: f64,
}

impl Sighting {
    /// Where `displacement_mm` puts the point, normalised.
    pub fn predicted(before: [f64; 2], inverse_depth: f64, [tx, ty, tz]: [f64; 3]) -> [f64; 2] {
        let shrink = 1.0 / (1.0 + inverse_depth * tz);
        [
            (before[0] + inverse_depth * tx) * shrink,
            (before[1] + inverse_depth * ty) * shrink,
        ]
    }

    /// Distance from where `displacement_mm` puts it, normalised.
    pub fn residual(&self, displacement_mm: [f64; 3]) -> f64 {
        let expected = Self::predicted(self.before, self.inverse_depth, displacement_mm);
        let off = [self.now[0] - expected[0], self.now[1] - expected[1]];
        (off[0] * off[0] + off[1] * off[1]).sqrt()
    }
}

/// The displacement that explains sightings in one camera: `ξ' - ξ = ρ Tx - ρ ξ' Tz` is linear in
/// it. Reweighted (Tukey's biweight at four times the median, never below `least`), so that nearly
/// half of them may be wrong.
pub fn fit(sightings: &[Sighting], start_mm: [f64; 3], least: f64) -> Option<[f64; 3]> {
    let mut displacement = least_median(sightings, start_mm)?;
    for _ in 0..8 {
        let limit = (4.0 * median_residual(sightings, displacement)?).max(least);
        displacement = least_squares(sightings.iter().map(|s| {
            let off = s.residual(displacement) / limit;
            (s, (1.0 - off * off).max(0.0).powi(2))
        }))?;
    }
    Some(displacement)
}

/// Pairs that are tried. With 60 % right sightings, all are spoiled with a probability of 1e-9.
const PAIRS: u64 = 48;

/// Least median of squares (Rousseeuw 1984): of the start and of what pairs of sightings say, the
/// displacement with the smallest median residual. Reweighting alone, started between two motions,
/// may settle on a blend of both.
fn least_median(sightings: &[Sighting], start_mm: [f64; 3]) -> Option<[f64; 3]> {
    let mut best = (median_residual(sightings, start_mm)?, start_mm);
    let mut random = Random::seeded(0);
    for _ in 0..PAIRS {
        let pair = [(); 2].map(|()| &sightings[random.below(sightings.len())]);
        let Some(displacement) = least_squares(pair.into_iter().map(|s| (s, 1.0))) else {
            continue;
        };
        let median = median_residual(sightings, displacement)?;
        if median < best.0 {
            best = (median, displacement);
        }
    }
    Some(best.1)
}

fn median_residual(sightings: &[Sighting], displacement_mm: [f64; 3]) -> Option<f64> {
    let residual = |s: &Sighting| s.residual(displacement_mm);
    median(&mut sightings.iter().map(residual).collect::<Vec<f64>>())
}

/// Of an even number, the larger of both in the middle.
fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Weighted least squares. `None` if the sightings do not determine it.
fn least_squares<'a>(sightings: impl Iterator<Item = (&'a Sighting, f64)>) -> Option<[f64; 3]> {
    // Normal equations of the unknowns Tx, Ty, Tz; Tx and Ty do not mix.
    let (mut n, mut sx, mut sy, mut sr) = (0.0, 0.0, 0.0, 0.0);
    let (mut rx, mut ry, mut rz) = (0.0, 0.0, 0.0);
    for (s, weight) in sightings {
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
    let spread = sr - (sx * sx + sy * sy) / n;
    let tz = (rz + (sx * rx + sy * ry) / n) / spread;
    let displacement = [(rx + sx * tz) / n, (ry + sy * tz) / n, tz];
    displacement
        .iter()
        .all(|t| t.is_finite())
        .then_some(displacement)
}
