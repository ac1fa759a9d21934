//! Choice of one axis's acceleration in the next tick.

use crate::fixed::{product, quotient, times};
use crate::motion::AxisLimits;
use crate::motion::stopping::Pace;
use crate::steps::Position;
use core::cmp::Ordering;

/// State of one axis between two ticks.
#[derive(Clone, Copy, Debug)]
pub(super) struct AxisPlan {
    pub(super) limits: AxisLimits,
    /// Pace of the axis's own limits.
    pub(super) own: Pace,
    /// Pace in use: slower for the leader of a line.
    pub(super) pace: Pace,
    pub(super) position: Position,
    /// Velocity, speed quanta, negative backwards. Within the limits.
    pub(super) speed: i64,
    /// Acceleration of the last tick, quanta.
    pub(super) acceleration: i64,
    /// Target position at the start of the next tick.
    pub(super) target: Position,
    /// Velocity of the target, speed quanta. Within the limits.
    pub(super) drift: i64,
    /// Distance from a soft limit beyond which the axis cannot run into it, distance quanta: a tick
    /// and braking, both from the highest speed and acceleration.
    margin: i64,
}

impl AxisPlan {
    pub(super) fn new(limits: AxisLimits, position: Position) -> Self {
        let own = Pace::of(&limits);
        Self {
            limits,
            own,
            pace: own,
            position,
            speed: 0,
            acceleration: 0,
            target: position,
            drift: 0,
            margin: 2 * own.speed + own.stopping_distance(own.speed, own.acceleration),
        }
    }

    /// Sets the target, which must lie within the limits.
    pub(super) fn aim(&mut self, target: Position, drift: i64) {
        self.pace = self.own;
        self.target = target;
        self.drift = drift.clamp(-self.pace.speed, self.pace.speed);
    }

    pub(super) fn is_at_rest(&self) -> bool {
        self.speed == 0 && self.acceleration == 0
    }

    /// Returns the distance from the position to the target, fine units.
    pub(super) fn distance(&self) -> i64 {
        self.target.fine().saturating_sub(self.position.fine())
    }

    /// Returns the acceleration of the next tick; `quantum` is N² fine units.
    ///
    /// The axis is planned relative to the target, which moves steadily, and comes to rest relative
    /// to it. The search takes the side on which the goal lies ahead of the point where braking
    /// would end, so that the axis can always reach it without overshoot from there.
    pub(super) fn choose(&self, quantum: i64) -> i64 {
        let speed = self.speed - self.drift;
        let distance = self.distance();
        let left = distance.saturating_sub(product(speed, quantum));
        if within(left, near(quantum)) && self.pace.brake(speed, self.acceleration) == -speed {
            // Braking ends in this tick, near enough.
            return -speed;
        }
        let stop = self.pace.stopping_distance(speed, self.acceleration);
        let (mut sign, mut ahead) = (1, quotient(distance, quantum));
        if stop > ahead {
            (sign, ahead) = (-1, quotient(distance.saturating_neg(), quantum));
        }
        let fastest = self.pace.speed - product(sign, self.drift);
        self.towards(sign, speed, ahead, fastest, stop)
    }

    /// Returns the next acceleration in the direction of `sign`, where `ahead` is the room and
    /// `fastest` the limit. `speed` and `stop`, the distance to rest, count forwards.
    #[inline(never)]
    fn towards(&self, sign: i64, speed: i64, ahead: i64, fastest: i64, stop: i64) -> i64 {
        let signed = |value: i64| product(sign, value);
        let (speed, last) = (signed(speed), signed(self.acceleration));
        signed(
            self.pace
                .next_acceleration(speed, last, ahead, fastest, signed(stop)),
        )
    }

    /// Returns `wanted`, or the acceleration nearest to it after which the axis can still stop
    /// within the soft limits.
    ///
    /// A target at rest lies within them, and so does every path to it. A moving target may leave
    /// them.
    fn keep_inside(&self, wanted: i64, quantum: i64) -> i64 {
        let [low, high] = self
            .limits
            .motor_ends()
            .map(|end| end.fine().saturating_sub(self.position.fine()));
        let margin = times(quantum, self.margin);
        if low <= margin.saturating_neg() && high >= margin {
            return wanted;
        }
        let behind = quotient(low.saturating_neg(), quantum);
        let ahead = quotient(high, quantum);
        let (speed, fastest) = (self.speed, self.pace.speed);
        let end = speed + wanted;
        let distance = speed + end + self.pace.stopping_distance(end, wanted);
        if -behind <= distance && distance <= ahead {
            return wanted;
        }
        let brake = self.pace.brake(speed, self.acceleration);
        let stop = self.pace.stopping_distance(speed, self.acceleration);
        let (sign, room) = match wanted.cmp(&brake) {
            Ordering::Equal => return wanted,
            Ordering::Greater => (1, ahead),
            Ordering::Less => (-1, behind),
        };
        let most = self.towards(sign, speed, room, fastest, stop);
        if sign > 0 {
            wanted.min(most)
        } else {
            wanted.max(most)
        }
    }

    /// Returns the acceleration of the axis in the next tick when it moves on its own.
    pub(super) fn free(&self, quantum: i64) -> i64 {
        let wanted = self.choose(quantum);
        if self.drift == 0 {
            wanted
        } else {
            self.keep_inside(wanted, quantum)
        }
    }

    /// Advances by the motion planned for a tick.
    pub(super) fn advance(&mut self, distance: i64, acceleration: i64, quantum: i64) {
        self.position = self.position.saturating_add(distance);
        self.target = self.target.saturating_add(product(2 * quantum, self.drift));
        self.speed += acceleration;
        self.acceleration = acceleration;
    }

    /// Returns the position at which full braking ends.
    pub(super) fn stop(&self, quantum: i64) -> Position {
        self.position
            .saturating_add(self.stopping_distance(quantum))
    }

    /// Returns the distance to rest at full braking, fine units.
    pub(super) fn stopping_distance(&self, quantum: i64) -> i64 {
        let distance = self.own.stopping_distance(self.speed, self.acceleration);
        times(quantum, distance)
    }
}

/// Returns the distance from its target within which an axis may come to rest, fine units: 1/128
/// step, or four distance quanta where these are coarser.
///
/// Braking mostly leaves less. Removing the rest would take two or three ticks without effect,
/// because the motor stands in the same step.
pub(super) fn near(quantum: i64) -> i64 {
    (4 * quantum).max(1 << 25)
}

/// Returns true if `value` is at most `size`, which is positive, in size.
pub(super) fn within(value: i64, size: i64) -> bool {
    value.unsigned_abs() <= size.unsigned_abs()
}
