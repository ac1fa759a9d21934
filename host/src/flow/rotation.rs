//! Whether the target turns. Sums know only displacements, so one that turns is measured wrongly:
//! half a degree of yaw is 18 sigma.
//!
//! A target that turns by the small angle `ω` about the points' centroid displaces the point at `p`
//! from it by `ω × p`. The midpoint model holds for every point's own displacement, so the residual
//! that a pure displacement leaves in camera `k` is
//!
//! ```text
//! r_k = g ((δ + ω × p)_xy - ξ_k (δ + ω × p)_z)
//! ```
//!
//! with a correction `δ` of the displacement: six unknowns, least squares. The residual's own
//! scatter and [`super::variance_inflation`] say how well `ω` is known.

use crate::matching::geometry::Geometry;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use shared::sums::View;

/// The 95 % quantile of χ² with three degrees of freedom: a turn beyond it is taken to be one.
const SIGNIFICANT: f64 = 7.81;

/// How the points turn between the two instants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// About x, y and z of the cameras, degrees.
    pub degrees: [f64; 3],
    /// What the displacement is off by if the turn is ignored, mm.
    pub bias_mm: [f64; 3],
    /// `ω' C^-1 ω`, of the order of 3 if nothing turns.
    pub chi_squared: f64,
    /// Root mean square residual per component that is left, as a share of what it was.
    pub left: f64,
}

impl Turn {
    /// Of `views` (per point, per camera), all of which are used, against `displacement_mm`.
    /// `widening` is the scatter's. `None` if the points do not determine it.
    pub fn of(
        geometry: &Geometry,
        views: &[Vec<View>],
        displacement_mm: [f64; 3],
        widening: f64,
    ) -> Option<Self> {
        let arms = geometry.arms.arms_mm();
        let points: Vec<_> = (views.iter())
            .filter_map(|views| {
                let fit = geometry.arms.point(views)?;
                let z = 1.0 / fit.inverse_depth;
                let (at, arm) = (*fit.middles.first()?, arms.first()?);
                let place = Vector3::new(at[0] * z + arm[0], at[1] * z + arm[1], z);
                Some((fit, place, views))
            })
            .collect();
        let centroid =
            points.iter().map(|p| p.1).sum::<Vector3<f64>>() / points.len().max(1) as f64;
        // Angles in units that make their columns as large as those of the displacement.
        let size = (points
            .iter()
            .map(|p| (p.1 - centroid).norm_squared())
            .sum::<f64>()
            / points.len().max(1) as f64)
            .sqrt();
        let mut normal = Matrix6::<f64>::zeros();
        let mut right = Vector6::<f64>::zeros();
        let mut before = 0.0;
        for (fit, place, views) in &points {
            let p = (place - centroid) / size;
            let cross = [[0.0, p.z, -p.y], [-p.z, 0.0, p.x], [p.y, -p.x, 0.0]];
            for (k, view) in views.iter().enumerate() {
                let (seen, expected) = (view.flow(), fit.flow(k, displacement_mm));
                for axis in 0..2 {
                    let mut row = [0.0; 6];
                    row[axis] = 1.0;
                    row[2] = -fit.middles[k][axis];
                    for i in 0..3 {
                        row[3 + i] = cross[axis][i] - fit.middles[k][axis] * cross[2][i];
                    }
                    let row = Vector6::from(row) * fit.inverse_depth;
                    let residual = seen[axis] - expected[axis];
                    normal += row * row.transpose();
                    right += row * residual;
                    before += residual * residual;
                }
            }
        }
        let inverse = normal.try_inverse()?;
        let solved = inverse * right;
        let after = (before - solved.dot(&right)).max(0.0);
        let freedom = (2 * points.len() * geometry.cameras()).checked_sub(6)?;
        let variance = widening * after / freedom.max(1) as f64;
        let omega: Vector3<f64> = solved.fixed_rows::<3>(3).into();
        let covariance: Matrix3<f64> = inverse.fixed_view::<3, 3>(3, 3) * variance;
        let chi_squared = omega.dot(&(covariance.try_inverse()? * omega));
        let turn = Self {
            degrees: [0, 1, 2].map(|i| (omega[i] / size).to_degrees()),
            bias_mm: [-solved[0], -solved[1], -solved[2]],
            chi_squared,
            left: (after / before).sqrt(),
        };
        turn.chi_squared.is_finite().then_some(turn)
    }

    /// Its angle, degrees.
    pub fn angle_deg(&self) -> f64 {
        self.degrees.iter().map(|d| d * d).sum::<f64>().sqrt()
    }

    /// Whether it is more than noise makes believe in 19 of 20 cases.
    pub fn is_significant(&self) -> bool {
        self.chi_squared > SIGNIFICANT
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::cloud::{Cloud, independent};
    use shared::estimate::midpoint;
    use shared::rig::Rotation;
    use shared::sums::centred::CentredSums;

    /// The turn that a poster is seen to make, and the displacement measured as if it made none.
    fn seen(degrees: [f64; 3], moved: [f64; 3], seed: u64) -> (Turn, [f64; 3]) {
        let cloud = Cloud::new();
        let count = cloud.places.len() as f64;
        let middle: [f64; 3] =
            core::array::from_fn(|i| cloud.places.iter().map(|p| p[i]).sum::<f64>() / count);
        let turn = Rotation::from_degrees(degrees).rows();
        let motion = |_, place: [f64; 3]| {
            let off: [f64; 3] = core::array::from_fn(|i| place[i] - middle[i]);
            let turned = turn.map(|row| row[0] * off[0] + row[1] * off[1] + row[2] * off[2]);
            core::array::from_fn(|i| middle[i] + turned[i] + moved[i])
        };
        let views = cloud.views(motion, independent(0.02, seed));
        let mut sums = CentredSums::new(&cloud.geometry.rig).unwrap();
        for views in &views {
            assert!(sums.add(views));
        }
        let measured = midpoint::solve(&sums).unwrap().displacement_mm;
        (
            Turn::of(&cloud.geometry, &views, measured, 1.0).unwrap(),
            measured,
        )
    }

    #[test]
    fn a_turn_is_measured_and_so_is_what_it_spoils() {
        let moved = [4.0, -3.0, 5.0];
        for degrees in [
            [0.5, 0.0, 0.0],
            [0.0, -0.5, 0.0],
            [0.0, 0.0, 0.8],
            [0.2, 0.3, -0.4],
        ] {
            let (turn, measured) = seen(degrees, moved, 1);
            for axis in 0..3 {
                let off = turn.degrees[axis] - degrees[axis];
                assert!(off.abs() < 0.05, "{degrees:?}: {turn:?}");
                let mended = measured[axis] - turn.bias_mm[axis];
                assert!(
                    (mended - moved[axis]).abs() < 0.1,
                    "{degrees:?}: {mended} mm"
                );
            }
            assert!(turn.is_significant() && turn.chi_squared > 50.0 && turn.left < 0.9);
        }
        // What is spoiled by half a degree of yaw is what would be believed to be motion along x.
        let (turn, measured) = seen([0.0, 0.5, 0.0], moved, 2);
        assert!((measured[0] - moved[0]).abs() > 0.05 && turn.bias_mm[0].abs() > 0.05);
    }

    #[test]
    fn noise_is_rarely_taken_for_a_turn() {
        let significant =
            (0..60).filter(|seed| seen([0.0; 3], [4.0, -3.0, 5.0], *seed).0.is_significant());
        // One in twenty: 3 of 60, and 9 is beyond three standard deviations.
        assert!(significant.count() <= 9);
    }
}
