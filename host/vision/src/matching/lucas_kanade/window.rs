//! Arithmetic of one window, row by row in vector lanes.
//!
//! Every sum is kept in [`LANES`] partial sums that are added up in a fixed order, so that the bits
//! are the same on every processor, for any width of its vectors. Everything is inlined into its
//! caller, which is compiled once per kind of processor.

use std::hint::black_box;

use super::super::pyramid::Plane;
use super::source::{Rows, WindowSource};

/// Number of partial sums: one vector.
const LANES: usize = 8;

/// Values of one window.
pub type Grid<const N: usize, const W: usize> = [[f32; W]; N];

/// Place of a window in a plane.
pub struct Window<'a, const N: usize, const W: usize> {
    rows: Rows<'a>,
    fraction: [f32; 2],
}

impl<'a, const N: usize, const W: usize> Window<'a, N, W> {
    /// Creates the window around `at`, which must fit ([`super::Template::fits`]).
    #[inline(always)]
    pub fn around<S: WindowSource + 'a>(source: S, part: &'a mut S::Part, at: [f32; 2]) -> Self {
        // Positive, so truncation is the floor.
        let corner = at.map(|a| a as usize);
        let reach = N / 2 + 1;
        Self {
            rows: source.rows(part, corner.map(|c| c - reach), [W + 3, N + 3]),
            fraction: [at[0] - corner[0] as f32, at[1] - corner[1] as f32],
        }
    }

    #[inline(always)]
    fn row(&self, r: usize) -> &'a [f32] {
        let Rows {
            grey,
            stride,
            start,
        } = self.rows;
        &grey[start + r * stride..][..W + 3]
    }

    /// Reads grey levels and both derivatives of the interpolated image. Columns beyond `N` are
    /// zero.
    #[inline(always)]
    pub fn read(&self, grey: &mut Grid<N, W>, along: &mut Grid<N, W>, down: &mut Grid<N, W>) {
        let (wx, sx) = (weights(self.fraction[0]), slopes(self.fraction[0]));
        let (wy, sy) = (weights(self.fraction[1]), slopes(self.fraction[1]));
        // Separable spline: ring buffer of the last four rows, filtered along x.
        let mut values = [[0.0_f32; W]; 4];
        let mut steeps = [[0.0_f32; W]; 4];
        for r in 0..N + 3 {
            let row = self.row(r);
            mix(row, &wx, &mut values[r % 4]);
            mix(row, &sx, &mut steeps[r % 4]);
            if let Some(out) = r.checked_sub(3) {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| &values[(out + i) % 4]);
                let [p, q, s, t] = [0, 1, 2, 3].map(|i| &steeps[(out + i) % 4]);
                for i in 0..W {
                    grey[out][i] = wy[0] * a[i] + wy[1] * b[i] + wy[2] * c[i] + wy[3] * d[i];
                    down[out][i] = sy[0] * a[i] + sy[1] * b[i] + sy[2] * c[i] + sy[3] * d[i];
                    along[out][i] = wy[0] * p[i] + wy[1] * q[i] + wy[2] * s[i] + wy[3] * t[i];
                }
                for part in [&mut *grey, &mut *along, &mut *down] {
                    part[out][N..].fill(0.0);
                }
            }
        }
    }

    /// Reads grey levels into `out`. Values beyond column `N` have no meaning.
    #[inline(always)]
    pub fn sample(&self, out: &mut Grid<N, W>) {
        let (wx, wy) = (weights(self.fraction[0]), weights(self.fraction[1]));
        let mut ring = [[0.0_f32; W]; 4];
        for r in 0..N + 3 {
            mix(self.row(r), &wx, &mut ring[r % 4]);
            let Some(row) = r.checked_sub(3) else {
                continue;
            };
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| &ring[(row + i) % 4]);
            let out = &mut out[row];
            for i in 0..W {
                out[i] = wy[0] * a[i] + wy[1] * b[i] + wy[2] * c[i] + wy[3] * d[i];
            }
        }
    }
}

