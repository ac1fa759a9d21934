//! Cameras that are turned about their optical axes: upside down, upright, and between.

use super::super::board::Board;
use super::super::rig::{self, Instant, RigCamera};
use super::super::stand::{self, CameraPose};
use super::{KEEP, LENS, NOISE_PX, SIZE_PX, corners, found, pose, standing};
use crate::calibration::intrinsics;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use trinocular_rig::random::Random;

const PLACES: [[f64; 3]; 3] = [[0.0; 3], [60.0, 0.0, 0.0], [120.0, 0.0, 0.0]];

/// Returns cameras in line with these rolls, degrees, and small rotations about the other axes.
fn in_line(rolls_deg: &[f64]) -> Vec<CameraPose> {
    let turn = |(k, roll): (usize, &f64)| [0.3 * k as f64, -0.2, *roll];
    let turns: Vec<[f64; 3]> = rolls_deg.iter().enumerate().map(turn).collect();
    let places = &PLACES[..rolls_deg.len()];
    stand::stands(&stand::numbers(&standing(places, &turns)))
}

/// Returns the difference of two angles, degrees, -180 to 180.
fn difference_deg(a: f64, b: f64) -> f64 {
    (a - b + 540.0).rem_euclid(360.0) - 180.0
}

#[test]
fn rolled_cameras_keep_their_line() {
    for (rolls, expected) in [
        (&[0.0, 180.0][..], &[0.0, 180.0][..]),
        (&[180.0, 0.0], &[0.0, 180.0]),
        (&[0.0, 90.0], &[0.0, 90.0]),
        (&[0.0, -90.0], &[0.0, -90.0]),
        (&[90.0, -90.0], &[90.0, -90.0]),
        (&[0.0, 135.0], &[0.0, 135.0]),
        (&[0.0, 180.0, 0.0], &[0.0, 180.0, 0.0]),
        (&[180.0, 0.0, 180.0], &[0.0, 180.0, 0.0]),
        (&[0.0, 90.0, 180.0], &[0.0, 90.0, 180.0]),
        (&[0.0, 0.0, 90.0], &[0.0, 0.0, 90.0]),
        (&[180.0, 180.0, 180.0], &[0.0, 0.0, 0.0]),
    ] {
        let stands = in_line(rolls);
        for ((stand, roll), place) in stands.iter().zip(expected).zip(PLACES) {
            let [x, y, z] = stand.offset_mm;
            assert!(y.abs() < 1e-9 && z.abs() < 1e-9, "{rolls:?}: {stands:?}");
            assert!((x.abs() - place[0]).abs() < 1e-9, "{rolls:?}: {stands:?}");
            let off = difference_deg(stand.rotation_deg[2], *roll);
            assert!(off.abs() < 1.0, "{rolls:?}: {stands:?}");
        }
    }
}

/// Tests that the axes of cameras in two directions exist whatever their rolls.
#[test]
fn rolled_cameras_in_a_square_have_axes() {
    let places = [
        [0.0; 3],
        [60.0, 0.0, 0.0],
        [0.0, 50.0, 0.0],
        [60.0, 50.0, 0.0],
    ];
    let turns = [0.0, 180.0, 90.0, -90.0].map(|roll| [0.0, 0.0, roll]);
    let stands = stand::stands(&stand::numbers(&standing(&places, &turns)));
    for (stand, (place, [_, _, roll])) in stands.iter().zip(places.iter().zip(turns)) {
        assert!((stand.offset_mm[0] - place[0]).abs() < 1e-9, "{stands:?}");
        assert!((stand.offset_mm[1] - place[1]).abs() < 1e-9, "{stands:?}");
        let off = difference_deg(stand.rotation_deg[2], roll);
        assert!(off.abs() < 1e-9, "{stands:?}");
    }
}

/// Tests boards that look the same after a turn and are numbered from any end in any image.
#[test]
fn rolled_cameras_see_boards_of_any_symmetry() {
    for (corners_of_board, rolls) in [
        ([9, 6], [0.0, 180.0]),
        ([7, 5], [0.0, 180.0]),
        ([7, 5], [0.0, 90.0]),
        ([6, 6], [0.0, 180.0]),
        ([6, 6], [90.0, 0.0]),
        ([6, 6], [0.0, 45.0]),
        ([7, 5], [0.0, 0.0]),
    ] {
        let board = Board {
            corners: corners_of_board,
            square_mm: 25.0,
        };
        let mut random = Random::new(13, 0);
        let turns = rolls.map(|roll| [0.4, -0.3, roll]);
        let motions = standing(&PLACES[..2], &turns);
        let first = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), rolls[0].to_radians());
        let instants: Vec<Instant> = (0..10)
            .map(|number| {
                let pose = first * pose(&mut random);
                let seen = |(camera, motion): (usize, &Isometry3<f64>)| {
                    let named = corners(&board, &LENS, &(motion * pose), NOISE_PX, &mut random);
                    let turns = board.symmetries();
                    let quarters = turns[(number * (camera + 1)) % turns.len()];
                    let mut seen = named.clone();
                    for (index, at) in named.into_iter().enumerate() {
                        seen[board.turned(index, quarters)] = at;
                    }
                    Some(seen)
                };
                motions.iter().enumerate().map(seen).collect()
            })
            .collect();
        let eye = |camera: usize| {
            let images: Vec<_> = instants.iter().filter_map(|i| i[camera].clone()).collect();
            let images: Vec<_> = images.into_iter().map(found).collect();
            let own = intrinsics::calibrate(&board, SIZE_PX, &images, KEEP).unwrap();
            RigCamera {
                lens: own.lens,
                covariance: own.covariance,
            }
        };
        let eyes: Vec<RigCamera> = (0..2).map(eye).collect();
        let solution = rig::calibrate(&board, &eyes, 0, &instants, KEEP).unwrap();
        let case = format!("{corners_of_board:?} {rolls:?}");
        assert!(solution.rms_px < 2.0 * NOISE_PX, "{case}: {solution:?}");
        let (baseline, sigma) = solution.baseline_mm(1);
        let off_mm = (baseline - 60.0).abs();
        assert!(
            off_mm < 4.0 * sigma && sigma < 0.5,
            "{case}: {off_mm} {sigma}"
        );
        let [a, b] = [0, 1].map(|k| solution.stands[k].rotation_deg[2]);
        let roll = difference_deg(b, a);
        let off = difference_deg(roll, rolls[1] - rolls[0]);
        assert!(off.abs() < 1.0, "{case}: {:?}", solution.stands);
    }
}
