//! Departure of motion from a parabola in time: running sums over a window of frames.
//!
//! A target with a constant speed or acceleration leaves no residual about the parabola. The
//! [watch](super) compares the residuals of the stage `s`, of the error `e` and of the apparent
//! target `p = s + e`. With the polynomials `P₀, P₁, P₂` that are orthogonal on the frames' times,
//! the covariance of two residuals is
//!
//! ```text
//! cov(a, b) = (Σ a b - Σₖ (Σ a Pₖ) (Σ b Pₖ) / Σ Pₖ²) / (n - 3)
//! ```
//!
//! A window of fewer than seven frames uses a straight line: `P₀, P₁` and `n - 2`.

use super::super::StepVector;
use super::super::filter::{steps, with_quantisation, within};
use super::Sample;
use crate::time::Instant;

/// Unit of time in the sums, ms. Windows are a few units long, so that the powers stay in range.
pub(super) const UNIT_MS: f32 = 100.0;

/// Largest variance of a residual, steps².
const MOST: f32 = 1e12;

/// Running sums of one axis about the window's first frame, steps.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Sums of the stage's position times 1, t, t².
    stage: [f32; 3],
    /// Sums of the error times 1, t, t².
    error: [f32; 3],
    /// Sum of the error's square.
    square: f32,
}

/// A window of frames: the stage's positions and the target's errors.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Window {
    /// Capture, stage and error of the first frame.
    first: Option<(Instant, StepVector, StepVector)>,
    /// Number of frames, and sums of t, t², t³, t⁴.
    times: [f32; 5],
    axes: [Sums; 3],
    /// Products of the stage's positions: xx, yy, zz, xy, yz, zx.
    stages: [f32; 6],
    /// Products of each error with the stage's position on each axis.
    cross: [[f32; 3]; 3],
    /// Time from the first frame to the last, ms.
    pub span_ms: f32,
}

/// Variances of one axis, steps².
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Spread {
    /// Variance of the stage.
    pub stage: f32,
    /// Variance of the error, target minus stage.
    pub error: f32,
    /// Variance of the apparent target, their sum.
    pub target: f32,
}

/// Variances summed over the axes, steps².
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Energy {
    /// Energy of the stage.
    pub stage: f32,
    /// Energy of the error, without the noise of the measurements.
    pub error: f32,
    /// Energy of the apparent target, without the noise of the measurements.
    pub target: f32,
}

impl Energy {
    /// Sums the axes' variances. `variance` is that of a measurement, steps².
    pub fn new(spreads: &[Spread; 3], variance: [f32; 3]) -> Self {
        let mut sum = Self::default();
        for (spread, variance) in spreads.iter().zip(variance) {
            let noise = with_quantisation(variance);
            sum.stage += spread.stage;
            sum.error += spread.error - noise;
            sum.target += spread.target - noise;
        }
        sum
    }
}

impl Window {
    /// Creates a window that begins with `sample`.
    pub fn starting(sample: &Sample) -> Self {
        let mut window = Self::default();
        window.add(sample);
        window
    }

    /// Returns the number of frames.
    pub fn frames(&self) -> f32 {
        let [n, ..] = self.times;
        n
    }

    /// Takes in a frame.
    pub fn add(&mut self, sample: &Sample) {
        let now = (sample.capture, sample.stage, sample.error);
        let (start, stage, error) = *self.first.get_or_insert(now);
        self.span_ms = milliseconds(sample.capture.since(start));
        let t = self.span_ms * (1.0 / UNIT_MS);
        let square = t * t;
        let [n, t1, t2, t3, t4] = self.times;
        self.times = [
            n + 1.0,
            t1 + t,
            t2 + square,
            t3 + square * t,
            t4 + square * square,
        ];
        let (s, e) = (from(sample.stage, stage), from(sample.error, error));
        let ([x, y, z], [xx, yy, zz, xy, yz, zx]) = (s, self.stages);
        self.stages = [
            xx + x * x,
            yy + y * y,
            zz + z * z,
            xy + x * y,
            yz + y * z,
            zx + z * x,
        ];
        let axes = self.axes.iter_mut().zip(&mut self.cross);
        for ((sums, cross), (s, e)) in axes.zip(s.into_iter().zip(e)) {
            let [a, b, c] = sums.stage;
            sums.stage = [a + s, b + s * t, c + s * square];
            let [a, b, c] = sums.error;
            sums.error = [a + e, b + e * t, c + e * square];
            sums.square += e * e;
            let [a, b, c] = *cross;
            *cross = [a + e * x, b + e * y, c + e * z];
        }
    }

