//! Pyramids against their definition.

use super::*;
use crate::thread_pool::ThreadPool;
use trinocular_rig::random::Random;

#[test]
fn slope_is_kept_at_every_level() {
    let grey = (0..64 * 48)
        .map(|i| (2 * (i % 64) + i / 64) as u8)
        .collect();
    let image = Image {
        width: 64,
        height: 48,
        grey,
    };
    let pyramid = Pyramid::new(&image, 3);
    for (level, plane) in pyramid.levels.iter().enumerate() {
        let scale = 1 << level;
        assert_eq!((plane.width, plane.height), (64 / scale, 48 / scale));
        for (x, y) in [(4, 4), (7, 5)] {
            let expected = (2 * x * scale + y * scale) as f32;
            assert_eq!(plane.grey[y * plane.stride + x], expected);
        }
    }
}

#[test]
fn halved_pyramid_has_the_levels_above() {
    let grey = (0..63 * 47).map(|i| (i * 7919 % 251) as u8).collect();
    let image = Image {
        width: 63,
        height: 47,
        grey,
    };
    let whole = Pyramid::new(&image, 4);
    // Levels that the pyramid has, and levels that it lacks.
    for levels in [2, 3, 4] {
        let halved = FramePyramid::new(&image, levels).halved(3);
        assert_eq!(halved.fine().grey, whole.levels[1].grey);
        assert_eq!(halved.coarse().len(), 2);
        for (level, expected) in halved.coarse().iter().zip(&whole.levels[2..]) {
            assert_eq!(
                [level.width, level.height],
                [expected.width, expected.height]
            );
            assert_eq!(level.grey, expected.grey);
        }
    }
    assert!(FramePyramid::default().halved(3).coarse().is_empty());
}

#[test]
fn halved_row_has_bits_of_single_places() {
    let mut random = trinocular_rig::random::Random::seeded(3);
    for width in 1..70_usize {
        let mut row: Vec<f32> = (0..width + 5)
            .map(|_| random.between(0.0, 4e3) as f32)
            .collect();
        repeat_ends(&mut row[..width + 4]);
        let mut parts = [(); 2].map(|()| vec![0.0; row.len().div_ceil(2)]);
        split(&row, parts.each_mut().map(Vec::as_mut_slice));
        let mut out = vec![0.0; width.div_ceil(2)];
        along_halved(parts.each_ref().map(Vec::as_slice), &mut out);
        for (i, found) in out.into_iter().enumerate() {
            let five = [0, 1, 2, 3, 4].map(|tap| row[2 * i + tap]);
            assert_eq!(found, wide(five) / 256.0, "{width} {i}");
        }
    }
}

#[test]
fn point_spreads_as_binomial() {
    let mut image = Image {
        width: 9,
        height: 9,
        grey: vec![0; 81],
    };
    image.grey[4 * 9 + 4] = 128;
    let plane = &Pyramid::new(&image, 1).levels[0];
    let row = |y: usize| &plane.grey[y * plane.stride..][..9];
    assert_eq!(row(4)[2..7], [3.0, 12.0, 18.0, 12.0, 3.0]);
    assert_eq!(row(2)[4], 3.0);
}

/// Computes a level by the module's definition, pixel by pixel.
fn by_definition(
    width: usize,
    height: usize,
    at: impl Fn(usize, usize) -> f64,
    step: usize,
) -> Vec<f64> {
    let tap = |centre: usize, offset: usize, size: usize| {
        (centre + offset).saturating_sub(2).min(size - 1)
    };
    let weights = [1.0, 4.0, 6.0, 4.0, 1.0];
    let mut out = Vec::new();
    for y in (0..height).step_by(step) {
        for x in (0..width).step_by(step) {
            let row = |j| {
                (0..5)
                    .map(|i| weights[i] * at(tap(x, i, width), tap(y, j, height)))
                    .sum::<f64>()
            };
            out.push((0..5).map(|j| weights[j] * row(j)).sum::<f64>() / 256.0);
        }
    }
    out
}

