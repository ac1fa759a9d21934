use super::*;
use crate::images::{Image, Scene, SceneSettings, Texture, TextureKind};
use crate::matching::corner::corners;
use crate::matching::pyramid::Pyramid;
use crate::thread_pool::ThreadPool;
use trinocular_core::rig::{Camera, Rig};

const STILL: [[f32; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];

/// Size of a pixel on the poster, mm: one camera of 530 px, the poster at 795 mm.
const MM_PER_PX: f64 = 1.5;

fn rig() -> Rig {
    let camera = Camera::ideal([530.0; 2], [160.0, 120.0], [0.0; 2]);
    Rig {
        image_size_px: [320, 240],
        cameras: [camera].into_iter().collect(),
    }
}

fn scene(kind: TextureKind, seed: u64, noise_grey: f64) -> Scene {
    let settings = SceneSettings {
        depth_mm: 530.0 * MM_PER_PX,
        noise_grey,
        ..SceneSettings::default()
    };
    Scene::new(&rig(), &Texture::of_kind(kind, seed), settings).unwrap()
}

/// Renders a poster displaced by `shift` px and `away_mm`.
fn shot(scene: &Scene, shift: [f64; 2], away_mm: f64, seed: u64) -> Plane {
    let displaced = [shift[0] * MM_PER_PX, shift[1] * MM_PER_PX, away_mm];
    plane(&scene.render(displaced, 0, seed).images[0])
}

fn plane(image: &Image) -> Plane {
    Pyramid::new(image, 1).levels.remove(0)
}

/// Computes the errors of the shift `(dx, dy)` px over a grid of points with enough texture, px.
fn errors(scene: &Scene, shift: [f64; 2], seed: u64) -> Vec<[f64; 2]> {
    let before = shot(scene, [0.0; 2], 0.0, 2 * seed);
    let after = shot(scene, shift, 0.0, 2 * seed + 1);
    let mut errors = Vec::new();
    for [x, y] in corners(&before, 18, 8.0, 200, &ThreadPool::default()) {
        // Positions between pixels as well: the spatial match puts templates there.
        let at = [x as f32, y as f32].map(|c| c + 0.37 * ((x + y) % 3) as f32);
        let Some(template) = FineTemplate::new(&before, at) else {
            continue;
        };
        let start = [0, 1].map(|i| at[i] + shift[i].round() as f32);
        let found = template
            .find(&after, start, STILL, 20)
            .expect("a shifted window is found");
        assert!(found.zncc > 0.9, "{}", found.zncc);
        errors.push([0, 1].map(|i| f64::from(found.at[i] - at[i]) - shift[i]));
    }
    assert!(errors.len() > 100);
    errors
}

fn mean_and_rms(errors: &[[f64; 2]]) -> ([f64; 2], f64) {
    let count = errors.len() as f64;
    let mean = [0, 1].map(|i| errors.iter().map(|e| e[i]).sum::<f64>() / count);
    let squares: f64 = errors.iter().flatten().map(|e| e * e).sum();
    (mean, (squares / (2.0 * count)).sqrt())
}

/// Tests all sub-pixel phases with noise of 2 grey levels. Prints the table with `--nocapture`.
#[test]
fn shift_is_found_at_every_phase() {
    for (kind, bound) in [(TextureKind::Natural, 0.013), (TextureKind::Blobs, 0.06)] {
        let scene = scene(kind, 11, 2.0);
        let mut biases = Vec::new();
        for step in 0..10 {
            let phase = f64::from(step) / 10.0;
            let (mean, rms) = mean_and_rms(&errors(
                &scene,
                [2.0 + phase, -1.0 - phase],
                50 + step as u64,
            ));
            println!(
                "{kind} phase {phase:.1}: mean {:+.4} {:+.4} px, rms {rms:.4} px",
                mean[0], mean[1]
            );
            assert!(rms < bound, "{kind} {phase}: rms {rms}");
            biases.push(mean);
        }
        let worst = biases.iter().flatten().fold(0.0_f64, |w, b| w.max(b.abs()));
        // The mean over two hundred windows that overlap is itself uncertain.
        assert!(worst < 0.3 * bound, "{kind}: bias {worst}");
    }
}

/// Tests without noise: the error of interpolation and of steps not taken remains.
#[test]
fn interpolation_is_unbiased() {
    let scene = scene(TextureKind::Natural, 12, 0.3);
    for phase in [0.1, 0.25, 0.4, 0.5, 0.75] {
        let (mean, rms) = mean_and_rms(&errors(&scene, [phase, 3.0 - phase], 3));
        println!(
            "phase {phase:.2}: mean {:+.4} {:+.4} px, rms {rms:.4} px",
            mean[0], mean[1]
        );
        assert!(
            mean.iter().all(|m| m.abs() < 0.001) && rms < 0.004,
            "{phase}: {mean:?} {rms}"
        );
    }
}

#[test]
fn gain_does_not_move_the_window() {
    let scene = scene(TextureKind::Natural, 13, 0.5);
    let before = shot(&scene, [0.0; 2], 0.0, 1);
    let mut dark = scene
        .render([1.3 * MM_PER_PX, 0.6 * MM_PER_PX, 0.0], 0, 2)
        .images
        .remove(0);
    for grey in &mut dark.grey {
        *grey = (0.6 * f64::from(*grey) + 20.0).round() as u8;
    }
    let after = plane(&dark);
    let mut errors = Vec::new();
    for x in (40..280).step_by(20) {
        let at = [x as f32, 120.0];
        if let Some(template) = FineTemplate::new(&before, at) {
            let found = template.find(&after, at, STILL, 20).unwrap();
            errors.push([
                f64::from(found.at[0] - at[0]) - 1.3,
                f64::from(found.at[1] - at[1]) - 0.6,
            ]);
        }
    }
    let (_, rms) = mean_and_rms(&errors);
    assert!(errors.len() > 5 && rms < 0.02, "{} {rms}", errors.len());
}

#[test]
fn warped_template_finds_enlarged_window() {
    let scene = scene(TextureKind::Natural, 14, 0.3);
    let before = shot(&scene, [0.0; 2], 0.0, 1);
    // 2 % nearer: everything grows by 1/0.98.
    let after = shot(&scene, [0.0; 2], -0.02 * 530.0 * MM_PER_PX, 2);
    let shrink = 0.98_f32;
    let rms_of = |warp: f32| {
        let mut errors = Vec::new();
        for y in (40..200).step_by(16) {
            for x in (40..280).step_by(16) {
                let at = [x as f32, y as f32];
                let goal = [
                    (at[0] - 160.0) / shrink + 160.0,
                    (at[1] - 120.0) / shrink + 120.0,
                ];
                let template = FineTemplate::new(&before, at);
                let warp = [[warp, 0.0], [0.0, warp]];
                if let Some(found) = template.and_then(|t| t.find(&after, goal, warp, 20)) {
                    errors.push([0, 1].map(|i| f64::from(found.at[i] - goal[i])));
                }
            }
        }
        mean_and_rms(&errors).1
    };
    let (warped, plain) = (rms_of(shrink), rms_of(1.0));
    println!("rms {warped:.4} px warped, {plain:.4} px not warped");
    assert!(warped < 0.012 && warped < 0.5 * plain, "{warped} {plain}");
}

#[test]
fn textureless_window_is_refused() {
    let even = Image {
        width: 64,
        height: 64,
        grey: vec![128; 64 * 64],
    };
    let flat = plane(&even);
    assert!(FineTemplate::new(&flat, [32.0, 32.0]).is_none());
    let edge = Image {
        grey: (0..64 * 64)
            .map(|i| if i % 64 < 32 { 50 } else { 200 })
            .collect(),
        ..even
    };
    let edge = plane(&edge);
    assert!(
        FineTemplate::new(&edge, [32.0, 32.0]).is_none(),
        "an edge slides along itself"
    );
    for at in [[11.9, 32.0], [32.0, 52.1], [f32::NAN, 32.0], [-5.0, 1e9]] {
        assert!(FineTemplate::new(&edge, at).is_none());
    }
}

/// A window that is turned by nothing is the window itself; by a quarter turn, its rows are columns
/// of the other. Both are read by different arithmetic.
#[test]
fn turned_window_has_grey_levels_of_its_places() {
    let plane = shot(&scene(TextureKind::Natural, 4, 2.0), [0.0; 2], 0.0, 1);
    let at = [121.3, 87.8];
    let upright = FineTemplate::new(&plane, at).unwrap();
    let turned = |linear| {
        let shrink = [0.0; 2];
        FineTemplate::turned(&plane, at, &PlaneWarp { linear, shrink }).unwrap()
    };
    let (same, quarter) = (turned(STILL), turned([[0.0, -1.0], [1.0, 0.0]]));
    let close = |a: f32, b: f32| assert!((a - b).abs() < 2e-3, "{a} {b}");
    let last = FineTemplate::SIDE - 1;
    for row in 0..FineTemplate::SIDE {
        for column in 0..FineTemplate::SIDE {
            close(same.grey[row][column], upright.grey[row][column]);
            close(same.along[row][column], upright.along[row][column]);
            close(same.down[row][column], upright.down[row][column]);
            // The place (-y, x) of the image; the gradient turns back with the window.
            let [x, y] = [last - row, column];
            close(quarter.grey[row][column], upright.grey[y][x]);
            close(quarter.along[row][column], upright.down[y][x]);
            close(quarter.down[row][column], -upright.along[y][x]);
        }
    }
}
