//! A rig whose cameras are rotated by a degree or two measures like a parallel one if its file
//! states the rotations.

use trinocular_core::rig::{Rig, Rotation};
use trinocular_vision::flow::{Correspondence, Flow, FlowSettings};
use trinocular_vision::images::{Scene, SceneSettings, Texture};
use trinocular_vision::sums::Sums;

const TURNED_DEG: [[f64; 3]; 3] = [[1.0, -2.0, 1.5], [-0.5, 0.7, -1.0], [0.4, 1.8, 2.0]];
const MOVES_MM: [[f64; 3]; 4] = [
    [4.0, 4.0, 1.0],
    [10.0, -5.0, 0.0],
    [0.0, 0.0, 7.0],
    [-12.0, 8.0, -4.0],
];
/// Largest error of a displacement, mm: the project's bound for a parallel rig.
const TOLERANCE_MM: [f64; 3] = [0.02, 0.02, 0.05];

fn turned_rig() -> Rig {
    let mut rig = Rig::paper();
    for (camera, degrees) in rig.cameras.iter_mut().zip(TURNED_DEG) {
        camera.rotation = Rotation::from_degrees(degrees);
    }
    rig
}

fn displacement(rig: &Rig, points: &[Correspondence]) -> [f64; 3] {
    let sums = Sums::new(rig, points).expect("a rig of three cameras");
    sums.estimates()
        .midpoint
        .expect("points enough")
        .displacement_mm
}

fn largest(error: [f64; 3]) -> f64 {
    error.iter().fold(0.0, |most, e| e.abs().max(most))
}

#[test]
fn exact_points_give_exact_result() {
    let rig = turned_rig();
    let points = [
        [0.0, 0.0, 900.0],
        [60.0, -50.0, 800.0],
        [-70.0, 55.0, 1000.0],
        [40.0, 65.0, 950.0],
        [-30.0, -60.0, 850.0],
    ];
    for moved in MOVES_MM {
        let seen = points.map(|point| {
            let now = [0, 1, 2].map(|i| point[i] + moved[i]);
            let cameras = rig.cameras.iter();
            let pixels = cameras.map(|camera| [camera.project(point), camera.project(now)]);
            pixels.collect::<Vec<_>>()
        });
        let error = |rig: &Rig| {
            let points = seen
                .clone()
                .map(|pixels| Correspondence::from_pixels(rig, pixels));
            let got = displacement(rig, &points);
            largest([0, 1, 2].map(|i| got[i] - moved[i]))
        };
        assert!(error(&rig) < 1e-9, "{moved:?}: {} mm", error(&rig));
        // Control: treated as parallel, the same cameras are wrong by a good part of a millimetre.
        assert!(
            error(&Rig::paper()) > 0.1,
            "{moved:?}: {} mm",
            error(&Rig::paper())
        );
    }
}

#[test]
fn rectified_rig_measures_like_parallel() {
    for (rig, what) in [(Rig::paper(), "parallel"), (turned_rig(), "turned")] {
        let scene =
            Scene::new(&rig, &Texture::natural(4), SceneSettings::default()).expect("a scene");
        let mut flow = Flow::new(&rig, FlowSettings::default()).expect("a rig of three cameras");
        flow.set_keyframe(&scene.render([0.0; 3], 0, 1))
            .expect("rich texture");
        for (moved, seed) in MOVES_MM.into_iter().zip(2..) {
            let seen = flow
                .measure(&scene.render(moved, seed, seed))
                .unwrap_or_else(|refusal| panic!("{what}: {refusal}"));
            let got = displacement(&rig, &seen.correspondences);
            let error = [0, 1, 2].map(|i| got[i] - moved[i]);
            let is_right = (0..3).all(|i| error[i].abs() <= TOLERANCE_MM[i]);
            assert!(
                is_right,
                "{what}: {error:?} mm off {moved:?}, {} points",
                seen.correspondences.len()
            );
        }
    }
}
