//! Contest between an oscillator and the filter on one axis, and the goal of an axis that the
//! oscillator leads.
//!
//! # Contest
//! Each model predicts where the target will be as long ahead as the stage needs to know it. The
//! first measurement after that time decides. With `n` and `o` the errors of the filter and the
//! oscillator, `d = n - o` and the measurement's variance `R`, the oscillator scores
//!
//! ```text
//! d (n + o)/(d² + 4 R)      within ±1
//! ```
//!
//! which is positive if it was nearer, and next to nothing if the measurement's noise hides who
//! was. It takes the lead when its mean score is above [`LEAD`] and its own covariance promises a
//! prediction as good as 1.4 measurements' sigmas, or with a tenth of the mean square of `n`. It
//! loses the lead when the mean is negative, a measurement does not pass its innovation gate, or
//! the promise is beyond 2.8 sigmas as well as that tenth. A still target, a line, a jump and the
//! beginning and end of any motion remain the filter's, and so does coasting.
//!
//! # Goal
//! The planner assumes that a goal keeps its velocity, and gets the next one a tick later. For a
//! target at `x` with `v` and `a`, the goal is the line on which the stage would come out if it
//! reduced `a` to nothing at its highest jerk `j`:
//!
//! ```text
//! velocity v + a|a|/2j      position x - a³/6j²
//! ```
//!
//! A stage that moves as the target does is then always just at the point where it must begin to
//! reduce `a`; it follows without lag.
//!
//! # Gain
//! If the swing needs much of the stage's jerk, a stage that does not yet swing in time overshoots
//! at every turn and never comes into time. So it begins with a small share of the swing about the
//! centre, which grows while the stage is near its goal and decays while it is not. A swing beyond
//! the stage's jerk is followed with the share that it allows.

use super::super::filter::{Filter, KinematicLimits, fine, steps, with_quantisation, within};
use super::super::oscillator::{Motion, Oscillator};
use super::{Aim, Measurement, milliseconds};
use crate::time::Instant;

/// Mean of the contest from which the oscillator leads.
const LEAD: f32 = 0.2;

/// Low-pass gain of the mean of the contest.
const FADE: f32 = 0.125;

/// Weight of a measurement's variance in a score.
const DOUBT: f32 = 4.0;

/// Longest time between two measurements of an oscillator, ms.
const LONGEST_MS: f32 = 1_000.0;

/// Highest variance of a prediction that takes the lead (`TRUST`) and keeps it (`KEEP`), in
/// variances of a measurement.
const TRUST: f32 = 2.0;
const KEEP: f32 = 8.0;

/// Variance of a prediction that suffices for both, as a share of the mean square of the filter's
/// errors.
const BETTER: f32 = 0.1;

/// Share of the highest jerk that any stage may swing with at once (`EASY`), and that no swing
/// exceeds (`HARD`); squared.
const EASY: f32 = 0.16;
const HARD: f32 = 0.8;

/// Distance from the goal up to which a stage swings in time, as a share of the amplitude, squared.
const NEAR: f32 = 0.02;

/// Change of the gain per tick: near the goal (`GROWTH`), and beyond (`DECAY`).
const GROWTH: f32 = 0.002;
const DECAY: f32 = 0.01;

/// Lowest gain of an axis that the oscillator leads.
const LEAST_GAIN: f32 = 0.01;

/// Predictions of the filter and the oscillator from one capture, in as few bytes as possible.
#[derive(Clone, Copy, Debug)]
struct Bet {
    /// Time since that capture, ms.
    age: f32,
    /// Position and velocity of the filter, 2⁻³² steps and steps/ms.
    position: i64,
    velocity: f32,
    /// Position of the oscillator less the filter's, steps.
    apart: f32,
    /// Velocity, acceleration and stiffness of the oscillator.
    swing: [f32; 3],
}

impl Bet {
    fn new(position: i64, velocity: f32, motion: &Motion) -> Self {
        Self {
            age: 0.0,
            position,
            velocity,
            apart: steps(motion.position.saturating_sub(position)),
            swing: [motion.velocity, motion.acceleration, motion.stiffness],
        }
    }

