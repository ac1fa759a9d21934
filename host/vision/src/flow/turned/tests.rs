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

/// Returns the error in stated standard deviations.
fn normalised(pose: &Estimate, moved_mm: [f64; 3], turned_deg: [f64; 3]) -> [f64; 6] {
    let off = error(pose, moved_mm, turned_deg);
    let [x, y, z] = pose.displacement_of(PIVOT_MM).sigma_mm();
    let [a, b, c] = pose.rotation_sigma_deg();
    let sigma = [x, y, z, a, b, c];
    std::array::from_fn(|i| off[i] / sigma[i])
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
            // A jump: no pose was measured before.
            let seen = flow.clone().measure_pose(&now);
            let seen = seen.unwrap_or_else(|refusal| panic!("{axis:?} {degrees}: {refusal}"));
            let off = error(&seen.pose, moved, turned);
            let sigmas = self::normalised(&seen.pose, moved, turned);
            for i in 0..6 {
                normalised[i] += sigmas[i] * sigmas[i];
                let limit = [0.012, 0.012, 0.04, 0.03, 0.03, 0.01][i];
                assert!(off[i].abs() < limit, "{axis:?} {degrees}: {off:?}");
            }
            count += 1.0;
        }
    }
    normalised.map(|sum| sum / count)
}

/// Images of more pixels show the same turn as a larger motion. The same jumps are found in them,
/// and their errors are as small as they state.
#[test]
fn jumps_are_found_in_images_of_any_size() {
    for (times, largest_deg) in [(0.5, 0.3), (2.0, 0.02), (4.0, 0.01)] {
        let mut rig = Rig::paper();
        rig.image_size_px = rig
            .image_size_px
            .map(|side| (times * f64::from(side)) as u32);
        for camera in &mut rig.cameras {
            camera.focal_px = camera.focal_px.map(|px| times * px);
            camera.principal_px = camera.principal_px.map(|px| times * (px + 0.5) - 0.5);
        }
        let scene = Scene::new(&rig, &Texture::natural(2), SceneSettings::default()).unwrap();
        let mut flow = Flow::new(&rig, FlowSettings::default()).unwrap();
        let keyframe = frame_set(&scene, [0.0; 3], [0.0; 3], 1);
        flow.set_keyframe(&keyframe).unwrap();
        for (seed, turned) in [
            [1.0, -1.0, 0.7],
            [-6.0, 5.0, 11.0],
            [12.0, 0.0, -5.0],
            [0.0, 20.0, 0.0],
            [0.0, 0.0, -20.0],
        ]
        .into_iter()
        .enumerate()
        {
            let moved = [4.0, -3.0, 6.0];
            let now = frame_set(&scene, moved, turned, 2 + seed as u64);
            let seen = flow.clone().measure_pose(&now);
            let seen = seen.unwrap_or_else(|refusal| panic!("{times} {turned:?}: {refusal}"));
            let [_, _, _, x, y, z] = error(&seen.pose, moved, turned);
            let off = [x, y, z].map(f64::abs).into_iter().fold(0.0, f64::max);
            assert!(off < largest_deg, "{times} {turned:?}: {off} degrees");
            let sigmas = normalised(&seen.pose, moved, turned).map(f64::abs);
            assert!(
                sigmas.iter().all(|s| *s < 4.0),
                "{times} {turned:?}: {sigmas:?}"
            );
        }
    }
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

#[test]
fn jumps_of_20_degrees_are_measured() {
    let rig = Rig::paper();
    let mut sum = 0.0;
    for texture in 1..=3 {
        let scene = Scene::new(&rig, &Texture::natural(texture), SceneSettings::default());
        let scene = scene.unwrap();
        let mut flow = flow_of(&rig);
        flow.set_keyframe(&frame_set(&scene, [0.0; 3], [0.0; 3], texture))
            .unwrap();
        for axis in 0..3 {
            for degrees in [-20.0, 20.0] {
                let mut turned = [0.0; 3];
                turned[axis] = degrees;
                let moved = [6.0, -5.0, 9.0];
                let now = frame_set(&scene, moved, turned, 10 + texture);
                let seen = flow.clone().measure_pose(&now);
                let seen = seen.unwrap_or_else(|refusal| panic!("{turned:?}: {refusal}"));
                let sigmas = normalised(&seen.pose, moved, turned);
                let largest = sigmas.iter().fold(0.0, |most: f64, s| most.max(s.abs()));
                assert!(largest < 4.5, "{turned:?}: {sigmas:.1?}");
                sum += sigmas.iter().map(|s| s * s).sum::<f64>();
            }
        }
    }
    let mean = sum / (3.0 * 6.0 * 6.0);
    println!("error²/sigma² {mean:.2}");
    assert!((0.4..2.0).contains(&mean), "{mean}");
}

/// Follows a poster that turns about an axis step by step while it moves, and asserts that sigma
/// states the errors.
fn follow(axis: [f64; 3], angles_deg: &[f64]) {
    let rig = Rig::paper();
    let scene = Scene::new(&rig, &Texture::natural(3), SceneSettings::default()).unwrap();
    let mut flow = flow_of(&rig);
    flow.set_keyframe(&frame_set(&scene, [0.0; 3], [0.0; 3], 1))
        .unwrap();
    let (mut sum, mut largest) = (0.0, 0.0f64);
    for (i, degrees) in angles_deg.iter().enumerate() {
        let phase = i as f64 / 5.0;
        let moved = [
            5.0 * phase.sin(),
            4.0 * phase.cos(),
            6.0 * (2.0 * phase).sin(),
        ];
        let turned = axis.map(|a| a * degrees);
        let seen = flow.measure_pose(&frame_set(&scene, moved, turned, 2 + i as u64));
        let seen = seen.unwrap_or_else(|refusal| panic!("{axis:?} {degrees}: {refusal}"));
        for sigmas in normalised(&seen.pose, moved, turned) {
            sum += sigmas * sigmas;
            largest = largest.max(sigmas.abs());
        }
    }
    let mean = sum / (6.0 * angles_deg.len() as f64);
    println!("{axis:?}: error²/sigma² {mean:.2}, largest error {largest:.1} sigma");
    // All have the errors of one keyframe.
    assert!((0.4..2.0).contains(&mean) && largest < 4.5, "{axis:?}");
}

/// Two whole turns, by 9 degrees from one frame set to the next.
#[test]
fn rotation_table_is_followed_for_whole_turns() {
    let angles: Vec<f64> = (1..=80).map(|i| 9.0 * f64::from(i)).collect();
    follow([0.0, 0.0, 1.0], &angles);
}

#[test]
fn target_that_tilts_is_followed_to_40_degrees() {
    let angles: Vec<f64> = (1..=10).map(|i| 4.0 * f64::from(i)).collect();
    for axis in [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.7, -0.7, 0.1],
    ] {
        follow(axis, &angles);
    }
}

