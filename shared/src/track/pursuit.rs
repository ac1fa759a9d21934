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
//! filter's [doubt](Filter::doubt): nearly all of a steady motion, nearly nothing of noise or of a
//! target that is braking hard. The share is low-pass filtered.
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

use super::StepVector;
use super::filter::{Filter, KinematicLimits, fine, floored_variance, steps, within};
use crate::time::Instant;
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

/// Low-pass gain of the velocity share, per frame.
const EASE: f32 = 0.4;

/// Speed over sigma, squared, above which a resting axis starts (`START`) and below which a moving
/// one comes to rest (`STOP`).
const START: f32 = 9.0;
const STOP: f32 = 2.25;

/// Distance of the filter's position from the step in sigmas, squared, at which a resting axis
/// starts anew.
const FAR: f32 = 9.0;

/// Weight of the mean over a still target, in measurements: at its beginning (`FEW`) and at most
/// (`MANY`), which is a second's worth.
const FEW: f32 = 4.0;
const MANY: f32 = 64.0;

/// Longest time since the last frame in which full acceleration explains a displacement, ms.
const RECENT_MS: f32 = 34.0;

/// Half a step, 2⁻³² steps.
const HALF: i64 = 1 << 31;

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

/// One axis that follows the target.
#[derive(Clone, Copy, Debug)]
struct TrackedAxis {
    filter: Filter,
    /// State of an axis at rest, while the target is still.
    rest: Option<Rest>,
    /// Velocity gain, 0 to 1.
    velocity_gain: f32,
}

/// State of an axis at a still target.
#[derive(Clone, Copy, Debug)]
struct Rest {
    /// Position of the axis: a whole step, in 2⁻³² steps.
    step: i64,
    /// Mean of the measurements, 2⁻³² steps.
    mean: i64,
    /// Number of measurements in the mean.
    count: f32,
    /// Variance of the mean, steps².
    variance: f32,
}

impl Rest {
    /// Rests the axis in the step nearest to the filter's position.
    fn new(filter: &Filter) -> Self {
        Self {
            step: nearest_step(filter.position()),
            mean: filter.position(),
            count: FEW,
            variance: filter.covariance().position,
        }
    }

    /// Averages another measurement, and goes to another step if the mean requires it.
    fn average(&mut self, position: i64, variance: f32) {
        self.count = within(self.count + 1.0, FEW, MANY);
        let off = steps(position.saturating_sub(self.mean));
        self.mean = self.mean.saturating_add(fine(off / self.count));
        self.variance = floored_variance(variance) / self.count;
        if !self.holds(self.mean, self.variance, 1.0) {
            self.step = nearest_step(self.mean);
        }
    }

    /// Returns true if `position` is no farther beyond the step than `sigmas` sigmas, squared.
    fn holds(&self, position: i64, variance: f32, sigmas: f32) -> bool {
        let off = steps(position.saturating_sub(self.step));
        let beyond = if off < 0.0 { -off } else { off } - 0.5;
        beyond < 0.0 || beyond * beyond < sigmas * variance
    }
}

impl TrackedAxis {
    fn new(filter: Filter) -> Self {
        Self {
            filter,
            rest: None,
            velocity_gain: 0.0,
        }
    }

    /// Takes the filter after its update with a measurement.
    fn go_on(&mut self, filter: Filter, position: i64, variance: f32) {
        self.filter = filter;
        if let Some(rest) = &mut self.rest {
            rest.average(position, variance);
        }
    }

    /// Computes the goal of the axis `lead` ms after the capture.
    fn aim(&mut self, lead: f32, prediction: bool, reach: KinematicLimits) -> Aim {
        let known = self.filter.covariance();
        let (position, velocity) = (self.filter.position(), self.filter.velocity());
        let square = velocity * velocity;
        let sigmas = if self.rest.is_some() { START } else { STOP };
        if !prediction || square < sigmas * known.velocity {
            let resting = self
                .rest
                .filter(|rest| rest.holds(position, known.position, FAR));
            let rest = resting.unwrap_or_else(|| Rest::new(&self.filter));
            self.rest = Some(rest);
            self.velocity_gain = 0.0;
            return Aim {
                position: rest.step,
                velocity: 0.0,
            };
        }
        self.rest = None;
        let (uncertainty, fourth) = (self.filter.velocity_uncertainty(reach), square * square);
        let wanted = fourth / (fourth + uncertainty * uncertainty);
        self.velocity_gain += (wanted - self.velocity_gain) * EASE;
        let velocity = velocity * self.velocity_gain;
        Aim {
            position: position.saturating_add(fine(velocity * lead)),
            velocity,
        }
    }
}

