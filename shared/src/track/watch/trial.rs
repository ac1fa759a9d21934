//! A trial: the stage is stopped for a moment, to see whether the apparent target stops with it.
//!
//! The stop is the station's own choice, so it has nothing to do with what the target does. That
//! makes the question decidable which no watching of the running loop decides: a target that the
//! stage follows moves as the stage does, too. With the apparent target's variance about a parabola
//! while the stage moves, `m`, and over an equal time while it stands, `r`:
//!
//! * *Free*: the target moves on, `r > m/25`. Whatever was suspicious, the stage did not cause it.
//! * *Coupled*: the target rests, `r < m/25`, and while the stage moved it made at least 74 % of
//!   the stage's energy (see [`shaking`](super::shaking)). The loop feeds itself.
//! * *Lost*: on an axis the ramp does not show in the error. Its steps do not move the cameras.
//! * *Calm*: the target rests, and did not move much with the stage either.
//!
//! A target may happen to come to rest when the stage does. So a verdict is a matter of points: 6
//! make the fault, and what a trial is worth depends on how probable the coincidence is.

use super::super::filter::{believed, within};
use super::Sample;
use super::window::{Energy, Spread, Window};
use crate::time::Instant;

/// Time after the standstill that does not count, µs: late stamps, exposure, a stage that swings.
const SETTLE_US: u64 = 70_000;

/// Frames that the stage stands for at least.
const FRAMES: f32 = 4.5;

/// Time that the stage stands for, ms: as long as it was seen to move, within these.
const LEAST_MS: f32 = 90.0;
const MOST_MS: f32 = 300.0;

/// Times the moving variance below which a target rests.
const RESTS: f32 = 1.0 / 25.0;

/// Longest window of which it counts how much the stage's motion explains, ms. In a longer one, of
/// fewer than some 25 frames per second, a target does too much by itself.
const BRIEF_MS: f32 = 450.0;

/// Points of a fault.
pub(super) const ENOUGH: u8 = 6;

/// Why the stage is stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Suspicion {
    /// The loop shakes.
    Shaking,
    /// It moves towards the target, which comes no nearer, or moves while frames are refused.
    Astray,
}

/// What a trial showed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It is not over yet.
    Wait,
    /// The target moves by itself.
    Free,
    /// The target rests, and the stage did not move it.
    Calm,
    /// The stage moves the target.
    Coupled {
        /// What this is worth.
        points: u8,
        /// The steps of an axis have no effect.
        lost: bool,
    },
}

/// What was seen while the stage moved.
#[derive(Clone, Copy, Debug)]
struct Moving {
    /// The window that was suspicious.
    spreads: [Spread; 3],
    /// The window with the ramp.
    ramp: [Spread; 3],
    /// The share of the apparent target's motion that the stage's explains, in the latter.
    explained: f32,
    /// How long the stage has to stand, ms.
    rest_ms: f32,
}

/// A stage that is stopped.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trial {
    suspicion: Suspicion,
    /// Since when it stands.
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

    /// Whether the loop was stopped because it shakes.
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
                        true => window.explained(),
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
        let (mut rests, mut goes_on) = (false, false);
        for ((m, r), variance) in moving.spreads.iter().zip(rest).zip(variance) {
            let noise = believed(variance);
            if m.target > 8.0 * noise && m.target > energy.stage / 16.0 {
                let calm = r.target < m.target * RESTS || r.target < 3.0 * noise;
                rests |= calm;
                goes_on |= !calm;
            }
        }
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
        match (lost || rests && !goes_on && feeds, goes_on) {
            (true, _) => {
                let strong = match shaking {
                    true => 16.0 * energy.stage > large,
                    false => lost || moving.explained > 0.97,
                };
                // Twice as much as the stage, all of it explained, and then nothing.
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

/// Whether an axis that moved most has no effect on the error, and no other axis is coupled; and if
/// so, whether one trial is enough.
///
/// The share of the stage's motion that the error shows is `-cov(e, s)/var(s)`: 1 for a right
/// mount, 0 for a stall. Below 0.05, or as near to it as the target's own motion allows, it is
/// lost. A mount that sees a tenth of the motion is not. No target comes to rest exactly as the
/// stage does, so an error that is steady to a fourteenth of a long ramp is enough.
fn lost(ramp: &[Spread; 3], rest: &[Spread; 3], variance: [f32; 3]) -> Option<bool> {
    let [x, y, z] = ramp;
    let all = x.stage + y.stage + z.stage;
    let (mut lost, mut others) = (None, false);
    for ((m, r), variance) in ramp.iter().zip(rest).zip(variance) {
        let noise = believed(variance);
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
