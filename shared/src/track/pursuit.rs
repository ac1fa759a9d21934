//! Where the stage should go: which measurements of the target to believe, where it is by now, and what to do without any.
//!
//! A measurement says where the target was at a capture, in stage coordinates (see [`Tracker`](super::Tracker)). It is old when it comes, by
//! exposure, flow, link and the station's own delay; and the next is some way off. So each axis has a [`Filter`], and the stage is sent to where
//! the target is by the time the next words are on the pins, with the target's speed to go on with.
//!
//! # Which measurements
//! One that no target within the stage's reach can have caused is an *outlier*: it is refused, and remembered. If the next one lies
//! near it and not near the prediction, both are right and the target made a *jump*: the filters start anew from the two.
//!
//! # How far ahead
//! A speed that is hardly known, or about to change, is worse than none: after a jump it would throw the stage far beyond its goal. Of
//! `v` the share `v⁴/(v⁴ + d²)` is used, with `d` the filter's [doubt](Filter::doubt): next to all of a steady motion, next to
//! nothing of noise or of a target that is braking hard. The share changes by degrees.
//!
//! # A still target
//! While the speed is less than three of its sigmas (once in motion: one and a half) the axis rests in a whole step. It goes to
//! another one when the target is more than half a step and two sigmas of its position off. So noise does not make the motor chatter.
//!
//! # No measurements
//! The stage *coasts*: the target is taken to go on as it did. After [`Settings::coast_ms`] it is *lost* and the stage ramps
//! down. It stays [following](crate::safety::State::Following): a frame near where the target was lost, or two beyond that agree, are followed again,
//! within the limits of the axes like any motion.

use super::Fine;
use super::filter::{Filter, Reach, fine, steps, within};
use crate::time::Instant;
use serde::{Deserialize, Serialize};

/// After so long without a measurement the target counts as out of sight, ms.
const SIGHT_MS: u64 = 100;

/// By how much of the difference the share of the speed changes with each frame.
const EASE: f32 = 0.4;

/// Speed to sigma, squared, at which a resting axis starts and a moving one comes to rest.
const START: f32 = 9.0;
const REST: f32 = 2.25;

/// An axis rests while the target is within so many sigmas of its step, squared.
const NEAR: f32 = 4.0;

/// Full acceleration since the last frame explains a displacement, for so long, ms.
const RECENT_MS: f32 = 34.0;

/// Half a step, 2⁻³² steps.
const HALF: i64 = 1 << 31;

/// How the target is followed. Part of the station's configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Settings {
    /// Whether latency is made up for. Without, the stage goes to where the target was.
    pub prediction: bool,
    /// How long the stage goes on without a frame, ms, up to [`Settings::LONGEST_COAST_MS`].
    pub coast_ms: u16,
}

impl Settings {
    /// With prediction; 800 ms.
    pub const DEFAULT: Self = Self {
        prediction: true,
        coast_ms: 800,
    };

    /// The longest time there may be between a frame and the loss of the target, ms.
    pub const LONGEST_COAST_MS: u16 = 5_000;
}

/// What is known of the target. Append-only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Sight {
    /// Nothing is followed.
    #[default]
    None,
    /// A frame was used within the last 100 ms.
    Tracking,
    /// None was for longer: the stage goes on as the target did.
    Coasting,
    /// None was for as long as the settings allow: the stage is at rest, or ramps down to it.
    Lost,
}

/// A measurement that no target within reach can have caused. One that agrees with it makes it a jump.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outlier;

/// A measurement: where the target was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// When.
    pub capture: Instant,
    /// 2⁻³² steps from zero.
    pub position: Fine,
    /// Variance per axis, steps².
    pub variance: [f32; 3],
}

/// Where an axis should go.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Aim {
    /// Where to be, 2⁻³² steps from zero.
    pub position: i64,
    /// How fast to go on from there, steps/ms.
    pub speed: f32,
}

/// One axis that is followed.
#[derive(Clone, Copy, Debug)]
struct Axis {
    filter: Filter,
    /// Where the axis rests while the target does, whole steps in 2⁻³² steps.
    rest: Option<i64>,
    /// What is used of the speed, 0 to 1.
    share: f32,
}

impl Axis {
    fn new(filter: Filter) -> Self {
        Self {
            filter,
            rest: None,
            share: 0.0,
        }
    }

    /// Where to go so as to be right `lead` ms after the capture.
    fn aim(&mut self, lead: f32, prediction: bool, reach: Reach) -> Aim {
        let Self {
            filter,
            rest,
            share,
        } = self;
        let [spread, _, variance] = filter.covariance();
        let position = filter.position();
        let square = filter.speed() * filter.speed();
        let sigmas = if rest.is_some() { START } else { REST };
        if !prediction || square < sigmas * variance {
            // A whole step: the one it rests in, or the nearest.
            let nearest = position.saturating_add(HALF) & !(2 * HALF - 1);
            let resting = rest.filter(|rest| {
                let off = steps(position.saturating_sub(*rest));
                let beyond = if off < 0.0 { -off } else { off } - 0.5;
                beyond < 0.0 || beyond * beyond < NEAR * spread
            });
            let position = resting.unwrap_or(nearest);
            *rest = Some(position);
            *share = 0.0;
            return Aim {
                position,
                speed: 0.0,
            };
        }
        *rest = None;
        let (doubt, fourth) = (filter.doubt(reach), square * square);
        let wanted = fourth / (fourth + doubt * doubt);
        *share += (wanted - *share) * EASE;
        let speed = filter.speed() * *share;
        Aim {
            position: position.saturating_add(fine(speed * lead)),
            speed,
        }
    }
}

