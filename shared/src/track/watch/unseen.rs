//! Motion towards the target that does not bring it nearer, on one axis.
//!
//! The distance `m` towards the target is counted, together with the largest and the smallest
//! distance `|e|` since the count began. The count begins anew when `|e|` has become smaller by
//! `m/4`, when the target is on the other side, or when it is near: within a sixteenth of the
//! bound.
//!
//! A count beyond the limit is suspicious if `|e|` changed by less than `m/10`, as it does before a
//! stage that stands still, or if `|e|` has grown and is larger than a quarter of the bound.

/// Divisor of the motion for the distance by which a target must come nearer.
const SHARE: i64 = 4;

/// Divisor of the bound for the distance within which a target is near.
const NEAR: u64 = 16;

/// Divisor of the motion for the range within which a distance is steady.
const STEADY: i64 = 10;

/// Divisor of the bound for the distance above which a growing distance is large.
const GROWN: i64 = 4;

/// State of one axis since its count began.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Unseen {
    /// Largest distance, with its sign.
    farthest: i64,
    /// Smallest distance.
    nearest: i64,
    /// Distance when the count began.
    first: i64,
    /// Motion towards the target.
    way: i64,
}

impl Unseen {
    /// Counts a move of the stage by `way`, after which the target is `error` away. Returns true if
    /// the count exceeds `limit`, a part of `bound`, and is suspicious.
    pub fn see(&mut self, way: i64, error: i64, bound: i64, limit: i64) -> bool {
        let side = error.signum();
        let distance = error.saturating_abs();
        let near = is_near(error, bound);
        let towards = match side {
            1 => way,
            -1 => way.saturating_neg(),
            _ => 0,
        };
        let moved = towards.saturating_add(self.way).max(0);
        let nearer = self.farthest.saturating_abs().saturating_sub(distance);
        if near || side != self.farthest.signum() || nearer > moved / SHARE {
            *self = Self {
                farthest: error,
                nearest: distance,
                first: distance,
                way: 0,
            };
            return false;
        }
        let farthest = self.farthest.saturating_abs().max(distance);
        *self = Self {
            farthest: if side < 0 { -farthest } else { farthest },
            nearest: self.nearest.min(distance),
            first: self.first,
            way: moved,
        };
        if bound <= 0 || moved <= limit {
            return false;
        }
        let steady = farthest.saturating_sub(self.nearest) < moved / STEADY;
        let grown = distance > self.first && farthest > bound / GROWN;
        steady || grown
    }
}

/// Returns true if a target that is `error` away is near.
pub(super) fn is_near(error: i64, bound: i64) -> bool {
    error.unsigned_abs() < bound.unsigned_abs() / NEAR
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: i64 = 1 << 32;

    /// Returns the first frame that is suspicious at a limit of 400 steps of 800.
    fn suspects(frames: i64, seen: impl Fn(i64) -> (i64, i64)) -> Option<i64> {
        let (mut unseen, mut before) = (Unseen::default(), 0);
        (0..frames).find(|k| {
            let (stage, error) = seen(*k);
            let way = stage - core::mem::replace(&mut before, stage);
            unseen.see(way * STEP, error * STEP, 800 * STEP, 400 * STEP)
        })
    }

    #[test]
    fn way_without_approach_is_suspicious() {
        assert_eq!(suspects(100, |k| (40 * k, 300)), Some(11));
        assert_eq!(suspects(100, |k| (-40 * k, -300)), Some(11));
        // The stage goes in the wrong direction.
        assert_eq!(suspects(100, |k| (40 * k, 300 + 40 * k)), Some(11));
        // The target itself moves a little.
        assert_eq!(suspects(100, |k| (40 * k, 300 + 8 * (k % 2))), Some(11));
    }

    #[test]
    fn approach_restarts_count() {
        let arrives = |k: i64| (40 * k.min(50), 2_000 - 40 * k.min(50));
        assert_eq!(suspects(100, arrives), None);
        // The matrix is off by half.
        assert_eq!(suspects(100, |k| (20 * k, 1_500 - 10 * k)), None);
        // The stage moves to and fro near the target.
        assert_eq!(suspects(1_000, |k| (30 * k, 49)), None);
        // The target accelerates and brakes, and the distance with it.
        assert_eq!(suspects(60, |k| (20 * k, 150 + 4 * (k - 30).abs())), None);
    }

    #[test]
    fn extremes_saturate() {
        let mut unseen = Unseen::default();
        for (way, error) in [
            (i64::MAX, i64::MIN),
            (i64::MIN, i64::MIN),
            (i64::MAX, i64::MAX),
        ] {
            unseen.see(way, error, 0, 0);
            unseen.see(way, error, i64::MAX, i64::MAX / 8);
        }
    }
}
