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
use crate::matching::pyramid::Plane;

/// Grey levels of a photograph, or of a level of its pyramid.
pub trait Grey {
    /// Returns the number of columns and of rows.
    fn size(&self) -> [usize; 2];

    /// Returns the grey level of a pixel within the image.
    fn level(&self, x: usize, y: usize) -> f64;
}

impl Grey for Image {
    fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    fn level(&self, x: usize, y: usize) -> f64 {
        f64::from(self.grey[y * self.width + x])
    }
}

impl Grey for Plane {
    fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    fn level(&self, x: usize, y: usize) -> f64 {
        f64::from(self.grey[y * self.stride + x])
    }
}

/// Length of the last step, px.
const STILL_PX: f64 = 1e-4;
const MOST_ITERATIONS: usize = 100;

/// Refines the corner near `start` within a window of `2 half + 1` px. Returns `None` without a
/// corner in it.
pub fn refine(image: &impl Grey, start: [f64; 2], half: usize) -> Option<[f64; 2]> {
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

/// Refines a corner whose edges are blurred over more than the window: the saddle point of a
/// quadratic surface fitted to the grey levels within `2 half + 1` px of `start`,
///
/// ```text
/// I = a + b x + c y + d x² + e x y + f y²        2 d x + e y = -b,  e x + 2 f y = -c
/// ```
///
/// The four squares around a corner are alike after half a turn about it, blurred or not, so the
/// corner is where the grey levels are level. Returns `None` without a saddle in the window.
pub fn saddle(image: &impl Grey, start: [f64; 2], half: usize) -> Option<[f64; 2]> {
    let side = 2 * half + 1;
    let mut patch = vec![0.0; side * side];
    let offset = |i: usize| i as f64 - half as f64;
    let weight = |i: usize| (-(offset(i) / half as f64).powi(2)).exp();
    // Moments of the weights along one axis: 1, x² and x⁴.
    let moment = |power: i32| {
        (0..side)
            .map(|i| weight(i) * offset(i).powi(power))
            .sum::<f64>()
    };
    let [m0, m2, m4] = [0, 2, 4].map(moment);
    let mut at = start;
    for _ in 0..MOST_ITERATIONS {
        sample(image, at, half, &mut patch)?;
        let (mut sum, mut b, mut c) = (0.0, 0.0, 0.0);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for (i, row) in patch.chunks_exact(side).enumerate() {
            for (j, level) in row.iter().enumerate() {
                let (x, y) = (offset(j), offset(i));
                let level = weight(i) * weight(j) * level;
                sum += level;
                b += x * level;
                c += y * level;
                xx += x * x * level;
                xy += x * y * level;
                yy += y * y * level;
            }
        }
        // Least squares. By the window's symmetry only a, d and f are coupled.
        let (b, c, e) = (b / (m2 * m0), c / (m2 * m0), xy / (m2 * m2));
        let both = (xx + yy - 2.0 * m2 / m0 * sum) / (m4 * m0 - m2 * m2);
        let difference = (xx - yy) / (m4 * m0 - m2 * m2);
        let (d, f) = ((both + difference) / 2.0, (both - difference) / 2.0);
        let determinant = 4.0 * d * f - e * e;
        if !(determinant < 0.0) {
            return None;
        }
        let step = [
            (e * c - 2.0 * f * b) / determinant,
            (e * b - 2.0 * d * c) / determinant,
        ];
        at = [at[0] + step[0], at[1] + step[1]];
        if [0, 1]
            .iter()
            .any(|&i| !((at[i] - start[i]).abs() <= half as f64))
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
fn sample(image: &impl Grey, at: [f64; 2], reach: usize, patch: &mut [f64]) -> Option<()> {
    let [width, height] = image.size();
    let [columns, rows] = [width, height].map(|n| n as f64);
    if !(at[0] >= 0.0 && at[1] >= 0.0 && at[0] <= columns - 1.0 && at[1] <= rows - 1.0) {
        return None;
    }
    let side = 2 * reach + 1;
    let [(x0, fx), (y0, fy)] = at.map(|c| (c.floor() as isize - reach as isize, c.fract()));
    let clamp = |i: isize, size: usize| i.clamp(0, size as isize - 1) as usize;
    let level = |x: isize, y: isize| image.level(clamp(x, width), clamp(y, height));
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
