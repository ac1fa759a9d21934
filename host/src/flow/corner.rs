//! Points worth following: where the image changes in both directions.
//!
//! Shi and Tomasi's measure: the smaller eigenvalue of the gradient matrix, summed over a 7 x 7 window. Corners are
//! its local maxima; they are taken in rounds, the best of every cell first, so that they cover the image even where it is pale.

use super::pyramid::Plane;

/// Half the window the gradient matrix is summed over, px.
const REACH: usize = 3;
/// The least eigenvalue of a corner: a gradient of 1 grey level per pixel (root mean square over the window) in the
/// weakest direction, three times what noise of 2 grey levels leaves after the filter.
const LEAST: f32 = ((2 * REACH + 1) * (2 * REACH + 1)) as f32;
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
    for y in margin..height.saturating_sub(margin) {
        for x in margin..width.saturating_sub(margin) {
            let here = score[y * width + x];
            if here > LEAST && is_peak(&score, width, x, y) {
                cells[y / CELL * columns + x / CELL].push((here, [x, y]));
            }
        }
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

/// Whether no neighbour is better. Of equal neighbours, the last counts.
fn is_peak(score: &[f32], width: usize, x: usize, y: usize) -> bool {
    let here = score[y * width + x];
    let row = |y: usize| &score[y * width + x - 1..][..3];
    let (above, level, below) = (row(y - 1), row(y), row(y + 1));
    here >= level[0]
        && here > level[2]
        && above.iter().all(|s| here >= *s)
        && below.iter().all(|s| here > *s)
}

/// The smaller eigenvalue at every pixel; 0 along the border.
fn smaller_eigenvalue(plane: &Plane) -> Vec<f32> {
    let (width, height) = (plane.width, plane.height);
    let mut score = vec![0.0_f32; width * height];
    if width < 2 * REACH + 3 || height < 2 * REACH + 3 {
        return score;
    }
    // Products gx gx, gx gy, gy gy of the row entering the window and running sums over its rows.
    let mut sums = [0, 1, 2].map(|_| vec![0.0_f32; width]);
    let mut products = [0, 1, 2].map(|_| vec![0.0_f32; width * height]);
    for y in 1..height - 1 {
        let row = |y: usize| &plane.grey[y * plane.stride..][..width];
        let (above, level, below) = (row(y - 1), row(y), row(y + 1));
        let [xx, xy, yy] = &mut products;
        let start = y * width;
        let (xx, xy, yy) = (&mut xx[start..], &mut xy[start..], &mut yy[start..]);
        for x in 1..width - 1 {
            let gx = 0.5 * (level[x + 1] - level[x - 1]);
            let gy = 0.5 * (below[x] - above[x]);
            xx[x] = gx * gx;
            xy[x] = gx * gy;
            yy[x] = gy * gy;
        }
    }
    for y in 1 + REACH..height - 1 - REACH {
        for (sum, product) in sums.iter_mut().zip(&products) {
            sum.fill(0.0);
            for inner in y - REACH..=y + REACH {
                for (s, p) in sum.iter_mut().zip(&product[inner * width..]) {
                    *s += p;
                }
            }
        }
        let out = &mut score[y * width..][..width];
        let across = |sum: &[f32], x: usize| sum[x - REACH..=x + REACH].iter().sum::<f32>();
        for (x, out) in out
            .iter_mut()
            .enumerate()
            .take(width - 1 - REACH)
            .skip(1 + REACH)
        {
            let [xx, xy, yy] = [0, 1, 2].map(|i| across(&sums[i], x));
            let half = 0.5 * (xx - yy);
            *out = 0.5 * (xx + yy) - (half * half + xy * xy).sqrt();
        }
    }
    score
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
