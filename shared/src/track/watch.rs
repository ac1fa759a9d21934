//! The cameras as an encoder: detects a stage that does not move as its steps say.
//!
//! The cameras ride on the stage, so they measure the error `e = target - stage`. With the stage's
//! position `s` the *apparent target* is `p = s + e`. If the stage really moves by `M s` and the
//! mount shows `G` of it, the apparent target is
//!
//! ```text
//! p = G target + (1 - G M) s + (what wrong time stamps make of the stage's speed)
//! ```
//!
//! A healthy stage has `G M = 1`: `p` contains nothing of `s`. A motor that stalls makes `M = 0` on
//! its axis and `p = target + s`: a target that runs away exactly as fast as the stage is sent
//! after it. A wrong sign makes `p = target + 2 s`; gain, rotation, swapped axes, and time stamps
//! act in the same way.
//!
//! # Suspicion and trial
//! A stage that follows well moves as the target does, `s = p` and `e = 0`. In closed loop, a
//! coupling of `p` to `s` cannot be separated from following, because both explain the same
//! figures. So there are two stages:
//!
//! 1. *Suspicion*, cheap and often wrong: the stage moves towards a target that comes no nearer; or
//!    the loop shakes, and `p` moves as much as `s`; or other time stamps would explain what `p`
//!    does; or frames are refused as outliers while the stage moves on.
//! 2. *Trial*: the stage is ramped down and stands for 0.1 to 0.3 s. A target that moves by itself
//!    goes on; one that the stage moves stops with it. Two trials that agree make the fault, or one
//!    that leaves no doubt, or one that shows the cause. Then following goes on.
//!
//! After a trial that finds a target that moves by itself, the next one waits for half a second,
//! then for 1, 2, 4 and 8 s. A suspicion of lost steps is pardoned up to three times if the error
//! answered the stage's own acceleration a moment before.
//!
//! # Work
//! What a frame's tick must decide is done there ([`Watch::see`]). The sums that show the cause
//! cost more than that tick can spare, so the ticks after it do them, a share each
//! ([`Watch::work`]).
//!
//! # Figures
//! `cargo test -p trinocular-tests --test lives -- --ignored --nocapture` follows random targets
//! with a healthy stage at 5 to 1000 frames per second (gaps, occlusions, exponential intervals,
//! targets out of the stage's reach, backlash, a mount off by 20 % and 8 degrees): 0 false alarms
//! in 10,000 lives, so fewer than 3 in 10,000 with 95 % confidence. A trial stops such a stage once
//! in three lives; at 60 frames per second after a target within reach, hardly ever.
//!
//! A stall after a target at rest or on a figure becomes a fault, with the stage at rest, within 26
//! mm of the stall at 20 frames per second and more (`tests/stalling.rs`), with a bound of 10 mm.
//! A target that reverses every 0.6 s moves on during the trials: then at least 44 of 48 stalls are
//! found in 5 s, half of them within 25 mm and all within 80 mm.
//! With 5 or 10 frames per second and a target that turns within a few frames, no trial is long
//! enough: such a stall is found late or not at all. If a tenth or more of the steps still arrive,
//! they bring the target nearer; they look like a mount of another scale, and the stage follows.
//!
//! Wrong signs, swapped axes, rotations from 90 degrees and scales from 2 are named within 2.2 s of
//! the first motion and 27 mm, rotations of 60 degrees and stamps off by 30 to 70 ms within 4 s,
//! while they shake by less than a few mm (`tests/unstable.rs`).
//!
//! # Following error
//! `|e|` beyond a bound in every frame for longer than a time is a fault of its own.

mod cause;
mod conclusion;
mod evidence;
mod late;
mod shaking;
mod trial;
mod unseen;
mod window;

use super::StepVector;
use super::filter::steps;
use super::history::History;
use crate::safety::Fault;
use crate::time::Instant;
use cause::Question;
use evidence::Evidence;
use shaking::Shaking;
use trial::{Suspicion, Trial, Verdict};
use unseen::{Unseen, is_near};
use window::{Spread, Window, milliseconds};

/// Shortest time between two frames that the watch uses, µs. Within it, only the noise changes.
const LEAST_US: u64 = 12_000;

/// Number of mean periods without a frame after which the watch begins anew.
const GAP: f32 = 2.5;

/// Shortest window: frames (`WINDOW_FRAMES`), and time in ms (`WINDOW_MS`).
const WINDOW_FRAMES: f32 = 7.5;
const WINDOW_MS: f32 = 145.0;

/// Part of [`Bounds::unseen`] that is a large motion, as a standard deviation.
const LARGE: f32 = 0.1;

/// Number of halvings of [`Bounds::unseen`] for the distance that the stage may go without
/// approach: before the first trial (`FIRST`), and after one that counts (`AGAIN`).
const FIRST: u32 = 1;
const AGAIN: u32 = 2;

