//! Flow from images to displacements.

use super::*;
use crate::images::{Folder, Scene, SceneSettings, Texture, TextureKind};
use crate::matching::Reject;
use std::path::Path;
use trinocular_core::estimate::midpoint::{self, Estimate};
use trinocular_core::rig::Camera;
use trinocular_core::sums::centred::CentredSums;
use trinocular_rig::random::Random;
use trinocular_rig::rig_file::RigFile;

/// Moves of the paper's Table 5, mm.
const MOVES: [[f64; 3]; 8] = [
    [10.0, 10.0, 0.0],
    [15.0, 15.0, 0.0],
    [20.0, 20.0, 0.0],
    [0.0, 0.0, 3.0],
    [0.0, 0.0, 5.0],
    [0.0, 0.0, 7.0],
    [15.0, 15.0, 2.0],
    [20.0, 20.0, 2.0],
];

fn estimate(rig: &Rig, measurement: &Measurement) -> Estimate {
    let mut sums = CentredSums::new(&measurement.rig(rig)).unwrap();
    for point in &measurement.correspondences {
        assert!(sums.add(&point.views));
    }
    midpoint::solve(&sums).unwrap()
}

/// Returns the error of the measured displacement, mm.
fn error(rig: &Rig, measurement: &Measurement, target: [f64; 3]) -> [f64; 3] {
    let found = estimate(rig, measurement).displacement_mm;
    std::array::from_fn(|i| found[i] - target[i])
}

/// Returns the standard deviation of the measured displacement, mm.
fn sigma_mm(rig: &Rig, measurement: &Measurement) -> [f64; 3] {
    let factor = measurement.variance_inflation.factor.sqrt();
    estimate(rig, measurement).sigma_mm().map(|mm| factor * mm)
}

/// Returns true if an error is within the bounds on rendered images, mm.
fn within(error: [f64; 3], xy: f64, z: f64) -> bool {
    error[0].abs() <= xy && error[1].abs() <= xy && error[2].abs() <= z
}

/// Returns a poster of this kind, square to the cameras.
fn poster(rig: &Rig, kind: TextureKind, depth_mm: f64, seed: u64) -> Scene {
    hung(rig, &Texture::of_kind(kind, seed), depth_mm, [0.0; 2])
}

fn hung(rig: &Rig, texture: &Texture, depth_mm: f64, tilt_rad: [f64; 2]) -> Scene {
    let settings = SceneSettings {
        depth_mm,
        tilt_rad,
        ..SceneSettings::default()
    };
    Scene::new(rig, texture, settings).unwrap()
}

/// Draws a wall in running bond whose bricks (56 x 24 mm) differ in shade by `variety` grey levels.
fn wall(variety: f64, seed: u64) -> Texture {
    const BRICKS: usize = 24;
    let mut random = Random::new(seed, 77);
    let shades: Vec<f64> = (0..BRICKS * 2 * BRICKS)
        .map(|_| 95.0 + variety * random.gaussian())
        .collect();
    let (width, height) = (BRICKS * 70, 2 * BRICKS * 30);
    let grey = (0..width * height)
        .map(|i| {
            let (x, course) = (i % width, i / width / 30);
            let shifted = (x + 35 * (course % 2)) % width;
            if shifted % 70 < 4 || i / width % 30 < 4 {
                return 200.0;
            }
            shades[course * BRICKS + shifted / 70].clamp(5.0, 250.0) as f32
        })
        .collect();
    Texture {
        width,
        height,
        mm_per_texel: 0.8,
        grey,
    }
}

/// Changes the light on a frame set.
fn lit(mut frame_set: FrameSet, factor: f64, offset: f64) -> FrameSet {
    for grey in frame_set.images.iter_mut().flat_map(|view| &mut view.grey) {
        *grey = (factor * f64::from(*grey) + offset).round() as u8;
    }
    frame_set
}

/// Creates a flow with the scene's frame set at zero displacement as its keyframe.
fn flow_with_keyframe(rig: &Rig, scene: &Scene, seed: u64) -> Result<Flow, FlowRefusal> {
    let mut flow = Flow::new(rig, FlowSettings::default())?;
    flow.set_keyframe(&scene.render([0.0; 3], 0, 1000 * seed))?;
    Ok(flow)
}

