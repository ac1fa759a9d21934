//! A trial: the stage is stopped for a moment, to test whether the apparent target stops with it.
//!
//! The stop is the station's own choice, so it is independent of the target. That makes the
//! question decidable, which it is not in the running loop: a target that the stage follows moves
//! as the stage does, too. The verdict compares the apparent target's variance about a parabola
//! while the stage moves, `m`, with that over an equal time while it stands, `r`:
//!
//! * *Free*: the target moves on, `r > m/25`. The stage did not cause the suspicious motion.
//! * *Coupled*: the target rests, `r < m/25`, and while the stage moved it made at least 74 % of
//!   the stage's energy (see [`shaking`](super::shaking)). The loop feeds itself.
//! * *Lost*: on an axis the ramp does not show in the error. Its steps do not move the cameras.
//! * *Calm*: the target rests, and did not move much with the stage either.
//!
//! A target may come to rest with the stage by coincidence. So a verdict is a matter of points: 6
//! make the fault, and the points of a trial depend on the probability of the coincidence.

use super::super::filter::{with_quantisation, within};
use super::Sample;
use super::window::{Energy, Spread, Window};
use crate::time::Instant;

/// Time after the standstill that does not count, µs: late stamps, exposure, and a stage that
/// swings.
const SETTLE_US: u64 = 70_000;

/// Least number of frames for which the stage stands.
const FRAMES: f32 = 4.5;

/// Time for which the stage stands, ms: the time for which it was seen to move, within these
/// limits.
const LEAST_MS: f32 = 90.0;
const MOST_MS: f32 = 300.0;

/// Share of the moving variance below which a target rests.
const RESTS: f32 = 1.0 / 25.0;

/// Longest window, ms, in which the share explained by the stage's motion counts. In a longer one,
/// of fewer than some 25 frames per second, a target moves too much by itself.
const BRIEF_MS: f32 = 450.0;

/// Number of points that make a fault.
pub(super) const ENOUGH: u8 = 6;

/// Reason for stopping the stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Suspicion {
    /// The loop shakes.
    Shaking,
    /// The stage moves towards the target, which comes no nearer, or moves while frames are
    /// refused.
    Astray,
}

/// Verdict of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// The trial is not over yet.
    Wait,
    /// The target moves by itself.
    Free,
    /// The target rests, and the stage did not move it.
    Calm,
    /// The stage moves the target.
    Coupled {
        /// Points towards a fault.
        points: u8,
        /// The steps of an axis have no effect.
        lost: bool,
    },
}

/// Observations while the stage moved.
#[derive(Clone, Copy, Debug)]
struct Moving {
    /// Variances of the window that was suspicious.
    spreads: [Spread; 3],
    /// Variances of the window with the ramp.
    ramp: [Spread; 3],
    /// Share of the apparent target's motion that the stage's explains, in the window with the
    /// ramp.
    explained: f32,
    /// Time for which the stage has to stand, ms.
    rest_ms: f32,
}

/// State of a trial: a stage that is stopped.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trial {
    suspicion: Suspicion,
    /// Instant since which the stage stands.
    stands: Option<Instant>,
    moving: Option<Moving>,
}

impl Trial {
    pub fn new(suspicion: Suspicion) -> Self {
        Self {
            suspicion,
            stands: None,
            moving: None,
        }
    }

    /// Returns true if the loop was stopped because it shakes.
    pub fn is_for_shaking(&self) -> bool {
        self.suspicion == Suspicion::Shaking
    }

    /// Takes in a frame, `last` being the one before. `window` goes on from before the trial, and
    /// `before` are the variances of the last whole window. `large` is the energy of a large
    /// motion.
    pub fn see(
        &mut self,
        [last, sample]: [&Sample; 2],
        window: &mut Window,
        before: Option<[Spread; 3]>,
        large: f32,
    ) -> Verdict {
        if self.stands.is_none() && sample.stage == last.stage {
            self.stands = Some(last.capture);
        }
        let settled = |since: Instant| sample.capture.since(since) >= SETTLE_US;
        let moving = match self.moving {
            Some(moving) => moving,
            None => {
                window.add(sample);
                if !self.stands.is_some_and(settled) {
                    return Verdict::Wait;
                }
                let ramp = window.spreads();
                let (spreads, ms) = match before {
                    Some(before) if self.is_for_shaking() => (before, super::WINDOW_MS),
                    _ => (ramp, window.span_ms),
                };
                let moving = Moving {
                    spreads,
                    ramp,
                    explained: match window.span_ms < BRIEF_MS {
                        true => window.covariances().map_or(0.0, |found| found.explained()),
                        false => 0.0,
                    },
                    rest_ms: 0.9 * within(ms, LEAST_MS, MOST_MS),
                };
                self.moving = Some(moving);
                *window = Window::default();
                moving
            }
        };
        window.add(sample);
        if !(window.frames() > FRAMES && window.span_ms > moving.rest_ms) {
            return Verdict::Wait;
        }
        self.judge(&moving, &window.spreads(), sample.variance, large)
    }

