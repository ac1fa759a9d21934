//! Shi-Tomasi corners, spread over the image.
//!
//! The measure is the smaller eigenvalue of the gradient matrix, summed over a 7 x 7 window (J. Shi
//! and C. Tomasi, *Good Features to Track*, 1994). Corners are its local maxima. They are taken in
//! rounds, the best of every cell first, so that they cover the image even where contrast is low.
//! OpenCV's `goodFeaturesToTrack` takes the best of the whole image instead.

use std::ops::Range;

use pulp::{Arch, NullaryFnOnce};

use super::pyramid::Plane;
use crate::thread_pool::ThreadPool;

/// Radius of the window over which the gradient matrix is summed, px.
const RADIUS: usize = 3;
const SIDE: usize = 2 * RADIUS + 1;
/// Width of a strip, px. Strips are processed one after the other from top to bottom, so that the
/// last rows' products stay in the nearest cache for any image width.
const STRIP: usize = 320;
/// Number of pixels over which the gradient matrix is summed.
const AREA: f32 = (SIDE * SIDE) as f32;
/// Side of a cell, px.
const CELL: usize = 20;

/// Smaller eigenvalue of a local maximum, and its pixel.
type Peak = (f32, [usize; 2]);

/// Chooses corners: how many, where, and how strong.
#[derive(Clone, Copy, Debug)]
pub struct CornerSettings {
    /// Least distance from the border of the image, px.
    pub margin: usize,
    /// Least distance between two corners, px.
    pub spacing_px: f64,
    /// Least gradient around a corner, root mean square in its weakest direction, grey levels per
    /// px.
    pub min_gradient: f32,
    /// Largest number of corners.
    pub count: usize,
}

/// Finds at most `count` corners of `plane`, at least `margin` px from its border and `spacing_px`
/// from each other, the best of every part of the image first.
///
/// ```
/// use trinocular_core::rig::Rig;
/// use trinocular_vision::images::{Scene, SceneSettings, Texture};
/// use trinocular_vision::matching::corner::corners;
/// use trinocular_vision::matching::pyramid::Pyramid;
/// use trinocular_vision::thread_pool::ThreadPool;
///
/// let scene = Scene::new(&Rig::paper(), &Texture::natural(1), SceneSettings::default())?;
/// let frame_set = scene.render([0.0; 3], 0, 1);
/// let pyramid = Pyramid::new(&frame_set.images[0], 1);
/// let found = corners(&pyramid.levels[0], 10, 5.0, 50, &ThreadPool::default());
/// assert_eq!(found.len(), 50);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn corners(
    plane: &Plane,
    margin: usize,
    spacing_px: f64,
    count: usize,
    thread_pool: &ThreadPool,
) -> Vec<[usize; 2]> {
    let settings = CornerSettings {
        margin,
        spacing_px,
        min_gradient: 1.0,
        count,
    };
    corners_within(plane, &settings, thread_pool, |_| true)
}

/// Does the same as [`corners`] for the pixels that `is_within` accepts.
pub fn corners_within(
    plane: &Plane,
    settings: &CornerSettings,
    thread_pool: &ThreadPool,
    is_within: impl Fn([usize; 2]) -> bool,
) -> Vec<[usize; 2]> {
    let CornerSettings {
        spacing_px, count, ..
    } = *settings;
    let margin = settings.margin.max(RADIUS + 2);
    let least = AREA * settings.min_gradient * settings.min_gradient;
    let columns = plane.width.div_ceil(CELL);
    let mut cells = vec![Vec::new(); columns * plane.height.div_ceil(CELL)];
    let arch = Arch::new();
    let peaks = |rows| {
        arch.dispatch(Peaks {
            plane,
            margin,
            least,
            rows,
        })
    };
    for peak in thread_pool.map(bands(plane, thread_pool), peaks).concat() {
        let (_, [x, y]) = peak;
        if !is_within([x, y]) {
            continue;
        }
        cells[y / CELL * columns + x / CELL].push(peak);
    }
    // Round by round: the next best corner of every cell, the best of the round first.
    for cell in &mut cells {
        cell.sort_by(|a: &Peak, b| b.0.total_cmp(&a.0));
    }
    let mut taken: Vec<[usize; 2]> = Vec::with_capacity(count);
    let most = cells.iter().map(Vec::len).max().unwrap_or(0);
    for round in 0..most {
        let mut candidates: Vec<_> = cells.iter().filter_map(|cell| cell.get(round)).collect();
        candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (_, at) in candidates {
            let near = |other: &[usize; 2]| {
                let square = |axis: usize| (at[axis] as f64 - other[axis] as f64).powi(2);
                square(0) + square(1) < spacing_px * spacing_px
            };
            if !taken.iter().any(near) {
                taken.push(*at);
            }
            if taken.len() == count {
                return taken;
            }
        }
    }
    taken
}