#[test]
fn levels_follow_definition() {
    for (width, height) in [(1, 1), (2, 9), (9, 2), (33, 17), (64, 47), (23, 40)] {
        let grey = (0..width * height)
            .map(|i| (i * 7919 % 251) as u8)
            .collect();
        let image = Image {
            width,
            height,
            grey,
        };
        let mut pyramid = Pyramid::default();
        // Old content of the memory must not matter.
        pyramid.refill(
            &Image {
                width: 40,
                height: 40,
                grey: vec![255; 1600],
            },
            3,
        );
        pyramid.refill(&image, 4);
        let mut expected = by_definition(
            width,
            height,
            |x, y| f64::from(image.grey[y * width + x]),
            1,
        );
        for (level, plane) in pyramid.levels.iter().enumerate() {
            if level > 0 {
                let below = &pyramid.levels[level - 1];
                let at = |x, y| f64::from(below.grey[y * below.stride + x]);
                expected = by_definition(below.width, below.height, at, 2);
            }
            assert_eq!(expected.len(), plane.width * plane.height);
            for (i, expected) in expected.iter().enumerate() {
                let row = &plane.grey[i / plane.width * plane.stride..][..plane.stride];
                let value = f64::from(row[i % plane.width]);
                assert!(
                    (value - expected).abs() < 1e-4,
                    "{width} x {height}, level {level}, {i}"
                );
                assert!(
                    row[plane.width..]
                        .iter()
                        .all(|v| *v == row[plane.width - 1])
                );
            }
        }
    }
}

/// Draws an image of random grey levels, some of them runs of black or white.
fn noise(random: &mut Random, [width, height]: [usize; 2]) -> Image {
    let mut grey = Vec::with_capacity(width * height);
    for _ in 0..width * height {
        let level = random.between(-100.0, 356.0);
        grey.push(level.clamp(0.0, 255.0) as u8);
    }
    Image {
        width,
        height,
        grey,
    }
}

#[test]
fn frame_pyramid_has_bits_of_whole_one() {
    let mut random = Random::seeded(5);
    let mut frame = FramePyramid::default();
    let pool = ThreadPool::new(2);
    let mut sizes = vec![[320, 240], [64, 128], [65, 129], [63, 127]];
    sizes.extend((1..=18).flat_map(|width| [1, 2, 3, 4, 5, 6, 9, 70].map(|h| [width, h])));
    for size in sizes {
        let white = Image {
            width: size[0],
            height: size[1],
            grey: vec![255; size[0] * size[1]],
        };
        for image in [noise(&mut random, size), white] {
            let whole = Pyramid::new(&image, 4);
            // In memory of another image, with level 0 in parts or as a whole.
            let windows = random.between(0.0, 3.0) as usize * size[0] * size[1] / 800;
            pool.map(frame.bands(&image, 4, windows), Band::fill);
            frame.complete();
            assert_eq!(frame.coarse().len(), 3);
            for (level, expected) in (1..).zip(&whole.levels[1..]) {
                let found = frame.level(level).unwrap();
                assert_eq!(
                    [found.width, found.height],
                    [expected.width, expected.height]
                );
                let rows = expected.stride * expected.height;
                assert!(
                    found.grey[..rows] == expected.grey[..rows],
                    "{size:?} {level}"
                );
            }
            let first = whole.levels[0].stride * size[1];
            assert!(
                frame.fine().grey[..first] == whole.levels[0].grey[..first],
                "{size:?}"
            );
            let mut again = FramePyramid::new(&image, 2);
            again.prepare_fine(&pool);
            assert!(
                again.fine().grey[..first] == whole.levels[0].grey[..first],
                "{size:?}"
            );
        }
    }
}

#[test]
fn patch_has_bits_of_whole_level() {
    let mut random = Random::seeded(6);
    for size in [[90, 70], [41, 33], [30, 24]] {
        let image = noise(&mut random, size);
        let whole = Pyramid::new(&image, 1).levels.remove(0);
        let mut patch = Patch::default();
        for _ in 0..400 {
            // Windows of both templates, as far as they lie within the image.
            for window in [[27, 24], [19, 14]] {
                let corner = [0, 1].map(|i| {
                    let most = size[i] - window[i].min(size[i]) + 1;
                    random.between(0.0, most as f64) as usize
                });
                let start = patch.place(&image, corner, window);
                for y in 0..window[1] {
                    let found = &patch.grey()[start + y * Patch::STRIDE..][..window[0]];
                    let expected = &whole.grey[(corner[1] + y) * whole.stride + corner[0]..];
                    assert_eq!(found, &expected[..window[0]], "{size:?} {corner:?}");
                }
            }
        }
    }
}
