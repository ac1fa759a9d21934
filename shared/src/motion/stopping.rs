use super::AxisLimits;
use crate::fixed::times;

/// Speed, acceleration and jerk an axis keeps to, in the grid of the [module](super): speed quanta, change of speed
/// per tick, change of that per tick.
///
/// *Invariant:* all at least 1, speed and jerk at most 2²⁸, and easing off from the full acceleration alone does not exceed
/// the speed: [`Pace::steepest`]`(speed) >= acceleration`. Hence `(acceleration / jerk)²` stays below 2²⁹, and with
/// `|u| <= 2²⁹`, `|e| <= acceleration` every number below fits an `i64`.
///
/// # Stopping
///
/// A tick with the deceleration `d` takes the speed from `u` to `u - d` and the axis `u + (u - d)` distance quanta on.
/// From one tick to the next `d` changes by at most the jerk `J`, never exceeds `A`, and ends at 0 together with `u`.
///
/// *Easing:* once `d` falls by `J` per tick, the ticks after this one take `T(d) = (d-J) + (d-2J) + ...` off the
/// speed (positive terms). With `d = qJ + s`, `0 <= s < J`: `T(d) = q d - J q(q+1)/2`.
///
/// *Braking rule:* each tick takes the largest `d'` with `d' <= d + J`, `d' <= A` and `T(d') <= u - d'`. The last one
/// keeps the axis able to ease off before its speed is gone; the rule never breaks it. If it is broken from the start, the
/// speed is going to change its sign whatever is done, and the rule applies to the mirrored axis.
///
/// The rule runs in three phases, each with a closed sum:
///
/// 1. `d` *climbs* by `J` per tick. From `d = kJ + s` (rounded down, `k` may be negative) it may reach the level `qJ + s` if
///    the speed left then allows it, and the sums over both flanks make that `J q² + 2 s q <= u + J k(k+1)/2 + s k`.
/// 2. It *holds* `A` while `u >= A + T(A)`.
/// 3. It *falls*. Let `V(q) = J q(q+1)/2` be what whole levels from `q` down take off, and `u = V(q) + (q+1) s + w` with
///    the largest `q` and `0 <= w <= q`. Then the rule gives level `l`, from `q` down to 0, the deceleration
///    `l J + s`, and one more on the last `w` levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pace {
    pub(super) speed: i64,
    pub(super) acceleration: i64,
    pub(super) jerk: i64,
}

impl Pace {
    pub(super) fn of(limits: &AxisLimits) -> Self {
        Self::new(limits.speed, limits.acceleration, limits.jerk)
    }

    /// Establishes the invariant by lowering what is of no use.
    pub(super) fn new(speed: u32, acceleration: u32, jerk: u32) -> Self {
        let clamp = |value: u32| i64::from(value).clamp(1, 1 << 28);
        let (speed, acceleration, jerk) = (clamp(speed), clamp(acceleration), clamp(jerk));
        let mut pace = Self {
            speed,
            acceleration,
            jerk,
        };
        pace.acceleration = acceleration.min(pace.steepest(speed));
        pace
    }

    /// `T(d)`, with the sign of `d`: what easing off takes from the speed after the tick with `d`.
    pub(super) fn easing(&self, d: i64) -> i64 {
        let size = d.abs();
        let q = size / self.jerk;
        let easing = times(q, size) - times(self.jerk, triangle(q));
        if d < 0 { -easing } else { easing }
    }

    /// Whole levels in the fall from speed `u >= 0`: the largest `q` with `J q(q+1)/2 <= u`.
    fn levels(&self, u: i64) -> i64 {
        // q(q+1) <= m is (2q+1)² <= 4m+1.
        let m = 2 * u / self.jerk;
        ((4 * m + 1).isqrt() - 1) / 2
    }

    /// The largest `d` with `d + T(d) <= u`, for `u >= 0`.
    fn steepest(&self, u: i64) -> i64 {
        let q = self.levels(u);
        times(q, self.jerk) + (u - times(self.jerk, triangle(q))) / (q + 1)
    }

    /// The acceleration of the next tick by the braking rule, after one with acceleration `e`.
    pub(super) fn brake(&self, u: i64, e: i64) -> i64 {
        let d = -e;
        if u >= self.easing(d) {
            -self.brake_ahead(u, d)
        } else {
            self.brake_ahead(-u, -d)
        }
    }

    fn brake_ahead(&self, u: i64, d: i64) -> i64 {
        let most = (d + self.jerk).min(self.acceleration);
        if most > 0 {
            most.min(self.steepest(u.max(0)))
        } else {
            most
        }
    }

