//! Goal of the stage: gates the measurements of the target, predicts it to the present, and coasts
//! without measurements.
//!
//! A measurement is the position of the target at a capture, in stage coordinates (see
//! [`Tracker`](super::Tracker)). It is old when it arrives, by exposure, flow, link and the
//! station's own delay, and the next one comes later still. So each axis has a [`Filter`], and the
//! stage is sent to the predicted position of the target at the instant when the next words are on
//! the pins, with the target's velocity.
//!
//! # Innovation gate
//! A measurement that no target within the stage's reach can have caused is an *outlier*: it is
//! refused, and remembered. If the next one lies near it and not near the prediction, both are
//! right and the target made a *jump*: the filters start anew from the two.
//!
//! # Velocity gain
//! A velocity that is hardly known, or about to change, is worse than none: after a jump it would
//! throw the stage far beyond its goal. Of `v` the share `v⁴/(v⁴ + d²)` is used, with `d` the
//! filter's [velocity uncertainty](Filter::velocity_uncertainty): nearly all of a steady motion,
//! nearly nothing of noise or of a target that is braking hard. The share is low-pass filtered.
//!
//! # A target that accelerates or swings
//! The filter lags behind a target that accelerates. So each axis has an
//! [`Oscillator`](super::oscillator::Oscillator) as well, which learns from the same measurements,
//! in the ticks after a frame ([`Pursuit::work`]). While it predicts better than the filter, it
//! leads the axis: its goals follow the curve, a new one in every tick ([`Pursuit::swing`]).
//! Everything else remains the filter's: gate, jumps, rest, and coasting.
//!
//! # A still target
//! While the speed is less than three of its sigmas (once in motion: one and a half) the axis rests
//! in a whole step, and the measurements are averaged, up to a second's worth. The axis goes to
//! another step if their mean is more than half a step and one sigma off, or the filter's position
//! more than half a step and three sigmas. So noise does not make the motor chatter, and the axis
//! rests in the right step.
//!
//! # No measurements
//! The stage *coasts*: it goes on as the target did. After [`Settings::coast_ms`] the target is
//! *lost* and the stage ramps down. It stays [following](crate::safety::State::Following): it
//! follows again after one frame near the place where the target was lost, or after two frames
//! beyond that agree. The limits of the axes hold as for any motion.

mod axis;
mod swing;
mod target;

use super::StepVector;
use super::filter::{Filter, KinematicLimits, steps};
use crate::time::Instant;
use axis::TrackedAxis;
use serde::{Deserialize, Serialize};
use target::Target;

/// Settings of tracking. Part of the station's configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Settings {
    /// True if the station predicts the target to the present. Otherwise the stage goes to the last
    /// measured position.
    pub prediction: bool,
    /// Time for which the stage goes on without a frame, ms, up to [`Settings::LONGEST_COAST_MS`].
    pub coast_ms: u16,
}

impl Settings {
    /// Default settings: with prediction; 800 ms.
    pub const DEFAULT: Self = Self {
        prediction: true,
        coast_ms: 800,
    };

    /// Longest time between a frame and the loss of the target, ms.
    pub const LONGEST_COAST_MS: u16 = 5_000;
}

/// Knowledge of the target. Append-only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Sight {
    /// The stage follows nothing.
    #[default]
    None,
    /// A frame was used within the last 100 ms, or 2.5 mean periods of the frames.
    Tracking,
    /// No frame was used for longer: the stage goes on as the target did.
    Coasting,
    /// No frame was used for the time that the settings allow: the stage is at rest, or ramps down.
    Lost,
}

/// Error of a measurement that fails the innovation gate. A following measurement that agrees with
/// it makes it a jump.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outlier;

/// Measured position of the target.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measurement {
    /// Capture time.
    pub capture: Instant,
    /// Position, 2⁻³² steps from zero.
    pub position: StepVector,
    /// Variance per axis, steps².
    pub variance: [f32; 3],
}

/// Goal of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Aim {
    /// Position, 2⁻³² steps from zero.
    pub position: i64,
    /// Velocity at that position, steps/ms.
    pub velocity: f32,
}

/// Target that the stage follows, and its last outlier.
#[derive(Clone, Debug, Default)]
pub struct Pursuit {
    target: Option<Target>,
    /// The last outlier if no measurement was accepted since ([`Target::is_suspect`]), else the
    /// measurement from which the oscillators learn.
    last: Measurement,
}

impl Pursuit {
    /// Takes in a measurement that arrived at `now`; capture times must come in order.
    ///
    /// # Errors
    /// [`Outlier`] if the measurement fails the innovation gate. It is then only remembered.
    pub fn measure(
        &mut self,
        now: Instant,
        measurement: &Measurement,
        reach: &[KinematicLimits; 3],
        settings: &Settings,
    ) -> Result<(), Outlier> {
        let is_plausible = match &mut self.target {
            None => {
                self.target = Some(Target::new(measurement, reach, now));
                true
            }
            Some(target) => target.take_in(measurement, reach, settings),
        };
        if !is_plausible {
            let axes = self.jump(measurement, reach);
            if let Some(target) = &mut self.target {
                let Some(axes) = axes else {
                    self.last = *measurement;
                    target.is_suspect = true;
                    target.unlearned = 0;
                    return Err(Outlier);
                };
                target.axes = axes;
            }
        }
        if let Some(target) = &mut self.target {
            target.count_interval(measurement.capture);
            target.capture = measurement.capture;
            target.heard = now;
            target.lost = false;
            target.is_suspect = false;
            // The oscillators learn in the ticks after this one. While they are still at the
            // measurement before, that one goes on: frames in every tick are thinned out.
            if target.unlearned > 0 {
                target.learn(&self.last, reach);
            } else {
                self.last = *measurement;
                target.unlearned = 3;
            }
        }
        Ok(())
    }

