//! The cameras as an encoder: is the target where the stage's own steps say, and does the stage's motion bring it nearer?
//!
//! The cameras ride on the stage, so `e = target - stage` is what they see. Two things are watched, each on every axis:
//!
//! * *Following error:* `|e|` beyond a bound in every frame for longer than a time.
//! * *Unseen motion:* the stage went towards the target, by its steps, and `e` is as large as before. A motor that stalls, is off, or turns the wrong
//!   way makes the target run away exactly as fast as the stage is sent after it: a target that nobody can reach.
//!
//! # Unseen motion
//! Counted is the way `m` towards the target, together with the largest and the smallest `|e|` since the count began. The count begins anew
//! whenever `|e|` has become smaller by `m/4`, when the target is on the other side, or when it is near: within an eighth of the bound.
//! So a target at rest that the stage really moves to never counts.
//!
//! A target in motion is followed without coming nearer, too; but from near by, and if it speeds up or turns from a distance that changes. So a count
//! beyond the bound is a fault only if `|e|` changed by less than `m/10`, as it does before a stage that stands still, or if it grew beyond
//! half the bound.
//!
//! A stall is noticed when the stage was sent the bound's length in vain, if the target is not near by then. With prediction switched off the
//! stage follows from a distance that is steady; then nothing is counted.

use super::Fine;
use crate::safety::Fault;
use crate::time::Instant;

/// A target that comes nearer by this part of the way is seen to come nearer.
const SHARE: i64 = 4;

/// Nearer than this part of the bound, a target that does not come nearer is followed well.
const FLOOR: u64 = 8;

/// A distance that changes by less than this part of the way is steady.
const STEADY: i64 = 10;

/// Farther than this part of the bound is too far for a target that is followed.
const GROWN: i64 = 2;

/// What is too much. 2⁻³² steps; zero is never.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bounds {
    /// Largest way towards the target that the cameras need not see.
    pub unseen: Fine,
    /// Largest distance of the target ...
    pub error: Fine,
    /// ... for how long, µs.
    pub longest_us: u64,
}

/// One axis since its count began.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    /// The target's distance: the largest since, with its sign.
    farthest: i64,
    /// The smallest, without.
    nearest: i64,
    /// The way towards the target.
    way: i64,
}

impl Axis {
    /// The stage moved by `way`, and now the target is `error` away. Too far in vain?
    fn see(&mut self, way: i64, error: i64, bound: i64) -> bool {
        let side = error.signum();
        let distance = error.saturating_abs();
        let near = distance.unsigned_abs() < bound.unsigned_abs() / FLOOR;
        let moved = way.saturating_mul(side).saturating_add(self.way).max(0);
        let nearer = self.farthest.saturating_abs().saturating_sub(distance);
        if near || side != self.farthest.signum() || nearer > moved / SHARE {
            *self = Self {
                farthest: error,
                nearest: distance,
                way: 0,
            };
            return false;
        }
        let farthest = self.farthest.saturating_abs().max(distance);
        *self = Self {
            farthest: farthest * side,
            nearest: self.nearest.min(distance),
            way: moved,
        };
        let steady = farthest.saturating_sub(self.nearest) < moved / STEADY;
        bound > 0 && moved > bound && (steady || farthest > bound / GROWN)
    }
}

/// What was seen so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Watch {
    axes: [Axis; 3],
    /// Where the stage was at the last capture.
    stage: Option<Fine>,
    /// Since when the target is too far away.
    far: Option<Instant>,
}