/// A keyframe that is foreshortened is found from nothing up to 4 degrees only.
#[test]
fn foreshortened_target_is_followed() {
    let rig = Rig::paper();
    let scene = Scene::new(&rig, &Texture::natural(3), SceneSettings::default()).unwrap();
    let mut flow = flow_of(&rig);
    let tilted = |degrees, seed| frame_set(&scene, [0.0; 3], [degrees, 0.0, 0.0], seed);
    flow.set_keyframe(&tilted(30.0, 1)).unwrap();
    for step in 1..=6u32 {
        let turned = 2.0 * f64::from(step);
        let seen = flow.measure_pose(&tilted(30.0 + turned, 1 + u64::from(step)));
        let seen = seen.unwrap_or_else(|refusal| panic!("{turned}: {refusal}"));
        let off = error(&seen.pose, [0.0; 3], [turned, 0.0, 0.0]);
        assert!(off[3..].iter().all(|deg| deg.abs() < 0.05), "{off:?}");
    }
}

/// A target that is hidden for a while is found again near its last pose.
#[test]
fn turned_target_is_found_after_occlusion() {
    let rig = Rig::paper();
    let scene = Scene::new(&rig, &Texture::natural(3), SceneSettings::default()).unwrap();
    let other = Scene::new(&rig, &Texture::natural(5), SceneSettings::default()).unwrap();
    let mut flow = flow_of(&rig);
    let turned =
        |scene: &Scene, degrees: f64, seed| frame_set(scene, [0.0; 3], [0.0, 0.0, degrees], seed);
    flow.set_keyframe(&turned(&scene, 0.0, 1)).unwrap();
    for step in 1..=6 {
        flow.measure_pose(&turned(&scene, 8.0 * f64::from(step), 2))
            .unwrap();
    }
    // One that takes over in between measures the same, bit for bit.
    let mut later = flow_of(&rig);
    later.set_keyframe(&turned(&scene, 0.0, 1)).unwrap();
    later.set_last_pose(flow.last_pose());
    let both = [&mut flow.clone(), &mut later].map(|flow| {
        let seen = flow.measure_pose(&turned(&scene, 50.0, 7)).unwrap();
        (seen.pose, seen.correspondences)
    });
    assert_eq!(both[0], both[1]);
    assert!(flow.measure_pose(&turned(&other, 0.0, 3)).is_err());
    let seen = flow.measure_pose(&turned(&scene, 51.0, 4)).unwrap();
    let [.., z] = seen.pose.rotation_deg();
    assert!((z - 51.0).abs() < 0.01, "{z}");
    // A new keyframe begins anew.
    flow.set_keyframe(&turned(&scene, 51.0, 5)).unwrap();
    let seen = flow.measure_pose(&turned(&scene, 51.0, 6)).unwrap();
    assert!(seen.pose.rotation_deg()[2].abs() < 0.01);
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
