//! Dead-leaves model: opaque shapes with power-law sizes fall on each other until they cover
//! everything. Its edges, corners and occlusions occur at every scale, as in natural images.

use std::f64::consts::PI;

use super::noise;
use trinocular_rig::random::Random;

/// Radii of the leaves, texels.
const RADIUS: [f64; 2] = [3.0, 160.0];
/// Ratio of the leaves' summed area to the poster's; `exp(-8)` of it, 0.03 %, stays bare.
const COVERS: f64 = 8.0;

/// Draws the grey levels of a `size * size` poster that repeats without a seam.
pub(super) fn fall(size: usize, random: &mut Random) -> Vec<f32> {
    let grain = noise::octaves(size, &[4, 8, 16, 32], random);
    let mut grey: Vec<f32> = grain.iter().map(|g| 128.0 + 20.0 * g).collect();
    let mut to_cover = COVERS * (size * size) as f64;
    while to_cover > 0.0 {
        let leaf = Leaf::new(size, random);
        to_cover -= leaf.draw(size, &grain, &mut grey);
    }
    grey
}

struct Leaf {
    centre: [f64; 2],
    radius: f64,
    /// Rows of the map from the poster to the leaf's own frame, in which it is round or regular.
    frame: [[f64; 2]; 2],
    /// Number of corners; 0 for an ellipse.
    corners: usize,
    grey: f32,
    /// Strength of its grain, grey levels, and the origin of its part of the grain.
    grain: f32,
    cut: [usize; 2],
}

impl Leaf {
    fn new(size: usize, random: &mut Random) -> Self {
        // Density r^-3 between the two radii, by inverting its distribution function in r^-2.
        let [low, high] = RADIUS.map(|r| r.powi(-2));
        let radius = random.between(high, low).powf(-0.5);
        let (sin, cos) = random.between(0.0, 2.0 * PI).sin_cos();
        let squeeze = random.between(1.0, 2.0);
        Self {
            centre: std::array::from_fn(|_| random.between(0.0, size as f64)),
            radius,
            frame: [[cos, sin], [-sin * squeeze, cos * squeeze]],
            corners: [0, 3, 4, 5][random.below(4)],
            grey: random.between(30.0, 225.0) as f32,
            grain: random.between(2.0, 14.0) as f32,
            cut: std::array::from_fn(|_| random.below(size)),
        }
    }

    /// Paints the leaf and returns the texels painted.
    fn draw(&self, size: usize, grain: &[f32], grey: &mut [f32]) -> f64 {
        let reach = self.radius.ceil() as isize;
        let side = size as isize;
        let middle = self.centre.map(|c| c.floor() as isize);
        let normals: Vec<[f64; 2]> = (0..self.corners)
            .map(|k| (2.0 * PI * k as f64 / self.corners as f64).sin_cos().into())
            .collect();
        let inner = self.radius * (PI / self.corners.max(1) as f64).cos();
        let mut painted = 0.0;
        for y in middle[1] - reach..=middle[1] + reach {
            let row = y.rem_euclid(side) as usize;
            let grain_row = (row + self.cut[1]) % size * size;
            for x in middle[0] - reach..=middle[0] + reach {
                let d = [x as f64 - self.centre[0], y as f64 - self.centre[1]];
                let [p, q] = self.frame.map(|r| r[0] * d[0] + r[1] * d[1]);
                let within = p * p + q * q <= self.radius * self.radius
                    && normals.iter().all(|n| n[0] * p + n[1] * q <= inner);
                if within {
                    let column = x.rem_euclid(side) as usize;
                    let fleck = grain[grain_row + (column + self.cut[0]) % size];
                    grey[row * size + column] = self.grey + self.grain * fleck;
                    painted += 1.0;
                }
            }
        }
        painted
    }
}