/// Reads grey level and both derivatives of the interpolated image at the first `N` of a row of
/// places, which must be 2 px within `plane`; what is outside counts as 0. Values beyond column `N`
/// have no meaning.
#[inline(always)]
pub fn read_at<const N: usize, const W: usize>(
    plane: &Plane,
    places: &[[f32; W]; 2],
    seen: &mut [[f32; W]; 3],
) {
    // Weights of a whole row first, in vectors.
    let stride = plane.stride as i32;
    let mut starts = [0_i32; W];
    let [mut values, mut slopes] = [[[[0.0_f32; W]; 4]; 2]; 2];
    for c in 0..W {
        // Positive, so truncation is the floor.
        let [x, y] = [places[0][c] as i32, places[1][c] as i32];
        starts[c] = (y.wrapping_sub(1).wrapping_mul(stride)).wrapping_add(x.wrapping_sub(1));
        for (axis, corner) in [x, y].into_iter().enumerate() {
            let t = places[axis][c] - corner as f32;
            let (w, s) = (weights(t), self::slopes(t));
            for i in 0..4 {
                values[axis][i][c] = w[i];
                slopes[axis][i][c] = s[i];
            }
        }
    }
    // Four rows around each place, mixed by the weights along y.
    let [first, second, third, fourth] = [0, 1, 2, 3].map(|r| &plane.grey[r * plane.stride..]);
    let taps = |row: &[f32], start: usize| -> [f32; 4] {
        let taps = row.get(start..).and_then(|row| row.first_chunk());
        taps.copied().unwrap_or_default()
    };
    let mut mixed = [[[0.0_f32; 4]; W]; 2];
    for c in 0..N {
        let start = starts[c] as usize;
        let (a, b) = (taps(first, start), taps(second, start));
        let (p, q) = (taps(third, start), taps(fourth, start));
        let (w, s) = (&values[1], &slopes[1]);
        for i in 0..4 {
            mixed[0][c][i] = w[0][c] * a[i] + w[1][c] * b[i] + w[2][c] * p[i] + w[3][c] * q[i];
        }
        for i in 0..4 {
            mixed[1][c][i] = s[0][c] * a[i] + s[1][c] * b[i] + s[2][c] * p[i] + s[3][c] * q[i];
        }
    }
    // The same along x.
    for c in 0..W {
        let by = |w: &[[f32; W]; 4], m: &[f32; 4]| {
            w[0][c] * m[0] + w[1][c] * m[1] + w[2][c] * m[2] + w[3][c] * m[3]
        };
        seen[0][c] = by(&values[0], &mixed[0][c]);
        seen[1][c] = by(&slopes[0], &mixed[0][c]);
        seen[2][c] = by(&values[0], &mixed[1][c]);
    }
}

/// Applies a four-tap filter along a row.
#[inline(always)]
fn mix<const W: usize>(row: &[f32], w: &[f32; 4], out: &mut [f32; W]) {
    let row = &row[..W + 3];
    for i in 0..W {
        out[i] = w[0] * row[i] + w[1] * row[i + 1] + w[2] * row[i + 2] + w[3] * row[i + 3];
    }
}

/// Computes `Σ a b` for three `b` at once. `W` is a multiple of 8, so no remainder is left.
#[inline(always)]
pub fn products<const N: usize, const W: usize>(a: &Grid<N, W>, b: [&Grid<N, W>; 3]) -> [f32; 3] {
    let [(a, _), (p, _), (q, _), (r, _)] =
        [a, b[0], b[1], b[2]].map(|grid| grid.as_flattened().as_chunks::<LANES>());
    let [mut x, mut y, mut z] = [[0.0_f32; LANES]; 3];
    for (((a, p), q), r) in a.iter().zip(p).zip(q).zip(r) {
        for l in 0..LANES {
            x[l] += a[l] * p[l];
            y[l] += a[l] * q[l];
            z[l] += a[l] * r[l];
        }
    }
    [x, y, z].map(lanes)
}

/// Computes `Σ a b`.
#[inline(always)]
pub fn product<const N: usize, const W: usize>(a: &Grid<N, W>, b: &Grid<N, W>) -> f32 {
    let [(a, _), (b, _)] = [a, b].map(|grid| grid.as_flattened().as_chunks::<LANES>());
    let mut sum = [0.0_f32; LANES];
    for (a, b) in a.iter().zip(b) {
        for l in 0..LANES {
            sum[l] += a[l] * b[l];
        }
    }
    lanes(sum)
}

/// Computes `Σ a` over the first `N` columns.
#[inline(always)]
pub fn total<const N: usize, const W: usize>(a: &Grid<N, W>) -> f32 {
    let inside: [f32; W] = core::array::from_fn(|c| if c < N { 1.0 } else { 0.0 });
    let mut sum = [0.0_f32; W];
    for row in a {
        for c in 0..W {
            sum[c] += inside[c] * row[c];
        }
    }
    let mut folded = [0.0_f32; LANES];
    for block in sum.chunks(LANES) {
        for (folded, value) in folded.iter_mut().zip(block) {
            *folded += value;
        }
    }
    lanes(folded)
}