/// Divisor of [`Bounds::unseen`] for the distance that the stage may go astray.
const ASTRAY: i64 = 4;

/// Longest series of pardons.
const PARDONS: u8 = 3;

/// Time for which a trial counts: in ms (`COUNTS_MS`), and in frames (`COUNTS_FRAMES`).
const COUNTS_MS: f32 = 4_000.0;
const COUNTS_FRAMES: f32 = 20.0;

/// Bounds of the watch, 2⁻³² steps; zero disables a bound.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bounds {
    /// Largest motion towards the target that does not bring it nearer.
    pub unseen: StepVector,
    /// Largest distance of the target.
    pub error: StepVector,
    /// Longest time above that distance, µs.
    pub longest_us: u64,
}

/// Data of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Capture time.
    pub capture: Instant,
    /// Position of the stage at the capture, 2⁻³² steps.
    pub stage: StepVector,
    /// Target minus stage, 2⁻³² steps.
    pub error: StepVector,
    /// Variance of the error, steps².
    pub variance: [f32; 3],
}

/// Advice for the machine after a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Advice {
    /// Go on. The stage follows unless [`Watch::holds`].
    GoOn,
    /// Ramp down: a trial begins.
    Stop,
    /// Latch the fault.
    Fail(Fault),
}

/// Trials that found the loop coupled.
#[derive(Clone, Copy, Debug)]
struct Case {
    points: u8,
    /// Instant of the last of these trials.
    at: Instant,
    /// True if that trial was for a loop that shakes.
    shook: bool,
    /// True if an axis's steps had no effect.
    lost: bool,
}

/// State of the watch.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    /// Last frame that the watch used.
    last: Option<Sample>,
    /// Mean time between used frames, ms.
    period_ms: f32,
    window: Window,
    evidence: Evidence,
    unseen: [Unseen; 3],
    shaking: Shaking,
    /// Number of refused frames in succession.
    refused: u32,
    /// Distance that the stage went astray.
    astray: StepVector,
    pardons: u8,
    trial: Option<Trial>,
    /// Verdict of a trial that waits for the cause.
    verdict: Option<Verdict>,
    case: Option<Case>,
    /// Instant before which no trial begins.
    quiet_until: Instant,
    /// Number of trials in succession that found a target that moves by itself.
    free: u32,
    /// Instant since which the target is too far away.
    far: Option<Instant>,
}

impl Watch {
    /// Returns true if the stage must stand because of a trial.
    pub fn holds(&self) -> bool {
        self.trial.is_some()
    }

    /// Does a tick's share of the work for which a frame's tick has no time. `history` tells where
    /// the stage was if the stamps are wrong.
    pub fn work(&mut self, history: &History) -> Advice {
        match self.evidence.work(history) {
            Some(answer) => self.hear(answer),
            None => Advice::GoOn,
        }
    }

    /// Takes in a frame. `used` is false for one that was refused as an outlier.
    pub fn see(&mut self, sample: &Sample, used: bool, bounds: &Bounds) -> Advice {
        if used && self.is_far(sample, bounds) {
            return Advice::Fail(Fault::FollowingError);
        }
        self.refused = if used {
            0
        } else {
            self.refused.saturating_add(1)
        };
        // A single outlier is a wrong frame.
        if bounds.unseen.iter().all(|bound| *bound == 0) || self.refused == 1 {
            return Advice::GoOn;
        }
        let since = match &self.last {
            Some(last) => sample.capture.since(last.capture),
            None => u64::MAX,
        };
        if since < LEAST_US {
            return Advice::GoOn;
        }
        let Some(last) = self.last.replace(*sample) else {
            self.begin_anew(sample);
            return Advice::GoOn;
        };
        let ms = milliseconds(since);
        let known = self.period_ms > 0.0;
        let gap = known && ms > GAP * self.period_ms;
        self.period_ms += (ms - self.period_ms) * if known { 0.1 } else { 1.0 };
        let counts_ms = COUNTS_MS + COUNTS_FRAMES * self.period_ms;
        self.case = self
            .case
            .filter(|case| milliseconds(sample.capture.since(case.at)) <= counts_ms);
        match self.trial {
            Some(trial) => self.try_on(trial, [&last, sample], bounds),
            None if gap => {
                self.begin_anew(sample);
                Advice::GoOn
            }
            None => self.suspect([&last, sample], bounds),
        }
    }

    /// Clears the state that leads to a suspicion.
    fn begin_anew(&mut self, sample: &Sample) {
        self.window = Window::starting(sample);
        self.evidence = Evidence::starting(sample);
        self.unseen = [Unseen::default(); 3];
        self.shaking = Shaking::default();
        self.astray = [0; 3];
    }

