//! The pose with its covariance, for any point of the target.

use super::cayley;
use super::normal::Solution;
use super::quarter_turn::QuarterTurn;
use crate::sums::centred::Geometry;
use libm::sqrt;
use nalgebra::{Matrix3, Matrix3x6, Rotation3, SMatrix, UnitQuaternion, Vector3};

/// Motion of a rigid target between two instants, with its covariance.
///
/// Positions are in the rig's axes, mm; rotations about these axes, right-handed (x right, y down,
/// z away).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Turn of the keyframe's points that comes first; all below is of the motion after it.
    pub first: QuarterTurn,
    /// Displacement `s` of the point whose mean of both instants is `middle_mm`, mm.
    pub s_mm: [f64; 3],
    /// Cayley vector `ω = tan(θ/2) n`, dimensionless.
    pub omega: [f64; 3],
    /// Mean of all points of both instants, mm.
    pub middle_mm: [f64; 3],
    /// Mean of all points at the keyframe, mm.
    pub centroid_mm: [f64; 3],
    /// Covariance of `(s, ω)`, mm and dimensionless.
    pub covariance: [[f64; 6]; 6],
    /// Standard deviation of one normalised coordinate, dimensionless.
    pub sigma: f64,
}

/// Displacement of one point of the target, with its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PivotDisplacement {
    /// Displacement, mm.
    pub displacement_mm: [f64; 3],
    /// Covariance of the displacement, mm².
    pub covariance_mm2: [[f64; 3]; 3],
}

impl PivotDisplacement {
    /// Returns the standard deviation of the displacement per axis, mm.
    pub fn sigma_mm(&self) -> [f64; 3] {
        core::array::from_fn(|i| sqrt(self.covariance_mm2[i][i]))
    }
}

impl Estimate {
    /// Creates the estimate of points whose mean at the keyframe, before the quarter turn `first`,
    /// is `start_mm`, about the mean camera.
    pub(super) fn new(
        geometry: &Geometry,
        (first, start_mm): (QuarterTurn, Vector3<f64>),
        middle: &Vector3<f64>,
        solution: &Solution,
        variance: f64,
    ) -> Self {
        let [x, y] = geometry.centre_mm();
        let centre = Vector3::new(x, y, 0.0);
        let [s0, s1, s2, w0, w1, w2] = solution.theta.into();
        Self {
            first,
            s_mm: [s0, s1, s2],
            omega: [w0, w1, w2],
            middle_mm: (middle + centre).into(),
            centroid_mm: (start_mm + centre).into(),
            covariance: rows(&(variance * solution.inverse)),
            sigma: sqrt(variance),
        }
    }

    /// Creates the exact pose of a rotation by the Cayley vector `omega` that displaces the point
    /// at `pivot_mm` by `displacement_mm`: a start for a search.
    pub fn exact(omega: [f64; 3], pivot_mm: [f64; 3], displacement_mm: [f64; 3]) -> Self {
        let displacement = Vector3::from(displacement_mm);
        let s = displacement - Vector3::from(omega).cross(&displacement);
        Self {
            first: QuarterTurn::default(),
            s_mm: s.into(),
            omega,
            middle_mm: pivot_mm,
            centroid_mm: pivot_mm,
            covariance: [[0.0; 6]; 6],
            sigma: 0.0,
        }
    }

    /// Creates the exact pose of a rotation vector, rad, that displaces the point at `pivot_mm` by
    /// `displacement_mm`. `geometry` is that of the cameras. `None` for half a turn about an axis
    /// across z.
    pub fn turned(
        geometry: &Geometry,
        rotation_rad: [f64; 3],
        pivot_mm: [f64; 3],
        displacement_mm: [f64; 3],
    ) -> Option<Self> {
        let rotation = Rotation3::new(Vector3::from(rotation_rad));
        let first = QuarterTurn::nearest_to(rotation.matrix(), geometry.centre_mm());
        let rest = Rotation3::from_matrix_unchecked(rotation * first.matrix().transpose());
        let rest = UnitQuaternion::from_rotation_matrix(&rest);
        let omega = rest.imag() / rest.w;
        if !omega.iter().all(|value| value.is_finite()) {
            return None;
        }
        let turned_mm = first.place(pivot_mm);
        let moved = [0, 1, 2].map(|i| pivot_mm[i] + displacement_mm[i] - turned_mm[i]);
        Some(Self {
            first,
            centroid_mm: pivot_mm,
            ..Self::exact(omega.into(), turned_mm, moved)
        })
    }

