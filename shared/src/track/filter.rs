//! Position and velocity of the target on one axis: a Kalman filter of constant velocity.
//!
//! State `(x, v)`, measurement `z = x + noise` of a variance `R` that comes with every estimate.
//! With `dt` since the last measurement used,
//!
//! ```text
//! x += v dt       P = F P F' + q [[dt³/3, dt²/2], [dt²/2, dt]]       F = [[1, dt], [0, 1]]
//! n = z - x      S = P_xx + R      K = (P_xx, P_xv)/S      (x, v) += K n      P -= K (P_xx, P_xv)
//! ```
//!
//! The position is an integer in 2⁻³² steps, with the full range of `i64`. All other numbers are
//! deviations or rates, for which `f32` suffices; their units are steps and milliseconds, so that
//! all have similar magnitudes.
//!
//! # The process noise adapts
//! `q` is the spectral density of the target's acceleration, which is unknown. Three rules set it:
//!
//! * *Whiteness.* Innovations `n` of the best filter are not correlated. Two consecutive ones of
//!   equal sign say that `q` is too small, of opposite signs that it is too large. With
//!   `c = n n_last / S` within ±1, `q` becomes `q (1 + c/4)` or, for negative `c`, `q/(1 - c/4)`. A
//!   still target is averaged down to a fraction of the measurement's noise, and one on a curve is
//!   followed.
//! * *Manoeuvre.* After an innovation beyond three sigmas, `q` is raised in that step until the
//!   innovation is three sigmas.
//! * *Bounds.* `q` does not exceed the value of a target that accelerates as the stage itself can.
//!
//! # Trust in the velocity
//! The covariance tells how well the velocity is known now. The stage, however, needs time to match
//! it, and the velocity of a target that accelerates or brakes changes within that time. So the
//! filter averages the acceleration over the last frames and keeps its highest square, which fades
//! from frame to frame. [`Filter::velocity_uncertainty`] adds the resulting change of the velocity.
//! Unevenness, now faster and now slower, averages out.
//!
//! # The same bits everywhere
//! The filter uses only `+ - * /` in a fixed order and comparisons; Rust contracts no product and
//! sum into one. Extremes are chosen by comparison, because a library's `max` may choose either
//! zero. Every state number is kept within bounds, so it is finite.

use crate::fixed::narrow;

/// Largest variance, steps² (and per ms²): far above any stage's, far below the limit of `f32`.
const MOST_VARIANCE: f32 = 1e12;

/// Quantisation noise that steps add to the variance of a measurement, steps²: 1/12 because the
/// stage stands in whole steps while its position is remembered as planned, and 1/12 for the drive
/// of the target.
const QUANTISATION_NOISE: f32 = 1.0 / 6.0;

/// Highest speed, steps per ms.
const MOST_SPEED: f32 = 1e6;

/// Lowest and highest acceleration of a stage, steps/ms².
const LEAST_ACCELERATION: f32 = 1e-6;
const MOST_ACCELERATION: f32 = 1e6;

/// Longest time between two measurements, ms.
const MOST_MS: f32 = 10_000.0;

/// Lowest process noise as a share of the highest: that of 1/2048 of the stage's acceleration.
const LEAST_NOISE_SHARE: f32 = 1.0 / 4_194_304.0;

/// Decay per frame of the mean acceleration and of its highest square; both span some three frames.
const FADE: f32 = 0.7;

/// Time in which the stage matches a velocity, over the time it needs to stop from its own highest
/// speed; squared.
const CATCH_UP: f32 = 4.0 * 4.0;

/// Sigmas of the velocity in [`Filter::velocity_uncertainty`], squared.
const VELOCITY_SIGMAS: f32 = 4.0;

/// Largest relative change of the process noise per frame.
const RATE: f32 = 0.25;

/// Innovation gate in sigmas, squared. A larger innovation is an outlier if the stage's
/// acceleration does not explain it.
const INNOVATION_GATE: f32 = 25.0;

