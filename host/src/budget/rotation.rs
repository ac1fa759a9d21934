//! Predicts the standard deviation of a rotation, and its price for the displacement of a pivot.
//!
//! `N` points are spread evenly over a flat target that faces the cameras. It moves by the small
//! displacement `d` of its middle `M` and by the small rotation vector `φ`, so that a point at `P`
//! has in each camera the flow of [`super::sigma`]:
//!
//! ```text
//! v = g (D_xy - ξ D_z)        D = d + φ × (P - M)
//! ```
//!
//! The rows `A` of these two times three equations have six columns instead of three, and the
//! covariance of `(d, φ)` is formed as that of a displacement alone, with the same variance
//! inflation factor. The displacement of a pivot at `M + a` is `d + φ × a`. The means of
//! polynomials of the fourth degree over a rectangle are computed exactly from nine Gauss points.
//!
//! For equal focal lengths that is the Cramér-Rao bound of small motions, which the pose estimator
//! reaches ([`trinocular_core::estimate::pose`]).

use nalgebra::{Matrix3, Matrix3x6, Matrix6, Vector3};
use serde::Serialize;
use trinocular_core::estimate::pose::LEAST_POINTS;
use trinocular_core::rig::Rig;
use trinocular_rig::pivot::Pivot;
use trinocular_vision::field_of_view::Rectangle;

use super::sigma::{Predictor, flow_rows, spoilt};

/// Distances of pivots right of the target's middle, mm.
const BESIDE_MM: [f64; 2] = [50.0, 100.0];

/// Predictions for a target at one depth whose rotation is estimated. Standard deviations are per
/// number of points, `None` below three points.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RotationBudget {
    /// Width and height of the target, mm.
    pub target_mm: [f64; 2],
    /// Standard deviation of the rotation about each axis, degrees.
    pub rotation_sigma_deg: Vec<Option<[f64; 3]>>,
    /// Standard deviation of the displacement if no rotation is estimated, mm.
    pub without_rotation_sigma_mm: Vec<Option<[f64; 3]>>,
    /// Displacement of the target's points.
    pub pivots: Vec<PivotBudget>,
}

/// Prediction of the displacement of one pivot.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PivotBudget {
    /// Name of the pivot.
    pub name: String,
    /// Place of the pivot, mm.
    pub place_mm: [f64; 3],
    /// Standard deviation of its displacement, mm.
    pub sigma_mm: Vec<Option<[f64; 3]>>,
}

impl RotationBudget {
    /// Predicts a target at `depth_mm` for numbers of points. `pivot` is that of the rig file.
    /// Returns `None` if such a target determines no rotation.
    pub fn of(
        rig: &Rig,
        (target, depth_mm): (&Rectangle, f64),
        (noise_px, points): (f64, &[u32]),
        pivot: Option<Pivot>,
    ) -> Option<Self> {
        let predictor = PosePredictor::new(rig, target, depth_mm, noise_px)?;
        let still = Predictor::over(rig, target, depth_mm, noise_px)?;
        // The variance inflation factor over the number of points that fit.
        let factor = |points: u32| {
            let used = points.min(still.room_for());
            (used as usize >= LEAST_POINTS)
                .then(|| still.predict(points).widening / f64::from(used))
        };
        let factors: Vec<Option<f64>> = points.iter().map(|n| factor(*n)).collect();
        let each = |predict: &dyn Fn(f64) -> [f64; 3]| {
            factors.iter().map(|factor| factor.map(predict)).collect()
        };
        let pivots = pivots(predictor.middle_mm, depth_mm, pivot);
        Some(Self {
            target_mm: target.sides(),
            rotation_sigma_deg: each(&|factor| predictor.rotation_sigma_deg(factor)),
            without_rotation_sigma_mm: points
                .iter()
                .zip(&factors)
                .map(|(n, factor)| factor.map(|_| still.predict(*n).sigma_mm))
                .collect(),
            pivots: pivots
                .into_iter()
                .map(|(name, place_mm)| PivotBudget {
                    name,
                    place_mm,
                    sigma_mm: each(&|factor| predictor.pivot_sigma_mm(place_mm, factor)),
                })
                .collect(),
        })
    }
}

