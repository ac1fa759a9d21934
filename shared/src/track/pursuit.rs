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

use super::StepVector;
use super::filter::{Filter, KinematicLimits, steps, within};
use crate::time::Instant;
use axis::TrackedAxis;
use serde::{Deserialize, Serialize};

/// Time without a measurement after which the target counts as out of sight, ms.
const SIGHT_MS: f32 = 100.0;

/// Number of mean periods without a measurement after which the target counts as out of sight, if
/// that is longer than [`SIGHT_MS`].
const SIGHT_PERIODS: f32 = 2.5;

/// Longest mean period of the measurements, ms.
const MOST_PERIOD_MS: f32 = 1_000.0;

/// Low-pass gain of the mean period, per measurement.
const INTERVAL: f32 = 0.125;

/// Longest time since the last frame in which full acceleration explains a displacement, ms.
const RECENT_MS: f32 = 34.0;

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
#[derive(Clone, Copy, Debug, PartialEq)]
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

/// The target that the stage follows.
#[derive(Clone, Debug)]
struct Target {
    axes: [TrackedAxis; 3],
    /// Capture time of the last measurement.
    capture: Instant,
    /// Instant at which that measurement arrived.
    heard: Instant,
    /// Mean time between measurements, ms; 0 after the first.
    period: f32,
    lost: bool,
}

/// Target that the stage follows, and its last outlier.
#[derive(Clone, Debug, Default)]
pub struct Pursuit {
    target: Option<Target>,
    /// The last outlier, if no measurement was accepted since.
    suspect: Option<Measurement>,
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
            let Some(axes) = self.jump(measurement, reach) else {
                self.suspect = Some(*measurement);
                return Err(Outlier);
            };
            if let Some(target) = &mut self.target {
                target.axes = axes;
            }
        }
        self.suspect = None;
        if let Some(target) = &mut self.target {
            target.count_interval(measurement.capture);
            target.capture = measurement.capture;
            target.heard = now;
            target.lost = false;
        }
        Ok(())
    }

    /// Returns the axes after a jump, if `measurement` agrees with the last outlier.
    fn jump(
        &self,
        measurement: &Measurement,
        reach: &[KinematicLimits; 3],
    ) -> Option<[TrackedAxis; 3]> {
        let suspect = self.suspect.as_ref()?;
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
            near.then(|| TrackedAxis::new(Filter::restart(before, position, dt, variances, reach)))
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
        let ([x, y, z], [rx, ry, rz]) = (&mut target.axes, *reach);
        let prediction = settings.prediction;
        Some([
            x.aim(lead, prediction, rx),
            y.aim(lead, prediction, ry),
            z.aim(lead, prediction, rz),
        ])
    }

    /// Checks for the loss of the target; returns `true` once per loss.
    pub fn lose(&mut self, now: Instant, settings: &Settings) -> bool {
        match &mut self.target {
            Some(target) if !target.lost => {
                target.lost = now.since(target.heard) > u64::from(settings.coast_ms) * 1000;
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

impl Target {
    fn new(measurement: &Measurement, reach: &[KinematicLimits; 3], now: Instant) -> Self {
        let [px, py, pz] = measurement.position;
        let [vx, vy, vz] = measurement.variance;
        let [rx, ry, rz] = *reach;
        let first =
            |position, variance, reach| TrackedAxis::new(Filter::new(position, variance, reach));
        Self {
            axes: [first(px, vx, rx), first(py, vy, ry), first(pz, vz, rz)],
            capture: measurement.capture,
            heard: now,
            period: 0.0,
            lost: false,
        }
    }

    /// Updates the mean period with the time since the last measurement, unless the target was
    /// lost.
    fn count_interval(&mut self, capture: Instant) {
        if self.lost {
            return;
        }
        let interval = milliseconds(capture.since(self.capture));
        let share = if self.period > 0.0 { INTERVAL } else { 1.0 };
        self.period += (interval - self.period) * share;
    }

    /// Returns true if the last measurement is as recent as the frame rate allows.
    fn is_in_sight(&self, now: Instant) -> bool {
        let longest = within(SIGHT_PERIODS * self.period, SIGHT_MS, MOST_PERIOD_MS);
        // Whole µs, below 2^20.
        now.since(self.heard) <= (longest * 1_000.0) as u64
    }

    /// Updates the filters with a measurement. Returns false and changes nothing if it is an
    /// outlier.
    fn take_in(
        &mut self,
        measurement: &Measurement,
        reach: &[KinematicLimits; 3],
        settings: &Settings,
    ) -> bool {
        let dt = milliseconds(measurement.capture.since(self.capture));
        // Search for a lost target where it was lost.
        let ahead = within(dt, 0.0, f32::from(settings.coast_ms));
        let recent = within(dt, 0.0, RECENT_MS);
        let mut filters = self.axes.each_ref().map(|axis| axis.filter);
        let seen = measurement.position.iter().zip(&measurement.variance);
        for ((filter, (position, variance)), reach) in filters.iter_mut().zip(seen).zip(reach) {
            filter.predict(ahead);
            if !filter.admits(*position, *variance, recent, *reach) {
                return false;
            }
            filter.update(*position, *variance, ahead, *reach);
        }
        let seen = measurement.position.into_iter().zip(measurement.variance);
        for ((axis, filter), (position, variance)) in self.axes.iter_mut().zip(filters).zip(seen) {
            axis.go_on(filter, position, variance);
        }
        true
    }
}

fn milliseconds(us: u64) -> f32 {
    u32::try_from(us).unwrap_or(u32::MAX) as f32 * 0.001
}

#[cfg(test)]
mod tests;
