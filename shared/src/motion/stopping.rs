use super::AxisLimits;
use crate::fixed::{product, quotient, root, square_root_32};
use core::ops::{Add, Neg, Sub};

/// Speed, acceleration and jerk of an axis, in the grid of the [module](super): speed quanta,
/// change of speed per tick, change of that per tick.
///
/// *Invariant:* all at least 1, speed and jerk at most 2²⁸, and easing off from the full
/// acceleration alone does not exceed the speed: [`Pace::steepest`]`(speed) >= acceleration`. Hence
/// `(acceleration / jerk)²` stays below 2²⁹, and with `|u| <= 2²⁹`, `|e| <= acceleration` every
/// number below fits an `i64`.
///
/// # Stopping
///
/// A tick with the deceleration `d` takes the speed from `u` to `u - d` and the axis `u + (u - d)`
/// distance quanta on. From one tick to the next `d` changes by at most the jerk `J`, never exceeds
/// `A`, and ends at 0 together with `u`.
///
/// *Easing:* once `d` falls by `J` per tick, the ticks after this one take `T(d) = (d-J) + (d-2J) +
/// ...` off the speed (positive terms). With `d = qJ + s`, `0 <= s < J`: `T(d) = q d - J q(q+1)/2`.
///
/// *Braking rule:* each tick takes the largest `d'` with `d' <= d + J`, `d' <= A` and `T(d') <= u -
/// d'`. The last condition keeps the axis able to ease off before its speed is gone, and the rule
/// never violates it. If it is violated from the start, the speed is going to change its sign in
/// any case, and the rule applies to the mirrored axis.
///
/// The rule runs in three phases, each with a closed sum:
///
/// 1. `d` *climbs* by `J` per tick. From `d = kJ + s` (rounded down, `k` may be negative) it may
///    reach the level `qJ + s` if the speed left then allows it, and the sums over both sides make
///    that `J q² + 2 s q <= u + J k(k+1)/2 + s k`.
/// 2. It *holds* `A` while `u >= A + T(A)`.
/// 3. It *falls*. Let `V(q) = J q(q+1)/2` be what whole levels from `q` down take off, and `u =
///    V(q) + (q+1) s + w` with the largest `q` and `0 <= w <= q`. Then the rule gives level `l`,
///    from `q` down to 0, the deceleration `l J + s`, and one more on the last `w` levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pace {
    pub(super) speed: i64,
    pub(super) acceleration: i64,
    pub(super) jerk: i64,
    /// True if the numbers of the rule fit 32 bits, in which a Cortex-M4 is several times faster.
    is_narrow: bool,
}

/// Integer type in which the rule is computed. Divisors are positive, quotients rounded down.
trait Integer:
    Copy + Ord + From<i8> + Add<Output = Self> + Sub<Output = Self> + Neg<Output = Self>
{
    fn times(self, by: Self) -> Self;
    fn over(self, by: Self) -> Self;
    fn root(self) -> Self;
}

