//! The target that the stage follows: its three axes, and the times of its measurements.

use super::super::filter::{Filter, KinematicLimits, within};
use super::axis::TrackedAxis;
use super::{Measurement, Settings, milliseconds};
use crate::time::Instant;

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

/// Age of a measurement up to which an oscillator leads, over that of the newest one at most.
const HORIZON: f32 = 2.0;

/// The target that the stage follows.
#[derive(Clone, Debug)]
pub(super) struct Target {
    pub(super) axes: [TrackedAxis; 3],
    /// Capture time of the last measurement.
    pub(super) capture: Instant,
    /// Instant at which that measurement arrived.
    pub(super) heard: Instant,
    /// Mean time between measurements, ms; 0 after the first.
    period: f32,
    pub(super) lost: bool,
    /// True if the last measurement was an outlier.
    pub(super) is_suspect: bool,
    /// Number of axes whose oscillators have yet to learn from the last measurement.
    pub(super) unlearned: u8,
    /// Time from the last capture to the goal that was computed from it, ms.
    pub(super) lead: f32,
}

impl Target {
    /// Creates a target from its first measurement, which arrived at `now`.
    pub(super) fn new(
        measurement: &Measurement,
        reach: &[KinematicLimits; 3],
        now: Instant,
    ) -> Self {
        let [px, py, pz] = measurement.position;
        let [vx, vy, vz] = measurement.variance;
        let [rx, ry, rz] = *reach;
        let first = |position, variance, reach| {
            let filter = Filter::new(position, variance, reach);
            TrackedAxis::new(filter, measurement.capture, reach)
        };
        Self {
            axes: [first(px, vx, rx), first(py, vy, ry), first(pz, vz, rz)],
            capture: measurement.capture,
            heard: now,
            period: 0.0,
            lost: false,
            is_suspect: false,
            unlearned: 0,
            lead: 0.0,
        }
    }

    /// Updates the mean period with the time since the last measurement, unless the target was
    /// lost.
    pub(super) fn count_interval(&mut self, capture: Instant) {
        if self.lost {
            return;
        }
        let interval = milliseconds(capture.since(self.capture));
        let share = if self.period > 0.0 { INTERVAL } else { 1.0 };
        self.period += (interval - self.period) * share;
    }

    /// Returns true if the last measurement is as recent as the frame rate allows.
    pub(super) fn is_in_sight(&self, now: Instant) -> bool {
        let longest = within(SIGHT_PERIODS * self.period, SIGHT_MS, MOST_PERIOD_MS);
        // Whole µs, below 2^20.
        now.since(self.heard) <= (longest * 1_000.0) as u64
    }

    /// Returns the age of a measurement up to which an oscillator leads, ms: two frames more than
    /// usual.
    pub(super) fn horizon(&self) -> f32 {
        HORIZON * (self.lead + self.period)
    }

    /// Lets one oscillator learn from the last measurement, if one has yet to.
    pub(super) fn learn(&mut self, measurement: &Measurement, reach: &[KinematicLimits; 3]) {
        let Some(left) = self.unlearned.checked_sub(1) else {
            return;
        };
        self.unlearned = left;
        let number = usize::from(left);
        if let (Some(axis), Some(reach)) = (self.axes.get_mut(number), reach.get(number)) {
            let filter = axis.filter;
            let plain = (&filter, axis.used_velocity());
            axis.swing
                .learn(plain, measurement, number, self.lead, *reach);
        }
    }

    /// Updates the filters with a measurement. Returns false and changes nothing if it is an
    /// outlier.
    pub(super) fn take_in(
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
