//! Position of a target that turns, accelerates or swings, on one axis: an extended Kalman filter
//! of an oscillator.
//!
//! State `(x, v, a, w)`: position, velocity, acceleration, and the *stiffness* `w`, the square of
//! the angular frequency. The acceleration changes as that of an oscillation about an unknown
//! centre,
//!
//! ```text
//! da/dt = -w v + white noise of the spectral density q
//! ```
//!
//! so that `w = 0` is a target of constant acceleration. With `S = sin(√w t)/√w` and
//! `C = (1 - cos(√w t))/w`, which are power series of `w`, the state after `t` is exactly
//!
//! ```text
//! x + S v + C a       (1 - w C) v + S a       -w S v + (1 - w C) a       w
//! ```
//!
//! The filter is linear but for the products with `w`, whose derivatives are those of the two
//! series. `q` adapts as in the [`Filter`]: by the whiteness of the innovations, and in a manoeuvre.
//! Units and the order of operations are those of the [filter](super::filter), so that every machine
//! computes the same bits.

use super::filter::{Filter, KinematicLimits, fine, steps, with_quantisation, within};

/// Standard deviation of the stiffness at the start, ms⁻²: that of 5 Hz.
const START_STIFFNESS: f32 = 1e-3;

/// Highest stiffness, ms⁻²: that of 8 Hz.
const MOST_STIFFNESS: f32 = 2.5e-3;

/// Variance by which the stiffness may drift per ms, as a share of its square: 1 % in a second.
const DRIFT: f32 = 1e-7;

/// Process noise at the start (`START_NOISE`) and at least (`LEAST_NOISE`), as shares of the
/// highest.
const START_NOISE: f32 = 1e-8;
const LEAST_NOISE: f32 = 1e-12;

/// Largest relative change of the process noise per frame.
const RATE: f32 = 0.25;

/// Innovation in sigmas above which the target manoeuvres, squared. At the filter's three sigmas,
/// noise alone would cost an axis the knowledge of its swing every six seconds.
const MANOEUVRE: f32 = 16.0;

/// Largest variance of the position, steps².
const MOST_VARIANCE: f32 = 1e9;

/// Position, velocity and acceleration of a target.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Position, 2⁻³² steps from zero.
    pub position: i64,
    /// Velocity, steps/ms.
    pub velocity: f32,
    /// Acceleration, steps/ms².
    pub acceleration: f32,
    /// Stiffness, ms⁻².
    pub stiffness: f32,
}

/// Symmetric covariance of the state, by the letters of its rows and columns.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Covariance {
    xx: f32,
    xv: f32,
    xa: f32,
    xw: f32,
    vv: f32,
    va: f32,
    vw: f32,
    aa: f32,
    aw: f32,
    ww: f32,
}

/// Extended Kalman filter of an oscillating target. See the [module](self).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oscillator {
    motion: Motion,
    covariance: Covariance,
    /// The process noise `q`, steps²/ms⁵.
    process_noise: f32,
    /// Last innovation, steps.
    last_innovation: f32,
}

/// `S` and `C` of the [module](self), and their derivatives by the stiffness.
struct Waves {
    s: f32,
    c: f32,
    ds: f32,
    dc: f32,
}

impl Oscillator {
    /// Creates an oscillator from the state of a filter; acceleration and stiffness are unknown.
    pub fn new(filter: &Filter, reach: KinematicLimits) -> Self {
        let known = filter.covariance();
        let acceleration = 0.25 * within(reach.acceleration, 1e-6, 1e6);
        Self {
            motion: Motion {
                position: filter.position(),
                velocity: filter.velocity(),
                acceleration: 0.0,
                stiffness: 0.0,
            },
            covariance: Covariance {
                xx: known.position,
                xv: known.cross,
                xa: 0.0,
                xw: 0.0,
                vv: known.velocity,
                va: 0.0,
                vw: 0.0,
                aa: acceleration * acceleration,
                aw: 0.0,
                ww: START_STIFFNESS * START_STIFFNESS,
            },
            process_noise: most_noise(reach) * START_NOISE,
            last_innovation: 0.0,
        }
    }

    /// Returns the present motion.
    pub const fn motion(&self) -> &Motion {
        &self.motion
    }

