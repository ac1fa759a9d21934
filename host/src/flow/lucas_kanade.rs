//! Where a small window of one image is in another, to a few thousandths of a pixel.
//!
//! Lucas and Kanade's least squares, inverse compositional (Baker and Matthews 2004): the gradients are those of the template, made once.
//! Brightness may change by a factor and an offset: the gradients are made orthogonal to the template and to a constant, so
//! that neither shows in the step:
//!
//! ```text
//! g' = g - mean(g) - T' (g·T')/(T'·T')         T' = T - mean(T)
//! step = (Σ g' g'^T)^-1 Σ g' I(x + p) / gain     gain = Σ T' I / Σ T' T'
//! ```
//!
//! (`Σ g' T = 0`, so no difference image is needed.) Values between pixels come from cubic convolution: linear
//! interpolation would pull every position towards the middle between two pixels.

use super::pyramid::Plane;

/// What a search for a template found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Where its centre is, px of the level.
    pub at: [f32; 2],
    /// Zero-mean normalised cross-correlation there, -1 to 1.
    pub likeness: f32,
}

/// Stops when a step is shorter than this, px. Steps shrink about tenfold, so the rest is a thousandth.
const SHORT_STEP: f32 = 0.01;
/// Longest single step, px: beyond it the linear model says nothing.
const LONG_STEP: f32 = 2.0;
/// The least mean square gradient of a template in its weakest direction, (grey level / px)².
const LEAST_GRADIENT: f32 = 0.25;

/// A square window of `N` x `N` px. `W >= N` is a multiple of 4: rows as the processor likes them.
#[derive(Clone, Debug)]
pub struct Template<const N: usize, const W: usize> {
    grey: [[f32; W]; N],
    along: [[f32; W]; N],
    down: [[f32; W]; N],
    /// Inverse of the gradient matrix: xx, xy, yy.
    inverse: [f32; 3],
    /// `Σ T'²`.
    energy: f32,
}

/// The window at level 0.
pub type Large = Template<21, 24>;
/// The window at coarser levels.
pub type Small = Template<11, 12>;

impl<const N: usize, const W: usize> Template<N, W> {
    /// How far the centre of a window must stay from the borders, px.
    pub const MARGIN: usize = N / 2 + 2;

    /// Whether a window around `at` lies within `plane`.
    pub fn fits(plane: &Plane, at: [f32; 2]) -> bool {
        let inside = |at: f32, size: usize| {
            at >= Self::MARGIN as f32 && at < size as f32 - Self::MARGIN as f32
        };
        inside(at[0], plane.width) && inside(at[1], plane.height)
    }

    /// The window of `plane` around `at`, bent by `warp` (near the identity): the template's pixel at `d` from the centre is
    /// the image's at `warp d`.
    ///
    /// `None` if the window leaves the image or has too little contrast in some direction.
    pub fn new(plane: &Plane, at: [f32; 2], warp: [[f32; 2]; 2]) -> Option<Self> {
        if !Self::fits(plane, at) {
            return None;
        }
        let mut template = Self {
            grey: [[0.0; W]; N],
            along: [[0.0; W]; N],
            down: [[0.0; W]; N],
            inverse: [0.0; 3],
            energy: 0.0,
        };
        template.read(plane, at);
        template.bend(warp);
        template.centre().then_some(template)
    }