    /// Looks for a reason to stop the stage.
    fn suspect(&mut self, [last, sample]: [&Sample; 2], bounds: &Bounds) -> Advice {
        self.window.add(sample);
        self.evidence.add(sample);
        let full = self.window.frames() > WINDOW_FRAMES && self.window.span_ms > WINDOW_MS;
        let mut astray = self.is_astray([last, sample], bounds);
        let unseen = self.unseen([last, sample], bounds);
        if !full && unseen == [false; 3] && !astray {
            return Advice::GoOn;
        }
        let spreads = self.window.spreads();
        astray |= !self.pardon(unseen, &spreads);
        let mut shakes = false;
        if full {
            let large = large(bounds);
            let again = self.case.is_some();
            shakes = self.shaking.see(spreads, sample.variance, large, again);
            if !self.shaking.is_active() {
                self.pardons = 0;
            }
            self.window = Window::starting(sample);
            self.evidence.ask(Question::Moving);
        }
        let suspicion = match (astray, shakes) {
            (true, _) => Suspicion::Astray,
            (false, true) => Suspicion::Shaking,
            (false, false) => return Advice::GoOn,
        };
        self.stop_for(suspicion, sample.capture)
    }

    /// Begins a trial, unless it is too early for the next one.
    fn stop_for(&mut self, suspicion: Suspicion, at: Instant) -> Advice {
        if at < self.quiet_until {
            self.unseen = [Unseen::default(); 3];
            return Advice::GoOn;
        }
        self.trial = Some(Trial::new(suspicion));
        Advice::Stop
    }

    /// Returns true if the stage went too far while frames were refused, or went away from the
    /// target with steps that one trial found lost.
    fn is_astray(&mut self, [last, sample]: [&Sample; 2], bounds: &Bounds) -> bool {
        let lost = self.case.is_some_and(|case| case.lost);
        let mut astray = false;
        let axes = self.astray.iter_mut().zip(bounds.unseen);
        let ways = sample.stage.iter().zip(&last.stage).zip(&sample.error);
        for ((sum, bound), ((now, before), error)) in axes.zip(ways) {
            let counts = self.refused > 0 || lost && !is_near(*error, bound);
            let way = now.saturating_sub(*before).saturating_abs();
            *sum = if counts { sum.saturating_add(way) } else { 0 };
            astray |= bound > 0 && *sum > bound / ASTRAY;
        }
        astray
    }

    /// Returns true for each axis on which the target comes no nearer.
    fn unseen(&mut self, [last, sample]: [&Sample; 2], bounds: &Bounds) -> [bool; 3] {
        let halvings = match self.case {
            Some(Case { shook: false, .. }) => AGAIN,
            _ => FIRST,
        };
        let mut suspicious = [false; 3];
        let ways = sample.stage.iter().zip(&last.stage).zip(&sample.error);
        let axes = self
            .unseen
            .iter_mut()
            .zip(bounds.unseen)
            .zip(&mut suspicious);
        for (((axis, bound), suspicious), ((now, before), error)) in axes.zip(ways) {
            let way = now.saturating_sub(*before);
            *suspicious = axis.see(way, *error, bound, bound >> halvings);
        }
        suspicious
    }

    /// Returns true if all suspicious axes are pardoned, because the cameras saw the stage's
    /// acceleration there.
    fn pardon(&mut self, suspicious: [bool; 3], spreads: &[Spread; 3]) -> bool {
        let seen = |spread: &Spread| spread.stage > 4.0 && spread.target < 0.1 * spread.stage;
        let before = self.shaking.before.unwrap_or_default();
        let mut all = true;
        let axes = self.unseen.iter_mut().zip(suspicious);
        for ((axis, suspicious), (now, before)) in axes.zip(spreads.iter().zip(&before)) {
            if suspicious && self.pardons < PARDONS && (seen(now) || seen(before)) {
                self.pardons += 1;
                *axis = Unseen::default();
            } else {
                all &= !suspicious;
            }
        }
        all
    }

    /// Returns true if the target has been too far away for too long.
    fn is_far(&mut self, sample: &Sample, bounds: &Bounds) -> bool {
        let beyond = |(error, bound): (i64, i64)| bound > 0 && error.saturating_abs() > bound;
        if !sample.error.into_iter().zip(bounds.error).any(beyond) {
            self.far = None;
            return false;
        }
        let since = *self.far.get_or_insert(sample.capture);
        sample.capture.since(since) > bounds.longest_us
    }
}

/// Returns the energy of a large motion, steps².
fn large(bounds: &Bounds) -> f32 {
    let bounds = bounds.unseen.into_iter().filter(|bound| *bound > 0);
    let deviation = steps(bounds.min().unwrap_or(0)) * LARGE;
    deviation * deviation
}

#[cfg(test)]
mod tests;