    /// Returns the variance of the position `t` ms ahead, steps², as if the acceleration stayed.
    pub fn variance(&self, t: f32) -> f32 {
        let p = &self.covariance;
        // The variance of x + t (v + t/2 a), and q t⁵/20 of the noise until then.
        let noise = 0.1 * self.process_noise * t;
        let half = 0.5 * t;
        let speed = p.vv + t * (p.va + half * (0.5 * p.aa + noise));
        p.xx + t * (2.0 * (p.xv + half * p.xa) + t * speed)
    }

    /// Predicts the state `dt` ms ahead.
    pub fn predict(&mut self, dt: f32) {
        let dt = within(dt, 0.0, 1e3);
        let Motion {
            velocity,
            acceleration,
            stiffness,
            ..
        } = self.motion;
        let waves = Waves::new(stiffness, dt);
        let (s, c) = (waves.s, waves.c);
        let cos = 1.0 - stiffness * c;
        let pull = -stiffness * s;
        let change = -c - stiffness * waves.dc;
        // Derivatives of the state by the stiffness.
        let xw = velocity * waves.ds + acceleration * waves.dc;
        let vw = velocity * change + acceleration * waves.ds;
        let aw = acceleration * change - velocity * (s + stiffness * waves.ds);
        let p = self.covariance;
        // Columns of F P.
        let column = |x: f32, v: f32, a: f32, w: f32| {
            [
                x + s * v + c * a + xw * w,
                cos * v + s * a + vw * w,
                pull * v + cos * a + aw * w,
            ]
        };
        let [px, _, _] = column(p.xx, p.xv, p.xa, p.xw);
        let [xv, vv, av] = column(p.xv, p.vv, p.va, p.vw);
        let [xa, va, aa] = column(p.xa, p.va, p.aa, p.aw);
        let [x4, v4, a4] = column(p.xw, p.vw, p.aw, p.ww);
        self.covariance = Covariance {
            xx: px + s * xv + c * xa + xw * x4,
            xv: cos * xv + s * xa + vw * x4,
            xa: pull * xv + cos * xa + aw * x4,
            xw: x4,
            vv: cos * vv + s * va + vw * v4,
            va: pull * vv + cos * va + aw * v4,
            vw: v4,
            aa: pull * av + cos * aa + aw * a4,
            aw: a4,
            ww: p.ww + DRIFT * dt * stiffness * stiffness,
        };
        self.covariance.add_noise(self.process_noise, dt);
        self.motion = self.motion.moved(&waves);
    }

    /// Returns true if the measurement passes the innovation gate. Call [`Oscillator::predict`]
    /// first.
    pub fn admits(&self, measured: i64, variance: f32) -> bool {
        let innovation = steps(measured.saturating_sub(self.motion.position));
        let expected = self.covariance.xx + with_quantisation(variance);
        innovation * innovation <= 25.0 * expected && self.covariance.xx < MOST_VARIANCE
    }

    /// Updates the state with a measurement, after a prediction of `dt` ms.
    pub fn update(&mut self, measured: i64, variance: f32, dt: f32, reach: KinematicLimits) {
        let variance = with_quantisation(variance);
        let innovation = steps(measured.saturating_sub(self.motion.position));
        let most = most_noise(reach);
        let expected = self.covariance.xx + variance;
        let excess = innovation * innovation / MANOEUVRE - expected;
        if excess > 0.0 && dt > 0.0 {
            let square = dt * dt;
            let unit = 0.05 * square * square * dt;
            self.covariance
                .add_noise(within(excess / unit, 0.0, most), dt);
        }
        let alike = within(innovation * self.last_innovation / expected, -1.0, 1.0);
        let wanted = if alike > 0.0 {
            self.process_noise * (1.0 + RATE * alike)
        } else {
            self.process_noise / (1.0 - RATE * alike)
        };
        self.process_noise = within(wanted, most * LEAST_NOISE, most);
        self.last_innovation = innovation;
        self.correct(innovation, variance, reach);
    }

