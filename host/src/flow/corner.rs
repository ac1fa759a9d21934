//! Where an image can be tracked: corners after Shi and Tomasi (1994).

use super::plane::Plane;

/// Half side of the window over which gradients are summed, px.
const WINDOW: usize = 3;

/// A corner must reach this share of the strongest one's smaller eigenvalue.
const QUALITY: f32 = 0.01;

/// Up to `count` corners, whole pixels, strongest first, at least `distance` px apart and `margin` px from the border.
///
/// The measure is the smaller eigenvalue of the gradient matrix `Σ [gx² gx gy; gx gy gy²]` over 7 x 7 px: large only where the image varies along
/// both axes.
pub fn corners(plane: &Plane, count: usize, distance: usize, margin: usize) -> Vec<[f32; 2]> {
    let (width, height) = (plane.width, plane.height);
    let margin = margin.max(WINDOW + 2);
    if width <= 2 * margin || height <= 2 * margin {
        return Vec::new();
    }
    let strength = strengths(plane);
    let best = strength.iter().copied().fold(0.0, f32::max);
    let mut peaks = Vec::new();
    for y in margin..height - margin {
        for x in margin..width - margin {
            let here = strength[y * width + x];
            if here <= QUALITY * best || here <= f32::MIN_POSITIVE {
                continue;
            }
            let around = |dx: isize, dy: isize| {
                strength[(y.wrapping_add_signed(dy)) * width + x.wrapping_add_signed(dx)]
            };
            let highest =
                (-1..=1).all(|dy| (-1..=1).all(|dx| (dx, dy) == (0, 0) || around(dx, dy) <= here));
            if highest {
                peaks.push((here, x, y));
            }
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.2, a.1).cmp(&(b.2, b.1))));
    apart(&peaks, count, distance, width, height)
}

/// The strongest peaks that keep their distance; a coarse grid makes the search for neighbours short.
fn apart(
    peaks: &[(f32, usize, usize)],
    count: usize,
    distance: usize,
    width: usize,
    height: usize,
) -> Vec<[f32; 2]> {
    let cell = distance.max(1);
    let (columns, rows) = (width.div_ceil(cell), height.div_ceil(cell));
    let mut taken: Vec<Vec<(usize, usize)>> = vec![Vec::new(); columns * rows];
    let mut chosen = Vec::new();
    for &(_, x, y) in peaks {
        let (column, row) = (x / cell, y / cell);
        let free = (row.saturating_sub(1)..(row + 2).min(rows)).all(|r| {
            (column.saturating_sub(1)..(column + 2).min(columns)).all(|c| {
                taken[r * columns + c].iter().all(|&(u, v)| {
                    u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2) >= distance * distance
                })
            })
        });
        if free {
            taken[row * columns + column].push((x, y));
            chosen.push([x as f32, y as f32]);
            if chosen.len() == count {
                break;
            }
        }
    }
    chosen
}

/// The smaller eigenvalue at every pixel; zero within `WINDOW + 1` px of the border.
fn strengths(plane: &Plane) -> Vec<f32> {
    let (width, height) = (plane.width, plane.height);
    let size = width * height;
    let (mut xx, mut xy, mut yy) = (vec![0.0f32; size], vec![0.0f32; size], vec![0.0f32; size]);
    for y in 1..height - 1 {
        let (above, row, below) = (plane.row(y - 1), plane.row(y), plane.row(y + 1));
        for x in 1..width - 1 {
            let (gx, gy) = (row[x + 1] - row[x - 1], below[x] - above[x]);
            let at = y * width + x;
            (xx[at], xy[at], yy[at]) = (gx * gx, gx * gy, gy * gy);
        }
    }
    let (xx, xy, yy) = (boxed(&xx, width), boxed(&xy, width), boxed(&yy, width));
    let eigenvalue = |i: usize| {
        let (half_sum, half_difference) = (0.5 * (xx[i] + yy[i]), 0.5 * (xx[i] - yy[i]));
        half_sum - (half_difference * half_difference + xy[i] * xy[i]).sqrt()
    };
    (0..size).map(eigenvalue).collect()
}

/// Sums over windows of `2 WINDOW + 1` px squared; zero near the border.
fn boxed(values: &[f32], width: usize) -> Vec<f32> {
    let side = 2 * WINDOW + 1;
    let mut across = vec![0.0f32; values.len()];
    for (out, row) in across
        .chunks_exact_mut(width)
        .zip(values.chunks_exact(width))
    {
        for (o, window) in out[WINDOW..].iter_mut().zip(row.windows(side)) {
            *o = window.iter().sum();
        }
    }
    let height = values.len() / width;
    let mut down = vec![0.0f32; values.len()];
    for y in WINDOW..height.saturating_sub(WINDOW) {
        let out = &mut down[y * width..(y + 1) * width];
        for v in y - WINDOW..=y + WINDOW {
            for (o, a) in out.iter_mut().zip(&across[v * width..(v + 1) * width]) {
                *o += a;
            }
        }
    }
    down
}

#[cfg(test)]
mod tests {
    use super::*;

    fn squares() -> Plane {
        let inside = |x: usize, y: usize| (20..40).contains(&x) && (25..45).contains(&y);
        let grey = (0..64 * 64)
            .map(|i| if inside(i % 64, i / 64) { 200.0 } else { 20.0 })
            .collect();
        Plane {
            width: 64,
            height: 64,
            grey,
        }
        .filtered()
    }

    #[test]
    fn a_square_has_four_corners_and_its_edges_none() {
        let mut found = corners(&squares(), 50, 6, 8);
        found.sort_by(|a, b| (a[1], a[0]).partial_cmp(&(b[1], b[0])).unwrap());
        let expected = [[20.0, 25.0], [39.0, 25.0], [20.0, 44.0], [39.0, 44.0]];
        assert_eq!(found.len(), 4, "{found:?}");
        for (got, want) in found.iter().zip(expected) {
            assert!(
                (got[0] - want[0]).abs() <= 2.5 && (got[1] - want[1]).abs() <= 2.5,
                "{found:?}"
            );
        }
    }

    #[test]
    fn count_distance_and_flat_images() {
        assert_eq!(corners(&squares(), 2, 6, 8).len(), 2);
        assert_eq!(corners(&squares(), 9, 40, 8).len(), 1);
        let flat = Plane {
            width: 64,
            height: 64,
            grey: vec![7.0; 64 * 64],
        };
        assert!(corners(&flat, 9, 5, 8).is_empty());
        let tiny = Plane {
            width: 6,
            height: 6,
            grey: vec![7.0; 36],
        };
        assert!(corners(&tiny, 9, 5, 8).is_empty());
    }
}
