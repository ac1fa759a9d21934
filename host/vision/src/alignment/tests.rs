//! Alignment of rendered scenes with known offsets: estimates and their sigma.

use super::*;
use crate::flow::region::Region;
use crate::images::{Scene, SceneSettings, Texture};
use trinocular_rig::pivot::Pivot;
use trinocular_rig::random::Random;
use trinocular_rig::rig_file::RigFile;

/// Returns the paper's rig with shifted principal points, as the true rig of the images.
fn shifted(by_px: [[f64; 2]; 3]) -> Rig {
    let mut rig = Rig::paper();
    for (camera, by) in rig.cameras.iter_mut().zip(by_px) {
        let [x, y] = camera.principal_px;
        camera.principal_px = [x + by[0], y + by[1]];
    }
    rig
}

/// Returns the part of these offsets that shows in the paper's rig, with the middle camera kept:
/// equal heights and, of the horizontal offsets, the part along `(h2, -h1-h2, h1)` by constraint
/// (3).
fn visible(by_px: [[f64; 2]; 3]) -> [[f64; 2]; 3] {
    let cameras = Rig::paper().cameras;
    let e = |k: usize, i: usize| by_px[k][i] / cameras[k].focal_px[i];
    let law = [68.0, -138.0, 70.0];
    let size = law.iter().map(|l| l * l).sum::<f64>();
    let part = (0..3).map(|k| law[k] * e(k, 0)).sum::<f64>() / size;
    std::array::from_fn(|k| {
        [
            cameras[k].focal_px[0] * part * (law[k] - law[1]),
            cameras[k].focal_px[1] * (e(k, 1) - e(1, 1)),
        ]
    })
}

fn captures(rig: &Rig, texture: &Texture, settings: SceneSettings, seeds: &[u64]) -> Vec<FrameSet> {
    let scene = Scene::new(rig, texture, settings).unwrap();
    let render = |seed: &u64| {
        // A different place each time, like frame sets of a bench.
        let mut random = Random::new(*seed, 9);
        let at = [30.0, 30.0, 40.0].map(|most| random.between(-most, most));
        scene.render(at, 0, *seed)
    };
    seeds.iter().map(render).collect()
}

fn tilted(depth_mm: f64) -> SceneSettings {
    SceneSettings {
        depth_mm,
        tilt_rad: [0.2, -0.3],
        ..SceneSettings::default()
    }
}

fn align(captures: &[FrameSet]) -> Alignment {
    Alignment::of(&RigFile::paper(), captures, &AlignmentSettings::default()).unwrap()
}

#[track_caller]
fn assert_found(found: &Alignment, expected: [[f64; 2]; 3], bound_px: f64) {
    for (camera, expected) in found.cameras.iter().zip(expected) {
        for (i, expected_px) in expected.into_iter().enumerate() {
            let error = camera.offset_px[i] - expected_px;
            assert!(
                error.abs() <= bound_px,
                "{} {i}: {error} px off {expected:?}, sigma {:?}",
                camera.name,
                camera.sigma_px
            );
        }
    }
}

#[test]
fn offsets_are_found_to_a_fiftieth_px() {
    // The size of the paper's Table 4.
    let by = [[3.95, -0.29], [-7.36, 9.78], [-2.07, -0.43]];
    let scenes = [
        (Texture::natural(1), tilted(850.0)),
        (Texture::blobs(2), tilted(700.0)),
        (Texture::natural(3), SceneSettings::default()),
    ];
    for (texture, settings) in scenes {
        let found = align(&captures(&shifted(by), &texture, settings, &[1]));
        assert_found(&found, visible(by), 0.02);
        assert_eq!(found.cameras[1].offset_px, [0.0; 2]);
        assert_eq!(found.reference, "middle");
        assert!(found.points > 100 && found.scatter_px < 0.2, "{found:?}");
    }
}

#[test]
fn aligned_rig_stays_unchanged() {
    let found = align(&captures(
        &Rig::paper(),
        &Texture::natural(5),
        tilted(900.0),
        &[3],
    ));
    assert_found(&found, [[0.0; 2]; 3], 0.02);
    let z = found.penalty.before_percent.midpoint.unwrap();
    assert!(z.abs() < 0.1, "{z}");
}