    /// Corrects state and covariance by an innovation.
    fn correct(&mut self, innovation: f32, variance: f32, reach: KinematicLimits) {
        let p = self.covariance;
        let inverse = 1.0 / (p.xx + variance);
        let (kx, kv, ka, kw) = (
            p.xx * inverse,
            p.xv * inverse,
            p.xa * inverse,
            p.xw * inverse,
        );
        let Motion {
            position,
            velocity,
            acceleration,
            stiffness,
        } = self.motion;
        let most = within(reach.acceleration, 1e-6, 1e6);
        self.motion = Motion {
            position: position.saturating_add(fine(kx * innovation)),
            velocity: within(velocity + kv * innovation, -1e6, 1e6),
            acceleration: within(acceleration + ka * innovation, -most, most),
            stiffness: within(stiffness + kw * innovation, 0.0, MOST_STIFFNESS),
        };
        let rest = variance * inverse;
        self.covariance = Covariance {
            xx: within(p.xx * rest, 1e-6, MOST_VARIANCE),
            xv: p.xv * rest,
            xa: p.xa * rest,
            xw: p.xw * rest,
            vv: within(p.vv - kv * p.xv, 1e-12, 1e12),
            va: p.va - kv * p.xa,
            vw: p.vw - kv * p.xw,
            aa: within(p.aa - ka * p.xa, 1e-16, 1e12),
            aw: p.aw - ka * p.xw,
            ww: within(p.ww - kw * p.xw, 1e-20, 1e-5),
        };
    }
}

impl Motion {
    /// Returns the square of the highest jerk of the oscillation, (steps/ms³)².
    pub fn jerk(&self) -> f32 {
        let (v, a) = (self.velocity, self.acceleration);
        // Stiffness times the square of the highest acceleration.
        self.stiffness * (self.stiffness * v * v + a * a)
    }

    /// Returns the motion `t` ms later.
    #[inline(never)]
    pub fn ahead(&self, t: f32) -> Self {
        self.moved(&Waves::new(self.stiffness, t))
    }

    fn moved(&self, &Waves { s, c, .. }: &Waves) -> Self {
        let cos = 1.0 - self.stiffness * c;
        let way = self.velocity * s + self.acceleration * c;
        Self {
            position: self.position.saturating_add(fine(way)),
            velocity: cos * self.velocity + s * self.acceleration,
            acceleration: cos * self.acceleration - self.stiffness * s * self.velocity,
            stiffness: self.stiffness,
        }
    }
}

impl Covariance {
    /// Adds the covariance that white noise of the jerk adds in `t` ms.
    fn add_noise(&mut self, noise: f32, t: f32) {
        let aa = noise * t;
        let va = 0.5 * aa * t;
        let xa = va * t * (1.0 / 3.0);
        self.aa += aa;
        self.va += va;
        self.xa += xa;
        self.vv += 2.0 * xa;
        self.xv += 0.75 * xa * t;
        self.xx += 0.3 * xa * t * t;
    }
}

impl Waves {
    /// Computes the power series up to a sixth of a turn, and doubles the angle from there.
    fn new(stiffness: f32, t: f32) -> Self {
        let (mut t, mut doublings) = (within(t, 0.0, 1e4), 0);
        while stiffness * t * t > 1.0 && doublings < 16 {
            t *= 0.5;
            doublings += 1;
        }
        let square = t * t;
        let z = stiffness * square;
        // sin(√z)/√z and 2(1 - cos(√z))/z, and their derivatives by z.
        let sine = 1.0 - z * (1.0 / 6.0) * (1.0 - z * (1.0 / 20.0) * (1.0 - z * (1.0 / 42.0)));
        let sine_slope = -1.0 / 6.0 + z * (1.0 / 60.0) * (1.0 - z * (1.0 / 28.0));
        let cosine = 1.0 - z * (1.0 / 12.0) * (1.0 - z * (1.0 / 30.0) * (1.0 - z * (1.0 / 56.0)));
        let cosine_slope = -1.0 / 12.0 + z * (1.0 / 180.0) * (1.0 - z * (3.0 / 112.0));
        let mut waves = Self {
            s: t * sine,
            c: 0.5 * square * cosine,
            ds: t * square * sine_slope,
            dc: 0.5 * square * square * cosine_slope,
        };
        for _ in 0..doublings {
            let cos = 1.0 - stiffness * waves.c;
            let slope = -waves.c - stiffness * waves.dc;
            waves = Self {
                s: 2.0 * waves.s * cos,
                c: 2.0 * waves.s * waves.s,
                ds: 2.0 * (waves.ds * cos + waves.s * slope),
                dc: 4.0 * waves.s * waves.ds,
            };
        }
        waves
    }
}

/// Returns the highest process noise, steps²/ms⁵: that of the full acceleration reached in 30 ms,
/// drawn anew every 32 ms.
fn most_noise(reach: KinematicLimits) -> f32 {
    let jerk = within(reach.acceleration, 1e-6, 1e6) * (1.0 / 30.0);
    32.0 * jerk * jerk
}

#[cfg(test)]
mod tests;
