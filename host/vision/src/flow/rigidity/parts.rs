//! Two parts of the inliers that move differently, against one rotation.
//!
//! Two objects that move differently by less than an inlier's limit give a mean of both, and a
//! rotation that neither has: a step between two parts is like the slope that a rotation makes. Both
//! explanations have six unknowns and are linear in them ([`linear_motion`](crate::flow)), so the
//! squares that they leave can be compared: with `q` of one displacement and one rotation, and `q_a`
//! and `q_b` of a displacement for each half of the inliers,
//!
//! ```text
//! s² = factor (q_a + q_b) / (n - 6)
//! advantage = (q - q_a - q_b) / s²
//! χ² = (T_a - T_b)' (C_a + C_b)^-1 (T_a - T_b)        3 degrees of freedom
//! ```
//!
//! A step across or along the image that has the statistic `χ²` has an advantage of about a quarter
//! of it, and a rotation of the same statistic as large a disadvantage. A step in depth has nearly
//! none: the flow of points near the middle of the image hardly depends on depth, so that it looks
//! like a rotation about x or y, and is taken for one.
//!
//! The inliers are divided in several directions, and the one with the largest advantage counts. Two
//! objects need not be the halves: if in doubt, the variance grows by more than the halves alone
//! would ask for.
//!
//! A rig whose calibration is not exact measures parts of one target differently by a share of the
//! motion. Such a difference inflates the variance; one beyond it is refused.

use super::halves::halves;
use crate::flow::Correspondence;
use crate::flow::linear_motion::{Displaced, LinearMotion, PointMotions};
use crate::flow::rotation::TargetRotation;
use crate::matching::geometry::RigGeometry;
use nalgebra::Vector3;

/// Advantage beyond which the inliers are of two objects for certain.
const CERTAIN: f64 = 50.0;
/// Advantage beyond which two objects are likely. Noise exceeds it in one of the directions once in
/// a few hundred times.
const LIKELY: f64 = 16.0;
/// Statistic that a false rotation keeps after its inflation: two standard deviations.
const KEPT: f64 = 4.0;
/// Largest rotation for which the linear equations hold, degrees. Two objects whose difference is
/// below an inlier's limit imitate less.
const LINEAR_DEG: f64 = 1.0;
/// Difference that the calibration of a rig may cause, as a share of the displacement.
const CALIBRATED: f64 = 0.03;
/// Difference in the image that is always allowed, px.
const ALLOWED_PX: f64 = 0.05;

/// Comparison of one rotation with two displacements.
#[derive(Clone, Copy, Debug)]
pub(in crate::flow) struct TwoParts {
    /// Advantage of two displacements.
    advantage: f64,
    /// Test statistic of their difference.
    chi_squared: f64,
    /// True if the difference is larger than an inexact calibration may cause.
    is_beyond_calibration: bool,
    /// The rotation, if the points determine it.
    rotation: Option<TargetRotation>,
}

impl TwoParts {
    /// Compares both explanations of what `displacement_mm` leaves of the flow of `inliers`, whose
    /// variance inflation factor is `factor`.
    pub(in crate::flow) fn of(
        geometry: &RigGeometry,
        inliers: &[Correspondence],
        displacement_mm: [f64; 3],
        factor: f64,
    ) -> Self {
        let motions = PointMotions::of(geometry, inliers, displacement_mm);
        let all = motions.all();
        let none = Self {
            advantage: 0.0,
            chi_squared: 0.0,
            is_beyond_calibration: false,
            rotation: TargetRotation::of_motions(&motions, factor),
        };
        let Some(rotated) = all.rotated().filter(|_| all.residuals > 6) else {
            return none;
        };
        let freedom = (all.residuals - 6) as f64;
        let allowed_mm = CALIBRATED * Vector3::from(displacement_mm).norm()
            + ALLOWED_PX * motions.depth_mm / geometry.focal_px;
        let compared = halves(geometry, inliers).into_iter().filter_map(|halves| {
            let [a, b] = halves.map(|half| displaced(&motions, &half));
            let (a, b) = (a?, b?);
            let squares = a.squares + b.squares;
            let variance = factor * squares / freedom;
            let apart = a.correction_mm - b.correction_mm;
            let weight = (a.covariance + b.covariance).try_inverse()?;
            let parts = Self {
                advantage: (rotated.squares - squares) / variance,
                chi_squared: apart.dot(&(weight * apart)) / variance,
                is_beyond_calibration: apart.norm() > allowed_mm,
                ..none
            };
            // Without noise there is nothing to compare with.
            (parts.advantage.is_finite() && parts.chi_squared.is_finite()).then_some(parts)
        });
        let best = compared.max_by(|a, b| a.advantage.total_cmp(&b.advantage));
        best.unwrap_or(none)
    }

