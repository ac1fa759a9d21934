//! The restart after a trial that found the loop coupled: a second experiment of the station's own
//! choice.
//!
//! The motion of the target while the stage stood is known: a line. If the stage is healthy, the
//! target does not leave it when the stage starts; if the loop is coupled, it leaves it at that
//! moment. The largest squared way of the target from its line, over the largest squared way of the
//! stage, is the square of the mount's error: 0.04 for one that is off by 20 %, 0.74 and more for a
//! loop that feeds itself (see [`shaking`](super::shaking)).
//!
//! Until that is decided the stage stays near the place where it stood, so that a loop that runs
//! away does not run again.

use super::super::StepVector;
use super::super::filter::{with_quantisation, within};
use super::Sample;
use super::shaking::MOST;
use super::window::{Window, from, milliseconds};
use crate::time::Instant;

/// Number of frames with motion: before a decision (`FEWEST`), before the decision that the loop is
/// healthy (`FRAMES`), and before it is given up (`MOST_FRAMES`).
const FEWEST: u32 = 3;
const FRAMES: u32 = 5;
const MOST_FRAMES: u32 = 40;

/// Least time in which the stage moves, ms.
const LEAST_MS: f32 = 60.0;

/// Share of the stage's squared way above which the target's shows a coupled loop.
const COUPLED: f32 = 0.5;

/// Squared way of the stage above which it is seen: over the noise's, and in steps².
const CLEAR: f32 = 4.0;
const LEAST: f32 = 64.0;

/// Squares of the deviations that a measurement (`NOISE`) and a target that stands (`STANDS`) may
/// have.
const NOISE: f32 = 9.0;
const STANDS: f32 = 25.0;

/// Share of the stage's squared way with which an axis is judged alone.
const ALONE: f32 = 0.25;

/// Result of a restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// The target goes on as before.
    Healthy,
    /// The target moves with the stage, or by itself.
    Open,
    /// A target that stood moves with the stage.
    Coupled,
}

/// State since the end of a trial.
#[derive(Clone, Copy, Debug)]
pub(super) struct Restart {
    /// Instant of the last frame at which the stage stood.
    at: Instant,
    /// Position of the stage then.
    pub stage: StepVector,
    error: StepVector,
    /// True if the target stood.
    still: bool,
    /// Motion of the target while the stage stood, per axis: the difference of its line from
    /// `error` at `at`, steps, and its slope, steps/ms.
    line: [[f32; 2]; 3],
    /// Largest squared ways of the stage (`moved`) and of the apparent target from its line
    /// (`seen`) on each axis, steps².
    moved: [f32; 3],
    seen: [f32; 3],
    /// Variance of the target while the stage stood, steps².
    wander: [f32; 3],
    /// Instant of the first frame with motion.
    began: Option<Instant>,
    frames: u32,
}

impl Restart {
    /// Starts at the last frame of a trial, with the window of frames for which the stage stood.
    /// `still` is true if the target stood, too.
    pub fn new(sample: &Sample, window: &Window, still: bool) -> Self {
        Self {
            at: sample.capture,
            stage: sample.stage,
            error: sample.error,
            still,
            line: window.line(sample, still),
            wander: window.wander(),
            moved: [0.0; 3],
            seen: [0.0; 3],
            began: None,
            frames: 0,
        }
    }

