//! Roll of cameras about their own axes: estimate from the slopes of the residuals, and correction
//! of the rig.
//!
//! A camera that is rolled by `φ` sees a point at `R_z(φ) x` instead of `x`, so the residual across
//! the line of cameras grows along the line, by `φ` per unit. The rig file's `rotation_deg` undoes
//! the roll exactly: with the camera's rotation `R` so far, the new one is `R R_z(φ)`.
//!
//! Only the roll against the reference camera shows. A roll that is common to all cameras rotates
//! the rig's axes, but no camera against another.

use nalgebra::{Matrix3, Rotation3, Vector3};
use trinocular_core::rig::{Camera, Rig, Rotation};

use super::fit::RollFit;

/// Least significant roll, in standard deviations. By chance, one camera in 370 is corrected, by
/// the smallest roll that can be measured.
pub const SIGNIFICANT: f64 = 3.0;

/// Least further roll of a camera that was corrected before, in standard deviations. The first
/// matching may have missed the ends of the image rows.
const SETTLED: f64 = 0.5;

/// Returns the correction of a camera's roll, rad; `None` if the roll may be zero.
fn to_undo(turn: Option<RollFit>, turned_rad: f64) -> Option<f64> {
    let [roll_rad, sigma] = turn?.roll_rad;
    let limit = if turned_rad == 0.0 {
        SIGNIFICANT
    } else {
        SETTLED
    };
    (roll_rad.abs() > limit * sigma).then_some(roll_rad)
}

/// Returns the camera with its rotation corrected for a clockwise roll of `roll_rad`.
pub fn rolled(camera: &Camera, roll_rad: f64) -> Camera {
    let rows = camera.rotation.rows();
    let before = Matrix3::from_fn(|i, j| rows[i][j]);
    let roll = Rotation3::from_axis_angle(&Vector3::z_axis(), roll_rad);
    let turned = Rotation3::from_matrix_unchecked(before * roll.matrix());
    let [x, y, z] = turned.scaled_axis().map(f64::to_degrees).into();
    Camera {
        rotation: Rotation::from_degrees([x, y, z]),
        ..*camera
    }
}

/// Corrects every significant roll of the rig; `None` if there is none. `turned_rad` is the roll
/// corrected so far, per camera, and is updated.
pub fn undone(rig: &Rig, turns: &[Option<RollFit>], turned_rad: &mut [f64]) -> Option<Rig> {
    let mut turned: Option<Rig> = None;
    for (k, (turn, sum)) in turns.iter().zip(turned_rad).enumerate() {
        let Some(roll) = to_undo(*turn, *sum) else {
            continue;
        };
        if let Some(camera) = turned.get_or_insert_with(|| rig.clone()).cameras.get_mut(k) {
            *camera = rolled(camera, roll);
            *sum += roll;
        }
    }
    turned
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rolled_camera_turns_its_image() {
        let [roll, at] = [[0.02_f64, 0.0], [0.3, -0.1]];
        let mut camera = Rig::paper().cameras[0];
        camera.rotation = Rotation::from_degrees([1.0, -2.0, 0.5]);
        let seen = rolled(&camera, roll[0]).denormalise(at);
        let (sin, cos) = roll[0].sin_cos();
        let expected = camera.denormalise([cos * at[0] - sin * at[1], sin * at[0] + cos * at[1]]);
        assert!((seen[0] - expected[0]).hypot(seen[1] - expected[1]) < 1e-9);
    }

    #[test]
    fn insignificant_roll_is_ignored() {
        let turn = |roll_rad: f64| {
            Some(RollFit {
                roll_rad: [roll_rad, 0.001],
                scale: [0.0; 2],
            })
        };
        let rig = Rig::paper();
        let mut rolls = [0.0; 3];
        let small = [turn(0.002_9), None, turn(-0.002_9)];
        assert_eq!(undone(&rig, &small, &mut rolls), None);
        let turned = undone(&rig, &[turn(0.002), None, turn(-0.003_1)], &mut rolls).unwrap();
        assert_eq!(rolls, [0.0, 0.0, -0.003_1]);
        // A camera that was corrected once is corrected further by smaller rolls.
        let rest = undone(&turned, &small, &mut rolls).unwrap();
        assert!(rolls[0] == 0.0 && (rolls[2] + 0.006).abs() < 1e-12);
        assert_eq!(rest.cameras[0], rig.cameras[0]);
        assert_eq!(
            undone(&rest, &[None, None, turn(0.000_4)], &mut rolls),
            None
        );
        assert_eq!(turned.cameras[..2], rig.cameras[..2]);
        let [x, y, z] = turned.cameras[2].rotation.degrees();
        assert!(x.abs() + y.abs() < 1e-12 && (z.to_radians() + 0.003_1).abs() < 1e-12);
    }
}
