//! Lost motion between motor and load, and how it is taken up when an axis turns round.
//!
//! # Model
//! The motor pushes the load with one of two flanks, `width` apart; between them it moves without
//! the load, which friction holds where it is:
//!
//! ```text
//! load(t) = load(t - 1) clamped to  motor(t) ..= motor(t) + width
//! ```
//!
//! Pushed forwards the load is where the motor is, pushed backwards it is `width` before it.
//! Everything that is told to the planner or by it (goals, soft limits, positions) is the load's;
//! the steps are the motor's. So taking up lost motion is no special motion: it is part of the way
//! to the motor's target, within the same limits of speed, acceleration and jerk, and in whole
//! steps.
//!
//! # Which flank
//! Say where the load will stand when the axis has braked, in the frame of its target. As long as
//! that is not beyond the goal, seen in the direction in which the load is pushed now, the present
//! flank will do. Otherwise the load must come back, and the other flank is chosen. This is asked
//! anew at every tick. While a target is followed two things keep noise from driving the motor to
//! and fro: the load may be half a step beyond the goal, and a goal that comes after the load by
//! itself may be as far behind as it moves in [`PATIENCE`] ticks.

use crate::fixed::{product, times};
use crate::steps::Position;

/// Ticks in which a moving goal may catch up with a load that is beyond it.
const PATIENCE: i64 = 32;

/// How far beyond a goal that is followed a load may stay, fine units: half a step.
const SLACK: i64 = 1 << 31;

/// Motor and load of one axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Play {
    /// Lost motion, fine units: whole steps, from 0.
    width: i64,
    /// Within `motor ..= motor + width`.
    load: Position,
    /// The flank in use pushes backwards.
    backward: bool,
    /// The motor's target stands as it is, whatever that means for the load: a stop.
    held: bool,
    /// The goal is followed, with all its noise; else it is to be reached exactly.
    follows: bool,
}

impl Play {
    /// At rest, with a load that was last pushed forwards.
    pub(super) fn new(width_steps: u32, motor: Position) -> Self {
        Self {
            width: i64::from(width_steps) << 32,
            load: motor,
            backward: false,
            held: true,
            follows: false,
        }
    }

    /// The same axis at rest, with another width.
    pub(super) fn with_width(self, width_steps: u32, motor: Position) -> Self {
        let width = i64::from(width_steps) << 32;
        let play = Self {
            width,
            held: true,
            ..self
        };
        Self {
            load: play.pushed(self.load, motor),
            ..play
        }
    }

    /// There is lost motion.
    pub(super) const fn is_loose(&self) -> bool {
        self.width != 0
    }

    pub(super) const fn load(&self) -> Position {
        self.load
    }

    /// Motor minus goal with the flank in use.
    const fn offset(&self) -> i64 {
        if self.backward {
            self.width.wrapping_neg()
        } else {
            0
        }
    }

    /// Where the motor must go to bring the load to `goal`.
    pub(super) fn aim(&mut self, goal: Position, follows: bool) -> Position {
        self.held = false;
        self.follows = follows;
        goal.saturating_add(self.offset())
    }

    /// The motor comes to rest wherever it does.
    pub(super) fn hold(&mut self) {
        self.held = true;
        self.follows = false;
    }

    /// The goal is a target that is followed.
    pub(super) const fn is_following(&self) -> bool {
        self.follows
    }

    /// Where the load is to be when the motor has come to `target`.
    pub(super) fn goal(&self, target: Position) -> Position {
        if self.held {
            self.pushed(self.load, target)
        } else {
            target.saturating_add(self.offset().wrapping_neg())
        }
    }

    /// Where a load comes to be when the motor goes straight to `motor`.
    fn pushed(&self, load: Position, motor: Position) -> Position {
        // Not `clamp`, which would panic if the bounds were the wrong way round.
        load.max(motor).min(motor.saturating_add(self.width))
    }

    /// The motor has gone straight to `motor`.
    pub(super) fn advance(&mut self, motor: Position) {
        self.load = self.pushed(self.load, motor);
    }

    /// The same axis at rest, with all positions greater by so much.
    pub(super) fn shifted(self, by: i64) -> Self {
        Self {
            load: self.load.saturating_add(by),
            held: true,
            ..self
        }
    }

    /// Chooses the flank, and gives what the motor's target changes by: 0 if the present one will
    /// do. `target` is the motor's, which moves by `drift` speed quanta; relative to it the motor
    /// is braked at `stop`. `near` is how near to a goal an axis comes to rest, fine units.
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
        // A tick takes the goal 2 drift distance quanta on.
        let approach = times(product(sign, drift).max(0), product(2 * PATIENCE, quantum));
        if times(sign, beyond) < slack.saturating_add(approach) {
            return 0;
        }
        let before = self.offset();
        self.backward = !self.backward;
        self.offset().wrapping_sub(before)
    }
}
