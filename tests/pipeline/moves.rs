//! Posters with rich texture in front of the paper's rig.

use trinocular_vision::images::{FrameSet, SceneSettings, Texture, TextureKind};

use super::bench::{Bench, TOLERANCE_MM, Watch, table_5_mm};

#[test]
fn table_5_is_met_on_natural_posters() {
    for seed in 0..4 {
        let bench = Bench::new(&Texture::natural(seed), SceneSettings::default());
        let got = bench.measure_all(&table_5_mm(), seed);
        for (moved, got) in table_5_mm().into_iter().zip(got) {
            let got = got.expect("rich texture");
            got.assert_within(moved, TOLERANCE_MM, &format!("natural {seed}"));
        }
    }
}

/// With a wrong sign the stage would run away from its target.
#[test]
fn right_down_away_are_positive() {
    let bench = Bench::new(&Texture::natural(9), SceneSettings::default());
    let looking_at = |moved: [f64; 3]| bench.scene.render(moved, 0, 1);
    let (rest, right) = (looking_at([0.0; 3]), looking_at([3.0, 0.0, 0.0]));
    // 3 mm at 850 mm is nearly 2 px. A bright or dark spot of the middle image must be found
    // further right in the image itself.
    let difference = |before: usize, after: usize| -> u64 {
        let row = |capture: &FrameSet, column: usize| -> Vec<i64> {
            let view = &capture.images[1];
            let rows = 20..view.height - 20;
            rows.map(|y| i64::from(view.grey[y * view.width + column]))
                .collect()
        };
        let pairs = row(&rest, before).into_iter().zip(row(&right, after));
        pairs.map(|(a, b)| a.abs_diff(b)).sum()
    };
    let total = |shift: isize| -> u64 {
        (20..300)
            .map(|x: usize| difference(x, x.wrapping_add_signed(shift)))
            .sum()
    };
    assert!(total(2) < total(0) && total(0) < total(-2));

    let moves = [
        [3.0, 0.0, 0.0],
        [0.0, 3.0, 0.0],
        [0.0, 0.0, 3.0],
        [-3.0, 0.0, 0.0],
        [0.0, -3.0, 0.0],
        [0.0, 0.0, -3.0],
    ];
    for (moved, got) in moves.into_iter().zip(bench.measure_all(&moves, 9)) {
        got.expect("rich texture")
            .assert_within(moved, TOLERANCE_MM, "sign");
    }
}

/// Every image changes brightness by its own gain and offset between the two instants.
#[test]
fn changed_lighting_moves_nothing() {
    for kind in [TextureKind::Natural, TextureKind::Blobs] {
        // The contrast is low, so that the brightest image does not saturate.
        let mut texture = Texture::of_kind(kind, 3);
        texture.grey.iter_mut().for_each(|g| *g = 35.0 + 0.6 * *g);
        let bench = Bench::new(&texture, SceneSettings::default());
        let moved = [6.0, -4.0, 2.0];
        let mut watch = Watch::new(&bench.rig, &bench.scene.render([0.0; 3], 0, 1)).unwrap();
        let plain = bench.scene.render(moved, 1, 2);
        let steady = watch.measure(&plain).expect("plain");
        for light in [
            [(1.3, 0.0), (1.3, 0.0), (1.3, 0.0)],
            [(0.6, 0.0), (0.6, 0.0), (0.6, 0.0)],
            [(1.0, 50.0), (1.0, -30.0), (1.0, 0.0)],
            [(0.7, 40.0), (1.25, -10.0), (0.9, 10.0)],
        ] {
            let mut lit = plain.clone();
            for (view, (gain, offset)) in lit.images.iter_mut().zip(light) {
                for grey in &mut view.grey {
                    *grey = (gain * f64::from(*grey) + offset).round() as u8;
                }
            }
            let got = watch.measure(&lit).expect("only the light has changed");
            let bound = std::array::from_fn(|i| 0.02f64.max(5.0 * steady.sigma_mm[i]));
            got.assert_within(moved, bound, &format!("{kind} {light:?}"));
            assert!(
                got.points * 10 >= steady.points * 9,
                "{kind} {light:?}: {} points left of {}",
                got.points,
                steady.points
            );
        }
    }
}

/// Distances and angles far from the paper's: the result is right, or its sigma covers the error.
#[test]
fn extreme_moves_are_right_or_refused() {
    let mut answered = 0;
    for (seed, depth_mm) in [(1, 500.0), (2, 850.0), (3, 1400.0)] {
        for tilt_rad in [[0.0, 0.0], [0.5, 0.0], [-0.3, 0.4]] {
            let settings = SceneSettings {
                depth_mm,
                tilt_rad,
                ..SceneSettings::default()
            };
            let bench = Bench::new(&Texture::natural(seed), settings);
            let pixel = depth_mm / 533.0;
            let moves = [
                [60.0 * pixel, 0.0, 0.0],
                [-40.0 * pixel, 40.0 * pixel, 0.0],
                [0.0, 0.0, -0.06 * depth_mm],
                [5.0 * pixel, -11.0 * pixel, 0.06 * depth_mm],
            ];
            for (moved, got) in moves.into_iter().zip(bench.measure_all(&moves, seed)) {
                let Ok(got) = got else { continue };
                answered += 1;
                let what = format!("{depth_mm} mm, tilt {tilt_rad:?}");
                assert!(
                    got.is_honest(moved),
                    "{what}: {:?} off {moved:?}, sigma {:?}",
                    got.error_mm(moved),
                    got.sigma_mm
                );
            }
        }
    }
    assert!(answered >= 28, "only {answered} of 36 were answered");
}

/// A nearer poster covers the right two fifths of every image and moves on its own.
#[test]
fn moving_occluder_never_deceives() {
    let settings = SceneSettings::default();
    let nearer = SceneSettings {
        depth_mm: 700.0,
        ..settings
    };
    let mut measured = 0;
    for seed in 0..4 {
        let target = Bench::new(&Texture::natural(50 + seed), settings);
        let cover = Bench::new(&Texture::natural(60 + seed), nearer);
        let edge_mm = 30.0;
        let both = |target_mm: [f64; 3], cover_mm: [f64; 3], seed: u64| -> FrameSet {
            let mut capture = target.scene.render(target_mm, 0, 2 * seed);
            let front = cover.scene.render(cover_mm, 0, 2 * seed + 1);
            let views = capture.images.iter_mut().zip(front.images);
            for ((view, front), camera) in views.zip(&target.rig.cameras) {
                // The cover's left edge is a vertical line in space.
                let edge = camera.project([edge_mm + cover_mm[0], 0.0, 700.0 + cover_mm[2]]);
                for (i, grey) in view.grey.iter_mut().enumerate() {
                    if (i % view.width) as f64 > edge[0] {
                        *grey = front.grey[i];
                    }
                }
            }
            capture
        };
        let reference = both([0.0; 3], [0.0; 3], 10 * seed);
        let mut watch = Watch::new(&target.rig, &reference).expect("rich texture");
        let moved = [6.0, -5.0, 2.0];
        for (cover_mm, k) in [[-4.0, 7.0, 0.0], [9.0, 2.0, -6.0], [0.0; 3]]
            .into_iter()
            .zip(1..)
        {
            let Ok(got) = watch.measure(&both(moved, cover_mm, 10 * seed + k)) else {
                continue; // refused, with a reason
            };
            measured += 1;
            got.assert_within(
                moved,
                TOLERANCE_MM,
                &format!("cover {seed} moved by {cover_mm:?}"),
            );
        }
    }
    assert!(measured > 0, "everything was refused");
}
