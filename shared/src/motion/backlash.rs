//! Backlash: the play between motor and load, and its compensation when an axis reverses.
//!
//! # Model
//! The motor pushes the load with one of two flanks, `width` apart. Between them it moves without
//! the load, which friction holds in place:
//!
//! ```text
//! load(t) = load(t - 1) clamped to  motor(t) ..= motor(t) + width
//! ```
//!
//! Pushed forwards, the load is at the motor's position; pushed backwards, it is `width` ahead of
//! it. All positions that go into the planner or come out of it (goals, soft limits, positions) are
//! the load's; the steps are the motor's. Crossing the backlash is therefore no special motion: it
//! is part of the motor's path to its target, within the same limits of speed, acceleration and
//! jerk, and in whole steps.
//!
//! # Choice of the flank
//! The choice depends on the position of the load after braking, in the frame of its target. As
//! long as that is not beyond the goal, in the direction in which the load is pushed now, the
//! present flank stays. Otherwise the load must come back, and the other flank is chosen. Every
//! tick decides again. While the stage follows a target, two tolerances keep noise from driving the
//! motor to and fro: the load may be half a step beyond the goal, and a goal that approaches the
//! load by itself may be as far behind as it moves in [`PATIENCE`] ticks.

use crate::fixed::{product, times};
use crate::steps::Position;

/// Ticks within which a moving goal may catch up with a load that is beyond it.
const PATIENCE: i64 = 32;

/// Distance by which a load may stay beyond a goal that is followed, fine units: half a step.
const SLACK: i64 = 1 << 31;

/// Backlash of one axis, with the position of its load.
#[derive(Clone, Copy, Debug)]
pub(super) struct Backlash {
    /// Width of the backlash, fine units: whole steps, from 0.
    width: i64,
    /// Position of the load, within `motor ..= motor + width`.
    load: Position,
    /// True if the flank in use pushes backwards.
    backward: bool,
    /// True during a stop: the motor's target stays fixed, wherever the load ends.
    held: bool,
    /// True if the goal is followed, with all its noise; false if it is to be reached exactly.
    follows: bool,
}

impl Backlash {
    /// Creates the state at rest, with a load that was last pushed forwards.
    pub(super) fn new(width_steps: u32, motor: Position) -> Self {
        Self {
            width: i64::from(width_steps) << 32,
            load: motor,
            backward: false,
            held: true,
            follows: false,
        }
    }

    /// Returns the state of the same axis at rest, with another width.
    pub(super) fn with_width(self, width_steps: u32, motor: Position) -> Self {
        let width = i64::from(width_steps) << 32;
        let backlash = Self {
            width,
            held: true,
            ..self
        };
        Self {
            load: backlash.pushed(self.load, motor),
            ..backlash
        }
    }

    /// Returns true if the axis has backlash.
    pub(super) const fn has_backlash(&self) -> bool {
        self.width != 0
    }

    pub(super) const fn load(&self) -> Position {
        self.load
    }

    /// Returns motor minus goal with the flank in use.
    const fn offset(&self) -> i64 {
        if self.backward {
            self.width.wrapping_neg()
        } else {
            0
        }
    }

    /// Returns the motor's target that brings the load to `goal`.
    pub(super) fn aim(&mut self, goal: Position, follows: bool) -> Position {
        self.held = false;
        self.follows = follows;
        goal.saturating_add(self.offset())
    }

    /// Lets the motor come to rest, wherever the load ends.
    pub(super) fn hold(&mut self) {
        self.held = true;
        self.follows = false;
    }

    /// Returns true if the goal is a target that is followed.
    pub(super) const fn is_following(&self) -> bool {
        self.follows
    }

    /// Returns the goal of the load when the motor has come to `target`.
    pub(super) fn goal(&self, target: Position) -> Position {
        if self.held {
            self.pushed(self.load, target)
        } else {
            target.saturating_add(self.offset().wrapping_neg())
        }
    }

    /// Returns the position of a load after the motor went straight to `motor`.
    fn pushed(&self, load: Position, motor: Position) -> Position {
        // Not `clamp`, which would panic if the bounds were reversed.
        load.max(motor).min(motor.saturating_add(self.width))
    }

    /// Updates the load after the motor has gone straight to `motor`.
    pub(super) fn advance(&mut self, motor: Position) {
        self.load = self.pushed(self.load, motor);
    }

    /// Returns the state of the same axis at rest, with all positions greater by `by`.
    pub(super) fn shifted(self, by: i64) -> Self {
        Self {
            load: self.load.saturating_add(by),
            held: true,
            ..self
        }
    }

    /// Chooses the flank, and returns the change of the motor's target: 0 if the present flank
    /// stays.
    ///
    /// `target` is the motor's target, which moves by `drift` speed quanta; relative to it the
    /// motor is braked at `stop`. `near` is the distance from a goal at which an axis comes to
    /// rest, fine units.
    pub(super) fn turn(
        &mut self,
        target: Position,
        stop: Position,
        drift: i64,
        quantum: i64,
        near: i64,
    ) -> i64 {
        if self.held {
            return 0;
        }
        let goal = target.saturating_add(self.offset().wrapping_neg());
        let beyond = self
            .pushed(self.load, stop)
            .fine()
            .saturating_sub(goal.fine());
        let slack = if self.follows { SLACK } else { 2 * near };
        let sign = if self.backward { -1 } else { 1 };
        // A tick moves the goal by 2 drift distance quanta.
        let approach = times(product(sign, drift).max(0), product(2 * PATIENCE, quantum));
        if times(sign, beyond) < slack.saturating_add(approach) {
            return 0;
        }
        let before = self.offset();
        self.backward = !self.backward;
        self.offset().wrapping_sub(before)
    }
}