/// Splits the rows among the threads: equal shares of whole cells, so that the peaks of a cell come
/// in the same order on any number of threads.
fn bands(plane: &Plane, thread_pool: &ThreadPool) -> Vec<Range<usize>> {
    let cells = plane.height.div_ceil(CELL);
    let share = CELL * cells.div_ceil(thread_pool.count()).max(1);
    (0..plane.height)
        .step_by(share)
        .map(|top| top..(top + share).min(plane.height))
        .collect()
}

/// Search of some rows for local maxima of the smaller eigenvalue above `least`, at least `margin`
/// px from the border of the image. `margin` is at least [`RADIUS`]` + 2`. Of equal neighbours, the
/// last counts.
struct Peaks<'a> {
    plane: &'a Plane,
    margin: usize,
    least: f32,
    rows: Range<usize>,
}

impl NullaryFnOnce for Peaks<'_> {
    type Output = Vec<Peak>;

    #[inline(always)]
    fn call(self) -> Vec<Peak> {
        let (plane, margin) = (self.plane, self.margin);
        let (width, height) = (plane.width, plane.height);
        let mut found = Vec::new();
        let first = self.rows.start.max(margin);
        let end = self.rows.end.min(height.saturating_sub(margin));
        if width <= 2 * margin || first >= end {
            return found;
        }
        // Ring buffers of the last rows: products gx gx, gx gy, gy gy, and eigenvalues.
        let mut ring = [0; SIDE].map(|_| [0, 1, 2].map(|_| vec![0.0_f32; STRIP + 2 + SIDE - 1]));
        let mut scores = [0; 3].map(|_| vec![0.0_f32; STRIP + 2]);
        let mut sums = vec![0.0_f32; STRIP + 2 + SIDE - 1];
        let mut windows = [0, 1, 2].map(|_| vec![0.0_f32; STRIP + 2]);
        let mut is_peak = vec![0_u8; STRIP];
        for left in (margin..width - margin).step_by(STRIP) {
            let is_peak = &mut is_peak[..STRIP.min(width - margin - left)];
            // One neighbour on either side, its window and its central differences.
            let places = is_peak.len() + 2;
            let inner = places + SIDE - 1;
            let leftmost = left - (RADIUS + 2);
            let row = |y: usize| &plane.grey[y * plane.stride + leftmost..][..inner + 2];
            // One row of neighbours above and below.
            for lowest in first - 1 - RADIUS..=end + RADIUS {
                let newest = ring[lowest % SIDE]
                    .each_mut()
                    .map(|part| &mut part[..inner]);
                products([row(lowest - 1), row(lowest), row(lowest + 1)], newest);
                if lowest < first - 1 + RADIUS {
                    continue;
                }
                for (part, window) in windows.iter_mut().enumerate() {
                    let rows = ring.each_ref().map(|products| &products[part][..inner]);
                    // Box filter of the gradient matrix: rows, then columns.
                    sums_of_rows(rows, &mut sums[..inner]);
                    sums_of_seven(&sums[..inner], &mut window[..places]);
                }
                let below = lowest - RADIUS;
                let windows = windows.each_ref().map(|window| &window[..places]);
                smaller_eigenvalues(windows, &mut scores[below % 3][..places]);
                if below < first + 1 {
                    continue;
                }
                // Non-maximum suppression in 3 x 3 neighbourhoods.
                let y = below - 1;
                let rows = [below - 2, y, below].map(|y| &scores[y % 3][..places]);
                mark_peaks(rows, self.least, is_peak);
                for (block, flags) in is_peak.chunks(16).enumerate() {
                    if flags.iter().fold(0, |any, flag| any | flag) == 0 {
                        continue;
                    }
                    for (x, _) in flags.iter().enumerate().filter(|(_, flag)| **flag == 1) {
                        let x = 16 * block + x;
                        found.push((rows[1][x + 1], [left + x, y]));
                    }
                }
            }
        }
        found
    }
}

/// Computes the smaller eigenvalues of the matrices `[xx xy; xy yy]`.
#[inline(always)]
fn smaller_eigenvalues([xx, xy, yy]: [&[f32]; 3], out: &mut [f32]) {
    for (((out, xx), xy), yy) in out.iter_mut().zip(xx).zip(xy).zip(yy) {
        let half = 0.5 * (xx - yy);
        *out = 0.5 * (xx + yy) - (half * half + xy * xy).sqrt();
    }
}

/// Flags local maxima of the middle row with 1, without its first and last place.
#[inline(always)]
fn mark_peaks([above, level, below]: [&[f32]; 3], least: f32, is_peak: &mut [u8]) {
    let count = is_peak.len();
    let [a, b, c] = [0, 1, 2].map(|dx| &above[dx..][..count]);
    let [d, here, e] = [0, 1, 2].map(|dx| &level[dx..][..count]);
    let [f, g, h] = [0, 1, 2].map(|dx| &below[dx..][..count]);
    for x in 0..count {
        let s = here[x];
        let before = (s >= a[x]) & (s >= b[x]) & (s >= c[x]) & (s >= d[x]);
        let after = (s > e[x]) & (s > f[x]) & (s > g[x]) & (s > h[x]);
        is_peak[x] = u8::from(before & after & (s > least));
    }
}

