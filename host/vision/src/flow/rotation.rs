//! Rotation of the target. The flow sums describe only displacements, so a rotating target is
//! measured wrongly: half a degree of yaw is 18 sigma.
//!
//! The rotation about the centroid of the points is fitted to what a displacement leaves
//! (module `linear_motion`), six unknowns by least squares. The covariance of `ω` is that of the
//! remaining residuals, inflated by [`super::variance_inflation`].

use super::Correspondence;
use super::linear_motion::PointMotions;
use crate::matching::geometry::RigGeometry;
use nalgebra::{Matrix3, Vector3};

/// 95 % quantile of χ² with three degrees of freedom: the limit of a significant rotation.
const SIGNIFICANT: f64 = 7.81;

/// Rotation of the points between the two instants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetRotation {
    /// Rotation about x, y and z of the cameras, degrees.
    pub degrees: [f64; 3],
    /// Error of the displacement if the rotation is ignored, mm.
    pub bias_mm: [f64; 3],
    /// Test statistic `ω' C^-1 ω`, about 3 without a rotation.
    pub chi_squared: f64,
    /// Ratio of the root mean square residuals with and without the rotation.
    pub residual_share: f64,
}

impl TargetRotation {
    /// Fits a rotation to the residuals of `inliers` against `displacement_mm`. `factor` is their
    /// variance inflation factor. Returns `None` if the points do not determine a rotation.
    pub fn of(
        geometry: &RigGeometry,
        inliers: &[Correspondence],
        displacement_mm: [f64; 3],
        factor: f64,
    ) -> Option<Self> {
        let motions = PointMotions::of(geometry, inliers, displacement_mm);
        Self::of_motions(&motions, factor)
    }

    /// Does the same from the equations of the inliers.
    pub(super) fn of_motions(motions: &PointMotions, factor: f64) -> Option<Self> {
        // Solution, remaining residual, and the test statistic of ω alone.
        let (all, size) = (motions.all(), motions.size_mm);
        let rotated = all.rotated()?;
        let (before, after) = (all.squares, rotated.squares);
        let freedom = all.residuals.checked_sub(6)?;
        let variance = factor * after / freedom.max(1) as f64;
        let solved = rotated.motion;
        let omega: Vector3<f64> = solved.fixed_rows::<3>(3).into();
        let covariance: Matrix3<f64> = rotated.covariance.fixed_view::<3, 3>(3, 3) * variance;
        let chi_squared = omega.dot(&(covariance.try_inverse()? * omega));
        let rotation = Self {
            degrees: [0, 1, 2].map(|i| (omega[i] / size).to_degrees()),
            bias_mm: [-solved[0], -solved[1], -solved[2]],
            chi_squared,
            residual_share: (after / before).sqrt(),
        };
        rotation.chi_squared.is_finite().then_some(rotation)
    }

    /// Returns the angle of the rotation, degrees.
    pub fn angle_deg(&self) -> f64 {
        self.degrees.iter().map(|d| d * d).sum::<f64>().sqrt()
    }

    /// Returns true for a rotation that noise imitates in less than one of 20 cases.
    pub fn is_significant(&self) -> bool {
        self.chi_squared > SIGNIFICANT
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::cloud::{Cloud, independent};
    use trinocular_core::estimate::midpoint;
    use trinocular_core::rig::Rotation;
    use trinocular_core::sums::centred::CentredSums;

    /// Measures the rotation of a poster, and the displacement as if it did not rotate.
    fn seen(degrees: [f64; 3], moved: [f64; 3], seed: u64) -> (TargetRotation, [f64; 3]) {
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
        let points = cloud.points(motion, independent(0.02, seed));
        let mut sums = CentredSums::new(&cloud.geometry.rig).unwrap();
        for point in &points {
            assert!(sums.add(&point.views));
        }
        let measured = midpoint::solve(&sums).unwrap().displacement_mm;
        (
            TargetRotation::of(&cloud.geometry, &points, measured, 1.0).unwrap(),
            measured,
        )
    }

    #[test]
    fn rotation_and_bias_are_measured() {
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
            assert!(turn.is_significant() && turn.chi_squared > 50.0 && turn.residual_share < 0.9);
        }
        // Half a degree of yaw looks like motion along x.
        let (turn, measured) = seen([0.0, 0.5, 0.0], moved, 2);
        assert!((measured[0] - moved[0]).abs() > 0.05 && turn.bias_mm[0].abs() > 0.05);
    }

    #[test]
    fn noise_rarely_looks_like_rotation() {
        let significant =
            (0..60).filter(|seed| seen([0.0; 3], [4.0, -3.0, 5.0], *seed).0.is_significant());
        // One in twenty: 3 of 60, and 9 is beyond three standard deviations.
        assert!(significant.count() <= 9);
    }
}