/// Prints the table with `--nocapture`.
#[test]
fn table_5_is_measured_to_20_um() {
    let rig = Rig::paper();
    // Clouds have a tenth of the leaves' gradients: noise alone is 0.03 mm in z.
    for (kind, z) in [(TextureKind::Natural, 0.05), (TextureKind::Blobs, 0.12)] {
        for seed in 0..3_u64 {
            let depth = 800.0 + 45.0 * seed as f64;
            let scene = poster(&rig, kind, depth, seed);
            let mut flow = flow_with_keyframe(&rig, &scene, seed).unwrap();
            for (i, target) in (1..).zip(MOVES) {
                let now = scene.render(target, 0, 1000 * seed + i);
                let measurement = flow.measure(&now).unwrap();
                let error = error(&rig, &measurement, target);
                println!(
                    "{kind} {depth} mm, {target:?}: error {error:+.4?} mm, {} points",
                    measurement.correspondences.len()
                );
                assert!(
                    within(error, 0.02, z),
                    "{kind} {seed} {target:?}: {error:?}"
                );
                assert!(measurement.correspondences.len() > 100);
            }
        }
    }
}

#[test]
fn repetition_is_measured_or_refused() {
    let rig = Rig::paper();
    let mut outcomes = [0; 2];
    let varieties = [0.0, 4.0, 15.0, 40.0].map(Some);
    for variety in varieties.into_iter().chain([None]) {
        for seed in 0..3_u64 {
            let texture = variety.map_or_else(Texture::grid, |variety| wall(variety, seed));
            let scene = hung(&rig, &texture, 800.0 + 33.3 * seed as f64, [0.0; 2]);
            let mut flow = match flow_with_keyframe(&rig, &scene, seed) {
                Ok(flow) => flow,
                Err(refusal) => {
                    let named = matches!(refusal, FlowRefusal::AmbiguousDepth { .. });
                    assert!(named, "{variety:?}: {refusal}");
                    outcomes[1] += 1;
                    continue;
                }
            };
            for (i, target) in (1..).zip([[10.0, 10.0, 0.0], [60.0, 0.0, 0.0], [0.0, 26.0, 5.0]]) {
                let now = scene.render(target, 0, 1000 * seed + i);
                match flow.measure(&now) {
                    Ok(measurement) => {
                        let error = error(&rig, &measurement, target);
                        // At half the resolution the sigma is larger; a wrong brick is 36 mm off.
                        let sigma = sigma_mm(&rig, &measurement);
                        let is_honest = (0..3).all(|i| error[i].abs() < 4.5 * sigma[i]);
                        assert!(
                            within(error, 0.05, 0.1) || (is_honest && within(error, 0.2, 0.8)),
                            "{variety:?} {seed} {target:?}: {error:?}, sigma {sigma:?}"
                        );
                        outcomes[0] += 1;
                    }
                    Err(refusal) => {
                        let named = matches!(refusal, FlowRefusal::AmbiguousMotion { .. });
                        assert!(named, "{variety:?}: {refusal}");
                        outcomes[1] += 1;
                    }
                }
            }
        }
    }
    println!("{} measured, {} refused", outcomes[0], outcomes[1]);
    assert!(
        outcomes[0] > 0 && outcomes[1] > 0,
        "both must occur: {outcomes:?}"
    );
}

#[test]
fn right_down_away_are_positive() {
    let rig = Rig::paper();
    let scene = poster(&rig, TextureKind::Natural, 850.0, 21);
    let mut flow = flow_with_keyframe(&rig, &scene, 21).unwrap();
    for axis in 0..3 {
        let mut target = [0.0; 3];
        target[axis] = 6.0;
        let measurement = flow.measure(&scene.render(target, 0, 5)).unwrap();
        let found = estimate(&rig, &measurement).displacement_mm;
        assert!((found[axis] - 6.0).abs() < 0.05, "{axis}: {found:?}");
        // Back to the keyframe.
        let measurement = flow.measure(&scene.render([0.0; 3], 0, 6)).unwrap();
        let found = estimate(&rig, &measurement).displacement_mm;
        assert!(found.iter().all(|t| t.abs() < 0.05), "{axis}: {found:?}");
    }
}

