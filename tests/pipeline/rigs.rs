//! Rigs other than the paper's: the midpoint takes any cameras in a plane.

use trinocular_core::rig::{Camera, Rig};
use trinocular_vision::images::{SceneSettings, Texture};

use super::bench::{Bench, TOLERANCE_MM};

const MOVES_MM: [[f64; 3]; 4] = [
    [10.0, 10.0, 0.0],
    [0.0, 0.0, 7.0],
    [-15.0, 8.0, 2.0],
    [4.0, 4.0, 1.0],
];

/// Returns cameras of the paper's kind at the given positions, all slightly different.
fn rig(offsets_mm: &[[f64; 2]]) -> Rig {
    let mut rig = Rig::paper();
    let camera = |(i, offset_mm): (usize, &[f64; 2])| {
        let turn = i as f64;
        Camera {
            focal_px: [531.0 + 2.0 * turn, 529.0 + turn],
            principal_px: [158.0 + 4.0 * turn, 122.0 - 3.0 * turn],
            offset_mm: *offset_mm,
            ..rig.cameras[0]
        }
    };
    rig.cameras = offsets_mm.iter().enumerate().map(camera).collect();
    rig
}

#[track_caller]
fn assert_measures(rig: Rig, what: &str) {
    let bench = Bench::with_rig(rig, &Texture::natural(4), SceneSettings::default());
    for (moved, got) in MOVES_MM.into_iter().zip(bench.measure_all(&MOVES_MM, 4)) {
        let got = got.unwrap_or_else(|refusal| panic!("{what}: {refusal}"));
        got.assert_within(moved, TOLERANCE_MM, what);
    }
}

#[test]
fn two_cameras_are_enough() {
    assert_measures(rig(&[[-45.0, 0.0], [45.0, 0.0]]), "two side by side");
    assert_measures(rig(&[[0.0, -40.0], [0.0, 40.0]]), "two upon each other");
}

#[test]
fn five_cameras_in_a_cross_measure() {
    let cross = [
        [0.0, 0.0],
        [-60.0, 0.0],
        [60.0, 0.0],
        [0.0, -50.0],
        [0.0, 50.0],
    ];
    assert_measures(rig(&cross), "cross");
}

/// `verify` warns of this: half of the points are matched if one camera magnifies 1.3 times as much
/// as another, and nearly none at 1.7.
#[test]
fn unlike_focal_lengths_have_a_limit() {
    let measured = |times: f64| {
        let mut rig = Rig::paper();
        rig.cameras[0].focal_px = rig.cameras[0].focal_px.map(|f| times * f);
        let bench = Bench::with_rig(rig, &Texture::natural(4), SceneSettings::default());
        bench.measure_all(&MOVES_MM[3..], 4).remove(0)
    };
    let got = measured(1.3).expect("enough points");
    got.assert_within(MOVES_MM[3], TOLERANCE_MM, "1.3 times");
    let Err(refusal) = measured(1.7) else {
        panic!("1.7 times is not too much");
    };
    assert!(refusal.to_string().contains("too few matches"), "{refusal}");
}
