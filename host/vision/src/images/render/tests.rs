//! Rendered images against the camera model: the place of a dot, and the noise of the sensor.

use super::*;
use crate::images::TextureKind;

/// Size of the texture: 520 mm, so wide that no camera sees the dot twice.
const SIZE: usize = 1300;
const DOT_TEXEL: [usize; 2] = [838, 608];

/// Returns a black texture with one Gaussian dot at [`DOT_TEXEL`].
fn dot_texture() -> Texture {
    let (size, sigma) = (SIZE, 3.0);
    let bell = |i: usize| {
        let dx = (i % size) as f64 - DOT_TEXEL[0] as f64;
        let dy = (i / size) as f64 - DOT_TEXEL[1] as f64;
        (250.0 * (-0.5 * (dx * dx + dy * dy) / (sigma * sigma)).exp()) as f32
    };
    Texture {
        width: size,
        height: size,
        mm_per_texel: 0.4,
        grey: (0..size * size).map(bell).collect(),
    }
}

fn dot_mm() -> [f64; 2] {
    DOT_TEXEL.map(|t| (t as f64 - (SIZE as f64 - 1.0) / 2.0) * 0.4)
}

/// Returns the largest distance between a dot's centroid in any image and its projection, px.
fn worst_error_px(rig: &Rig, settings: SceneSettings, relative_mm: [f64; 3]) -> f64 {
    let scene = Scene::new(rig, &dot_texture(), settings).unwrap();
    let point = scene.point_mm(dot_mm(), relative_mm);
    let mut worst: f64 = 0.0;
    for (camera, eye) in rig.cameras.iter().zip(&scene.cameras) {
        let expected = camera.project(point);
        let mut sums = [0.0; 3];
        for (i, level) in scene.levels(eye, Pose::at(relative_mm)).enumerate() {
            let level = level.unwrap();
            let pixel = [(i % 320) as f64, (i / 320) as f64];
            for (sum, power) in sums.iter_mut().zip([1.0, pixel[0], pixel[1]]) {
                *sum += level * power;
            }
        }
        assert!(sums[0] > 500.0, "the dot is out of view at {expected:?}");
        worst = worst
            .max((sums[1] / sums[0] - expected[0]).abs())
            .max((sums[2] / sums[0] - expected[1]).abs());
    }
    worst
}

#[test]
fn dot_appears_at_its_projection() {
    let mut rig = Rig::paper();
    for distortion in [[0.0; 5], [-0.12, 0.05, 0.001, -0.0007, 0.01]] {
        for camera in &mut rig.cameras {
            camera.distortion = distortion;
        }
        for tilt_rad in [[0.0, 0.0], [0.2, -0.15]] {
            for relative_mm in [
                [0.0, 0.0, 0.0],
                [4.0, 4.0, 1.0],
                [-31.7, 22.2, -40.1],
                [0.13, -0.29, 37.9],
            ] {
                let settings = SceneSettings {
                    tilt_rad,
                    noise_grey: 0.0,
                    ..SceneSettings::default()
                };
                let error = worst_error_px(&rig, settings, relative_mm);
                assert!(
                    error < 0.002,
                    "{error} px: {distortion:?} {tilt_rad:?} {relative_mm:?}"
                );
            }
        }
    }
}

#[test]
fn right_down_away_are_rendered() {
    let camera = Rig::paper().cameras[1];
    let scene = Scene::new(&Rig::paper(), &dot_texture(), SceneSettings::default()).unwrap();
    let seen = |relative| camera.project(scene.point_mm([100.0, 50.0], relative));
    let [x, y] = seen([0.0; 3]);
    assert!(seen([1.0, 0.0, 0.0])[0] > x);
    assert!(seen([0.0, 1.0, 0.0])[1] > y);
    let [far_x, far_y] = seen([0.0, 0.0, 10.0]);
    assert!(far_x < x && far_y < y);
}

#[test]
fn positive_tilt_nears_lower_right() {
    let depth = |tilt_rad, poster| {
        let settings = SceneSettings {
            tilt_rad,
            ..SceneSettings::default()
        };
        let scene = Scene::new(&Rig::paper(), &dot_texture(), settings).unwrap();
        scene.point_mm(poster, [0.0; 3])[2]
    };
    assert!(depth([0.1, 0.0], [0.0, 100.0]) < 845.0);
    assert!(depth([0.0, 0.1], [100.0, 0.0]) < 845.0);
}