    /// Reads grey levels and both derivatives of the interpolated image.
    fn read(&mut self, plane: &Plane, at: [f32; 2]) {
        let window = Window::<N, W>::around(plane, at);
        let (value, slope) = (weights(window.fraction[0]), slopes(window.fraction[0]));
        let mut values = [[0.0_f32; W]; 4];
        let mut steeps = [[0.0_f32; W]; 4];
        let (wy, sy) = (weights(window.fraction[1]), slopes(window.fraction[1]));
        for r in 0..N + 3 {
            // The last four rows, filtered along x, in a ring.
            let row = window.row(r);
            mix(row, &value, &mut values[r % 4]);
            mix(row, &slope, &mut steeps[r % 4]);
            if let Some(out) = r.checked_sub(3) {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| &values[(out + i) % 4]);
                let [p, q, s, t] = [0, 1, 2, 3].map(|i| &steeps[(out + i) % 4]);
                for i in 0..W {
                    self.grey[out][i] = wy[0] * a[i] + wy[1] * b[i] + wy[2] * c[i] + wy[3] * d[i];
                    self.down[out][i] = sy[0] * a[i] + sy[1] * b[i] + sy[2] * c[i] + sy[3] * d[i];
                    self.along[out][i] = wy[0] * p[i] + wy[1] * q[i] + wy[2] * s[i] + wy[3] * t[i];
                }
            }
        }
    }

    /// First order in the deviation from the identity: at 2 % and 10 px from the centre, the neglected
    /// part is a fiftieth of a grey level per unit of curvature.
    fn bend(&mut self, warp: [[f32; 2]; 2]) {
        let off = [
            [warp[0][0] - 1.0, warp[0][1]],
            [warp[1][0], warp[1][1] - 1.0],
        ];
        if off.iter().flatten().all(|o| o.abs() < 1e-5) {
            return;
        }
        let half = (N / 2) as f32;
        for r in 0..N {
            let y = r as f32 - half;
            for c in 0..W {
                let x = c as f32 - half;
                let dx = off[0][0] * x + off[0][1] * y;
                let dy = off[1][0] * x + off[1][1] * y;
                self.grey[r][c] += dx * self.along[r][c] + dy * self.down[r][c];
            }
        }
    }

    /// Makes the grey levels zero-mean, the gradients orthogonal to them and to a constant, everything beyond column
    /// `N` zero, and inverts the gradient matrix. `false` if that is impossible or the result too uncertain.
    fn centre(&mut self) -> bool {
        let count = (N * N) as f32;
        for part in [&mut self.grey, &mut self.along, &mut self.down] {
            for row in part.iter_mut() {
                row[N..].fill(0.0);
            }
            let mean = part.as_flattened().iter().sum::<f32>() / count;
            for row in part.iter_mut() {
                for value in &mut row[..N] {
                    *value -= mean;
                }
            }
        }
        self.energy = product(&self.grey, &self.grey);
        if self.energy < count * LEAST_GRADIENT {
            return false;
        }
        for part in [&mut self.along, &mut self.down] {
            let share = product(part, &self.grey) / self.energy;
            for (value, grey) in (part.as_flattened_mut().iter_mut()).zip(self.grey.as_flattened())
            {
                *value -= share * grey;
            }
        }
        let xx = product(&self.along, &self.along);
        let xy = product(&self.along, &self.down);
        let yy = product(&self.down, &self.down);
        let half = 0.5 * (xx - yy);
        let smaller = 0.5 * (xx + yy) - (half * half + xy * xy).sqrt();
        if !(smaller > count * LEAST_GRADIENT) {
            return false;
        }
        let determinant = xx * yy - xy * xy;
        self.inverse = [yy / determinant, -xy / determinant, xx / determinant];
        true
    }

    /// Looks for the template in `plane`, from `start` on. `None` if it leaves the image, turns into its negative, or does
    /// not settle in `steps` steps.
    pub fn find(&self, plane: &Plane, start: [f32; 2], steps: usize) -> Option<Found> {
        let mut at = start;
        let mut window = [[0.0_f32; W]; N];
        for _ in 0..steps {
            if !Self::fits(plane, at) {
                return None;
            }
            sample(plane, at, &mut window);
            let likeness = product(&self.grey, &window);
            if !(likeness > 0.1 * self.energy) {
                return None;
            }
            let bx = product(&self.along, &window);
            let by = product(&self.down, &window);
            let gain = self.energy / likeness;
            let mut step = [
                gain * (self.inverse[0] * bx + self.inverse[1] * by),
                gain * (self.inverse[1] * bx + self.inverse[2] * by),
            ];
            let length = step[0].hypot(step[1]);
            if length > LONG_STEP {
                step = step.map(|s| s * LONG_STEP / length);
            }
            at = [at[0] - step[0], at[1] - step[1]];
            if length < SHORT_STEP {
                let likeness = likeness / (self.energy * variation(&window)).sqrt();
                return likeness.is_finite().then_some(Found { at, likeness });
            }
        }
        None
    }
}