    fn judge(
        &self,
        moving: &Moving,
        rest: &[Spread; 3],
        variance: [f32; 3],
        large: f32,
    ) -> Verdict {
        let energy = Energy::new(&moving.spreads, variance);
        // Sum over the axes on which the apparent target moved.
        let (mut moved, mut rested, mut noise) = (0.0, 0.0, 0.0);
        for ((m, r), variance) in moving.spreads.iter().zip(rest).zip(variance) {
            let variance = with_quantisation(variance);
            if m.target > 8.0 * variance && m.target > energy.stage / 16.0 {
                moved += m.target;
                rested += r.target;
                noise += variance;
            }
        }
        let rests = moved > 0.0 && (rested < moved * RESTS || rested < 3.0 * noise);
        let goes_on = moved > 0.0 && !rests;
        let shaking = self.is_for_shaking();
        let lost = match shaking {
            true => None,
            false => lost(&moving.ramp, rest, variance),
        };
        let (lost, sure) = (lost.is_some(), lost == Some(true));
        let feeds = shaking
            || energy.stage > 9.0
                && energy.target > 0.74 * energy.stage
                && energy.error > 0.04 * energy.stage;
        match (lost || rests && feeds, goes_on) {
            (true, _) => {
                let strong = match shaking {
                    true => 16.0 * energy.stage > large,
                    false => lost || moving.explained > 0.97,
                };
                // The target moved twice as much as the stage, as explained by it, and then rested.
                let alone = 400.0 * Energy::new(rest, variance).target < energy.target;
                let runs = moving.explained > 0.995 && energy.target > 1.8 * energy.stage;
                let points = match (sure || !shaking && runs && alone, strong) {
                    (true, _) => ENOUGH,
                    (false, true) => 3,
                    (false, false) => 2,
                };
                Verdict::Coupled { points, lost }
            }
            (false, true) => Verdict::Free,
            (false, false) => Verdict::Calm,
        }
    }
}

/// Returns `None` unless an axis that moved most has no effect on the error and no other axis is
/// coupled. Otherwise returns true if one trial is enough.
///
/// The share of the stage's motion that the error shows is `-cov(e, s)/var(s)`: 1 for a right
/// mount, 0 for a stall. Below 0.05, or as near to it as the target's own motion allows, the axis
/// is lost. A mount that shows a tenth of the motion is not. No target comes to rest exactly as the
/// stage does, so an error that is steady to a fourteenth of a long ramp is enough.
fn lost(ramp: &[Spread; 3], rest: &[Spread; 3], variance: [f32; 3]) -> Option<bool> {
    let [x, y, z] = ramp;
    let all = x.stage + y.stage + z.stage;
    let (mut lost, mut others) = (None, false);
    for ((m, r), variance) in ramp.iter().zip(rest).zip(variance) {
        let noise = with_quantisation(variance);
        let seen = 0.5 * (m.stage + m.error - m.target) - 0.05 * m.stage;
        let moved = m.stage > 16.0 + 8.0 * noise && m.stage > 0.25 * all;
        let alike = m.target > 0.5 * m.stage && m.target < 2.0 * m.stage;
        let steady = m.error < m.stage / 16.0;
        let unseen = seen < 0.0 || seen * seen < 0.3 * r.target * m.stage;
        if moved && alike && steady && unseen {
            let long = m.stage > 400.0 && m.stage > 100.0 * noise;
            let sure = long && m.error < m.stage / 200.0 + 2.0 * noise;
            lost = Some(sure || lost == Some(true));
        } else {
            others |= m.target > all / 16.0 && r.target < m.target * RESTS;
        }
    }
    lost.filter(|_| !others)
}