    /// Returns true if the inliers are of two objects for certain.
    pub(in crate::flow) fn are_certain(&self) -> bool {
        self.advantage > CERTAIN && self.is_beyond_calibration
    }

    /// Returns the factor by which the variance of a displacement must grow to contain the
    /// difference of two parts.
    pub(in crate::flow) fn inflation_of_displacement(&self) -> f64 {
        match self.advantage > LIKELY {
            true => self.chi_squared.max(1.0),
            false => 1.0,
        }
    }

    /// Returns the factor by which the variance of a pose must grow to contain a rotation that two
    /// parts may imitate.
    pub(in crate::flow) fn inflation_of_pose(&self) -> f64 {
        let chi_squared = self.rotation.map_or(0.0, |rotation| rotation.chi_squared);
        match self.advantage > LIKELY {
            true => (chi_squared / KEPT).max(1.0),
            false => 1.0,
        }
    }

    /// Returns true if the rotation is small enough for the linear equations.
    pub(in crate::flow) fn are_linear(&self) -> bool {
        self.rotation
            .is_none_or(|rotation| rotation.angle_deg() < LINEAR_DEG)
    }
}

/// Solves for the displacement of some points, by their numbers.
fn displaced(motions: &PointMotions, half: &[usize]) -> Option<Displaced> {
    let mut sum = LinearMotion::none();
    half.iter().for_each(|i| sum.add(&motions.points[*i]));
    sum.displaced()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::cloud::{Cloud, independent};
    use trinocular_core::rig::Rotation;

    const MOVED: [f64; 3] = [4.0, -3.0, 5.0];

    /// Compares for a poster that turns by `degrees`, whose right part also moves by `apart_mm`.
    fn seen(degrees: [f64; 3], apart_mm: [f64; 3], seed: u64) -> TwoParts {
        let cloud = Cloud::new();
        let turn = Rotation::from_degrees(degrees).rows();
        let motion = |_, place: [f64; 3]| {
            let off = [place[0], place[1], place[2] - 850.0];
            let share = if place[0] > 0.0 { 1.0 } else { 0.0 };
            core::array::from_fn(|i| {
                let turned: f64 = (0..3).map(|j| turn[i][j] * off[j]).sum();
                let middle = if i == 2 { 850.0 } else { 0.0 };
                middle + turned + MOVED[i] + share * apart_mm[i]
            })
        };
        let points = cloud.points(motion, independent(0.02, seed));
        TwoParts::of(&cloud.geometry, &points, MOVED, 1.0)
    }

    #[test]
    fn rigid_target_passes() {
        let inflated = (0..100).filter(|seed| {
            let found = seen([0.0; 3], [0.0; 3], *seed);
            assert!(!found.are_certain() && found.are_linear(), "{found:?}");
            found.inflation_of_displacement() > 1.0 || found.inflation_of_pose() > 1.0
        });
        assert!(inflated.count() <= 3);
    }

    #[test]
    fn rotation_is_no_second_part() {
        for (seed, degrees) in [
            [0.1, 0.0, 0.0],
            [0.0, 0.12, 0.0],
            [0.05, -0.05, 0.1],
            [0.3, 0.4, -0.5],
        ]
        .into_iter()
        .enumerate()
        {
            let found = seen(degrees, [0.0; 3], seed as u64);
            assert!(!found.are_certain(), "{degrees:?}: {found:?}");
            assert_eq!(
                found.inflation_of_displacement(),
                1.0,
                "{degrees:?}: {found:?}"
            );
            assert_eq!(found.inflation_of_pose(), 1.0, "{degrees:?}: {found:?}");
        }
    }

    #[test]
    fn parts_that_move_apart_are_certain() {
        for apart in [[0.4, 0.0, 0.0], [0.0, -0.5, 0.0], [0.1, 0.1, 0.8]] {
            let found = seen([0.0; 3], apart, 1);
            assert!(found.are_certain(), "{apart:?}: {found:?}");
        }
    }

    #[test]
    fn small_difference_inflates_variance() {
        for apart in [[0.1, 0.0, 0.0], [0.0, -0.03, 0.0], [0.07, 0.05, 0.2]] {
            let found = seen([0.0; 3], apart, 2);
            assert!(!found.are_certain(), "{apart:?}: {found:?}");
            assert!(
                found.inflation_of_displacement() > 5.0,
                "{apart:?}: {found:?}"
            );
        }
    }

    #[test]
    fn false_rotation_is_within_its_sigma() {
        for apart in [[0.0, 0.06, 0.0], [0.08, -0.05, 0.0]] {
            for seed in 0..20 {
                let found = seen([0.0; 3], apart, seed);
                let rotation = found.rotation.unwrap().chi_squared;
                assert!(rotation > 25.0, "{apart:?}: {found:?}");
                let left = rotation / found.inflation_of_pose();
                assert!(left <= KEPT, "{apart:?}: {found:?}");
            }
        }
    }
}