impl Watch {
    /// A frame that was used: where the stage was at the capture, and how far from there the target.
    ///
    /// # Errors
    /// The fault, if there is one.
    pub fn see(
        &mut self,
        capture: Instant,
        stage: Fine,
        error: Fine,
        bounds: &Bounds,
    ) -> Result<(), Fault> {
        let before = self.stage.replace(stage).unwrap_or(stage);
        let mut unseen = false;
        let axes = self.axes.iter_mut().zip(error).zip(bounds.unseen);
        for (((axis, error), bound), (now, before)) in axes.zip(stage.into_iter().zip(before)) {
            unseen |= axis.see(now.saturating_sub(before), error, bound);
        }
        if unseen {
            return Err(Fault::LostSteps);
        }
        let beyond = |(error, bound): (i64, i64)| bound > 0 && error.saturating_abs() > bound;
        if !error.into_iter().zip(bounds.error).any(beyond) {
            self.far = None;
            return Ok(());
        }
        let since = *self.far.get_or_insert(capture);
        match capture.since(since) > bounds.longest_us {
            true => Err(Fault::FollowingError),
            false => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: i64 = 1 << 32;

    fn bounds() -> Bounds {
        Bounds {
            unseen: [800 * STEP; 3],
            error: [1_600 * STEP; 3],
            longest_us: 500_000,
        }
    }

    /// Frames every 20 ms; gives the frame of the fault.
    fn faults(frames: u64, seen: impl Fn(i64) -> (i64, i64)) -> Option<(u64, Fault)> {
        let mut watch = Watch::default();
        (0..frames).find_map(|k| {
            let (stage, error) = seen(k as i64);
            let capture = Instant::from_micros(20_000 * k);
            let (stage, error) = ([0, stage * STEP, 0], [0, error * STEP, 0]);
            let outcome = watch.see(capture, stage, error, &bounds());
            outcome.err().map(|fault| (k, fault))
        })
    }

    #[test]
    fn a_stage_that_is_sent_in_vain_has_lost_steps() {
        // 40 steps a frame, either way: the first frame beyond 800.
        assert_eq!(faults(100, |k| (40 * k, 300)), Some((21, Fault::LostSteps)));
        assert_eq!(
            faults(100, |k| (-40 * k, -300)),
            Some((21, Fault::LostSteps))
        );
        // The wrong way round: it is sent away from where the target is.
        assert_eq!(
            faults(100, |k| (40 * k, 300 + 40 * k)),
            Some((21, Fault::LostSteps))
        );
        // While the target itself moves a little.
        let wavers = |k: i64| (40 * k, 300 + 8 * (k % 2));
        assert_eq!(faults(100, wavers), Some((21, Fault::LostSteps)));
    }

    #[test]
    fn a_stage_that_gets_there_has_not() {
        assert_eq!(
            faults(100, |k| (40 * k.min(50), 2_000 - 40 * k.min(50))),
            None
        );
        // Slower than it is sent, but surely: a matrix that is off by half.
        assert_eq!(faults(100, |k| (20 * k, 1_500 - 10 * k)), None);
        // After a target that runs away for a while, and is caught.
        let caught = |k: i64| {
            (
                40 * k,
                200 + if k < 15 { 10 * k } else { 150 - 20 * (k - 15) },
            )
        };
        assert_eq!(faults(40, caught), None);
        // After one that speeds up and slows down, which takes its distance with it.
        assert_eq!(faults(60, |k| (20 * k, 150 + 4 * (k - 30).abs())), None);
        // To and fro, from near by.
        assert_eq!(faults(1_000, |k| (30 * k, 90)), None);
    }

    #[test]
    fn a_target_that_stays_far_away_is_a_following_error() {
        // At rest: 26 frames are the first beyond half a second.
        assert_eq!(
            faults(100, |_| (0, 1_601)),
            Some((26, Fault::FollowingError))
        );
        assert_eq!(faults(100, |_| (0, 1_599)), None);
        // One frame within begins anew.
        assert_eq!(
            faults(100, |k| (0, if k == 20 { 0 } else { -1_700 })),
            Some((47, Fault::FollowingError))
        );
    }

    #[test]
    fn without_bounds_nothing_is_watched() {
        let mut watch = Watch::default();
        for k in 0..1_000 {
            let far = [i64::MAX - k, i64::MIN + k, k << 40];
            let seen = watch.see(Instant::from_micros(k as u64), far, far, &Bounds::default());
            assert_eq!(seen, Ok(()));
        }
    }
}