/// A window's place in a plane.
struct Window<'a, const N: usize, const W: usize> {
    plane: &'a Plane,
    start: usize,
    fraction: [f32; 2],
}

impl<'a, const N: usize, const W: usize> Window<'a, N, W> {
    /// `at` must fit ([`Template::fits`]).
    fn around(plane: &'a Plane, at: [f32; 2]) -> Self {
        let corner = at.map(f32::floor);
        let reach = N / 2 + 1;
        let (left, top) = (corner[0] as usize - reach, corner[1] as usize - reach);
        Self {
            plane,
            start: top * plane.stride + left,
            fraction: [at[0] - corner[0], at[1] - corner[1]],
        }
    }

    fn row(&self, r: usize) -> &'a [f32] {
        &self.plane.grey[self.start + r * self.plane.stride..][..W + 3]
    }
}

/// Grey levels of the `N` x `W` window around `at`, by cubic convolution.
fn sample<const N: usize, const W: usize>(plane: &Plane, at: [f32; 2], out: &mut [[f32; W]; N]) {
    let window = Window::<N, W>::around(plane, at);
    let (wx, wy) = (weights(window.fraction[0]), weights(window.fraction[1]));
    let mut ring = [[0.0_f32; W]; 4];
    for r in 0..N + 3 {
        mix(window.row(r), &wx, &mut ring[r % 4]);
        if let Some(row) = r.checked_sub(3) {
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| &ring[(row + i) % 4]);
            for i in 0..W {
                out[row][i] = wy[0] * a[i] + wy[1] * b[i] + wy[2] * c[i] + wy[3] * d[i];
            }
        }
    }
}

/// Four-tap filter along a row.
#[inline]
fn mix<const W: usize>(row: &[f32], w: &[f32; 4], out: &mut [f32; W]) {
    let row = &row[..W + 3];
    for i in 0..W {
        out[i] = w[0] * row[i] + w[1] * row[i + 1] + w[2] * row[i + 2] + w[3] * row[i + 3];
    }
}

/// `Σ a b`, in lanes.
#[inline]
fn product<const N: usize, const W: usize>(a: &[[f32; W]; N], b: &[[f32; W]; N]) -> f32 {
    let mut lanes = [0.0_f32; 4];
    for (a, b) in a.iter().zip(b) {
        for (a, b) in a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0) {
            for i in 0..4 {
                lanes[i] += a[i] * b[i];
            }
        }
    }
    (lanes[0] + lanes[2]) + (lanes[1] + lanes[3])
}

/// `Σ (I - mean)²` over the window's first `N` columns.
fn variation<const N: usize, const W: usize>(window: &[[f32; W]; N]) -> f32 {
    let count = (N * N) as f32;
    let mean = window
        .iter()
        .map(|row| row[..N].iter().sum::<f32>())
        .sum::<f32>()
        / count;
    (window.iter())
        .map(|row| {
            row[..N]
                .iter()
                .map(|v| (v - mean) * (v - mean))
                .sum::<f32>()
        })
        .sum()
}

/// Cubic convolution (Keys 1981, a = -1/2): weights of the four neighbours at `t` in `[0, 1)` after the second.
fn weights(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        -0.5 * t + t2 - 0.5 * t3,
        1.0 - 2.5 * t2 + 1.5 * t3,
        0.5 * t + 2.0 * t2 - 1.5 * t3,
        -0.5 * t2 + 0.5 * t3,
    ]
}

/// Derivatives of [`weights`] with respect to the position.
fn slopes(t: f32) -> [f32; 4] {
    let t2 = t * t;
    [
        -0.5 + 2.0 * t - 1.5 * t2,
        -5.0 * t + 4.5 * t2,
        0.5 + 4.0 * t - 4.5 * t2,
        -t + 1.5 * t2,
    ]
}

#[cfg(test)]
mod tests;