    /// The way to rest by the braking rule from speed `u`, after a tick with acceleration `e`: distance quanta, both and
    /// the result signed in the same direction.
    pub(super) fn stopping_way(&self, u: i64, e: i64) -> i64 {
        let d = -e;
        if u >= self.easing(d) {
            self.stopping_ahead(u, d)
        } else {
            -self.stopping_ahead(-u, -d)
        }
    }

    /// [`Pace::stopping_way`] for `u >= T(d)`.
    fn stopping_ahead(&self, u: i64, d: i64) -> i64 {
        let jerk = self.jerk;
        let (k, s) = (d.div_euclid(jerk), d.rem_euclid(jerk));
        let spare = u + times(jerk, triangle(k)) + times(s, k);
        // J q² + 2 s q <= spare is (Jq + s)² <= s² + J spare. Below level 0 nothing is in the way.
        let level = if spare < 0 {
            -1
        } else {
            ((times(s, s) + times(jerk, spare)).isqrt() - s) / jerk
        };
        let level = level.min((self.acceleration - s).div_euclid(jerk)).max(k);
        let c = level - k;
        let climb = times(c, 2 * u - times(c, d)) - times(jerk, pyramid(c));
        climb + self.falling_way(u - times(c, d) - times(jerk, triangle(c)))
    }

    /// The way of holding and falling from speed `u >= 0`.
    fn falling_way(&self, u: i64) -> i64 {
        let a = self.acceleration;
        let full = a + self.easing(a);
        let held = if u >= full { (u - full) / a + 1 } else { 0 };
        let hold = times(held, 2 * u - times(a, held));
        let u = u - times(a, held);
        let q = self.levels(u);
        let rest = u - times(self.jerk, triangle(q));
        let (s, w) = (rest / (q + 1), rest % (q + 1));
        // (q+1)² - (q+1-w)² is w (2(q+1) - w).
        hold + times(self.jerk, pyramid(q))
            + times(s, times(q + 1, q + 1))
            + times(w, 2 * (q + 1) - w)
    }

    /// The highest acceleration of the next tick after which the axis can still stop within `ahead` distance quanta
    /// of where it is now, and ease off before it is faster than `fastest`. The braking rule's, if there is none.
    ///
    /// The way to rest grows with the acceleration, almost in proportion. So the highest one is looked for by interpolation (the
    /// Illinois rule), which takes some five evaluations where halving the interval takes one for each bit of the jerk.
    pub(super) fn next_acceleration(&self, u: i64, e: i64, ahead: i64, fastest: i64) -> i64 {
        // How far past the goal the axis would come to rest.
        let past = |e: i64| {
            let end = u + e;
            (u + end + self.stopping_way(end, e)).saturating_sub(ahead)
        };
        let lowest = self.brake(u, e);
        // Easing off takes T(e) on top of e.
        let most = match fastest - u {
            room @ 0.. => self.steepest(room),
            _ => 0,
        };
        let highest = (e + self.jerk).min(self.acceleration).min(most);
        if highest <= lowest {
            return lowest;
        }
        let (mut good, mut bad) = (lowest, highest);
        let mut past_bad = past(bad);
        if past_bad <= 0 {
            return bad;
        }
        let mut past_good = past(good);
        // 1 if the last evaluation moved `good`, -1 if `bad`.
        let mut moved = 0;
        // Halves whenever interpolation was unlucky for long, so at most some 60 rounds.
        let mut rounds = 0;
        while bad - good > 1 && past_good <= 0 {
            rounds += 1;
            let width = bad - good;
            let step = if rounds % 4 == 0 {
                width / 2
            } else {
                times(width, past_good.saturating_neg()) / past_bad.saturating_sub(past_good).max(1)
            };
            let middle = good + step.clamp(1, width - 1);
            let here = past(middle);
            if here <= 0 {
                (good, past_good) = (middle, here);
                if moved == 1 {
                    past_bad /= 2;
                }
                moved = 1;
            } else {
                (bad, past_bad) = (middle, here);
                if moved == -1 {
                    past_good /= 2;
                }
                moved = -1;
            }
        }
        good
    }
}

/// `1 + 2 + ... + q`.
fn triangle(q: i64) -> i64 {
    times(q, q + 1) / 2
}