/// Tests photographs: every pair of frame sets, so both kinds of keyframe. Prints the table with
/// `--nocapture`.
#[test]
fn teddy_moves_by_camera_steps() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/images/teddy");
    let file = RigFile::read(&folder.join("rig.toml")).unwrap();
    let rig = &file.rig;
    let frame_sets: Vec<FrameSet> = Folder::open(&folder, &file.names, rig.image_size_px, 33_333)
        .unwrap()
        .frame_sets()
        .map(Result::unwrap)
        .collect();
    let mut flow = Flow::new(rig, FlowSettings::default()).unwrap();
    for from in 0..frame_sets.len() - 1 {
        flow.set_keyframe(&frame_sets[from]).unwrap();
        for (to, frame_set) in frame_sets.iter().enumerate().skip(from + 1) {
            let measurement = flow.measure(frame_set).unwrap();
            let target = [from as f64 - to as f64, 0.0, 0.0];
            let error = error(rig, &measurement, target);
            println!(
                "{from} to {to}: error {error:+.4?} steps, {} points",
                measurement.correspondences.len()
            );
            let tolerance = [0.04, 0.03, 0.05];
            assert!(
                (0..3).all(|i| error[i].abs() <= tolerance[i]),
                "{from} to {to}: {error:?}"
            );
        }
    }
}

#[test]
fn light_and_hand_change_nothing() {
    let rig = Rig::paper();
    let scene = poster(&rig, TextureKind::Natural, 850.0, 22);
    let mut flow = flow_with_keyframe(&rig, &scene, 22).unwrap();
    let target = [8.0, -5.0, 2.0];
    let mut now = lit(scene.render(target, 0, 5), 0.7, 15.0);
    // Another texture, nearer and with a different motion, over a third of every image.
    let other = poster(&rig, TextureKind::Blobs, 700.0, 23);
    let hand = other.render([-9.0, 3.0, 0.0], 0, 7);
    for (view, hand) in now.images.iter_mut().zip(&hand.images) {
        for (i, grey) in view.grey.iter_mut().enumerate() {
            if i % view.width > 2 * view.width / 3 {
                *grey = hand.grey[i];
            }
        }
    }
    let measurement = flow.measure(&now).unwrap();
    let error = error(&rig, &measurement, target);
    assert!(within(error, 0.02, 0.08), "{error:?}");
    assert!(measurement.rejected.of(Reject::Dissimilar) > 10);
}

#[test]
fn unusable_frame_set_is_refused() {
    let rig = Rig::paper();
    let scene = poster(&rig, TextureKind::Natural, 850.0, 24);
    let still = scene.render([0.0; 3], 0, 1);
    let mut flow = Flow::new(&rig, FlowSettings::default()).unwrap();
    assert_eq!(flow.measure(&still).unwrap_err(), FlowRefusal::NoKeyframe);

    let grey = lit(still.clone(), 0.0, 128.0);
    let refusal = flow.set_keyframe(&grey).unwrap_err();
    assert!(
        matches!(refusal, FlowRefusal::FewCorners { .. }),
        "{refusal}"
    );

    let mut mixed = scene.render([0.0; 3], 0, 2);
    mixed.images[0] = poster(&rig, TextureKind::Natural, 850.0, 99)
        .render([0.0; 3], 0, 1)
        .images
        .remove(0);
    let refusal = flow.set_keyframe(&mixed).unwrap_err();
    assert!(
        matches!(refusal, FlowRefusal::FewMatches { .. }),
        "{refusal}"
    );

    flow.set_keyframe(&still).unwrap();
    let other = poster(&rig, TextureKind::Natural, 850.0, 25).render([0.0; 3], 0, 2);
    for unlike in [&other, &grey] {
        let refusal = flow.measure(unlike).unwrap_err();
        let lost = matches!(
            refusal,
            FlowRefusal::Lost { .. } | FlowRefusal::FewTracks { .. }
        );
        assert!(lost, "{refusal}");
    }
    let mut few = still.clone();
    few.images.pop();
    let expected = FlowRefusal::WrongViews {
        found: 2,
        cameras: 3,
    };
    assert_eq!(flow.measure(&few).unwrap_err(), expected);
    let mut small = still.clone();
    small.images[1].height -= 1;
    let refusal = flow.measure(&small).unwrap_err();
    assert!(
        matches!(refusal, FlowRefusal::WrongSize { camera: 1, .. }),
        "{refusal}"
    );
    assert!(
        flow.measure(&still).is_ok(),
        "the reference outlives refusals"
    );
}