/// Tests the mean square of error over sigma: 1 if sigma is right. Ten scenes of three independent
/// numbers leave it uncertain by 0.26. With sharp images and little noise the points scatter
/// because their sub-pixel phases differ, which averages out better than noise does.
#[test]
fn offset_sigma_is_true() {
    for (soft, noise_grey, least) in [(true, 2.0, 0.35), (true, 6.0, 0.35), (false, 2.0, 0.1)] {
        let (mut sum, mut worst, mut count) = (0.0, 0.0_f64, 0);
        for poster in 0..2 {
            let texture = match soft {
                true => Texture::blobs(10 + poster),
                false => Texture::natural(10 + poster),
            };
            for seed in 0..5 {
                let mut random = Random::new(77 + poster, seed);
                let by = [(); 3].map(|()| [(); 2].map(|()| random.between(-5.0, 5.0)));
                let settings = SceneSettings {
                    noise_grey,
                    ..tilted(random.between(600.0, 1000.0))
                };
                let found = align(&captures(&shifted(by), &texture, settings, &[seed]));
                for (camera, expected) in found.cameras.iter().zip(visible(by)) {
                    let offsets = camera.offset_px.into_iter().zip(expected);
                    for ((offset, expected), sigma) in offsets.zip(camera.sigma_px) {
                        if sigma > 0.0 {
                            let error = offset - expected;
                            sum += (error / sigma).powi(2);
                            worst = worst.max(error.abs());
                            count += 1;
                        }
                    }
                }
            }
        }
        let mean = sum / f64::from(count);
        println!("soft {soft}, noise {noise_grey}: mean square {mean:.2}, worst {worst:.4} px");
        assert!(
            (least..1.7).contains(&mean),
            "soft {soft}, {noise_grey}: {mean}"
        );
    }
}

#[test]
fn more_frame_sets_reduce_error() {
    let by = [[0.5, -2.0], [0.0, 0.0], [1.0, 3.0]];
    let settings = SceneSettings {
        noise_grey: 8.0,
        ..tilted(850.0)
    };
    let all = captures(
        &shifted(by),
        &Texture::blobs(4),
        settings,
        &[1, 2, 3, 4, 5, 6],
    );
    let (one, six) = (align(&all[..1]), align(&all));
    assert_found(&six, visible(by), 0.02);
    let gain = one.cameras[0].sigma_px[1] / six.cameras[0].sigma_px[1];
    assert!((1.8..3.2).contains(&gain), "{gain}");
    assert_eq!(six.captures, [6, 6]);
}

#[test]
fn known_depth_shows_common_disparity() {
    let by = [[1.2, 0.4], [0.0, 0.0], [-0.9, -0.6]];
    let rig = shifted(by);
    let scene = Scene::new(&rig, &Texture::natural(6), tilted(850.0)).unwrap();
    let capture = [scene.render([0.0; 3], 0, 4)];
    // Distance on the middle camera's axis, which meets the poster on the world's z axis.
    let settings = AlignmentSettings {
        depth_mm: Some(850.0),
        ..AlignmentSettings::default()
    };
    let found = Alignment::of(&RigFile::paper(), &capture, &settings).unwrap();
    assert_found(&found, by, 0.02);
    assert!(found.depth_known);
    assert!((found.depth_mm - 850.0).abs() < 20.0);
}

#[test]
fn wrong_known_depth_is_refused() {
    let scene = Scene::new(&Rig::paper(), &Texture::natural(6), tilted(850.0)).unwrap();
    let settings = AlignmentSettings {
        depth_mm: Some(550.0),
        ..AlignmentSettings::default()
    };
    let captures = [scene.render([0.0; 3], 0, 4)];
    let refused = Alignment::of(&RigFile::paper(), &captures, &settings);
    let Err(AlignmentRefusal::WrongDepth {
        seen_mm, offset_px, ..
    }) = refused
    else {
        panic!("{refused:?}");
    };
    assert!((seen_mm - 850.0).abs() < 20.0, "{seen_mm} mm");
    // 70 mm at 550 instead of 850 mm.
    assert!((20.0..30.0).contains(&offset_px), "{offset_px} px");
}

#[test]
fn known_depth_needs_flat_target() {
    // Two frame sets of different depths are not one plane.
    let scene = Scene::new(&Rig::paper(), &Texture::natural(6), tilted(850.0)).unwrap();
    let captures = [0.0, 100.0].map(|z| scene.render([0.0, 0.0, z], 0, 4));
    let settings = AlignmentSettings {
        depth_mm: Some(850.0),
        ..AlignmentSettings::default()
    };
    let refused = Alignment::of(&RigFile::paper(), &captures, &settings);
    assert!(
        matches!(refused, Err(AlignmentRefusal::NotFlat { .. })),
        "{refused:?}"
    );
}