/// Innovation in sigmas above which the target manoeuvres, squared.
const MANOEUVRE: f32 = 9.0;

/// Limits of the stage along one axis, and so of the motion of a target that it can follow.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KinematicLimits {
    /// Highest speed, steps/ms.
    pub speed: f32,
    /// Highest acceleration, steps/ms².
    pub acceleration: f32,
    /// Highest jerk, steps/ms³.
    pub jerk: f32,
}

/// Covariance of position and velocity, in steps and ms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance {
    /// Variance of the position.
    pub position: f32,
    /// Covariance of position and velocity.
    pub cross: f32,
    /// Variance of the velocity.
    pub velocity: f32,
}

/// Kalman filter of one axis of the target. See the [module](self).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filter {
    /// Position, 2⁻³² steps from zero.
    position: i64,
    /// Velocity, steps/ms.
    velocity: f32,
    covariance: Covariance,
    /// The process noise `q`, steps²/ms³.
    process_noise: f32,
    /// Mean acceleration over the last frames, steps/ms².
    acceleration: f32,
    /// Square of the acceleration, or of its decayed highest value before, (steps/ms²)².
    peak_squared_acceleration: f32,
    /// Last innovation, steps.
    last_innovation: f32,
}

impl Filter {
    /// Creates a filter from the first measurement; the velocity may be any within `reach`.
    /// `variance` is in steps².
    pub fn new(position: i64, variance: f32, reach: KinematicLimits) -> Self {
        let velocity = within(0.5 * reach.speed, 1e-3, MOST_SPEED);
        Self {
            position,
            velocity: 0.0,
            covariance: Covariance {
                position: with_quantisation(variance),
                cross: 0.0,
                velocity: velocity * velocity,
            },
            process_noise: least_noise(reach),
            acceleration: 0.0,
            peak_squared_acceleration: 0.0,
            last_innovation: 0.0,
        }
    }

    /// Creates a filter after a jump of the target, from two measurements `dt` ms apart that agree
    /// with each other but not with the prediction.
    pub fn restart(
        before: i64,
        position: i64,
        dt: f32,
        variances: [f32; 2],
        reach: KinematicLimits,
    ) -> Self {
        let dt = within(dt, 1e-3, MOST_MS);
        let [first, second] = variances.map(with_quantisation);
        let restless = process(most_noise(reach), dt);
        let velocity = steps(position.saturating_sub(before)) / dt;
        let covariance = Covariance {
            position: second,
            cross: second / dt,
            velocity: (first + second + restless.position) / (dt * dt),
        };
        Self {
            position,
            velocity: within(velocity, -MOST_SPEED, MOST_SPEED),
            covariance: covariance.bounded(),
            process_noise: least_noise(reach),
            acceleration: 0.0,
            peak_squared_acceleration: 0.0,
            last_innovation: 0.0,
        }
    }

    /// Returns the position, 2⁻³² steps from zero.
    pub const fn position(&self) -> i64 {
        self.position
    }

    /// Returns the velocity, steps/ms.
    pub const fn velocity(&self) -> f32 {
        self.velocity
    }

    /// Returns the covariance of position and velocity.
    pub const fn covariance(&self) -> Covariance {
        self.covariance
    }

    /// Returns the square of the error that the velocity may have, or of its change before the
    /// stage has matched it, (steps/ms)².
    pub fn velocity_uncertainty(&self, reach: KinematicLimits) -> f32 {
        let acceleration = within(reach.acceleration, LEAST_ACCELERATION, MOST_ACCELERATION);
        let change = within(reach.speed / acceleration, 0.0, MOST_MS);
        VELOCITY_SIGMAS * self.covariance.velocity
            + CATCH_UP * change * change * self.peak_squared_acceleration
    }