#[test]
fn two_and_four_cameras_measure() {
    let camera = |x, y| Camera::ideal([530.0, 528.0], [160.0, 120.0], [x, y]);
    let pair = [camera(0.0, 0.0), camera(90.0, 0.0)];
    let square = [
        camera(-35.0, -30.0),
        camera(35.0, -30.0),
        camera(-35.0, 30.0),
        camera(35.0, 30.0),
    ];
    let upright = [camera(0.0, -40.0), camera(0.0, 0.0), camera(0.0, 45.0)];
    for cameras in [&pair[..], &square[..], &upright[..]] {
        let rig = Rig {
            image_size_px: [320, 240],
            cameras: cameras.iter().copied().collect(),
        };
        let scene = hung(
            &rig,
            &Texture::of_kind(TextureKind::Natural, 26),
            830.0,
            [0.05, -0.1],
        );
        let mut flow = flow_with_keyframe(&rig, &scene, 26).unwrap();
        let target = [12.0, -7.0, 3.0];
        let measurement = flow.measure(&scene.render(target, 0, 5)).unwrap();
        let error = error(&rig, &measurement, target);
        println!(
            "{} cameras: error {error:+.4?} mm, {} points",
            cameras.len(),
            measurement.correspondences.len()
        );
        assert!(
            within(error, 0.03, 0.08),
            "{} cameras: {error:?}",
            cameras.len()
        );
    }
}

/// Tests the paper's rig at 700 mm, with 53 px of disparity: matches need no prior, and none of
/// them is wrong.
#[test]
fn matches_at_53_px_are_right() {
    let rig = Rig::paper();
    let target = [9.0, -6.0, 3.0];
    for (seed, kind) in (40..).zip([TextureKind::Natural, TextureKind::Blobs]) {
        let scene = poster(&rig, kind, 700.0, seed);
        let mut flow = flow_with_keyframe(&rig, &scene, seed).unwrap();
        let measurement = flow.measure(&scene.render(target, 0, seed)).unwrap();
        assert!(measurement.correspondences.len() > 100);
        let mut squares = 0.0;
        for point in &measurement.correspondences {
            let [x, y] = rig.cameras[1].normalise(point.pixels[1][0]);
            let place = [x * 700.0, y * 700.0, 700.0];
            let moved: [f64; 3] = std::array::from_fn(|i| place[i] + target[i]);
            for (camera, pixels) in rig.cameras.iter().zip(&point.pixels) {
                for (place, pixel) in [place, moved].into_iter().zip(pixels) {
                    let truth = camera.project(place);
                    let off = (pixel[0] - truth[0]).hypot(pixel[1] - truth[1]);
                    assert!(off < 0.5, "{kind}: {pixel:?}, not {truth:?}");
                    squares += off * off / (6 * measurement.correspondences.len()) as f64;
                }
            }
        }
        println!("{kind}: rms {:.4} px", squares.sqrt());
        let bound = if kind == TextureKind::Natural {
            0.02
        } else {
            0.1
        };
        assert!(squares.sqrt() < bound, "{kind}: {}", squares.sqrt());
    }
}

#[test]
fn threads_do_not_change_results() {
    let rig = Rig::paper();
    let scene = poster(&rig, TextureKind::Natural, 850.0, 41);
    let [before, now] = [([0.0; 3], 1), ([6.0, 4.0, -3.0], 2)].map(|(t, s)| scene.render(t, 0, s));
    let measured = [1, 2, 3, 5].map(|threads| {
        let settings = FlowSettings {
            threads,
            ..FlowSettings::default()
        };
        let mut flow = Flow::new(&rig, settings).unwrap();
        flow.set_keyframe(&before).unwrap();
        // `{:?}` prints all digits, so the texts are equal only if all bits are.
        format!("{:?}", flow.measure(&now).unwrap())
    });
    for several in &measured[1..] {
        assert_eq!(several, &measured[0]);
    }
}