    /// Returns the variances of each axis; zero for fewer than four frames.
    pub fn spreads(&self) -> [Spread; 3] {
        let Some(basis) = Basis::new(&self.times) else {
            return [Spread::default(); 3];
        };
        let [xx, yy, zz, ..] = self.stages;
        let [[ex, ..], [_, ey, _], [.., ez]] = self.cross;
        let [x, y, z] = &self.axes;
        [(x, xx, ex), (y, yy, ey), (z, zz, ez)].map(|(sums, square, product)| {
            let (s, e) = (basis.project(sums.stage), basis.project(sums.error));
            let stage = basis.covariance(square, s, s);
            let error = basis.covariance(sums.square, e, e);
            let both = basis.covariance(product, s, e);
            Spread {
                stage: within(stage, 0.0, MOST),
                error: within(error, 0.0, MOST),
                target: within(stage + error + both + both, 0.0, MOST),
            }
        })
    }

    /// Returns the polynomials on the frames' times; `None` for fewer than four frames.
    pub fn basis(&self) -> Option<Basis> {
        Basis::new(&self.times)
    }

    /// Returns the covariances of stage and apparent target; `None` for fewer than four frames.
    pub fn covariances(&self) -> Option<Covariances> {
        let basis = Basis::new(&self.times)?;
        let [sx, sy, sz] = self.axes.each_ref().map(|sums| basis.project(sums.stage));
        let [xx, yy, zz, xy, yz, zx] = self.stages;
        let (xx, yy) = (basis.covariance(xx, sx, sx), basis.covariance(yy, sy, sy));
        let (zz, xy) = (basis.covariance(zz, sz, sz), basis.covariance(xy, sx, sy));
        let (yz, zx) = (basis.covariance(yz, sy, sz), basis.covariance(zx, sz, sx));
        let rows = [[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]];
        let (mut target, mut own) = (rows, [0.0; 3]);
        let axes = self
            .axes
            .iter()
            .zip(self.cross)
            .zip(&mut target)
            .zip(&mut own);
        for (axis, (((sums, [ex, ey, ez]), row), own)) in axes.enumerate() {
            let e = basis.project(sums.error);
            let ex = basis.covariance(ex, e, sx);
            let ey = basis.covariance(ey, e, sy);
            let ez = basis.covariance(ez, e, sz);
            let [x, y, z] = *row;
            let (x, y, z) = (x + ex, y + ey, z + ez);
            *row = [x, y, z];
            let error = basis.covariance(sums.square, e, e);
            *own = match axis {
                0 => x + ex + error,
                1 => y + ey + error,
                _ => z + ez + error,
            };
        }
        Some(Covariances {
            stage: rows,
            target,
            own,
        })
    }
}

/// Covariances of the residuals of stage `s` and apparent target `p`, steps².
#[derive(Clone, Copy, Debug)]
pub(super) struct Covariances {
    /// `cov(s, s)`.
    pub stage: [[f32; 3]; 3],
    /// `cov(p, s)`, a row for each axis of the target.
    pub target: [[f32; 3]; 3],
    /// Variances of the target.
    pub own: [f32; 3],
}

impl Covariances {
    /// Returns the sum of the target's variances.
    pub fn all(&self) -> f32 {
        let [x, y, z] = self.own;
        x + y + z
    }

    /// Returns the share of the apparent target's variance that a linear function of the stage's
    /// motion explains, 0 to 1: `Σᵢ bᵢ' A⁻¹ bᵢ / Σᵢ var(pᵢ)` with `A = cov(s, s)` and
    /// `bᵢ = cov(s, pᵢ)`.
    pub fn explained(&self) -> f32 {
        let [[xx, xy, zx], [_, yy, yz], [_, _, zz]] = self.stage;
        // An axis that rests explains nothing, and must not make the matrix singular.
        let ridge = 0.1 + 1e-3 * (xx + yy + zz);
        let (a, b, c) = (xx + ridge, yy + ridge, zz + ridge);
        // The adjugate, row by row.
        let (ax, ay, az) = (b * c - yz * yz, yz * zx - xy * c, xy * yz - b * zx);
        let (by, bz, cz) = (a * c - zx * zx, xy * zx - a * yz, a * b - xy * xy);
        let determinant = a * ax + xy * ay + zx * az;
        let mut explained = 0.0;
        for [x, y, z] in self.target {
            let first = x * (ax * x + ay * y + az * z);
            let second = y * (ay * x + by * y + bz * z);
            explained += first + second + z * (az * x + bz * y + cz * z);
        }
        within(explained / (determinant * self.all()), 0.0, 1.0)
    }
}

/// Polynomials that are orthogonal on the frames' times: `1`, `t - m`, `t² - c (t - m) - q`.
pub(super) struct Basis {
    mean: f32,
    tilt: f32,
    square: f32,
    /// Reciprocals of the polynomials' sums of squares; 0 for one that is not used.
    over: [f32; 3],
    /// Reciprocal of the degrees of freedom.
    share: f32,
}