    /// Takes in a frame. Returns `None` while there is not enough motion.
    pub fn see(&mut self, sample: &Sample) -> Option<Outcome> {
        let s = from(sample.stage, self.stage);
        if self.began.is_none() && s == [0.0; 3] {
            return None;
        }
        let began = *self.began.get_or_insert(sample.capture);
        self.frames = self.frames.saturating_add(1);
        let ms = milliseconds(sample.capture.since(self.at));
        let e = from(sample.error, self.error);
        let ways = self.moved.iter_mut().zip(&mut self.seen);
        for ((moved, seen), ((s, e), [offset, slope])) in
            ways.zip(s.into_iter().zip(e).zip(self.line))
        {
            let p = s + e - offset - slope * ms;
            *moved = within(*moved, s * s, f32::MAX);
            *seen = within(*seen, p * p, f32::MAX);
        }
        let lasted = milliseconds(sample.capture.since(began));
        if self.frames < FEWEST {
            return None;
        }
        let [x, y, z] = self.moved;
        let all = x + y + z;
        let (mut seen, mut noise, mut wandered) = (0.0, 0.0, 0.0);
        let (mut one, mut sure) = (false, false);
        let axes = self.moved.into_iter().zip(self.seen);
        for ((m, p), (variance, wander)) in axes.zip(sample.variance.into_iter().zip(self.wander)) {
            let (n, w) = (NOISE * with_quantisation(variance), STANDS * wander);
            one |= m > ALONE * all && p - n > COUPLED * m;
            // A target that stood but for a little must go far beyond that.
            sure |= m > ALONE * all && p - n - w > COUPLED * m;
            seen += p;
            noise += n;
            wandered += w;
        }
        if all < LEAST + CLEAR * noise {
            return (self.frames >= MOST_FRAMES).then_some(Outcome::Healthy);
        }
        if (one || seen - noise > COUPLED * all) && seen < MOST * all {
            let sure = sure || seen - noise - wandered > COUPLED * all;
            return Some(match self.still && sure {
                true => Outcome::Coupled,
                false => Outcome::Open,
            });
        }
        let over = self.frames >= FRAMES && lasted >= LEAST_MS;
        over.then_some(Outcome::Healthy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: i64 = 1 << 32;

    /// Frame number `k` at 60 per second, with positions on the y axis in steps.
    fn sample(k: u64, stage: i64, error: i64) -> Sample {
        Sample {
            capture: Instant::from_micros(16_667 * k),
            stage: [0, stage * STEP, 0],
            error: [0, error * STEP, 0],
            variance: [0.1; 3],
        }
    }

    /// Restarts a stage that stood for ten frames and then moves by 8, 16, 24 .. steps a frame.
    /// `seen` is the place of the apparent target at a frame, for a stage at a position, steps.
    /// Returns the outcome and the number of frames that it took.
    fn restarted(still: bool, seen: impl Fn(i64, i64) -> i64) -> Option<(Outcome, u64)> {
        let standing = |k: u64| sample(k, 0, seen(k as i64, 0));
        let mut window = Window::starting(&standing(0));
        (1..10).for_each(|k| window.add(&standing(k)));
        let mut restart = Restart::new(&standing(9), &window, still);
        (1..100).find_map(|n: u64| {
            let (k, stage) = (9 + n, 4 * (n * (n + 1)) as i64);
            let frame = sample(k, stage, seen(k as i64, stage) - stage);
            restart.see(&frame).map(|outcome| (outcome, n))
        })
    }

    #[test]
    fn target_on_its_line_is_healthy() {
        for still in [false, true] {
            let (outcome, _) = restarted(still, |_, _| 300).expect("an outcome");
            assert_eq!(outcome, Outcome::Healthy, "still: {still}");
        }
        let moving = restarted(false, |k, _| 300 - 25 * k);
        assert_eq!(moving.map(|(outcome, _)| outcome), Some(Outcome::Healthy));
        // A mount that is off by 20 %.
        let off = restarted(true, |_, stage| 300 + stage / 5);
        assert_eq!(off.map(|(outcome, _)| outcome), Some(Outcome::Healthy));
    }

    #[test]
    fn target_that_starts_with_stage_is_coupled() {
        // A wrong sign, a scale of 2 and more, and a stage that does not arrive.
        for seen in [
            |_: i64, stage: i64| 300 + 2 * stage,
            |_, stage| 300 - stage,
            |_, stage| 300 + stage,
        ] {
            let (outcome, frames) = restarted(true, seen).expect("an outcome");
            assert_eq!(outcome, Outcome::Coupled);
            assert!(frames <= 12, "{frames}");
        }
    }

    #[test]
    fn moving_target_that_starts_with_stage_is_open() {
        let seen = restarted(false, |k, stage| 25 * k + 2 * stage);
        assert_eq!(seen.map(|(outcome, _)| outcome), Some(Outcome::Open));
    }

    #[test]
    fn stage_at_rest_decides_nothing() {
        let standing = |k: u64| sample(k, 0, 300);
        let mut restart = Restart::new(&standing(0), &Window::starting(&standing(0)), true);
        assert!((1..200).all(|k| restart.see(&standing(k)).is_none()));
    }

    #[test]
    fn extreme_frames_do_not_overflow() {
        let far = |k: u64, sign: i64| Sample {
            capture: Instant::from_micros(16_667 * k),
            stage: [sign * (i64::MAX / 4); 3],
            error: [sign * (i64::MAX / 4); 3],
            variance: [f32::MAX; 3],
        };
        let mut window = Window::starting(&far(0, 1));
        window.add(&far(1, -1));
        let mut restart = Restart::new(&far(1, -1), &window, true);
        for k in 2..100 {
            let _ = restart.see(&far(k, if k % 2 == 0 { 1 } else { -1 }));
        }
    }
}