    /// Returns the axes after a jump, if `measurement` agrees with the last outlier.
    fn jump(
        &self,
        measurement: &Measurement,
        reach: &[KinematicLimits; 3],
    ) -> Option<[TrackedAxis; 3]> {
        let is_suspect = self.target.as_ref()?.is_suspect;
        let suspect = is_suspect.then_some(&self.last)?;
        let dt = milliseconds(measurement.capture.since(suspect.capture));
        if !(dt > 0.0) {
            return None;
        }
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let reach = *reach.get(axis)?;
            let before = *suspect.position.get(axis)?;
            let position = *measurement.position.get(axis)?;
            let variances = [
                *suspect.variance.get(axis)?,
                *measurement.variance.get(axis)?,
            ];
            let way = steps(position.saturating_sub(before));
            let most = reach.speed * dt;
            let near = way * way <= most * most + 25.0 * (variances[0] + variances[1]);
            near.then(|| {
                let filter = Filter::restart(before, position, dt, variances, reach);
                TrackedAxis::new(filter, measurement.capture, reach)
            })
        });
        Some([x?, y?, z?])
    }

    /// Computes the goal of the stage at `at`, if there is a target in sight.
    pub fn aim(
        &mut self,
        at: Instant,
        reach: &[KinematicLimits; 3],
        settings: &Settings,
    ) -> Option<[Aim; 3]> {
        let target = self.target.as_mut().filter(|target| !target.lost)?;
        let lead = milliseconds(at.since(target.capture));
        target.lead = lead;
        let horizon = target.horizon();
        let mut aims = [Aim::default(); 3];
        let axes = target.axes.iter_mut().zip(reach);
        for (aim, (axis, reach)) in aims.iter_mut().zip(axes) {
            axis.decide(settings.prediction, *reach);
            axis.swings = settings.prediction && axis.swing.leads(at, horizon);
            *aim = match axis.swings {
                true => axis.swing.aim(at, *reach),
                false => axis.plain(lead),
            };
        }
        Some(aims)
    }

    /// Does a tick's share of the work for which a frame's tick has no time: one oscillator learns
    /// from the last measurement.
    pub fn work(&mut self, reach: &[KinematicLimits; 3]) {
        if let Some(target) = &mut self.target {
            target.learn(&self.last, reach);
        }
    }

    /// Gives the lead to the filter on each axis on which the target is farther away (`error`) than
    /// a quarter of the largest motion without approach (`unseen`; zero disables it). A stage that
    /// lost its steps makes a target run away, and an oscillator would chase it ever faster.
    pub fn doubt_stage(&mut self, error: &StepVector, unseen: &StepVector) {
        let Some(target) = &mut self.target else {
            return;
        };
        for (axis, (error, unseen)) in target.axes.iter_mut().zip(error.iter().zip(unseen)) {
            if *unseen > 0 && error.saturating_abs() > unseen >> 2 {
                axis.swing.yield_lead();
            }
        }
    }

    /// Computes the goals at `at` of the axes that an oscillator leads. `stage` is the stage's
    /// position then.
    pub fn swing(
        &mut self,
        at: Instant,
        stage: StepVector,
        reach: &[KinematicLimits; 3],
        settings: &Settings,
    ) -> [Option<Aim>; 3] {
        let mut aims = [None; 3];
        let target = self.target.as_mut().filter(|target| !target.lost);
        let Some(target) = target.filter(|_| settings.prediction) else {
            return aims;
        };
        let horizon = target.horizon();
        let lead = milliseconds(at.since(target.capture));
        let axes = target.axes.iter_mut().zip(stage).zip(reach);
        for (aim, ((axis, stage), reach)) in aims.iter_mut().zip(axes) {
            if !axis.swings {
                continue;
            }
            axis.swings = axis.swing.leads(at, horizon);
            *aim = Some(match axis.swings {
                true => axis.swing.steer(at, stage, *reach),
                false => axis.plain(lead),
            });
        }
        aims
    }

    /// Checks for the loss of the target; returns `true` once per loss.
    pub fn lose(&mut self, now: Instant, settings: &Settings) -> bool {
        match &mut self.target {
            Some(target) if !target.lost => {
                target.lost = now.since(target.heard) > u64::from(settings.coast_ms) * 1000;
                if target.lost {
                    let axes = target.axes.iter_mut();
                    axes.for_each(|axis| axis.swing.yield_lead());
                }
                target.lost
            }
            _ => false,
        }
    }

    /// Returns the knowledge of the target.
    pub fn sight(&self, now: Instant) -> Sight {
        match &self.target {
            None => Sight::None,
            Some(target) if target.lost => Sight::Lost,
            Some(target) if target.is_in_sight(now) => Sight::Tracking,
            Some(_) => Sight::Coasting,
        }
    }

    /// Returns the time since the target was seen, µs; 0 without a target.
    pub fn age_us(&self, now: Instant) -> u64 {
        self.target
            .as_ref()
            .map_or(0, |target| now.since(target.capture))
    }
}

fn milliseconds(us: u64) -> f32 {
    u32::try_from(us).unwrap_or(u32::MAX) as f32 * 0.001
}

#[cfg(test)]
mod tests;