    /// Returns true if the measurement passes the innovation gate: its squared innovation is at
    /// most that of five sigmas plus that of full acceleration for `recent` ms. Call
    /// [`Filter::predict`] first.
    pub fn admits(
        &self,
        measured: i64,
        variance: f32,
        recent: f32,
        reach: KinematicLimits,
    ) -> bool {
        let innovation = steps(measured.saturating_sub(self.position));
        let sigmas = INNOVATION_GATE * (self.covariance.position + with_quantisation(variance));
        let way = 0.5 * reach.acceleration * recent * recent;
        innovation * innovation <= sigmas + way * way
    }

    /// Predicts the state `dt` ms ahead. The covariance is bounded at the next update.
    pub fn predict(&mut self, dt: f32) {
        let dt = within(dt, 0.0, MOST_MS);
        self.position = self.position.saturating_add(fine(self.velocity * dt));
        let Covariance {
            position,
            cross,
            velocity,
        } = self.covariance;
        let carried = cross + velocity * dt;
        let added = process(self.process_noise, dt);
        self.covariance = Covariance {
            position: position + dt * (cross + carried) + added.position,
            cross: carried + added.cross,
            velocity: velocity + added.velocity,
        };
    }

    /// Updates the state with a measurement, after a prediction of `dt` ms.
    pub fn update(&mut self, measured: i64, variance: f32, dt: f32, reach: KinematicLimits) {
        let variance = with_quantisation(variance);
        let innovation = steps(measured.saturating_sub(self.position));
        let most = most_noise(reach);
        let expected = self.covariance.position + variance;
        let excess = innovation * innovation / MANOEUVRE - expected;
        if excess > 0.0 && dt > 0.0 {
            let unit = process(1.0, within(dt, 0.0, MOST_MS));
            let needed = within(excess / unit.position, 0.0, most);
            self.covariance.position += unit.position * needed;
            self.covariance.cross += unit.cross * needed;
            self.covariance.velocity += unit.velocity * needed;
        }
        let alike = within(innovation * self.last_innovation / expected, -1.0, 1.0);
        let wanted = if alike > 0.0 {
            self.process_noise * (1.0 + RATE * alike)
        } else {
            self.process_noise / (1.0 - RATE * alike)
        };
        self.process_noise = within(wanted, most * LEAST_NOISE_SHARE, most);
        self.last_innovation = innovation;
        self.correct(innovation, variance, dt);
    }

    /// Corrects state and covariance by an innovation.
    fn correct(&mut self, innovation: f32, variance: f32, dt: f32) {
        let Covariance {
            position,
            cross,
            velocity,
        } = self.covariance;
        let inverse = 1.0 / (position + variance);
        let change = cross * inverse * innovation;
        self.position = self
            .position
            .saturating_add(fine(position * inverse * innovation));
        self.velocity = within(self.velocity + change, -MOST_SPEED, MOST_SPEED);
        self.covariance = Covariance {
            position: position * (variance * inverse),
            cross: cross * (variance * inverse),
            velocity: velocity - cross * inverse * cross,
        }
        .bounded();
        let acceleration = change / within(dt, 1.0, MOST_MS);
        let mean = FADE * self.acceleration + (1.0 - FADE) * acceleration;
        self.acceleration = within(mean, -MOST_ACCELERATION, MOST_ACCELERATION);
        self.peak_squared_acceleration = within(
            FADE * self.peak_squared_acceleration,
            mean * mean,
            MOST_VARIANCE,
        );
    }
}

impl Covariance {
    /// Returns the covariance with finite numbers and positive variances.
    fn bounded(self) -> Self {
        Self {
            position: within(self.position, 1e-6, MOST_VARIANCE),
            cross: within(self.cross, -MOST_VARIANCE, MOST_VARIANCE),
            velocity: within(self.velocity, 1e-12, MOST_VARIANCE),
        }
    }
}