fn flat(grey: f32) -> Texture {
    Texture {
        width: 2,
        height: 2,
        mm_per_texel: 1.0,
        grey: vec![grey; 4],
    }
}

#[test]
fn noise_has_sigma_and_no_bias() {
    for noise_grey in [0.7, 2.0, 5.0] {
        let settings = SceneSettings {
            noise_grey,
            ..SceneSettings::default()
        };
        let scene = Scene::new(&Rig::paper(), &flat(128.3), settings).unwrap();
        for view in scene.render([0.0; 3], 0, 9).images {
            let count = view.grey.len() as f64;
            let error = |&g: &u8| f64::from(g) - f64::from(128.3_f32);
            let bias = view.grey.iter().map(error).sum::<f64>() / count;
            let square = view.grey.iter().map(|g| error(g).powi(2)).sum::<f64>() / count;
            // Rounding to whole grey levels adds its 1/12.
            let expected = noise_grey * noise_grey + 1.0 / 12.0;
            assert!(bias.abs() < 5.0 * noise_grey / count.sqrt(), "bias {bias}");
            assert!((square / expected - 1.0).abs() < 0.03, "{square}");
        }
    }
}

#[test]
fn noise_depends_on_seed_and_camera() {
    let scene = Scene::new(&Rig::paper(), &flat(100.0), SceneSettings::default()).unwrap();
    let first = scene.render([0.0; 3], 5, 1);
    let again = scene.render([0.0; 3], 5, 1);
    let other = scene.render([0.0; 3], 5, 2);
    assert_eq!(first.time_us, 5);
    assert_eq!(first.images, again.images);
    assert_ne!(first.images[0], first.images[1]);
    assert_ne!(first.images[0], other.images[0]);
}

#[test]
fn poster_behind_is_not_seen() {
    let scene = Scene::new(&Rig::paper(), &flat(200.0), SceneSettings::default()).unwrap();
    for z in [-850.0, -2000.0, f64::NAN] {
        for view in scene.render([0.0, 0.0, z], 0, 1).images {
            assert!(view.grey.iter().all(|&g| g == 0));
        }
    }
}

#[test]
fn impossible_settings_are_refused() {
    let make = |change: fn(&mut SceneSettings)| {
        let mut settings = SceneSettings::default();
        change(&mut settings);
        let error = Scene::new(&Rig::paper(), &flat(1.0), settings).unwrap_err();
        error.to_string()
    };
    assert_eq!(
        make(|s| s.depth_mm = -3.0),
        "depth_mm is -3, must be 1 to 100000"
    );
    assert!(make(|s| s.tilt_rad[1] = f64::NAN).starts_with("tilt_rad[1] is NaN"));
    assert!(make(|s| s.blur_px = 99.0).starts_with("blur_px"));
    assert!(make(|s| s.noise_grey = -1.0).starts_with("noise_grey"));
    let empty = Texture {
        grey: Vec::new(),
        ..flat(1.0)
    };
    let error = Scene::new(&Rig::paper(), &empty, SceneSettings::default()).unwrap_err();
    assert_eq!(error.to_string(), "texture of 2 x 2 texels has 0");
}

/// Tests that a sub-pixel move changes the image as its derivative predicts, which fails for a
/// renderer that aliases or wobbles from texel to texel.
#[test]
fn small_move_follows_gradient() {
    let texture = Texture::of_kind(TextureKind::Natural, 3);
    let settings = SceneSettings {
        noise_grey: 0.0,
        ..SceneSettings::default()
    };
    let scene = Scene::new(&Rig::paper(), &texture, settings).unwrap();
    let eye = &scene.cameras[1];
    let levels = |x: f64| -> Vec<f64> {
        scene
            .levels(eye, Pose::at([x, 0.0, 0.0]))
            .map(Option::unwrap)
            .collect()
    };
    let mm_per_px = 850.0 / 538.14;
    let (before, after) = (levels(-0.05 * mm_per_px), levels(0.05 * mm_per_px));
    // Least squares for the move (Lucas and Kanade), from gradients of a half-pixel step.
    let (left, right) = (levels(0.25 * mm_per_px), levels(-0.25 * mm_per_px));
    let (mut gradient_square, mut gradient_change) = (0.0, 0.0);
    for i in 0..before.len() {
        let gradient = 2.0 * (right[i] - left[i]);
        gradient_square += gradient * gradient;
        gradient_change += gradient * (before[i] - after[i]);
    }
    let moved = gradient_change / gradient_square;
    assert!((moved - 0.1).abs() < 0.004, "{moved}");
}

