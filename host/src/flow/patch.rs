//! Following one patch to sub-pixel accuracy: Lucas and Kanade's method in its inverse form (Baker and Matthews 2004).
//!
//! The template `T` is a square of the reference image with mean removed, `g` its gradient. If the current image shows it displaced by
//! `d`, with gain `a` and offset `b`, then around the position tried so far `I(q + x) = a T(x + q - q*) + b`, to first order
//!
//! ```text
//! I = a T + a g·(q - q*) + b
//! ```
//!
//! Let `g'` be `g` with its components along `T` and along a constant removed. Then lighting drops out, and
//!
//! ```text
//! a (q - q*) = H^-1 Σ g' I       H = Σ g' g''       a = Σ T I / Σ T²
//! ```
//!
//! so one step costs an interpolation and five sums; nothing about the current image is differentiated.

use super::plane::Plane;

/// Steps per image at most.
const MAX_STEPS: usize = 12;

/// A step shorter than this ends the search, px.
const CONVERGED_PX: f32 = 0.004;

/// Smallest mean squared gradient across the weaker direction, (grey/px)²: below it noise would steer.
const MIN_TEXTURE: f32 = 0.4;

/// A square of the reference image, ready to be found again.
#[derive(Clone, Debug)]
pub struct Patch {
    radius: usize,
    /// Mean removed.
    template: Vec<f32>,
    /// Gradients along x and y without what lighting could mimic.
    slopes: [Vec<f32>; 2],
    /// Inverse of `H`.
    inverse: [f32; 3],
    /// `Σ T²`.
    energy: f32,
}

/// A patch found in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Its centre, px.
    pub at: [f32; 2],
    /// Normalised correlation with the template, -1 to 1.
    pub likeness: f32,
}

/// Buffers that following patches needs, made once.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    square: Vec<f32>,
}

impl Patch {
    /// The square of `2 radius + 1` px around `centre`. `None` if it leaves the image or has too little texture.
    pub fn new(
        plane: &Plane,
        centre: [f32; 2],
        radius: usize,
        scratch: &mut Scratch,
    ) -> Option<Self> {
        let (side, wide) = (2 * radius + 1, 2 * radius + 3);
        scratch.square.resize(wide * wide, 0.0);
        if !plane.sample(centre, radius + 1, &mut scratch.square) {
            return None;
        }
        let square = &scratch.square[..wide * wide];
        let count = side * side;
        let (mut template, mut gx, mut gy) = (
            Vec::with_capacity(count),
            Vec::with_capacity(count),
            Vec::with_capacity(count),
        );
        for y in 1..=side {
            let (above, row, below) = (
                &square[(y - 1) * wide..],
                &square[y * wide..],
                &square[(y + 1) * wide..],
            );
            for x in 1..=side {
                template.push(row[x]);
                gx.push(0.5 * (row[x + 1] - row[x - 1]));
                gy.push(0.5 * (below[x] - above[x]));
            }
        }
        remove_mean(&mut template);
        let energy = dot(&template, &template);
        for slope in [&mut gx, &mut gy] {
            remove_mean(slope);
            let along = dot(slope, &template) / energy.max(f32::MIN_POSITIVE);
            slope
                .iter_mut()
                .zip(&template)
                .for_each(|(s, t)| *s -= along * t);
        }
        let (a, b, c) = (dot(&gx, &gx), dot(&gx, &gy), dot(&gy, &gy));
        let determinant = a * c - b * b;
        let smaller = 0.5 * (a + c) - (0.25 * (a - c) * (a - c) + b * b).sqrt();
        if !(smaller > MIN_TEXTURE * count as f32) {
            return None;
        }
        let inverse = [c / determinant, -b / determinant, a / determinant];
        Some(Self {
            radius,
            template,
            slopes: [gx, gy],
            inverse,
            energy,
        })
    }

    /// Finds the patch in `plane`, starting at `start` and going at most `reach` px away. `None` if it leaves the image or the reach.
    pub fn find(
        &self,
        plane: &Plane,
        start: [f32; 2],
        reach: f32,
        scratch: &mut Scratch,
    ) -> Option<Found> {
        let mut at = start;
        let count = self.template.len();
        scratch.square.resize(count.max(scratch.square.len()), 0.0);
        let square = &mut scratch.square[..count];
        for _ in 0..MAX_STEPS {
            if !plane.sample(at, self.radius, square) {
                return None;
            }
            let gain = (dot(&self.template, square) / self.energy).clamp(0.3, 3.0);
            let (bx, by) = (dot(&self.slopes[0], square), dot(&self.slopes[1], square));
            let [ixx, ixy, iyy] = self.inverse;
            let step = [(ixx * bx + ixy * by) / gain, (ixy * bx + iyy * by) / gain];
            // A long step only tells the direction.
            let length = (step[0] * step[0] + step[1] * step[1]).sqrt();
            let scale = (2.0 / length).min(1.0);
            at = [at[0] - scale * step[0], at[1] - scale * step[1]];
            if !((at[0] - start[0]).abs().max((at[1] - start[1]).abs()) <= reach) {
                return None;
            }
            if length < CONVERGED_PX {
                break;
            }
        }
        let likeness = self.likeness(plane, at, scratch)?;
        Some(Found { at, likeness })
    }

    /// Normalised correlation with the image around `at`. `None` outside the image.
    pub fn likeness(&self, plane: &Plane, at: [f32; 2], scratch: &mut Scratch) -> Option<f32> {
        let count = self.template.len();
        scratch.square.resize(count.max(scratch.square.len()), 0.0);
        let square = &mut scratch.square[..count];
        if !plane.sample(at, self.radius, square) {
            return None;
        }
        let mean = square.iter().sum::<f32>() / count as f32;
        let spread: f32 = square.iter().map(|g| (g - mean) * (g - mean)).sum();
        Some(dot(&self.template, square) / (self.energy * spread).sqrt().max(f32::MIN_POSITIVE))
    }
}

fn remove_mean(values: &mut [f32]) {
    let mean = values.iter().sum::<f32>() / values.len() as f32;
    values.iter_mut().for_each(|v| *v -= mean);
}

/// Sum of products in eight running sums, which the compiler turns into vector instructions.
pub fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0f32; 8];
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    for (x, y) in a8.iter().zip(b8) {
        for i in 0..8 {
            lanes[i] += x[i] * y[i];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(x, y)| x * y).sum();
    lanes.iter().sum::<f32>() + rest
}