    /// Returns the position that the filter predicts.
    fn plain(&self) -> i64 {
        self.position.saturating_add(fine(self.velocity * self.age))
    }

    /// Returns the position that the oscillator predicts.
    fn swinging(&self) -> i64 {
        let [velocity, acceleration, stiffness] = self.swing;
        let motion = Motion {
            position: self.position.saturating_add(fine(self.apart)),
            velocity,
            acceleration,
            stiffness,
        };
        motion.ahead(self.age).position
    }
}

/// Oscillator of one axis, and its standing. See the [module](self).
#[derive(Clone, Copy, Debug)]
pub(super) struct Swing {
    oscillator: Oscillator,
    /// Capture time of the oscillator's last measurement.
    capture: Instant,
    bet: Bet,
    /// Mean of the contest, -1 to 1.
    score: f32,
    /// Mean square of the filter's errors in the contest, steps².
    missed: f32,
    /// Share of the swing that the stage makes, up to 1; 0 while the filter leads.
    gain: f32,
}

impl Swing {
    /// Creates the oscillator of a filter, which leads until the contest is won.
    #[inline(never)]
    pub(super) fn new(filter: &Filter, capture: Instant, reach: KinematicLimits) -> Self {
        let oscillator = Oscillator::new(filter, reach);
        Self {
            oscillator,
            capture,
            bet: Bet::new(filter.position(), filter.velocity(), oscillator.motion()),
            score: 0.0,
            missed: 0.0,
            gain: 0.0,
        }
    }

    /// Returns true if the oscillator leads the axis at `at`: its last measurement is at most
    /// `horizon` ms old.
    pub(super) fn leads(&self, at: Instant, horizon: f32) -> bool {
        self.gain > 0.0 && milliseconds(at.since(self.capture)) <= horizon
    }

    /// Gives the lead to the filter.
    pub(super) fn yield_lead(&mut self) {
        self.score = 0.0;
        self.gain = 0.0;
    }

    /// Takes in a measurement on `axis` that the filter has taken, and judges the contest if the
    /// last predictions are `lead` ms old. `velocity` is the one that the stage uses of the
    /// filter's.
    pub(super) fn learn(
        &mut self,
        (filter, velocity): (&Filter, f32),
        measurement: &Measurement,
        axis: usize,
        lead: f32,
        reach: KinematicLimits,
    ) {
        let (Some(&position), Some(&variance)) = (
            measurement.position.get(axis),
            measurement.variance.get(axis),
        ) else {
            return;
        };
        let capture = measurement.capture;
        let dt = milliseconds(capture.since(self.capture));
        if !(dt > 0.0) {
            return;
        }
        self.oscillator.predict(dt);
        if dt > LONGEST_MS || !self.oscillator.admits(position, variance) {
            *self = Self::new(filter, capture, reach);
            return;
        }
        self.oscillator.update(position, variance, dt, reach);
        self.capture = capture;
        let noise = with_quantisation(variance);
        let promised = self.oscillator.variance(lead);
        if !self.is_trusted(promised, noise, KEEP) {
            self.gain = 0.0;
        }
        self.bet.age += dt;
        if self.bet.age >= lead {
            self.judge(promised, position, noise, reach);
            self.bet = Bet::new(filter.position(), velocity, self.oscillator.motion());
        }
    }

    /// Judges the predictions by a measurement with the variance `noise`. The oscillator promises
    /// the next prediction with the variance `promised`.
    fn judge(&mut self, promised: f32, measured: i64, noise: f32, reach: KinematicLimits) {
        let error = |predicted: i64| steps(measured.saturating_sub(predicted));
        let (plain, swinging) = (error(self.bet.plain()), error(self.bet.swinging()));
        let between = plain - swinging;
        let won = between * (plain + swinging) / (between * between + DOUBT * noise);
        self.score += (within(won, -1.0, 1.0) - self.score) * FADE;
        self.missed += (plain * plain - self.missed) * FADE;
        let leads = self.gain > 0.0;
        if leads && self.score <= 0.0 {
            self.gain = 0.0;
        }
        if !leads && self.score > LEAD && self.is_trusted(promised, noise, TRUST) {
            let jerk = self.oscillator.motion().jerk();
            self.gain = within(EASY * most_jerk(reach) / jerk, LEAST_GAIN, 1.0);
        }
    }

