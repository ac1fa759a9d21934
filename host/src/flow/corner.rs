//! Points worth following: where the image changes in both directions.
//!
//! Shi and Tomasi's measure: the smaller eigenvalue of the gradient matrix, summed over a 7 x 7 window. Corners are
//! its local maxima; they are taken in rounds, the best of every cell first, so that they cover the image even where it is pale.

use pulp::{Arch, NullaryFnOnce};

use super::pyramid::Plane;

/// Half the window the gradient matrix is summed over, px.
const REACH: usize = 3;
const SIDE: usize = 2 * REACH + 1;
/// The least eigenvalue of a corner: a gradient of 1 grey level per pixel (root mean square over the window) in the
/// weakest direction, three times what noise of 2 grey levels leaves after the filter.
const LEAST: f32 = (SIDE * SIDE) as f32;
/// The side of a cell, px.
const CELL: usize = 20;

/// Corners of `plane` at least `margin` px from its border and `apart` px from each other, at most `count`, the most
/// useful first.
pub fn corners(plane: &Plane, margin: usize, apart: f64, count: usize) -> Vec<[usize; 2]> {
    let score = smaller_eigenvalue(plane);
    let (width, height) = (plane.width, plane.height);
    let margin = margin.max(REACH + 2);
    let columns = width.div_ceil(CELL);
    let mut cells: Vec<Vec<(f32, [usize; 2])>> = vec![Vec::new(); columns * height.div_ceil(CELL)];
    let peaks = Arch::new().dispatch(Peaks {
        score: &score,
        width,
        margin,
    });
    for [x, y] in peaks {
        cells[y / CELL * columns + x / CELL].push((score[y * width + x], [x, y]));
    }
    for cell in &mut cells {
        cell.sort_by(|a, b| b.0.total_cmp(&a.0));
    }
    let mut taken: Vec<[usize; 2]> = Vec::with_capacity(count);
    let most = cells.iter().map(Vec::len).max().unwrap_or(0);
    for round in 0..most {
        let mut candidates: Vec<_> = cells.iter().filter_map(|cell| cell.get(round)).collect();
        candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (_, at) in candidates {
            let near = |other: &[usize; 2]| {
                let square = |axis: usize| (at[axis] as f64 - other[axis] as f64).powi(2);
                square(0) + square(1) < apart * apart
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

/// The smaller eigenvalue at every pixel; 0 along the border.
fn smaller_eigenvalue(plane: &Plane) -> Vec<f32> {
    let mut score = vec![0.0_f32; plane.width * plane.height];
    if plane.width >= SIDE + 2 && plane.height >= SIDE + 2 {
        Arch::new().dispatch(Eigenvalues {
            plane,
            score: &mut score,
        });
    }
    score
}

/// The smaller eigenvalue of every window.
struct Eigenvalues<'a> {
    plane: &'a Plane,
    score: &'a mut [f32],
}

impl NullaryFnOnce for Eigenvalues<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (width, height) = (self.plane.width, self.plane.height);
        let row = |y: usize| &self.plane.grey[y * self.plane.stride..][..width];
        // Products gx gx, gx gy, gy gy of the last rows, in a ring; those of column x are at x - 1.
        let inner = width - 2;
        let mut ring = [0; SIDE].map(|_| [0, 1, 2].map(|_| vec![0.0_f32; inner]));
        let mut sums = vec![0.0_f32; inner];
        let places = inner - (SIDE - 1);
        let mut windows = [0, 1, 2].map(|_| vec![0.0_f32; places]);
        for y in 1..height - 1 {
            let (above, level, below) = (row(y - 1), row(y), row(y + 1));
            let [xx, xy, yy] = &mut ring[y % SIDE];
            products([above, level, below], [xx, xy, yy]);
            if y < SIDE {
                continue;
            }
            for (part, window) in windows.iter_mut().enumerate() {
                sums.fill(0.0);
                for products in &ring {
                    for (sum, product) in sums.iter_mut().zip(&products[part]) {
                        *sum += product;
                    }
                }
                sums_of_seven(&sums, window);
            }
            let [xx, xy, yy] = &windows;
            let out = &mut self.score[(y - REACH) * width + 1 + REACH..][..places];
            for (((out, xx), xy), yy) in out.iter_mut().zip(xx).zip(xy).zip(yy) {
                let half = 0.5 * (xx - yy);
                *out = 0.5 * (xx + yy) - (half * half + xy * xy).sqrt();
            }
        }
    }
}

/// Products of the central differences, without the first and the last column.
#[inline(always)]
fn products([above, level, below]: [&[f32]; 3], [xx, xy, yy]: [&mut Vec<f32>; 3]) {
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

/// Sums of [`SIDE`] values from each place on.
#[inline(always)]
fn sums_of_seven(values: &[f32], out: &mut [f32]) {
    const { assert!(SIDE == 7) }
    let count = out.len();
    let [a, b, c, d, e, f, g] = [0, 1, 2, 3, 4, 5, 6].map(|i| &values[i..][..count]);
    for x in 0..count {
        out[x] = (a[x] + b[x]) + (c[x] + d[x]) + (e[x] + f[x]) + g[x];
    }
}

/// Where the score is above [`LEAST`] and no neighbour's is higher, at least `margin` px from the border. Of equal neighbours, the last counts.
struct Peaks<'a> {
    score: &'a [f32],
    width: usize,
    margin: usize,
}

impl NullaryFnOnce for Peaks<'_> {
    type Output = Vec<[usize; 2]>;

    #[inline(always)]
    fn call(self) -> Vec<[usize; 2]> {
        let (width, margin) = (self.width, self.margin);
        let height = self.score.len() / width.max(1);
        let mut found = Vec::new();
        if width <= 2 * margin || height <= 2 * margin {
            return found;
        }
        let count = width - 2 * margin;
        let mut is_peak = vec![0_u8; count];
        for y in margin..height - margin {
            let part = |dx: usize, dy: usize| {
                &self.score[(y + dy - 1) * width + margin + dx - 1..][..count]
            };
            let here = part(1, 1);
            let [a, b, c] = [0, 1, 2].map(|dx| part(dx, 0));
            let (d, e) = (part(0, 1), part(2, 1));
            let [f, g, h] = [0, 1, 2].map(|dx| part(dx, 2));
            for x in 0..count {
                let s = here[x];
                let before = (s >= a[x]) & (s >= b[x]) & (s >= c[x]) & (s >= d[x]);
                let after = (s > e[x]) & (s > f[x]) & (s > g[x]) & (s > h[x]);
                is_peak[x] = u8::from(before & after & (s > LEAST));
            }
            for (block, flags) in is_peak.chunks(16).enumerate() {
                if flags.iter().fold(0, |any, flag| any | flag) == 0 {
                    continue;
                }
                for (x, _) in flags.iter().enumerate().filter(|(_, flag)| **flag == 1) {
                    found.push([margin + 16 * block + x, y]);
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::pyramid::Pyramid;
    use crate::images::Image;

    fn plane(level: impl Fn(usize, usize) -> u8) -> Plane {
        let grey = (0..120 * 100).map(|i| level(i % 120, i / 120)).collect();
        let image = Image {
            width: 120,
            height: 100,
            grey,
        };
        Pyramid::new(&image, 1).levels.remove(0)
    }

    #[test]
    fn a_square_has_four_corners_and_its_edges_none() {
        let square = |x, y| {
            if (40..80).contains(&x) && (30..70).contains(&y) {
                200
            } else {
                50
            }
        };
        let mut found = corners(&plane(square), 10, 6.0, 50);
        found.sort_unstable();
        assert_eq!(found.len(), 4, "{found:?}");
        for (at, expected) in found.iter().zip([[40, 30], [40, 69], [79, 30], [79, 69]]) {
            assert!(at[0].abs_diff(expected[0]) <= 3 && at[1].abs_diff(expected[1]) <= 3);
        }
    }

    #[test]
    fn an_even_image_and_a_slope_have_none() {
        assert!(corners(&plane(|_, _| 128), 10, 6.0, 50).is_empty());
        assert!(corners(&plane(|x, y| (x + y) as u8), 10, 6.0, 50).is_empty());
    }

    #[test]
    fn corners_keep_their_distance() {
        let noise = |x: usize, y: usize| ((x / 3 * 7919 + y / 3 * 104_729) % 251) as u8;
        let found = corners(&plane(noise), 10, 9.0, 500);
        assert!(found.len() > 20);
        for (i, a) in found.iter().enumerate() {
            for b in &found[..i] {
                let square = |axis: usize| (a[axis] as f64 - b[axis] as f64).powi(2);
                assert!(square(0) + square(1) >= 81.0);
            }
        }
    }
}