/// Subtracts `mean` in the first `N` columns and sets the others to zero.
#[inline(always)]
pub fn centre<const N: usize, const W: usize>(a: &mut Grid<N, W>, mean: f32) {
    let inside: [f32; W] = core::array::from_fn(|c| if c < N { 1.0 } else { 0.0 });
    for row in a {
        for c in 0..W {
            row[c] = inside[c] * (row[c] - mean);
        }
    }
}

/// Adds the partial sums in a fixed order.
#[inline(always)]
fn lanes(sum: [f32; LANES]) -> f32 {
    // Hides the use of the sums from the compiler, which would otherwise vectorise by two.
    let mut sum = black_box(sum);
    for width in [4, 2, 1] {
        for l in 0..width {
            sum[l] += sum[l + width];
        }
    }
    sum[0]
}

/// Returns the length of a vector.
#[inline(always)]
pub fn length([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}

/// Symmetric 2 x 2 matrix of normal equations.
#[derive(Clone, Copy, Debug)]
pub struct LeastSquares {
    pub xx: f32,
    pub xy: f32,
    pub yy: f32,
}

impl LeastSquares {
    /// Computes the smaller eigenvalue.
    #[inline(always)]
    pub fn weakest(&self) -> f32 {
        let half = 0.5 * (self.xx - self.yy);
        0.5 * (self.xx + self.yy) - (half * half + self.xy * self.xy).sqrt()
    }

    /// Solves the equations for a right-hand side.
    #[inline(always)]
    pub fn solve(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let determinant = self.xx * self.yy - self.xy * self.xy;
        [
            (self.yy * x - self.xy * y) / determinant,
            (self.xx * y - self.xy * x) / determinant,
        ]
    }
}

/// Computes one Lucas-Kanade step with the roles exchanged, px: from the window `seen` (zero-mean),
/// which is `gain` times the zero-mean `template`, with the gradients of `seen`. Gradients are
/// central differences; the window's border has none. The step is not finite if the gradients do
/// not determine it.
#[inline(always)]
pub fn step_back<const N: usize, const W: usize>(
    seen: &Grid<N, W>,
    template: &Grid<N, W>,
    gain: f32,
) -> [f32; 2] {
    let half: [f32; W] = core::array::from_fn(|c| if (1..N - 1).contains(&c) { 0.5 } else { 0.0 });
    let mut sums = [[0.0_f32; LANES]; 5];
    let [xx, xy, yy, x, y] = &mut sums;
    for r in 1..N - 1 {
        // The row with its neighbours in memory. At either end these are not its neighbours in the
        // window, but their weight is zero.
        let near = &seen.as_flattened()[r * W - 1..][..W + 2];
        let (above, below) = (&seen[r - 1], &seen[r + 1]);
        for block in 0..W / LANES {
            for l in 0..LANES {
                let c = block * LANES + l;
                let along = half[c] * (near[c + 2] - near[c]);
                let down = half[c] * (below[c] - above[c]);
                let rest = near[c + 1] - gain * template[r][c];
                xx[l] += along * along;
                xy[l] += along * down;
                yy[l] += down * down;
                x[l] += along * rest;
                y[l] += down * rest;
            }
        }
    }
    let [xx, xy, yy, x, y] = sums.map(lanes);
    LeastSquares { xx, xy, yy }.solve([x, y])
}

/// Returns the weights of the cubic B-spline for the four neighbours at `t` in `[0, 1)` after the
/// second.
#[inline(always)]
fn weights(t: f32) -> [f32; 4] {
    let (u, t2, t3) = (1.0 - t, t * t, t * t * t);
    [
        u * u * u / 6.0,
        2.0 / 3.0 - t2 + 0.5 * t3,
        (1.0 + 3.0 * (t + t2 - t3)) / 6.0,
        t3 / 6.0,
    ]
}

/// Returns the derivatives of [`weights`] with respect to the position.
#[inline(always)]
fn slopes(t: f32) -> [f32; 4] {
    let (u, t2) = (1.0 - t, t * t);
    [
        -0.5 * u * u,
        1.5 * t2 - 2.0 * t,
        0.5 + t - 1.5 * t2,
        0.5 * t2,
    ]
}
