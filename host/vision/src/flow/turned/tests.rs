//! Rendered posters that turn and move at once.

use crate::flow::{Flow, FlowRefusal, FlowSettings};
use crate::images::{Exposure, FrameSet, Pose, Scene, SceneSettings, Texture};
use nalgebra::{Rotation3, Vector3};
use trinocular_core::estimate::pose::Estimate;
use trinocular_core::rig::Rig;
use trinocular_rig::random::Random;

/// The posters' origin at the keyframe, mm.
const PIVOT_MM: [f64; 3] = [0.0, 0.0, 850.0];

fn frame_set(scene: &Scene, relative_mm: [f64; 3], turned_deg: [f64; 3], seed: u64) -> FrameSet {
    let pose = Pose {
        relative_mm,
        turned_deg,
    };
    let exposures = vec![Exposure::of(pose, scene.settings().noise_grey); scene.cameras()];
    scene.render_exposures(&exposures, seed * 33_333, seed)
}

/// Returns the error of displacement, mm, and rotation, degrees.
fn error(pose: &Estimate, moved_mm: [f64; 3], turned_deg: [f64; 3]) -> [f64; 6] {
    let moved = pose.displacement_of(PIVOT_MM).displacement_mm;
    let truth = Rotation3::new(Vector3::from(turned_deg.map(f64::to_radians)));
    let got = Rotation3::new(Vector3::from(pose.rotation_rad()));
    let off = (got * truth.inverse()).scaled_axis().map(f64::to_degrees);
    let [x, y, z] = [0, 1, 2].map(|i| moved[i] - moved_mm[i]);
    [x, y, z, off.x, off.y, off.z]
}

/// Measures turns about one axis, degrees, and returns the mean squared errors over their stated
/// variances.
fn sweep(axis: [f64; 3], angles_deg: &[f64], textures: u64) -> [f64; 6] {
    let rig = Rig::paper();
    let (mut normalised, mut count) = ([0.0; 6], 0.0);
    let mut random = Random::seeded(9);
    for seed in 1..=textures {
        let texture = Texture::natural(seed);
        let scene = Scene::new(&rig, &texture, SceneSettings::default()).unwrap();
        let mut flow = Flow::new(&rig, FlowSettings::default()).unwrap();
        let keyframe = frame_set(&scene, [0.0; 3], [0.0; 3], 100 * seed);
        flow.set_keyframe(&keyframe).unwrap();
        for (i, degrees) in angles_deg.iter().enumerate() {
            let moved = [6.0, 6.0, 10.0].map(|most| random.between(-most, most));
            let turned = axis.map(|a| a * degrees);
            let now = frame_set(&scene, moved, turned, 100 * seed + 1 + i as u64);
            let seen = flow.measure_pose(&now);
            let seen = seen.unwrap_or_else(|refusal| panic!("{axis:?} {degrees}: {refusal}"));
            let off = error(&seen.pose, moved, turned);
            let [x, y, z] = seen.pose.displacement_of(PIVOT_MM).sigma_mm();
            let [a, b, c] = seen.pose.rotation_sigma_deg();
            for (i, sigma) in [x, y, z, a, b, c].into_iter().enumerate() {
                normalised[i] += (off[i] / sigma).powi(2);
                let limit = [0.012, 0.012, 0.04, 0.03, 0.03, 0.01][i];
                assert!(off[i].abs() < limit, "{axis:?} {degrees}: {off:?}");
            }
            count += 1.0;
        }
    }
    normalised.map(|sum| sum / count)
}

#[test]
fn turns_about_every_axis_are_measured() {
    let mut all = [0.0; 6];
    for axis in [
        [1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.577, 0.577, -0.577],
    ] {
        let normalised = sweep(axis, &[0.0, 0.5, 2.0, 5.0, 8.0, 12.0], 2);
        all = std::array::from_fn(|i| all[i] + normalised[i] / 4.0);
    }
    println!("error²/sigma² {all:.2?}");
    // Of 48 measurements with two keyframes, whose errors are common to half of them.
    assert!(all.iter().all(|ratio| *ratio < 2.5), "{all:?}");
    let mean = all.iter().sum::<f64>() / 6.0;
    assert!((0.5..1.5).contains(&mean), "{all:?}");
}

fn flow_of(rig: &Rig) -> Flow {
    Flow::new(rig, FlowSettings::default()).expect("the paper's rig")
}

#[test]
fn measurement_without_keyframe_is_refused() {
    let rig = Rig::paper();
    let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default()).unwrap();
    let mut flow = flow_of(&rig);
    let now = frame_set(&scene, [0.0; 3], [0.0; 3], 1);
    assert_eq!(flow.measure_pose(&now).err(), Some(FlowRefusal::NoKeyframe));
    assert_eq!(flow.keyframe_centroid_mm(), None);
}

#[test]
fn turn_beyond_search_is_lost() {
    let rig = Rig::paper();
    let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default()).unwrap();
    let mut flow = flow_of(&rig);
    flow.set_keyframe(&frame_set(&scene, [0.0; 3], [0.0; 3], 1))
        .unwrap();
    let far = frame_set(&scene, [0.0; 3], [0.0, 0.0, 40.0], 2);
    let refusal = flow.measure_pose(&far).err();
    assert!(
        matches!(refusal, Some(FlowRefusal::Lost { .. })),
        "{refusal:?}"
    );
}

#[test]
fn other_poster_is_lost() {
    let rig = Rig::paper();
    let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default()).unwrap();
    let mut flow = flow_of(&rig);
    flow.set_keyframe(&frame_set(&scene, [0.0; 3], [0.0; 3], 1))
        .unwrap();
    let other = Scene::new(&rig, &Texture::natural(2), SceneSettings::default()).unwrap();
    let refusal = flow
        .measure_pose(&frame_set(&other, [0.0; 3], [0.0; 3], 3))
        .err();
    assert!(
        matches!(refusal, Some(FlowRefusal::Lost { .. })),
        "{refusal:?}"
    );
}