/// Tests the five cameras that a rig may have; the remark names the failed one.
#[test]
fn failed_camera_is_left_out() {
    let rig = Rig::paper();
    let scene = poster(&rig, TextureKind::Natural, 850.0, 42);
    let names = ["left", "middle", "right"].map(String::from);
    let target = [7.0, -4.0, 2.0];
    let before = scene.render([0.0; 3], 0, 1);
    let mut flow = Flow::new(&rig, FlowSettings::default()).unwrap();
    flow.set_keyframe(&before).unwrap();
    for (k, name) in names.iter().enumerate() {
        // Each image has its own noise, because a repeated image is frozen.
        let mut seed = 10 * (k as u64 + 1);
        let [mut missing, mut dark, mut frozen] = [(); 3].map(|()| {
            seed += 1;
            scene.render(target, 0, seed)
        });
        missing.images[k] = crate::images::Image::missing();
        dark.images[k].grey.fill(3);
        frozen.images[k] = before.images[k].clone();
        for (frame_set, word) in [
            (missing, "no image"),
            (dark, "shows nothing"),
            (frozen, "frozen"),
        ] {
            let measurement = flow.measure(&frame_set).unwrap();
            assert_eq!(measurement.cameras.len(), 2);
            let remarks = measurement.remarks(&names);
            assert!(
                remarks.len() == 1
                    && remarks[0].contains(name.as_str())
                    && remarks[0].contains(word),
                "{remarks:?}"
            );
            let error = error(&rig, &measurement, target);
            assert!(within(error, 0.02, 0.08), "{name} {word}: {error:?}");
        }
    }
    // A keyframe without the camera serves as well, even after the camera is back.
    let mut reference = scene.render([0.0; 3], 0, 3);
    reference.images[1].grey.fill(3);
    flow.set_keyframe(&reference).unwrap();
    let measurement = flow.measure(&scene.render(target, 0, 50)).unwrap();
    assert_eq!(measurement.cameras, [0, 2]);
    assert!(within(error(&rig, &measurement, target), 0.02, 0.08));
    // A single camera cannot measure.
    let mut one = scene.render(target, 0, 51);
    one.images[0] = crate::images::Image::missing();
    assert_eq!(
        flow.measure(&one).unwrap_err(),
        FlowRefusal::FewCameras { left: 1 }
    );
}

/// Tests a camera so late that its points fail the test of disparities, or scatter too much to
/// agree: the result names the camera, not these symptoms.
#[test]
fn late_camera_is_left_out() {
    let rig = Rig::paper();
    let scene = poster(&rig, TextureKind::Natural, 850.0, 44);
    let mut flow = flow_with_keyframe(&rig, &scene, 44).unwrap();
    let mut seed = 10;
    for target in [[24.0, 3.0, 2.0], [-4.0, 26.0, -3.0], [17.0, -17.0, 1.0]] {
        for camera in 0..3 {
            for share in [0.06, 0.1, -0.1] {
                seed += 1;
                let mut now = scene.render(target, 0, seed);
                let then = target.map(|t| (1.0 + share) * t);
                now.images[camera] = scene.render(then, 0, seed).images.remove(camera);
                let measurement = flow.measure(&now).unwrap();
                let [(which, CameraRefusal::Unsynchronised { share: seen })] =
                    measurement.refused_cameras[..]
                else {
                    panic!("{camera} {share}: {:?}", measurement.refused_cameras);
                };
                assert_eq!(which, camera, "{target:?} {share}");
                assert!((seen - share).abs() < 0.02, "{target:?} {share}: {seen}");
                let error = error(&rig, &measurement, target);
                assert!(within(error, 0.02, 0.08), "{target:?} {share}: {error:?}");
            }
        }
    }
}

/// Tests a camera that froze after the keyframe: it repeats the frame set before.
#[test]
fn later_frozen_camera_is_found() {
    let rig = Rig::paper();
    let scene = poster(&rig, TextureKind::Natural, 850.0, 43);
    let mut flow = flow_with_keyframe(&rig, &scene, 43).unwrap();
    let first = scene.render([2.0, 1.0, 0.0], 0, 1);
    assert!(flow.measure(&first).unwrap().refused_cameras.is_empty());
    let mut second = scene.render([4.0, 2.0, 0.0], 0, 2);
    second.images[2] = first.images[2].clone();
    let measurement = flow.measure(&second).unwrap();
    assert_eq!(measurement.refused_cameras, [(2, CameraRefusal::Frozen)]);
    assert!(within(
        error(&rig, &measurement, [4.0, 2.0, 0.0]),
        0.02,
        0.08
    ));
}