/// The target that is being followed.
#[derive(Clone, Debug)]
struct Target {
    axes: [Axis; 3],
    /// When it was seen last.
    capture: Instant,
    /// When that was heard of.
    heard: Instant,
    lost: bool,
}

/// What the stage is after.
#[derive(Clone, Debug, Default)]
pub struct Pursuit {
    target: Option<Target>,
    /// The last outlier, if nothing was believed since.
    suspect: Option<Measurement>,
}

impl Pursuit {
    /// Takes in a measurement that arrived at `now`; captures must come in order.
    ///
    /// # Errors
    /// [`Outlier`]: only remembered.
    pub fn measure(
        &mut self,
        now: Instant,
        measurement: &Measurement,
        reach: &[Reach; 3],
        settings: &Settings,
    ) -> Result<(), Outlier> {
        let axes = match &self.target {
            None => first(measurement, reach),
            Some(target) => match target.take_in(measurement, reach, settings) {
                Some(axes) => axes,
                None => match self.jump(measurement, reach) {
                    Some(axes) => axes,
                    None => {
                        self.suspect = Some(*measurement);
                        return Err(Outlier);
                    }
                },
            },
        };
        self.suspect = None;
        self.target = Some(Target {
            axes,
            capture: measurement.capture,
            heard: now,
            lost: false,
        });
        Ok(())
    }

    /// The target anew, if `measurement` agrees with the suspect.
    fn jump(&self, measurement: &Measurement, reach: &[Reach; 3]) -> Option<[Axis; 3]> {
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
            near.then(|| Axis::new(Filter::restart(before, position, dt, variances, reach)))
        });
        Some([x?, y?, z?])
    }

    /// Where the stage should be at `at`, if there is a target in sight.
    pub fn aim(
        &mut self,
        at: Instant,
        reach: &[Reach; 3],
        settings: &Settings,
    ) -> Option<[Aim; 3]> {
        let target = self.target.as_mut().filter(|target| !target.lost)?;
        let lead = milliseconds(at.since(target.capture));
        let ([x, y, z], [rx, ry, rz]) = (&mut target.axes, *reach);
        Some(
            [(x, rx), (y, ry), (z, rz)]
                .map(|(axis, reach)| axis.aim(lead, settings.prediction, reach)),
        )
    }

    /// Notices that the target is lost: `true` once.
    pub fn lose(&mut self, now: Instant, settings: &Settings) -> bool {
        match &mut self.target {
            Some(target) if !target.lost => {
                target.lost = now.since(target.heard) > u64::from(settings.coast_ms) * 1000;
                target.lost
            }
            _ => false,
        }
    }

    /// What is known of the target.
    pub fn sight(&self, now: Instant) -> Sight {
        match &self.target {
            None => Sight::None,
            Some(target) if target.lost => Sight::Lost,
            Some(target) if now.since(target.heard) > SIGHT_MS * 1000 => Sight::Coasting,
            Some(_) => Sight::Tracking,
        }
    }

    /// How long ago the target was seen, µs. 0 without one.
    pub fn age_us(&self, now: Instant) -> u64 {
        self.target
            .as_ref()
            .map_or(0, |target| now.since(target.capture))
    }

    /// The filters of the three axes.
    pub fn filters(&self) -> Option<[Filter; 3]> {
        self.target
            .as_ref()
            .map(|target| target.axes.map(|axis| axis.filter))
    }
}

impl Target {
    /// The axes with a measurement taken in; `None` if it is an outlier.
    fn take_in(
        &self,
        measurement: &Measurement,
        reach: &[Reach; 3],
        settings: &Settings,
    ) -> Option<[Axis; 3]> {
        let dt = milliseconds(measurement.capture.since(self.capture));
        // A target that was lost is looked for where that happened.
        let ahead = within(dt, 0.0, f32::from(settings.coast_ms));
        let recent = within(dt, 0.0, RECENT_MS);
        let [x, y, z] = [0, 1, 2].map(|i| {
            let axis = *self.axes.get(i)?;
            let reach = *reach.get(i)?;
            let variance = *measurement.variance.get(i)?;
            let mut filter = axis.filter.after(ahead);
            let innovation = filter.innovation(*measurement.position.get(i)?);
            if !filter.admits(innovation, variance, recent, reach) {
                return None;
            }
            filter.update(innovation, variance, ahead, reach);
            Some(Axis { filter, ..axis })
        });
        Some([x?, y?, z?])
    }
}

fn first(measurement: &Measurement, reach: &[Reach; 3]) -> [Axis; 3] {
    let [px, py, pz] = measurement.position;
    let [vx, vy, vz] = measurement.variance;
    let [rx, ry, rz] = *reach;
    [(px, vx, rx), (py, vy, ry), (pz, vz, rz)]
        .map(|(position, variance, reach)| Axis::new(Filter::new(position, variance, reach)))
}

fn milliseconds(us: u64) -> f32 {
    u32::try_from(us).unwrap_or(u32::MAX) as f32 * 0.001
}