/// Returns the paper's rig with rolled cameras.
fn rolled(by_deg: [f64; 3]) -> Rig {
    let mut rig = Rig::paper();
    for (camera, by) in rig.cameras.iter_mut().zip(by_deg) {
        *camera = roll::rolled(camera, by.to_radians());
    }
    rig
}

#[test]
fn rolled_camera_is_corrected() {
    for by_deg in [[0.5, 0.0, 0.0], [-0.2, 0.0, 1.0]] {
        let found = align(&captures(
            &rolled(by_deg),
            &Texture::blobs(8),
            tilted(850.0),
            &[2],
        ));
        for (k, by_deg) in by_deg.into_iter().enumerate() {
            let camera = &found.cameras[k];
            if k == 1 {
                assert_eq!((camera.roll_deg, camera.rotation_deg), (None, None));
                continue;
            }
            let [value, sigma] = camera.roll_deg.unwrap();
            assert!(
                (value - by_deg).abs() < 4.0 * sigma && sigma < 0.02,
                "{k}: {value} ± {sigma}, not {by_deg}"
            );
            let turned = found.rig.cameras[k].rotation.degrees();
            match camera.rotation_deg {
                Some(rotation_deg) => assert_eq!(rotation_deg, turned),
                None => assert_eq!((by_deg, turned), (0.0, [0.0; 3])),
            }
            assert!(turned[0].abs() + turned[1].abs() < 1e-9);
            assert!((turned[2] - by_deg).abs() < 4.0 * sigma, "{turned:?}");
        }
        // The corrected rig needs no further correction.
        assert_found(&found, [[0.0; 2]; 3], 0.02);
        let facts = present::facts(&found);
        let told = facts.iter().any(|(name, text)| {
            *name == "roll"
                && text.starts_with("of left")
                && text.contains("rotation_deg = [0.0000")
        });
        assert!(told, "{facts:?}");
    }
}

/// Tests the mean square of the roll's error over its sigma, and the number of times that a camera
/// without roll is corrected.
#[test]
fn roll_sigma_is_true() {
    let (mut sum, mut count, mut false_alarms) = (0.0, 0, 0);
    for scene in 0..10 {
        let mut random = Random::new(21, scene);
        let by_deg = match scene % 2 {
            0 => [0.0; 3],
            _ => [random.between(-0.5, 0.5), 0.0, random.between(-0.5, 0.5)],
        };
        let texture = match scene % 3 {
            0 => Texture::blobs(scene),
            _ => Texture::natural(scene),
        };
        let settings = tilted(random.between(600.0, 1000.0));
        let found = align(&captures(&rolled(by_deg), &texture, settings, &[scene]));
        for k in [0, 2] {
            let [value, sigma] = found.cameras[k].roll_deg.unwrap();
            println!("{k}: {value:.4} ± {sigma:.4}, {:.4}", by_deg[k]);
            sum += ((value - by_deg[k]) / sigma).powi(2);
            count += 1;
            false_alarms += u32::from(by_deg[k] == 0.0 && found.cameras[k].rotation_deg.is_some());
        }
    }
    let mean = sum / f64::from(count);
    println!("mean square {mean:.2}, {false_alarms} turned for nothing");
    assert!((0.2..2.0).contains(&mean), "{mean}");
    assert!(false_alarms <= 1, "{false_alarms}");
}

#[test]
fn other_rigs_get_visible_offsets() {
    // Two cameras one above the other show only the offset across, which is horizontal.
    let mut rig = Rig::paper();
    rig.cameras.pop();
    rig.cameras[0].offset_mm = [0.0, -60.0];
    rig.cameras[1].offset_mm = [0.0, 0.0];
    let file = RigFile {
        names: vec!["top".into(), "bottom".into()],
        rig: rig.clone(),
        stage: None,
        rotation: None,
        pivot: Pivot::Centroid,
        trigger: None,
        laser: None,
        targets: Vec::new(),
        capture: Vec::new(),
    };
    let mut truth = rig;
    truth.cameras[0].principal_px[0] += 4.0;
    truth.cameras[0].principal_px[1] += 1.5;
    let captures = captures(&truth, &Texture::natural(2), tilted(850.0), &[5]);
    let found = Alignment::of(&file, &captures, &AlignmentSettings::default()).unwrap();
    let moved = (0..2).map(|k| found.cameras[k].offset_px);
    let [a, b]: [[f64; 2]; 2] = moved.collect::<Vec<_>>().try_into().unwrap();
    let seen = a[0] - b[0] * 533.16 / 538.14;
    assert!((seen - 4.0).abs() < 0.02, "{a:?} {b:?}");
    assert!(a[1].abs() < 1e-6 && b[1].abs() < 1e-6, "{a:?} {b:?}");
}

