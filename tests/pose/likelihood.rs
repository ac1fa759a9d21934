//! Maximum likelihood of the pose: the oracle, which iterates from a start value.
//!
//! Minimises the squared distances of all observations from positions `â` (three numbers a point)
//! and their motion by the pose. The positions are eliminated in closed form in each step. This
//! equals the maximum likelihood of all pixels, because `(α, β, ρ)` is a sufficient statistic.

use nalgebra::{Matrix3, Matrix3x6, Matrix6, Rotation3, Vector3, Vector6};
use trinocular_core::estimate::pose::{Estimate, Observation};
use trinocular_core::sums::centred::Geometry;

/// Steps; the second is already below rounding in most cases.
const STEPS: usize = 12;

/// A pose `p1 = R p0 + t` about the mean camera.
pub struct Pose {
    rotation: Rotation3<f64>,
    translation: Vector3<f64>,
    centre: Vector3<f64>,
}

impl Pose {
    pub fn new(rotation: Rotation3<f64>, translation: Vector3<f64>, geometry: &Geometry) -> Self {
        let [x, y] = geometry.centre_mm();
        Self {
            rotation,
            translation,
            centre: Vector3::new(x, y, 0.0),
        }
    }

    /// Returns the displacement of the point at `pivot_mm` in the rig's axes, mm.
    pub fn displacement_of(&self, pivot_mm: [f64; 3]) -> [f64; 3] {
        let at = Vector3::from(pivot_mm) - self.centre;
        (self.rotation * at + self.translation - at).into()
    }

    pub fn rotation_rad(&self) -> [f64; 3] {
        self.rotation.scaled_axis().into()
    }

    /// Returns where a point goes, and the derivative by its three numbers and by a small
    /// displacement and rotation about its pivot.
    fn apply(&self, at: &Vector3<f64>, pivot: &Vector3<f64>) -> Moved {
        let [x, y, rho] = [at.x, at.y, at.z];
        let ray = self.rotation * Vector3::new(x, y, 1.0) + self.translation * rho;
        let to = Vector3::new(ray.x, ray.y, rho) / ray.z;
        // d(ray) by (α, β, ρ), then the quotient.
        let mut by_place = Matrix3::zeros();
        by_place.set_column(0, &self.rotation.matrix().column(0));
        by_place.set_column(1, &self.rotation.matrix().column(1));
        by_place.set_column(2, &self.translation);
        let quotient =
            |d: Vector3<f64>, d_rho: f64| (Vector3::new(d.x, d.y, d_rho) - to * d.z) / ray.z;
        let place = Matrix3::from_columns(&[
            quotient(by_place.column(0).into(), 0.0),
            quotient(by_place.column(1).into(), 0.0),
            quotient(by_place.column(2).into(), 1.0),
        ]);
        let position = ray / rho;
        let arm = position - pivot;
        let pose = Matrix3x6::from_columns(&std::array::from_fn::<_, 6, _>(|i| {
            let change = match i {
                0..3 => Vector3::ith(i, 1.0),
                _ => Vector3::ith(i - 3, 1.0).cross(&arm),
            };
            quotient(rho * change, 0.0)
        }));
        Moved { to, place, pose }
    }
}

struct Moved {
    to: Vector3<f64>,
    place: Matrix3<f64>,
    pose: Matrix3x6<f64>,
}

fn covariance(geometry: &Geometry) -> Matrix3<f64> {
    let count = geometry.cameras() as f64;
    let squares = geometry.arms_squared_mm2();
    Matrix3::from_diagonal(&Vector3::new(1.0 / count, 1.0 / count, 1.0 / squares))
}

/// Fits the pose, from a start value near it.
pub fn fit(geometry: &Geometry, observations: &[Observation], start: &Estimate) -> Pose {
    let rotation = Matrix3::from_fn(|i, j| start.rotation()[i][j]);
    let mut pose = Pose::new(
        Rotation3::from_matrix(&rotation),
        Vector3::zeros(),
        geometry,
    );
    let centre: [f64; 3] = pose.centre.into();
    pose.translation = Vector3::from(start.displacement_of(centre).displacement_mm);
    let noise = covariance(geometry);
    let precision = noise.try_inverse().expect("two cameras apart");
    let pairs = observations.iter();
    let pairs: Vec<[Vector3<f64>; 2]> = pairs.map(|o| [o.start.into(), o.end.into()]).collect();
    let mut places: Vec<Vector3<f64>> = pairs.iter().map(|[a0, _]| *a0).collect();
    let pivot = Vector3::from(start.middle_mm) - pose.centre;
    for _ in 0..STEPS {
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for ([a0, a1], place) in pairs.iter().zip(&places) {
            let moved = pose.apply(place, &pivot);
            let h = moved.place;
            let weight = (noise + h * noise * h.transpose())
                .try_inverse()
                .expect("definite");
            let off = a1 - moved.to - h * (a0 - place);
            normal += moved.pose.transpose() * weight * moved.pose;
            right += moved.pose.transpose() * weight * off;
        }
        let step = normal
            .lu()
            .solve(&right)
            .expect("points that determine a pose");
        for ([a0, a1], place) in pairs.iter().zip(&mut places) {
            let moved = pose.apply(place, &pivot);
            let h = moved.place;
            let curvature = precision + h.transpose() * precision * h;
            let off = a1 - moved.to - moved.pose * step;
            let slope = precision * (a0 - *place) + h.transpose() * precision * off;
            *place += curvature.lu().solve(&slope).expect("definite");
        }
        let turn = Rotation3::new(step.fixed_rows::<3>(3).into_owned());
        pose.translation = turn * (pose.translation - pivot) + pivot + step.fixed_rows::<3>(0);
        pose.rotation = turn * pose.rotation;
    }
    pose
}

/// Returns the Cramér-Rao bound of displacement of the point at `pivot_mm` and of the rotation
/// about its place after the motion, for points known exactly: 6 x 6, mm and rad, for the variance
/// 1 of a normalised coordinate.
pub fn bound(
    geometry: &Geometry,
    exact: &[Observation],
    pose: &Pose,
    pivot_mm: [f64; 3],
) -> Matrix6<f64> {
    let noise = covariance(geometry);
    let moved = Vector3::from(pivot_mm) + Vector3::from(pose.displacement_of(pivot_mm));
    let pivot = moved - pose.centre;
    let information = exact.iter().map(|observation| {
        let moved = pose.apply(&observation.start.into(), &pivot);
        let h = moved.place;
        let weight = (noise + h * noise * h.transpose())
            .try_inverse()
            .expect("definite");
        moved.pose.transpose() * weight * moved.pose
    });
    let information: Matrix6<f64> = information.sum();
    information
        .try_inverse()
        .expect("points that determine a pose")
}