/// Computes products of central differences, without the first and last column.
#[inline(always)]
fn products([above, level, below]: [&[f32]; 3], [xx, xy, yy]: [&mut [f32]; 3]) {
    let count = xx.len();
    let (left, right) = (&level[..count], &level[2..][..count]);
    let (above, below) = (&above[1..][..count], &below[1..][..count]);
    let (xx, xy, yy) = (&mut xx[..count], &mut xy[..count], &mut yy[..count]);
    for x in 0..count {
        let gx = 0.5 * (right[x] - left[x]);
        let gy = 0.5 * (below[x] - above[x]);
        xx[x] = gx * gx;
        xy[x] = gx * gy;
        yy[x] = gy * gy;
    }
}

/// Computes sums of [`SIDE`] values from each place on.
#[inline(always)]
fn sums_of_seven(values: &[f32], out: &mut [f32]) {
    sums_of_rows([0, 1, 2, 3, 4, 5, 6].map(|i| &values[i..]), out);
}

/// Computes sums of [`SIDE`] rows, place by place.
#[inline(always)]
fn sums_of_rows(rows: [&[f32]; SIDE], out: &mut [f32]) {
    let count = out.len();
    let [a, b, c, d, e, f, g] = rows.map(|row| &row[..count]);
    for x in 0..count {
        out[x] = (a[x] + b[x]) + (c[x] + d[x]) + (e[x] + f[x]) + g[x];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::Image;
    use crate::matching::pyramid::Pyramid;

    fn plane(level: impl Fn(usize, usize) -> u8) -> Plane {
        wide(120, level)
    }

    fn wide(width: usize, level: impl Fn(usize, usize) -> u8) -> Plane {
        let grey = (0..width * 100)
            .map(|i| level(i % width, i / width))
            .collect();
        let image = Image {
            width,
            height: 100,
            grey,
        };
        Pyramid::new(&image, 1).levels.remove(0)
    }

    fn corners_of(plane: &Plane, spacing_px: f64, count: usize) -> Vec<[usize; 2]> {
        corners(plane, 10, spacing_px, count, &ThreadPool::default())
    }

    #[test]
    fn square_has_four_corners() {
        let square = |x, y| {
            if (40..80).contains(&x) && (30..70).contains(&y) {
                200
            } else {
                50
            }
        };
        let mut found = corners_of(&plane(square), 6.0, 50);
        found.sort_unstable();
        assert_eq!(found.len(), 4, "{found:?}");
        for (at, expected) in found.iter().zip([[40, 30], [40, 69], [79, 30], [79, 69]]) {
            assert!(at[0].abs_diff(expected[0]) <= 3 && at[1].abs_diff(expected[1]) <= 3);
        }
    }

    #[test]
    fn plain_image_and_slope_have_no_corners() {
        assert!(corners_of(&plane(|_, _| 128), 6.0, 50).is_empty());
        assert!(corners_of(&plane(|x, y| (x + y) as u8), 6.0, 50).is_empty());
    }

    #[test]
    fn corners_keep_their_spacing() {
        let noise = |x: usize, y: usize| ((x / 3 * 7919 + y / 3 * 104_729) % 251) as u8;
        let found = corners_of(&plane(noise), 9.0, 500);
        assert!(found.len() > 20);
        for (i, a) in found.iter().enumerate() {
            for b in &found[..i] {
                let square = |axis: usize| (a[axis] as f64 - b[axis] as f64).powi(2);
                assert!(square(0) + square(1) >= 81.0);
            }
        }
    }

    /// Tests a texture of equal tiles, which has many equal corners: their order decides which of
    /// them are chosen.
    #[test]
    fn threads_do_not_change_corners() {
        let tiles = |x: usize, y: usize| ((x % 12 / 3 * 7919 + y % 12 / 3 * 104_729) % 251) as u8;
        let noise = |x: usize, y: usize| ((x / 3 * 7919 + y / 3 * 104_729) % 251) as u8;
        // An image so wide that a cell lies in two strips.
        for plane in [wide(STRIP + 60, tiles), wide(STRIP + 60, noise)] {
            let alone = corners_of(&plane, 5.0, 400);
            assert!(alone.len() > 20);
            for threads in [2, 3, 5, 9] {
                let thread_pool = ThreadPool::new(threads);
                assert_eq!(
                    corners(&plane, 10, 5.0, 400, &thread_pool),
                    alone,
                    "{threads}"
                );
            }
        }
    }
}