impl Basis {
    fn new(times: &[f32; 5]) -> Option<Self> {
        let [n, t, t2, t3, t4] = *times;
        let over = 1.0 / n;
        let (mean, square) = (t * over, t2 * over);
        let p11 = t2 - t * mean;
        if !(n > 3.5 && p11 > 0.0) {
            return None;
        }
        let slope = 1.0 / p11;
        let p12 = t3 - t2 * mean;
        let p22 = t4 - t2 * square;
        let bend = p22 - p12 * p12 * slope;
        let curved = n > 6.5 && bend > 1e-3 * p22;
        let (bend, share) = match curved {
            true => (1.0 / bend, 1.0 / (n - 3.0)),
            false => (0.0, 1.0 / (n - 2.0)),
        };
        Some(Self {
            mean,
            tilt: p12 * slope,
            square,
            over: [over, slope, bend],
            share,
        })
    }

    /// Converts the sums with 1, t, t² to those with the polynomials.
    pub fn project(&self, [x, xt, xt2]: [f32; 3]) -> [f32; 3] {
        let first = xt - x * self.mean;
        [x, first, xt2 - x * self.square - self.tilt * first]
    }

    /// Returns the covariance of two residuals, from the sum of the products and both projections.
    pub fn covariance(&self, sum: f32, [a, b, c]: [f32; 3], [d, e, f]: [f32; 3]) -> f32 {
        let [over, slope, bend] = self.over;
        (sum - a * d * over - b * e * slope - c * f * bend) * self.share
    }
}

/// Returns the difference of two positions, steps.
pub(super) fn from([x, y, z]: StepVector, [a, b, c]: StepVector) -> [f32; 3] {
    [
        steps(x.saturating_sub(a)),
        steps(y.saturating_sub(b)),
        steps(z.saturating_sub(c)),
    ]
}

/// Converts a time from µs to ms.
pub(super) fn milliseconds(us: u64) -> f32 {
    u32::try_from(us).unwrap_or(u32::MAX) as f32 * 0.001
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a window of frames every 20 ms.
    fn window(frames: u64, seen: impl Fn(f64) -> ([f64; 3], [f64; 3])) -> Window {
        let mut window = Window::default();
        for k in 0..frames {
            let fine = |steps: f64| (steps * 4_294_967_296.0) as i64;
            let (stage, error) = seen(0.02 * k as f64);
            window.add(&Sample {
                capture: Instant::from_micros(20_000 * k),
                stage: stage.map(fine),
                error: error.map(fine),
                variance: [0.0; 3],
            });
        }
        window
    }

    fn explained(window: &Window) -> f32 {
        window.covariances().map_or(0.0, |found| found.explained())
    }

    fn wave(t: f64) -> f64 {
        100.0 * (30.0 * t).sin()
    }

    #[test]
    fn parabola_leaves_no_residual() {
        let bend = |t: f64| 50.0 + 1_000.0 * t - 3_000.0 * t * t;
        let spreads = window(15, |t| ([bend(t); 3], [-2.0 * bend(t); 3])).spreads();
        for spread in spreads {
            assert!(spread.stage < 0.01 && spread.target < 0.05, "{spread:?}");
        }
    }

    #[test]
    fn variances_match_residuals() {
        let seen = |t: f64| ([wave(t), 0.0, 900.0 * t], [-0.5 * wave(t), 70.0, wave(t)]);
        let [x, y, z] = window(60, seen).spreads();
        // Some 5000 for a sine of amplitude 100, less what the parabola takes.
        assert!((4_000.0..5_500.0).contains(&x.stage), "{x:?}");
        assert!((x.error / x.stage - 0.25).abs() < 1e-3, "{x:?}");
        assert!((x.target / x.stage - 0.25).abs() < 1e-3, "{x:?}");
        assert!(y.error < 0.01 && z.stage < 0.01 && z.target > 4_000.0);
    }

    #[test]
    fn linear_motion_is_explained() {
        // The mount is turned and the target rests: p is a linear function of s.
        let turned = |t: f64| {
            let (x, y) = (wave(t), wave(1.3 * t + 0.4));
            ([x, y, 0.0], [-0.5 * x + 0.8 * y, -0.8 * x - 0.5 * y, 0.0])
        };
        assert!(explained(&window(40, turned)) > 0.99);
        let alone = |t: f64| ([wave(t), 0.0, 0.0], [-wave(t) + wave(1.7 * t), 0.0, 0.0]);
        assert!(explained(&window(40, alone)) < 0.2);
        assert_eq!(explained(&window(3, turned)), 0.0);
    }
}