/// Returns the highest process noise, steps²/ms³: that of full acceleration, drawn anew every 32
/// ms.
fn most_noise(reach: KinematicLimits) -> f32 {
    let acceleration = within(reach.acceleration, LEAST_ACCELERATION, MOST_ACCELERATION);
    32.0 * acceleration * acceleration
}

/// Returns the lowest process noise, steps²/ms³.
fn least_noise(reach: KinematicLimits) -> f32 {
    most_noise(reach) * LEAST_NOISE_SHARE
}

/// Returns the covariance that white noise of the acceleration adds in `dt` ms.
fn process(noise: f32, dt: f32) -> Covariance {
    let velocity = noise * dt;
    let cross = 0.5 * velocity * dt;
    Covariance {
        position: cross * dt * (2.0 / 3.0),
        cross,
        velocity,
    }
}

/// Returns the variance of a measurement with quantisation noise, within bounds.
pub(super) fn with_quantisation(variance: f32) -> f32 {
    within(
        variance + QUANTISATION_NOISE,
        QUANTISATION_NOISE,
        MOST_VARIANCE,
    )
}

/// Returns the value within bounds; the lower one if the value is not a number.
pub(super) fn within(value: f32, low: f32, high: f32) -> f32 {
    if value > low {
        if value < high { value } else { high }
    } else {
        low
    }
}

/// Converts a distance from 2⁻³² steps to steps, at a resolution of 2⁻¹⁶; saturates at ±32768.
pub(super) fn steps(fine: i64) -> f32 {
    narrow(fine >> 16) as f32 * (1.0 / 65_536.0)
}

/// Converts a distance from steps to 2⁻³² steps; saturates.
pub(super) fn fine(steps: f32) -> i64 {
    // The conversion saturates, and converts NaN to zero.
    i64::from((steps * 65_536.0) as i32) << 16
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn any_reach() -> impl Strategy<Value = KinematicLimits> {
        any::<[f32; 3]>().prop_map(|[speed, acceleration, jerk]| KinematicLimits {
            speed,
            acceleration,
            jerk,
        })
    }

    fn is_sound(filter: &Filter) -> bool {
        let known = filter.covariance();
        let positive = known.position > 0.0 && known.velocity > 0.0;
        positive
            && [
                known.position,
                known.cross,
                known.velocity,
                filter.velocity(),
            ]
            .iter()
            .all(|value| value.is_finite())
    }

    proptest! {
        /// Feeds any values, including infinities and NaN.
        #[test]
        fn every_number_stays_finite(
            start: (i64, f32), reach in any_reach(),
            measurements in prop::collection::vec(any::<(i64, f32, f32)>(), 0..60),
        ) {
            let mut filter = Filter::new(start.0, start.1, reach);
            prop_assert!(is_sound(&filter));
            let mut before = start;
            for (position, variance, dt) in measurements {
                filter.predict(dt);
                filter.admits(position, variance, dt, reach);
                filter.update(position, variance, dt, reach);
                prop_assert!(is_sound(&filter), "{filter:?}");
                prop_assert!(filter.velocity_uncertainty(reach) > 0.0);
                let anew = Filter::restart(before.0, position, dt, [before.1, variance], reach);
                prop_assert!(is_sound(&anew), "{anew:?}");
                before = (position, variance);
            }
        }

        #[test]
        fn steps_round_trip(fine_steps in -(1i64 << 46)..1 << 46) {
            // A float has 24 bits.
            let off = (fine(steps(fine_steps)) - fine_steps).abs();
            prop_assert!(off <= (1 << 16) + (fine_steps.abs() >> 23), "{off}");
        }
    }

    #[test]
    fn nan_becomes_lower_bound() {
        assert_eq!(within(f32::NAN, -1.0, 2.0), -1.0);
        assert_eq!(within(f32::INFINITY, -1.0, 2.0), 2.0);
        assert_eq!(within(0.5, -1.0, 2.0), 0.5);
        assert_eq!(fine(f32::NAN), 0);
        assert_eq!(steps(i64::MAX), 32_768.0);
    }
}