    /// Returns the pose of a displacement that is followed by this pose; its covariance is this
    /// one's.
    pub fn preceded_by(self, displacement_mm: [f64; 3]) -> Self {
        let turned = Vector3::from(self.first.turned(displacement_mm));
        let after = |place: [f64; 3], moved: &Vector3<f64>| (Vector3::from(place) - moved).into();
        Self {
            s_mm: (Vector3::from(self.s_mm) + turned - self.cayley().cross(&turned)).into(),
            middle_mm: after(self.middle_mm, &turned),
            centroid_mm: after(self.centroid_mm, &displacement_mm.into()),
            ..self
        }
    }

    /// Returns the exact pose of this one followed by a rotation by the Cayley vector `omega` about
    /// the place `about_mm`, which turns by less than half a turn in all.
    pub fn followed_by(self, omega: [f64; 3], about_mm: [f64; 3]) -> Self {
        let (then, own) = (Vector3::from(omega), self.cayley());
        let sum = (own + then + then.cross(&own)) / (1.0 - own.dot(&then));
        let about = Vector3::from(about_mm);
        let middle = Vector3::from(self.middle_mm);
        let arrived = middle + self.displacement_of_turned(self.middle_mm);
        let place = about + cayley::matrix(&then) * (arrived - about);
        Self {
            first: self.first,
            centroid_mm: self.centroid_mm,
            ..Self::exact(sum.into(), self.middle_mm, (place - middle).into())
        }
    }

    /// Returns the estimate with all variances multiplied by `factor`, for errors of neighbouring
    /// points that are not independent.
    pub fn inflated(self, factor: f64) -> Self {
        Self {
            covariance: self.covariance.map(|row| row.map(|value| factor * value)),
            ..self
        }
    }

    fn cayley(&self) -> Vector3<f64> {
        self.omega.into()
    }

    /// Returns the rotation matrix `R`, row by row.
    pub fn rotation(&self) -> [[f64; 3]; 3] {
        rows(&(cayley::matrix(&self.cayley()) * self.first.matrix()))
    }

    /// Returns the translation `t` of `p1 = R p0 + t`, mm: the displacement of the target's point
    /// at the rig's origin.
    pub fn translation_mm(&self) -> [f64; 3] {
        self.displacement_of([0.0; 3]).displacement_mm
    }

    /// Returns where the target's point at `point_mm` goes, mm.
    pub fn apply(&self, point_mm: [f64; 3]) -> [f64; 3] {
        (Vector3::from(point_mm) + self.displacement(point_mm)).into()
    }

    /// Returns the direction and inverse depth about the mean camera, as the field `end` of an
    /// [`Observation`](super::Observation), to which the pose moves a point at `start`. `None` if
    /// the point is then not in front of the cameras.
    pub fn moved(&self, geometry: &Geometry, start: [f64; 3]) -> Option<[f64; 3]> {
        let [alpha, beta, rho] = start;
        let [cx, cy] = geometry.centre_mm();
        let [x, y, z] = self.apply([alpha / rho + cx, beta / rho + cy, 1.0 / rho]);
        (z > 0.0).then(|| [(x - cx) / z, (y - cy) / z, 1.0 / z])
    }

    fn displacement(&self, pivot_mm: [f64; 3]) -> Vector3<f64> {
        let turned_mm = self.first.place(pivot_mm);
        let first = Vector3::from(turned_mm) - Vector3::from(pivot_mm);
        self.displacement_of_turned(turned_mm) + first
    }

