//! Blur of a board's edges.
//!
//! An edge between two grey levels that differ by `D`, blurred by a Gaussian, rises by at most `D /
//! (sqrt(2 π) σ)` per pixel. The result is the larger of two medians, one over the edges along each
//! of the board's directions, because motion blurs one direction only.

use super::board::Board;
use crate::images::Image;
use crate::median::median;

/// Share of a square that is sampled on either side of an edge.
const REACH: f64 = 0.3;
/// Distance of the samples, px.
const STEP_PX: f64 = 0.5;

/// Measures the blur of the edges between `corners`, px.
pub fn of_edges(image: &Image, board: &Board, corners: &[[f64; 2]]) -> f64 {
    let [columns, rows] = board.corners;
    let mut along = Vec::new();
    let mut down = Vec::new();
    for r in 0..rows {
        for c in 0..columns {
            let here = c + r * columns;
            let below = (r + 1 < rows).then_some(here + columns);
            let right = (c + 1 < columns).then_some(here + 1);
            if let (Some(below), Some(right)) = (below, right) {
                along.extend(of_edge(
                    image,
                    corners[here],
                    corners[right],
                    corners[below],
                ));
                down.extend(of_edge(
                    image,
                    corners[here],
                    corners[below],
                    corners[right],
                ));
            }
        }
    }
    median(along).max(median(down))
}

/// Samples across the middle of the edge from `a` to `b`, towards the side of `aside`.
fn of_edge(image: &Image, a: [f64; 2], b: [f64; 2], aside: [f64; 2]) -> Option<f64> {
    let way = [b[0] - a[0], b[1] - a[1]];
    let length = way[0].hypot(way[1]);
    let normal = [-way[1] / length, way[0] / length];
    let height = (0..2)
        .map(|i| normal[i] * (aside[i] - a[i]))
        .sum::<f64>()
        .abs();
    let reach = (REACH * height / STEP_PX).round() as i32;
    let levels: Vec<f64> = (-reach..=reach)
        .map(|i| {
            let off = f64::from(i) * STEP_PX;
            grey(
                image,
                [0, 1].map(|axis| (a[axis] + b[axis]) / 2.0 + off * normal[axis]),
            )
        })
        .collect();
    let rise = levels
        .windows(3)
        .map(|w| (w[2] - w[0]).abs() / (2.0 * STEP_PX))
        .fold(0.0, f64::max);
    let difference = (levels.last()? - levels.first()?).abs();
    (rise > 0.0).then(|| difference / rise / std::f64::consts::TAU.sqrt())
}

fn grey(image: &Image, at: [f64; 2]) -> f64 {
    let [x, y] = [(at[0], image.width), (at[1], image.height)]
        .map(|(c, size)| c.clamp(0.0, (size as f64 - 2.0).max(0.0)));
    let (fx, fy) = (x.fract(), y.fract());
    let level = |dx: usize, dy: usize| {
        let place = (y as usize + dy) * image.width + x as usize + dx;
        f64::from(image.grey.get(place).copied().unwrap_or(0))
    };
    let upper = (1.0 - fx) * level(0, 0) + fx * level(1, 0);
    let lower = (1.0 - fx) * level(0, 1) + fx * level(1, 1);
    (1.0 - fy) * upper + fy * lower
}