/// Returns the centroid of the dot in the first camera's image.
fn centroid(scene: &Scene, exposure: Exposure) -> [f64; 2] {
    let view = scene
        .render_exposures(&[exposure; 3], 0, 1)
        .images
        .remove(0);
    let mut sums = [0.0; 3];
    for (i, grey) in view.grey.iter().enumerate() {
        let pixel = [(i % 320) as f64, (i / 320) as f64];
        for (sum, power) in sums.iter_mut().zip([1.0, pixel[0], pixel[1]]) {
            *sum += f64::from(*grey) * power;
        }
    }
    [sums[1] / sums[0], sums[2] / sums[0]]
}

#[track_caller]
fn assert_near(seen: [f64; 2], expected: [f64; 2]) {
    for axis in 0..2 {
        let off = seen[axis] - expected[axis];
        assert!(off.abs() < 0.05, "{seen:?}, not {expected:?}");
    }
}

#[test]
fn turned_poster_moves_its_dot() {
    let rig = Rig::paper();
    let scene = Scene::new(&rig, &dot_texture(), SceneSettings::default()).unwrap();
    for turned_deg in [[3.0, 0.0, 0.0], [0.0, -3.0, 0.0], [0.0, 0.0, 5.0]] {
        let pose = Pose {
            relative_mm: [2.0, -1.0, 4.0],
            turned_deg,
        };
        let turn = Rotation::from_degrees(turned_deg).rows();
        let [u, v] = dot_mm();
        let off = turn.map(|row| row[0] * u + row[1] * v);
        let point = [2.0 + off[0], -1.0 + off[1], 854.0 + off[2]];
        let seen = centroid(&scene, Exposure::of(pose, 0.0));
        assert_near(seen, rig.cameras[0].project(point));
    }
}

#[test]
fn smear_is_centred_on_exposure() {
    let rig = Rig::paper();
    let scene = Scene::new(&rig, &dot_texture(), SceneSettings::default()).unwrap();
    let ends = [Pose::at([-6.0, 0.0, 0.0]), Pose::at([6.0, 4.0, 0.0])];
    let middle = Exposure::of(Pose::at([0.0, 2.0, 0.0]), 0.0);
    let smeared = Exposure {
        poses: ends,
        ..middle
    };
    assert_near(centroid(&scene, smeared), centroid(&scene, middle));
}

#[test]
fn look_at_centres_the_point() {
    let rig = Rig::paper();
    let mut scene = Scene::new(&rig, &dot_texture(), SceneSettings::default()).unwrap();
    scene.look_at(dot_mm());
    let seen = centroid(&scene, Exposure::of(Pose::default(), 0.0));
    assert_near(seen, rig.cameras[0].project([0.0, 0.0, 850.0]));
}

#[test]
fn gain_and_offset_leave_noise_unchanged() {
    let rig = Rig::paper();
    let texture = Texture::of_kind(TextureKind::Blobs, 3);
    let scene = Scene::new(&rig, &texture, SceneSettings::default()).unwrap();
    let plain = Exposure::of(Pose::default(), 0.0);
    let lit = Exposure {
        gain: 0.5,
        offset_grey: 30.0,
        ..plain
    };
    let [a, b] = [plain, lit].map(|s| scene.render_exposures(&[s; 3], 0, 1).images.remove(2));
    for (a, b) in a.grey.iter().zip(&b.grey) {
        assert!((f64::from(*b) - (0.5 * f64::from(*a) + 30.0)).abs() <= 0.76);
    }
}