/// Returns the pivots of a target with this middle: names and places, mm. The rig file's is the
/// last, if it has one beside the centroid.
fn pivots(middle_mm: [f64; 3], depth_mm: f64, own: Option<Pivot>) -> Vec<(String, [f64; 3])> {
    let [x, y, z] = middle_mm;
    let mut pivots = vec![("centroid".to_owned(), middle_mm)];
    pivots.extend(BESIDE_MM.map(|beside| (format!("{beside} mm beside"), [x + beside, y, z])));
    match own {
        Some(Pivot::Place(place_mm)) => pivots.push(("pivot of the rig file".to_owned(), place_mm)),
        Some(Pivot::Spot(laser)) => {
            let along = (depth_mm - laser.from_mm[2]) / laser.direction[2];
            let spot_mm = [0, 1, 2].map(|i| laser.from_mm[i] + along * laser.direction[i]);
            pivots.push(("spot".to_owned(), spot_mm));
        }
        Some(Pivot::Centroid) | None => {}
    }
    pivots
}

/// Information of one point about the pose of a flat target at a depth.
#[derive(Clone, Debug, PartialEq)]
pub struct PosePredictor {
    /// Covariance of the displacement of the middle, mm, and of the rotation, rad, from one point,
    /// averaged over the target.
    covariance: Matrix6<f64>,
    /// Middle of the target, mm.
    middle_mm: [f64; 3],
}

impl PosePredictor {
    /// Creates a predictor for points on the rectangle `target` at `depth_mm`, whose flow has noise
    /// of `noise_px` (standard deviation of each component in each camera). Returns `None` if they
    /// determine no rotation.
    pub fn new(rig: &Rig, target: &Rectangle, depth_mm: f64, noise_px: f64) -> Option<Self> {
        let [x, y] = [0, 1].map(|i| 0.5 * (target.low[i] + target.high[i]));
        let middle_mm = [x, y, depth_mm];
        let (mut normal, mut noisy) = (Matrix6::zeros(), Matrix6::zeros());
        for ([x, y], share) in gauss_points(target) {
            let motion = motion([x, y, depth_mm], middle_mm);
            for camera in &rig.cameras {
                let rows = flow_rows(camera, [x, y], depth_mm);
                let all = rows * motion;
                normal += share * all.transpose() * all;
                noisy += share * all.transpose() * (spoilt(&rows, camera, noise_px) * motion);
            }
        }
        let inverse = normal.try_inverse()?;
        let covariance = inverse * noisy * inverse;
        let is_usable = covariance.iter().all(|n| n.is_finite());
        is_usable.then_some(Self {
            covariance,
            middle_mm,
        })
    }

    /// Returns the standard deviation of the rotation about each axis, degrees. `factor` is 1 over
    /// the number of independent points.
    pub fn rotation_sigma_deg(&self, factor: f64) -> [f64; 3] {
        [3, 4, 5].map(|i| (factor * self.covariance[(i, i)]).sqrt().to_degrees())
    }

    /// Returns the standard deviation of the displacement of the target's point at `place_mm`, mm.
    pub fn pivot_sigma_mm(&self, place_mm: [f64; 3], factor: f64) -> [f64; 3] {
        let motion = motion(place_mm, self.middle_mm);
        let covariance: Matrix3<f64> = motion * self.covariance * motion.transpose();
        [0, 1, 2].map(|i| (factor * covariance[(i, i)]).sqrt())
    }
}

/// Returns the derivative of the displacement of a place by `(d, φ)`.
fn motion(place_mm: [f64; 3], middle_mm: [f64; 3]) -> Matrix3x6<f64> {
    let arm = Vector3::from(place_mm) - Vector3::from(middle_mm);
    let mut motion = Matrix3x6::identity();
    let turn = -arm.cross_matrix();
    motion.fixed_view_mut::<3, 3>(0, 3).copy_from(&turn);
    motion
}

/// Returns the nine Gauss points of a rectangle with their shares: the mean of any polynomial of up
/// to the fifth degree is exact.
fn gauss_points(rectangle: &Rectangle) -> [([f64; 2], f64); 9] {
    let nodes = [
        (-0.6f64.sqrt(), 5.0 / 18.0),
        (0.0, 8.0 / 18.0),
        (0.6f64.sqrt(), 5.0 / 18.0),
    ];
    let place = |i: usize, node: f64| {
        let middle = 0.5 * (rectangle.low[i] + rectangle.high[i]);
        middle + node * 0.5 * rectangle.sides()[i]
    };
    core::array::from_fn(|n| {
        let [(x, across), (y, down)] = [nodes[n / 3], nodes[n % 3]];
        ([place(0, x), place(1, y)], across * down)
    })
}

#[cfg(test)]
mod tests;