/// `1 + 4 + ... + q²`.
fn pyramid(q: i64) -> i64 {
    times(times(q, q + 1), 2 * q + 1) / 6
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition: the highest acceleration that is allowed, by halving.
    fn next_by_halving(pace: &Pace, u: i64, e: i64, ahead: i64, fastest: i64) -> i64 {
        let allowed = |e: i64| {
            let end = u + e;
            let too_fast = e > 0 && end + pace.easing(e) > fastest;
            !too_fast && u + end + pace.stopping_way(end, e) <= ahead
        };
        let highest = (e + pace.jerk).min(pace.acceleration);
        if allowed(highest) {
            return highest;
        }
        let (mut good, mut bad) = (pace.brake(u, e), highest);
        while bad - good > 1 {
            let middle = good + (bad - good) / 2;
            if allowed(middle) {
                good = middle;
            } else {
                bad = middle;
            }
        }
        good
    }

    /// Follows the braking rule tick by tick, checking it against its definition, and adds up the way.
    fn slow_stop(pace: &Pace, mut u: i64, mut e: i64) -> i64 {
        let mut way = 0;
        for _ in 0..100_000 {
            if u == 0 && e.abs() <= pace.jerk {
                return way;
            }
            let next = pace.brake(u, e);
            assert!((next - e).abs() <= pace.jerk, "jerk at {u} {e}");
            assert!(next.abs() <= pace.acceleration);
            way += 2 * u + next;
            u += next;
            e = next;
        }
        panic!("never stops")
    }

    fn slow_easing(mut d: i64, jerk: i64) -> i64 {
        let mut sum = 0;
        while d > 0 {
            d -= jerk;
            sum += d.max(0);
        }
        sum
    }

    prop_compose! {
        fn states()(speed in 1..5_000u32, acceleration in 1..300u32, jerk in 1..300u32, u in -1.0..1.0f64, e in -1.0..1.0f64)
            -> (Pace, i64, i64) {
            let pace = Pace::new(speed, acceleration, jerk);
            // Twice the speed: relative to a moving target.
            (pace, (u * 2.0 * f64::from(speed)) as i64, (e * pace.acceleration as f64).round() as i64)
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2_000))]

        #[test]
        fn stopping_way_is_that_of_the_braking_rule((pace, u, e) in states()) {
            prop_assert_eq!(pace.stopping_way(u, e), slow_stop(&pace, u, e));
        }

        #[test]
        fn steepest_is_the_largest_that_can_ease_off((pace, u, _) in states()) {
            let u = u.abs();
            let fits = |d: i64| d + slow_easing(d, pace.jerk) <= u;
            let d = pace.steepest(u);
            prop_assert!(fits(d) && !fits(d + 1));
            prop_assert_eq!(pace.easing(d), slow_easing(d, pace.jerk));
            prop_assert_eq!(pace.easing(-d), -slow_easing(d, pace.jerk));
        }

        #[test]
        fn interpolating_finds_what_halving_finds(
            speed in 1u32..1 << 28, acceleration in 1u32..1 << 28, jerk in 1u32..1 << 26,
            (v, a, spare, margin) in (any::<i32>(), any::<i32>(), 0..1i64 << 40, 0..1i64 << 28),
        ) {
            let pace = Pace::new(speed, acceleration, jerk);
            let u = i64::from(v) % (pace.speed + 1);
            let e = i64::from(a) % (pace.acceleration + 1);
            let ahead = pace.stopping_way(u, e) + spare;
            let fastest = u.abs() + margin;
            prop_assert_eq!(
                pace.next_acceleration(u, e, ahead, fastest),
                next_by_halving(&pace, u, e, ahead, fastest)
            );
        }

        #[test]
        fn next_acceleration_is_the_largest_allowed((pace, u, e) in states(), spare in 0..20_000i64) {
            let ahead = pace.stopping_way(u, e) + spare;
            let fastest = u.abs() + slow_easing(e.abs(), pace.jerk) + spare;
            let allowed = |next: &i64| {
                let end = u + next;
                (*next <= 0 || end + slow_easing(*next, pace.jerk) <= fastest) && u + end + slow_stop(&pace, end, *next) <= ahead
            };
            let lowest = (e - pace.jerk).max(-pace.acceleration);
            let highest = (e + pace.jerk).min(pace.acceleration);
            let best = (lowest..=highest).rev().find(allowed);
            prop_assert_eq!(Some(pace.next_acceleration(u, e, ahead, fastest)), best);
        }

        #[test]
        fn nothing_overflows(speed: u32, acceleration: u32, jerk: u32, u in -(1i64 << 29)..1 << 29, e in -1.0..1.0f64, ahead: i64) {
            let pace = Pace::new(speed, acceleration, jerk);
            let e = (e * pace.acceleration as f64) as i64;
            pace.stopping_way(u, e);
            pace.next_acceleration(u, e, ahead, pace.speed);
        }
    }
}