    /// Returns the displacement of a point after the first turn, mm.
    fn displacement_of_turned(&self, turned_mm: [f64; 3]) -> Vector3<f64> {
        let omega = self.cayley();
        let arm = Vector3::from(turned_mm) - Vector3::from(self.middle_mm);
        cayley::half_inverse(&omega) * (Vector3::from(self.s_mm) + 2.0 * omega.cross(&arm))
    }

    /// Returns the rotation vector: axis times angle, rad, at most half a turn.
    pub fn rotation_rad(&self) -> [f64; 3] {
        self.first.followed_by(&self.cayley()).into()
    }

    /// Returns the rotation vector, degrees.
    pub fn rotation_deg(&self) -> [f64; 3] {
        self.rotation_rad().map(f64::to_degrees)
    }

    /// Returns the covariance of the rotation, rad²: of the small rotation about the rig's axes
    /// that leads from the true one to the estimate.
    pub fn rotation_covariance_rad2(&self) -> [[f64; 3]; 3] {
        let derivative = cayley::derivative(&self.cayley());
        let omega = self.covariance().fixed_view::<3, 3>(3, 3).into_owned();
        rows(&(derivative * omega * derivative.transpose()))
    }

    /// Returns the standard deviation of the rotation about each axis, degrees.
    pub fn rotation_sigma_deg(&self) -> [f64; 3] {
        let covariance = self.rotation_covariance_rad2();
        core::array::from_fn(|i| sqrt(covariance[i][i]).to_degrees())
    }

    /// Returns the squared rotation over its variance: χ² with 3 degrees of freedom if the target
    /// did not turn. `None` if the covariance is singular, as that of points without noise.
    pub fn rotation_chi_squared(&self) -> Option<f64> {
        if !self.first.is_none() {
            let rotation = Vector3::from(self.rotation_rad());
            let covariance = self.rotation_covariance_rad2();
            let covariance = Matrix3::from_fn(|i, j| covariance[i][j]);
            return Some(rotation.dot(&covariance.cholesky()?.solve(&rotation)));
        }
        let omega = self.cayley();
        let covariance = self.covariance().fixed_view::<3, 3>(3, 3).into_owned();
        Some(omega.dot(&covariance.cholesky()?.solve(&omega)))
    }

    /// Computes the displacement of the target's point that was at `pivot_mm` at the keyframe:
    ///
    /// ```text
    /// d = (I - Ω)^-1 (s + 2 ω × (pivot - m))
    /// δd = (I - Ω)^-1 (δs - [2 (pivot - m) + d]× δω)
    /// ```
    ///
    /// The variance grows with the pivot's distance from the middle of the points.
    pub fn displacement_of(&self, pivot_mm: [f64; 3]) -> PivotDisplacement {
        let omega = self.cayley();
        let half = cayley::half_inverse(&omega);
        let turned_mm = self.first.place(pivot_mm);
        let arm = Vector3::from(turned_mm) - Vector3::from(self.middle_mm);
        let rest = half * (Vector3::from(self.s_mm) + 2.0 * omega.cross(&arm));
        let displacement = rest + (Vector3::from(turned_mm) - Vector3::from(pivot_mm));
        let lever = (2.0 * arm + rest).cross_matrix();
        let mut derivative = Matrix3x6::zeros();
        derivative.fixed_view_mut::<3, 3>(0, 0).copy_from(&half);
        derivative
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(-half * lever));
        let covariance: Matrix3<f64> = derivative * self.covariance() * derivative.transpose();
        PivotDisplacement {
            displacement_mm: displacement.into(),
            covariance_mm2: rows(&covariance),
        }
    }

    fn covariance(&self) -> SMatrix<f64, 6, 6> {
        SMatrix::from_fn(|i, j| self.covariance[i][j])
    }
}

fn rows<const N: usize>(matrix: &SMatrix<f64, N, N>) -> [[f64; N]; N] {
    core::array::from_fn(|i| core::array::from_fn(|j| matrix[(i, j)]))
}
