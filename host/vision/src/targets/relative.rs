//! Motion of a target relative to the reference target.

use crate::estimation::{Solution, Turn};
use crate::flow::offered::SIGNIFICANT;
use nalgebra::{Matrix3, Rotation3, Vector3};
use trinocular_core::estimate::pose::Estimate;

/// Returns the motion of a target relative to the reference, whose pose is `pose` if its rotation
/// was estimated. `centroid_mm` is the mean of the target's points at the keyframe: the pivot of a
/// target whose rotation was not.
///
/// Without rotations it is the difference of the displacements. Otherwise it is the motion in axes
/// that are fixed to the reference, of which `R` is the rotation and `d_r(p)` the displacement that
/// the target's pivot `p` would have if it were part of the reference:
///
/// ```text
/// d = Rᵀ (d_t - d_r(p)),   C = Rᵀ (C_t + C_r(p)) R,   R' = Rᵀ R_t
/// ```
///
/// The two are measured with different points, so that their errors are independent.
pub(super) fn relative(
    target: &Solution,
    reference: &Solution,
    pose: Option<Estimate>,
    centroid_mm: Option<[f64; 3]>,
) -> Solution {
    let own_mm = target.turn.and_then(|turn| turn.pivot_mm);
    let (Some(pose), Some(pivot_mm)) = (pose, own_mm.or(centroid_mm)) else {
        return difference(target, reference);
    };
    let axes = Rotation3::from_scaled_axis(Vector3::from(pose.rotation_rad())).inverse();
    let carried = pose.displacement_of(pivot_mm);
    let moved = Vector3::from(target.displacement_mm) - Vector3::from(carried.displacement_mm);
    let covariance_mm2 = target
        .covariance_mm2
        .map(|covariance| turned(&axes, matrix(covariance) + matrix(carried.covariance_mm2)));
    solution(
        target,
        (axes * moved).into(),
        covariance_mm2,
        target.turn.map(|turn| relative_turn(&axes, turn, &pose)),
    )
}

/// Returns the difference of two displacements without rotation.
fn difference(target: &Solution, other: &Solution) -> Solution {
    let moved = [0, 1, 2].map(|i| target.displacement_mm[i] - other.displacement_mm[i]);
    let covariances = target.covariance_mm2.zip(other.covariance_mm2);
    let covariance_mm2 = covariances.map(|(a, b)| rows(matrix(a) + matrix(b)));
    solution(target, moved, covariance_mm2, target.turn)
}

fn solution(
    target: &Solution,
    displacement_mm: [f64; 3],
    covariance_mm2: Option<[[f64; 3]; 3]>,
    turn: Option<Turn>,
) -> Solution {
    let sigma_mm = covariance_mm2.map(|rows| [0, 1, 2].map(|i: usize| rows[i][i].sqrt()));
    Solution {
        displacement_mm,
        sigma_mm,
        covariance_mm2,
        turn,
        ..*target
    }
}

/// Returns the rotation of the target in the axes of the reference.
fn relative_turn(axes: &Rotation3<f64>, turn: Turn, reference: &Estimate) -> Turn {
    let Some(rotation_deg) = turn.rotation_deg else {
        return turn;
    };
    let rotation = Rotation3::from_scaled_axis(Vector3::from(rotation_deg.map(f64::to_radians)));
    let rotation = (axes * rotation).scaled_axis();
    let others = turned(axes, matrix(reference.rotation_covariance_rad2()));
    let sigma_deg = turn.rotation_sigma_deg.map(|sigma_deg| {
        [0, 1, 2].map(|i: usize| sigma_deg[i].hypot(others[i][i].sqrt().to_degrees()))
    });
    let squares = sigma_deg.map(|sigma_deg| {
        let ratios = [0, 1, 2].map(|i| (rotation[i].to_degrees() / sigma_deg[i]).powi(2));
        ratios.iter().sum::<f64>()
    });
    Turn {
        rotation_deg: Some([0, 1, 2].map(|i| rotation[i].to_degrees())),
        rotation_sigma_deg: sigma_deg,
        is_significant: squares.is_none_or(|squares| squares > SIGNIFICANT),
        ..turn
    }
}

fn matrix(rows: [[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| rows[i][j])
}

fn rows(matrix: Matrix3<f64>) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| matrix[(i, j)]))
}

/// Returns a covariance in turned axes.
fn turned(axes: &Rotation3<f64>, covariance: Matrix3<f64>) -> [[f64; 3]; 3] {
    rows(axes * covariance * axes.inverse())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small target whose rotation is not determined, on a reference that tilts by 0.6 degrees.
    #[test]
    fn target_without_rotation_follows_reference() {
        let centroid_mm = [80.0, 0.0, 850.0];
        let omega = [0.0, 0.3f64.to_radians().tan(), 0.0];
        let pose = Estimate::exact(omega, [0.0, 0.0, 850.0], [1.0, 2.0, 3.0]);
        let at = |place_mm| Solution {
            displacement_mm: pose.displacement_of(place_mm).displacement_mm,
            sigma_mm: None,
            covariance_mm2: Some([[1e-6, 0.0, 0.0], [0.0, 1e-6, 0.0], [0.0, 0.0, 1e-6]]),
            points: 20,
            turn: Some(Turn::default()),
        };
        let (target, reference) = (at(centroid_mm), at([0.0, 0.0, 850.0]));
        let moved = relative(&target, &reference, Some(pose), Some(centroid_mm));
        assert!(
            moved.displacement_mm.iter().all(|mm| mm.abs() < 1e-9),
            "{moved:?}"
        );
        assert_eq!(moved.turn, target.turn);
        // The reference moves by 0.8 mm less in z.
        let apart = difference(&target, &reference).displacement_mm[2];
        assert!((apart.abs() - 0.84).abs() < 0.01, "{apart}");
    }
}
