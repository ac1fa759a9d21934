//! Refinement of a corner to a few hundredths of a pixel.
//!
//! At a corner `q` every edge points to it: the gradient `g` at a place `p` is either zero or at
//! right angles to `p - q`. So `q` solves, over a window with weights `w`,
//!
//! ```text
//! Σ w g gᵀ q = Σ w g gᵀ p
//! ```
//!
//! (Förstner and Gülch 1987; OpenCV's `cornerSubPix` solves the same equations with the same
//! weights), iterated because the window moves with `q`. The window must see the four squares
//! around the corner and nothing else: a border or a neighbour's edge within it biases the result,
//! by whole pixels at worst.

use crate::images::Image;

/// Length of the last step, px.
const STILL_PX: f64 = 1e-4;
const MOST_ITERATIONS: usize = 100;

/// Refines the corner near `start` within a window of `2 half + 1` px. Returns `None` without a
/// corner in it.
pub fn refine(image: &Image, start: [f64; 2], half: usize) -> Option<[f64; 2]> {
    let side = 2 * half + 1;
    let mut patch = vec![0.0; (side + 2) * (side + 2)];
    let weight: Vec<f64> = (0..side)
        .map(|i| {
            let x = (i as f64 - half as f64) / half as f64;
            (-x * x).exp()
        })
        .collect();
    let mut at = start;
    for _ in 0..MOST_ITERATIONS {
        sample(image, at, half + 1, &mut patch)?;
        let (mut a, mut b, mut c, mut d, mut e) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (i, wy) in weight.iter().enumerate() {
            for (j, wx) in weight.iter().enumerate() {
                let here = (i + 1) * (side + 2) + j + 1;
                let gx = patch[here + 1] - patch[here - 1];
                let gy = patch[here + side + 2] - patch[here - side - 2];
                let (x, y) = (j as f64 - half as f64, i as f64 - half as f64);
                let w = wx * wy;
                let [xx, xy, yy] = [w * gx * gx, w * gx * gy, w * gy * gy];
                a += xx;
                b += xy;
                c += yy;
                d += xx * x + xy * y;
                e += xy * x + yy * y;
            }
        }
        let determinant = a * c - b * b;
        // A single edge leaves the position along it undetermined.
        if !(determinant > 1e-3 * (a + c) * (a + c) / 4.0) {
            return None;
        }
        let step = [(c * d - b * e) / determinant, (a * e - b * d) / determinant];
        at = [at[0] + step[0], at[1] + step[1]];
        if [0, 1]
            .iter()
            .any(|&i| (at[i] - start[i]).abs() > half as f64)
        {
            return None;
        }
        if step[0].hypot(step[1]) < STILL_PX {
            break;
        }
    }
    Some(at)
}

/// Reads grey levels on a grid around `at`, interpolated linearly; the image's border repeats.
/// Returns `None` far outside the image.
fn sample(image: &Image, at: [f64; 2], reach: usize, patch: &mut [f64]) -> Option<()> {
    let [columns, rows] = [image.width, image.height].map(|n| n as f64);
    if !(at[0] >= 0.0 && at[1] >= 0.0 && at[0] <= columns - 1.0 && at[1] <= rows - 1.0) {
        return None;
    }
    let side = 2 * reach + 1;
    let [(x0, fx), (y0, fy)] = at.map(|c| (c.floor() as isize - reach as isize, c.fract()));
    let clamp = |i: isize, size: usize| i.clamp(0, size as isize - 1) as usize;
    let level = |x: isize, y: isize| {
        f64::from(image.grey[clamp(y, image.height) * image.width + clamp(x, image.width)])
    };
    for (i, row) in patch.chunks_exact_mut(side).enumerate() {
        let y = y0 + i as isize;
        for (j, out) in row.iter_mut().enumerate() {
            let x = x0 + j as isize;
            let upper = (1.0 - fx) * level(x, y) + fx * level(x + 1, y);
            let lower = (1.0 - fx) * level(x, y + 1) + fx * level(x + 1, y + 1);
            *out = (1.0 - fy) * upper + fy * lower;
        }
    }
    Some(())
}
