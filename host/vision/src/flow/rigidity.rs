//! Rigidity of the inliers: all parts of one rigid target have one pose.
//!
//! Two objects that move differently by less than the limit of an inlier can be blended into one
//! pose, whose rotation is false. Each of them alone has another pose. The inliers are therefore
//! divided into halves, in several directions of the image, and every half has an estimate of its
//! own. With `θ = (s, ω)` of both halves about one middle, and `C` their covariances,
//!
//! ```text
//! χ² = (θ_a - θ_b)' (C_a + C_b)^-1 (θ_a - θ_b)        6 degrees of freedom
//! ```
//!
//! A blend is wrong by half of the difference. Its own variance is a quarter of the halves' sum, so
//! that the variance times `χ²/6` contains the error. A large `χ²` is refused; a smaller one
//! inflates the variance. [`parts`] finds what halves cannot tell: small steps that look like a
//! rotation.

mod halves;
pub(super) mod parts;

use super::Correspondence;
use crate::matching::geometry::RigGeometry;
use halves::halves;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use trinocular_core::estimate::pose::{Estimate, Observation, Parts, Point, QuarterTurn};

/// `χ²` above which the halves are different objects for certain.
const CERTAIN: f64 = 100.0;
/// `χ²` above which the variance grows: noise exceeds it in one of the directions once in a hundred
/// times.
const SIGNIFICANT: f64 = 20.0;
/// Degrees of freedom of a pose.
const FREEDOM: f64 = 6.0;

/// Comparison of the halves that differ most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rigidity {
    /// Test statistic, about 6 for one rigid target.
    pub(super) chi_squared: f64,
}

impl Rigidity {
    /// Compares the halves of `inliers`, whose variance inflation factor is `factor`. Halves that do
    /// not determine a pose are not compared. All are turned first as the pose of all is.
    pub(super) fn of(
        geometry: &RigGeometry,
        inliers: &[Correspondence],
        first: QuarterTurn,
        factor: f64,
    ) -> Self {
        let observed = Observed::of(geometry, inliers);
        let parts = Parts::of(first, &geometry.arms, &observed.all());
        observed.compare(parts.ok(), factor)
    }

    /// Does the same for a target that does not turn, by the fastest stage of the pose.
    pub(super) fn of_still(
        geometry: &RigGeometry,
        inliers: &[Correspondence],
        factor: f64,
    ) -> Self {
        let observed = Observed::of(geometry, inliers);
        let parts = Parts::of_still(&geometry.arms, &observed.all());
        observed.compare(parts.ok(), factor)
    }

    /// Returns true if the inliers are of more than one object.
    pub(super) fn is_broken(self) -> bool {
        self.chi_squared > CERTAIN
    }

    /// Returns the factor by which the variance must grow to contain the difference of the halves.
    pub(super) fn variance_inflation(self) -> f64 {
        match self.chi_squared > SIGNIFICANT {
            true => self.chi_squared / FREEDOM,
            false => 1.0,
        }
    }
}

/// Inliers as the estimator sees them, and their halves.
struct Observed {
    each: Vec<Option<Observation>>,
    halves: [[Vec<usize>; 2]; 5],
}

impl Observed {
    fn of(geometry: &RigGeometry, inliers: &[Correspondence]) -> Self {
        let observe = |point: &Correspondence| Observation::new(&geometry.arms, &point.views);
        Self {
            each: inliers.iter().map(observe).collect(),
            halves: halves(geometry, inliers),
        }
    }

    fn all(&self) -> Vec<Observation> {
        self.each.iter().flatten().copied().collect()
    }

    fn compare(&self, parts: Option<Parts<'_>>, factor: f64) -> Rigidity {
        let compared = parts.map_or(0.0, |parts| {
            let share = |seen: &Option<Observation>| parts.point(seen.as_ref()?);
            let points: Vec<Option<Point>> = self.each.iter().map(share).collect();
            let solve = |half: &Vec<usize>| {
                let half = half.iter().filter_map(|i| points.get(*i)?.as_ref());
                parts.solve(half).ok()
            };
            let compared = self
                .halves
                .each_ref()
                .map(|[a, b]| difference(&solve(a)?, &solve(b)?));
            compared.into_iter().flatten().fold(0.0, f64::max)
        });
        Rigidity {
            chi_squared: compared / factor,
        }
    }
}

/// Computes `χ²` of two poses; `None` if their covariance is singular.
fn difference(a: &Estimate, b: &Estimate) -> Option<f64> {
    let [a, b] = [a, b].map(|pose| about(pose, [0.0, 0.0, a.middle_mm[2]]));
    let difference = a.0 - b.0;
    let solved = (a.1 + b.1).cholesky()?.solve(&difference);
    Some(difference.dot(&solved)).filter(|chi| chi.is_finite())
}

/// Returns `(s, ω)` about another middle, and its covariance: `s' = s + 2 ω × (m' - m)`.
fn about(pose: &Estimate, middle_mm: [f64; 3]) -> (Vector6<f64>, Matrix6<f64>) {
    let off = Vector3::from(middle_mm) - Vector3::from(pose.middle_mm);
    let mut change = Matrix6::identity();
    let lever: Matrix3<f64> = -2.0 * off.cross_matrix();
    change.fixed_view_mut::<3, 3>(0, 3).copy_from(&lever);
    let [s, omega] = [pose.s_mm, pose.omega];
    let theta = Vector6::new(s[0], s[1], s[2], omega[0], omega[1], omega[2]);
    let covariance = Matrix6::from_fn(|i, j| pose.covariance[i][j]);
    (change * theta, change * covariance * change.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::cloud::{Cloud, independent};
    use trinocular_core::rig::Rotation;

    /// Returns the rigidity of a poster that turns by 8 degrees, whose right part also moves by
    /// `apart_mm`.
    fn seen(apart_mm: [f64; 3], seed: u64) -> Rigidity {
        let cloud = Cloud::new();
        let turn = Rotation::from_degrees([3.0, -4.0, 6.0]).rows();
        let motion = |_, place: [f64; 3]| {
            let off = [place[0], place[1], place[2] - 850.0];
            let share = if place[0] > 20.0 { 1.0 } else { 0.0 };
            core::array::from_fn(|i| {
                let turned: f64 = (0..3).map(|j| turn[i][j] * off[j]).sum();
                turned + [4.0, -3.0, 855.0][i] + share * apart_mm[i]
            })
        };
        let points = cloud.points(motion, independent(0.02, seed));
        Rigidity::of(&cloud.geometry, &points, QuarterTurn::default(), 1.0)
    }

    #[test]
    fn rigid_target_passes() {
        let ratios: Vec<f64> = (0..40)
            .map(|seed| seen([0.0; 3], seed).chi_squared)
            .collect();
        let inflated = ratios.iter().filter(|chi| **chi > SIGNIFICANT).count();
        let largest = ratios.iter().copied().fold(0.0, f64::max);
        assert!(inflated <= 3 && largest < 40.0, "{inflated}, {largest}");
    }

    #[test]
    fn parts_that_move_apart_are_found() {
        for apart in [[0.2, 0.0, 0.0], [0.0, -0.2, 0.0], [0.1, 0.1, 0.3]] {
            let found = seen(apart, 1);
            assert!(found.is_broken(), "{apart:?}: {found:?}");
        }
    }

    #[test]
    fn small_differences_inflate_variance() {
        let found = seen([0.0, 0.03, 0.0], 2);
        assert!(
            !found.is_broken() && found.variance_inflation() > 2.0,
            "{found:?}"
        );
    }
}