#[test]
fn large_distorted_images_are_aligned() {
    let mut rig = Rig::paper();
    rig.image_size_px = [640, 480];
    for (camera, k1) in rig.cameras.iter_mut().zip([-0.25, -0.2, -0.3]) {
        camera.focal_px = camera.focal_px.map(|f| 1.6 * f);
        camera.principal_px = camera.principal_px.map(|p| 2.0 * p);
        camera.distortion = [k1, 0.1, 0.001, -0.001, 0.0];
    }
    let file = RigFile {
        rig: rig.clone(),
        ..RigFile::paper()
    };
    let mut truth = rig;
    truth.cameras[0].principal_px[1] += 7.5;
    truth.cameras[2].principal_px[1] -= 4.0;
    let captures = captures(&truth, &Texture::natural(7), tilted(850.0), &[1]);
    let found = Alignment::of(&file, &captures, &AlignmentSettings::default()).unwrap();
    assert_found(&found, [[0.0, 7.5], [0.0; 2], [0.0, -4.0]], 0.02);
}

#[test]
fn repetitive_pattern_is_refused() {
    let by = [[1.0, -3.0], [0.0; 2], [0.5, 2.0]];
    for texture in [Texture::grid(), Texture::bricks(1)] {
        let captures = captures(&shifted(by), &texture, SceneSettings::default(), &[1]);
        let refused = Alignment::of(&RigFile::paper(), &captures, &AlignmentSettings::default());
        println!("{refused:?}");
        assert!(refused.is_err(), "{refused:?}");
    }
}

#[test]
fn blank_images_are_refused() {
    let blank = crate::images::Image {
        width: 320,
        height: 240,
        grey: vec![90; 320 * 240],
    };
    let capture = FrameSet {
        time_us: 0,
        images: vec![blank; 3],
    };
    let refused = Alignment::of(&RigFile::paper(), &[capture], &AlignmentSettings::default());
    assert!(matches!(
        refused,
        Err(AlignmentRefusal::NoRoughOffset { found: 0, .. })
    ));
    let far = shifted([[0.0, 0.0], [0.0, 0.0], [0.0, 30.0]]);
    let captures = captures(&far, &Texture::natural(1), tilted(850.0), &[1]);
    let refused = Alignment::of(&RigFile::paper(), &captures, &AlignmentSettings::default());
    assert!(
        matches!(refused, Err(AlignmentRefusal::NoRoughOffset { .. })),
        "{refused:?}"
    );
    let wider = AlignmentSettings {
        reach_px: 40.0,
        ..AlignmentSettings::default()
    };
    let found = Alignment::of(&RigFile::paper(), &captures, &wider).unwrap();
    assert!((found.cameras[2].offset_px[1] - 30.0).abs() < 0.02);
}

/// Tests images whose lower part shows another scene, taken with other offsets, such as a mirror or
/// a screen.
#[test]
fn region_selects_aligned_points() {
    let expected = [[0.0, 2.5], [0.0; 2], [0.0, -1.5]];
    let mut seen = captures(
        &shifted(expected),
        &Texture::natural(3),
        tilted(850.0),
        &[1],
    );
    let others = shifted([[0.0, -4.0], [0.0; 2], [0.0, 6.0]]);
    let below = captures(&others, &Texture::natural(4), tilted(700.0), &[2]);
    let [width, height] = Rig::paper().image_size_px;
    let edge = height * 2 / 5;
    for (image, other) in seen[0].images.iter_mut().zip(&below[0].images) {
        let start = (edge * width) as usize;
        image.grey[start..].copy_from_slice(&other.grey[start..]);
    }
    let region = Region {
        rectangle_px: Some([0, 0, width, edge - 10]),
        mask: None,
    };
    let settings = AlignmentSettings {
        regions: Regions(vec![region; 3]),
        ..AlignmentSettings::default()
    };
    let found = Alignment::of(&RigFile::paper(), &seen, &settings).unwrap();
    assert_found(&found, visible(expected), 0.05);
    let whole = Alignment::of(&RigFile::paper(), &seen, &AlignmentSettings::default());
    let off = |found: Alignment| (found.cameras[0].offset_px[1] - 2.5).abs();
    assert!(whole.is_err() || off(whole.unwrap()) > 1.0);
}