/// Defines an integer type whose values are known to fit, so that only debug builds check them.
macro_rules! exact {
    ($(#[$doc:meta])* $name:ident, $word:ty, $over:expr, $root:expr) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        struct $name($word);

        impl From<i8> for $name {
            fn from(value: i8) -> Self {
                Self(value.into())
            }
        }

        impl Add for $name {
            type Output = Self;

            fn add(self, by: Self) -> Self {
                debug_assert!(self.0.checked_add(by.0).is_some());
                Self(self.0.wrapping_add(by.0))
            }
        }

        impl Sub for $name {
            type Output = Self;

            fn sub(self, by: Self) -> Self {
                debug_assert!(self.0.checked_sub(by.0).is_some());
                Self(self.0.wrapping_sub(by.0))
            }
        }

        impl Neg for $name {
            type Output = Self;

            fn neg(self) -> Self {
                Self(self.0.wrapping_neg())
            }
        }

        impl Integer for $name {
            fn times(self, by: Self) -> Self {
                debug_assert!(self.0.checked_mul(by.0).is_some());
                Self(self.0.wrapping_mul(by.0))
            }

            fn over(self, by: Self) -> Self {
                Self($over(self.0, by.0))
            }

            fn root(self) -> Self {
                Self($root(self.0))
            }
        }
    };
}

exact!(
    /// 64-bit integer; values fit by [`Pace`]'s invariant.
    Wide,
    i64,
    quotient,
    root
);
exact!(
    /// 32-bit integer; values fit by [`Pace::fits_32_bits`].
    Narrow,
    i32,
    quotient_32,
    |a: i32| square_root_32(a.max(0).unsigned_abs()).cast_signed()
);

/// Computes `a / divisor`, rounded down; a divisor below 1 counts as 1.
fn quotient_32(a: i32, divisor: i32) -> i32 {
    let divisor = divisor.max(1);
    let quotient = a.wrapping_div(divisor);
    quotient.wrapping_sub((quotient.wrapping_mul(divisor) > a).into())
}

/// Braking rule for one acceleration `a` and jerk `j`.
#[derive(Clone, Copy)]
struct Rule<I> {
    a: I,
    j: I,
}

impl<I: Integer> Rule<I> {
    /// Returns what whole levels from `q` down take off the speed.
    fn level_sum(self, q: I) -> I {
        self.j.times(triangle(q))
    }

    /// Computes `T(d)`, with the sign of `d`.
    fn easing(self, d: I) -> I {
        let size = d.max(-d);
        let q = size.over(self.j);
        let easing = q.times(size) - self.level_sum(q);
        if d < 0.into() { -easing } else { easing }
    }

    /// Returns the number of whole levels in the fall from speed `u >= 0`: the largest `q` with `J
    /// q(q+1)/2 <= u`.
    fn levels(self, u: I) -> I {
        // q(q+1) <= m is (2q+1)² <= 4m+1.
        let m = (u + u).over(self.j);
        let odd = (m.times(4.into()) + 1.into()).root();
        (odd - 1.into()).over(2.into())
    }

    /// Returns the largest `d` with `d + T(d) <= u`, for `u >= 0`.
    fn steepest(self, u: I) -> I {
        let q = self.levels(u);
        q.times(self.j) + (u - self.level_sum(q)).over(q + 1.into())
    }

    /// Implements [`Pace::brake`].
    fn brake(self, u: I, e: I) -> I {
        let d = -e;
        if u >= self.easing(d) {
            -self.brake_ahead(u, d)
        } else {
            self.brake_ahead(-u, -d)
        }
    }

    fn brake_ahead(self, u: I, d: I) -> I {
        let most = (d + self.j).min(self.a);
        if most > 0.into() {
            most.min(self.steepest(u.max(0.into())))
        } else {
            most
        }
    }

    /// Implements [`Pace::stopping_distance`].
    fn stopping_distance(self, u: I, e: I) -> I {
        let d = -e;
        if u >= self.easing(d) {
            self.stopping_ahead(u, d)
        } else {
            -self.stopping_ahead(-u, -d)
        }
    }

    /// Returns the distance to rest for `u >= T(d)`.
    fn stopping_ahead(self, u: I, d: I) -> I {
        let j = self.j;
        let k = d.over(j);
        let s = d - k.times(j);
        let spare = u + self.level_sum(k) + s.times(k);
        // J q² + 2 s q <= spare is (Jq + s)² <= s² + J spare. Below level 0 there is no limit.
        let level = if spare < 0.into() {
            I::from(-1)
        } else {
            ((s.times(s) + j.times(spare)).root() - s).over(j)
        };
        let level = level.min((self.a - s).over(j)).max(k);
        let c = level - k;
        let climb = c.times(u + u - c.times(d)) - j.times(pyramid(c));
        climb + self.falling_distance(u - c.times(d) - self.level_sum(c))
    }

    /// Returns the distance of holding and falling from speed `u >= 0`.
    fn falling_distance(self, u: I) -> I {
        let a = self.a;
        let full = a + self.easing(a);
        let held = if u >= full {
            (u - full).over(a) + 1.into()
        } else {
            0.into()
        };
        let hold = held.times(u + u - a.times(held));
        let u = u - a.times(held);
        let q = self.levels(u);
        let next = q + 1.into();
        let rest = u - self.level_sum(q);
        let s = rest.over(next);
        let w = rest - s.times(next);
        // (q+1)² - (q+1-w)² is w (2(q+1) - w).
        hold + self.j.times(pyramid(q)) + s.times(next.times(next)) + w.times(next + next - w)
    }
}

/// Computes `1 + 2 + ... + q`.
fn triangle<I: Integer>(q: I) -> I {
    q.times(q + 1.into()).over(2.into())
}

/// Computes `1 + 4 + ... + q²`.
fn pyramid<I: Integer>(q: I) -> I {
    let both = q.times(q + 1.into());
    both.times(q + q + 1.into()).over(6.into())
}

impl Pace {
    pub(super) fn of(limits: &AxisLimits) -> Self {
        Self::new(limits.speed, limits.acceleration, limits.jerk)
    }

    /// Creates the pace, and lowers limits that have no effect to establish the invariant.
    pub(super) fn new(speed: u32, acceleration: u32, jerk: u32) -> Self {
        let clamp = |value: u32| i64::from(value).clamp(1, 1 << 28);
        let (speed, acceleration, jerk) = (clamp(speed), clamp(acceleration), clamp(jerk));
        let rule = Rule {
            a: Wide(acceleration),
            j: Wide(jerk),
        };
        let acceleration = acceleration.min(rule.steepest(Wide(speed)).0);
        let mut pace = Self {
            speed,
            acceleration,
            jerk,
            is_narrow: false,
        };
        pace.is_narrow = pace.fits_32_bits();
        pace
    }

    /// Returns true if all terms of the rule stay below 2²⁹, and so their sums below 2³¹, for
    /// speeds up to twice the highest (relative to a target that moves at the highest).
    ///
    /// `R = A/J + 2` is above the ticks of a ramp, and a climb takes at most twice as many. Because
    /// the full acceleration can be eased off below the highest speed, `A²/J` is at most twice
    /// that, and `R` below the root of `u`. So a climb ends below three times the largest speed,
    /// from where a fall has fewer than `Q = sqrt(6 u/J) + 2` levels.
    fn fits_32_bits(&self) -> bool {
        let (a, j, u) = (self.acceleration, self.jerk, 2 * self.speed);
        if u > 1 << 20 || j > 1 << 16 {
            return false; // and everything below fits an i64
        }
        let top = 3 * u + a;
        let ramp = quotient(a, j) + 2;
        let level = root(quotient(6 * u, j)) + 2;
        let largest = product(j, 2 * j + 4 * u)
            | product(48 * u, ramp)
            | product(2 * top, quotient(top, a) + 1)
            | product(8 + 2 * j, product(level, product(level, level)));
        largest < 1 << 29 // none has a higher bit
    }

    /// Returns the rule in 32 bits, if it fits.
    fn narrow(&self, u: i64, e: i64) -> Option<(Rule<Narrow>, Narrow, Narrow)> {
        if !self.is_narrow || u.abs() > 2 * self.speed || e.abs() > self.acceleration {
            return None;
        }
        let narrow = |value: i64| Narrow(value as i32);
        let rule = Rule {
            a: narrow(self.acceleration),
            j: narrow(self.jerk),
        };
        Some((rule, narrow(u), narrow(e)))
    }

    fn wide(&self) -> Rule<Wide> {
        Rule {
            a: Wide(self.acceleration),
            j: Wide(self.jerk),
        }
    }

    /// Computes `T(d)`, with the sign of `d`: the speed that easing off takes after the tick with
    /// `d`.
    fn easing(&self, d: i64) -> i64 {
        match self.narrow(0, d) {
            Some((rule, _, d)) => rule.easing(d).0.into(),
            None => self.wide().easing(Wide(d)).0,
        }
    }

    /// Returns the largest `d` with `d + T(d) <= u`, or 0 for `u < 0`.
    fn steepest(&self, u: i64) -> i64 {
        match self.narrow(u, 0) {
            _ if u < 0 => 0,
            Some((rule, u, _)) => rule.steepest(u).0.into(),
            None => self.wide().steepest(Wide(u)).0,
        }
    }

    /// Returns the acceleration of the next tick by the braking rule, after one with acceleration
    /// `e`.
    pub(super) fn brake(&self, u: i64, e: i64) -> i64 {
        match self.narrow(u, e) {
            Some((rule, u, e)) => rule.brake(u, e).0.into(),
            None => self.wide().brake(Wide(u), Wide(e)).0,
        }
    }

    /// Returns the distance to rest by the braking rule from speed `u`, after a tick with
    /// acceleration `e`: distance quanta. All three are signed in the same direction.
    pub(super) fn stopping_distance(&self, u: i64, e: i64) -> i64 {
        match self.narrow(u, e) {
            Some((rule, u, e)) => rule.stopping_distance(u, e).0.into(),
            None => self.wide().stopping_distance(Wide(u), Wide(e)).0,
        }
    }

    /// Returns the highest acceleration of the next tick after which the axis can still stop within
    /// `ahead` distance quanta of where it is now, and ease off before it is faster than `fastest`;
    /// that of the braking rule if there is none.
    ///
    /// `stop` is [`Pace::stopping_distance`] from here, where the search starts.
    pub(super) fn next_acceleration(
        &self,
        u: i64,
        e: i64,
        ahead: i64,
        fastest: i64,
        stop: i64,
    ) -> i64 {
        let distance = |e: i64| {
            let end = u + e;
            u + end + self.stopping_distance(end, e)
        };
        let mut highest = (e + self.jerk).min(self.acceleration);
        if highest > 0 && u + highest + self.easing(highest) > fastest {
            highest = highest.min(self.steepest(fastest - u));
        }
        let mut good = self.brake(u, e);
        if highest <= good {
            return good;
        }
        let (mut bad, mut good_distance, mut bad_distance) = (highest, stop, distance(highest));
        if bad_distance <= ahead {
            return highest;
        }
        // The distance grows with the acceleration, nearly in proportion, so two or three tries
        // suffice. After a try that leaves more than half of the interval, the next one halves it.
        let mut halve = false;
        while bad - good > 1 {
            let size = bad - good;
            let step = if halve {
                size >> 1
            } else {
                let slope = quotient(bad_distance.saturating_sub(good_distance), size);
                quotient(ahead.saturating_sub(good_distance), slope)
            };
            let middle = good + step.clamp(1, size - 1);
            let middle_distance = distance(middle);
            if middle_distance <= ahead {
                (good, good_distance) = (middle, middle_distance);
            } else {
                (bad, bad_distance) = (middle, middle_distance);
            }
            halve = !halve && bad - good > size >> 1;
        }
        good
    }
}

#[cfg(test)]
mod tests;