/// Returns the whole step nearest to a position, both in 2⁻³² steps.
fn nearest_step(position: i64) -> i64 {
    position.saturating_add(HALF) & !(2 * HALF - 1)
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
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn any_measurement() -> impl Strategy<Value = Measurement> {
        any::<(u64, StepVector, [f32; 3])>().prop_map(|(capture, position, variance)| Measurement {
            capture: Instant::from_micros(capture),
            position,
            variance,
        })
    }

    const REACH: [KinematicLimits; 3] = [KinematicLimits {
        speed: 8.0,
        acceleration: 0.16,
    }; 3];

    /// Returns a measurement with the same position on all axes, `ms` ms after the start.
    fn seen(ms: u64, steps: i64) -> Measurement {
        Measurement {
            capture: Instant::from_micros(ms * 1_000),
            position: [steps << 32; 3],
            variance: [0.1; 3],
        }
    }

    fn measure(pursuit: &mut Pursuit, measurement: &Measurement) -> Result<(), Outlier> {
        pursuit.measure(measurement.capture, measurement, &REACH, &Settings::DEFAULT)
    }

    /// Returns a pursuit after one second at a still target.
    fn settled() -> Pursuit {
        let mut pursuit = Pursuit::default();
        for k in 1..=60 {
            assert_eq!(measure(&mut pursuit, &seen(16 * k, 0)), Ok(()));
        }
        pursuit
    }

    impl Pursuit {
        fn filters(&self) -> Option<[Filter; 3]> {
            self.target
                .as_ref()
                .map(|target| target.axes.map(|axis| axis.filter))
        }
    }

    proptest! {
        /// Feeds any measurements, in any order and at any time.
        #[test]
        fn every_aim_is_finite(
            reach in any::<[[f32; 2]; 3]>(), prediction: bool, coast_ms: u16,
            measurements in prop::collection::vec((any_measurement(), any::<[u64; 2]>()), 0..40),
        ) {
            let settings = Settings { prediction, coast_ms };
            let reach = reach.map(|[speed, acceleration]| KinematicLimits { speed, acceleration });
            let mut pursuit = Pursuit::default();
            for (measurement, [now, at]) in measurements {
                let _ = pursuit.measure(Instant::from_micros(now), &measurement, &reach, &settings);
                let aims = pursuit.aim(Instant::from_micros(at), &reach, &settings);
                for aim in aims.into_iter().flatten() {
                    prop_assert!(aim.velocity.is_finite());
                }
                pursuit.lose(Instant::from_micros(at), &settings);
            }
        }
    }

    #[test]
    fn second_agreeing_outlier_is_jump() {
        let mut pursuit = settled();
        let before = pursuit.filters();
        // 5 mm.
        assert_eq!(measure(&mut pursuit, &seen(976, 400)), Err(Outlier));
        assert_eq!(pursuit.filters(), before);
        // Neither near the last outlier nor near the prediction.
        assert_eq!(measure(&mut pursuit, &seen(992, -400)), Err(Outlier));
        assert_eq!(pursuit.filters(), before);
        assert_eq!(measure(&mut pursuit, &seen(1_008, -400)), Ok(()));
        let positions = pursuit
            .filters()
            .map(|axes| axes.map(|axis| axis.position()));
        assert_eq!(positions, Some([-400 << 32; 3]));
    }

    #[test]
    fn expected_frame_clears_suspicion() {
        let mut pursuit = settled();
        assert_eq!(measure(&mut pursuit, &seen(976, 400)), Err(Outlier));
        assert_eq!(measure(&mut pursuit, &seen(992, 0)), Ok(()));
        assert_eq!(measure(&mut pursuit, &seen(1_008, 400)), Err(Outlier));
    }

    #[test]
    fn slow_frames_keep_target_in_sight() {
        let mut pursuit = Pursuit::default();
        for k in 1..=20 {
            assert_eq!(measure(&mut pursuit, &seen(200 * k, 0)), Ok(()));
            let before = Instant::from_micros((200 * k + 199) * 1_000);
            // The first interval must be known.
            let expected = if k == 1 {
                Sight::Coasting
            } else {
                Sight::Tracking
            };
            assert_eq!(pursuit.sight(before), expected);
        }
        let late = |ms: u64| Instant::from_micros((4_000 + ms) * 1_000);
        assert_eq!(pursuit.sight(late(500)), Sight::Tracking);
        assert_eq!(pursuit.sight(late(501)), Sight::Coasting);
    }

    #[test]
    fn target_coasts_then_is_lost_once() {
        let mut pursuit = settled();
        let last = Instant::from_micros(960_000);
        let after = |ms: u64| last.plus_micros(ms * 1_000);
        assert_eq!(Pursuit::default().sight(last), Sight::None);
        assert_eq!(pursuit.sight(after(100)), Sight::Tracking);
        assert_eq!(pursuit.sight(after(101)), Sight::Coasting);
        assert!(!pursuit.lose(after(800), &Settings::DEFAULT));
        assert!(pursuit.lose(after(801), &Settings::DEFAULT));
        assert!(!pursuit.lose(after(802), &Settings::DEFAULT));
        assert_eq!(pursuit.sight(after(900)), Sight::Lost);
        assert_eq!(pursuit.age_us(after(900)), 900_000);
        assert_eq!(pursuit.aim(after(900), &REACH, &Settings::DEFAULT), None);
        assert_eq!(measure(&mut pursuit, &seen(9_000, 3)), Ok(()));
        assert_eq!(pursuit.sight(after(8_100)), Sight::Tracking);
    }
}