    /// Returns true if the variance `promised` of a prediction is at most `share` variances of a
    /// measurement (`noise`), or far below the filter's errors.
    fn is_trusted(&self, promised: f32, noise: f32, share: f32) -> bool {
        promised <= share * noise || promised <= BETTER * self.missed
    }

    /// Computes the goal of the axis at `at`.
    pub(super) fn aim(&self, at: Instant, reach: KinematicLimits) -> Aim {
        self.goal(&self.next(at), reach)
    }

    /// Computes the goal of the axis at `at`, when the stage is at `load`, and adapts the gain.
    pub(super) fn steer(&mut self, at: Instant, load: i64, reach: KinematicLimits) -> Aim {
        let motion = self.next(at);
        self.adapt(&motion, load, reach);
        self.goal(&motion, reach)
    }

    /// Returns the motion of the target a millisecond after `at`, when the tick ends that is
    /// planned from there.
    fn next(&self, at: Instant) -> Motion {
        let lead = milliseconds(at.since(self.capture));
        self.oscillator.motion().ahead(lead + 1.0)
    }

    /// Returns the goal, a millisecond before the target has this motion.
    fn goal(&self, motion: &Motion, reach: KinematicLimits) -> Aim {
        let most = within(reach.acceleration, 1e-6, 1e6);
        // A swing that has become easy since the last tick is made whole, which needs no centre.
        let gain = match motion.jerk() > EASY * most_jerk(reach) {
            true => self.gain,
            false => 1.0,
        };
        let acceleration = within(gain * motion.acceleration, -most, most);
        let size = if acceleration < 0.0 {
            -acceleration
        } else {
            acceleration
        };
        let time = size / within(reach.jerk, 1e-9, 1e6);
        let velocity = gain * motion.velocity + 0.5 * acceleration * time;
        let back = acceleration * time * time * (1.0 / 6.0) + velocity;
        Aim {
            position: motion
                .position
                .saturating_add(fine(shift(gain, motion) - back)),
            velocity,
        }
    }

    /// Adapts the gain to a stage that is at `load` a millisecond before the target has this
    /// motion.
    fn adapt(&mut self, motion: &Motion, load: i64, reach: KinematicLimits) {
        let (jerk, most) = (motion.jerk(), most_jerk(reach));
        if jerk <= EASY * most {
            self.gain = 1.0;
            return;
        }
        let made = self.gain * self.gain * jerk;
        let shift = shift(self.gain, motion) - self.gain * motion.velocity;
        let goal = motion.position.saturating_add(fine(shift));
        // Times the stiffness to the power of 3/2, as the jerk is the amplitude.
        let off = steps(goal.saturating_sub(load)) * motion.stiffness;
        let off = off * off * motion.stiffness;
        self.gain = if made < EASY * most {
            within(self.gain + DECAY, LEAST_GAIN, 1.0)
        } else if off < NEAR * jerk && made < HARD * most {
            within(self.gain + GROWTH, LEAST_GAIN, 1.0)
        } else {
            within(self.gain * (1.0 - DECAY), LEAST_GAIN, 1.0)
        };
    }
}

/// Returns the way towards the centre that a gain takes off a swing, steps. The swing has a
/// stiffness if the gain is below 1.
fn shift(gain: f32, motion: &Motion) -> f32 {
    if gain < 1.0 {
        (1.0 - gain) * motion.acceleration / motion.stiffness
    } else {
        0.0
    }
}

/// Returns the square of the stage's highest jerk, (steps/ms³)².
fn most_jerk(reach: KinematicLimits) -> f32 {
    let jerk = within(reach.jerk, 1e-9, 1e6);
    jerk * jerk
}

#[cfg(test)]
mod tests;
