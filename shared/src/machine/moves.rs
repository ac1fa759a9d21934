//! Moves to a position and by a distance, and the limits that apply to them.
//!
//! A move names axes: a jog those with a distance, a setpoint those that stand elsewhere. An axis
//! without a name keeps its place to the fraction of a step, or continues an earlier move. No axis
//! moves against the direction of its jog, except for the distance that an earlier motion takes to
//! reverse.
//!
//! An axis may stand outside its travel: after a search for its home switch that was stopped, with
//! a narrower configuration, or with a travel that excludes the place that was declared to be zero.
//! From there it only moves inwards, when it is named, at the speed of an unknown position.

use super::Machine;
use crate::fixed::{narrow, times};
use crate::frame::message::Denial;
use crate::motion::{Limits, Planner};
use crate::safety::{State, Trust};
use crate::steps::Position;

/// One step in units of 2⁻³² step.
const STEP: i64 = 1 << 32;

/// Goals of a move, 2⁻³² steps from zero; `None` for an axis that it does not name.
type Goals = [Option<i64>; 3];

impl Machine {
    /// Plans again from where the stage stands, with the limits that apply there.
    pub(super) fn use_limits(&mut self) {
        if let Some(limits) = self.limits_here() {
            self.limit_to(limits);
        }
    }

    /// Calls [`Machine::use_limits`] if other limits apply now, because an axis may have come back
    /// from outside its travel. Requires rest.
    pub(super) fn renew_limits(&mut self) {
        let Some(limits) = self.limits_here() else {
            return;
        };
        if self
            .planner
            .as_ref()
            .is_some_and(|planner| *planner.limits() != limits)
        {
            self.limit_to(limits);
        }
    }

    /// Plans again from where the stage stands, with these limits.
    pub(super) fn limit_to(&mut self, limits: Limits) {
        self.planner = Some(match &self.planner {
            Some(planner) => planner.relimited(limits),
            None => Planner::new(limits, [Position::centre(0); 3]),
        });
    }

    fn limits_here(&self) -> Option<Limits> {
        let active = self.active.as_ref()?;
        if self.trust != Trust::Homed {
            return Some(active.slow);
        }
        let mut limits = active.limits;
        for axis in 0..3 {
            if self.outside(axis) != 0 {
                limits = limits.with_axis_of(axis, &active.slow);
            }
        }
        Some(limits)
    }

    /// Returns the side of its travel on which an axis stands: -1 below, 1 above, 0 within.
    fn outside(&self, axis: usize) -> i64 {
        let Some((active, planner)) = self.active.as_ref().zip(self.planner.as_ref()) else {
            return 0;
        };
        let range = active.limits.axes().get(axis).map(|limits| limits.range());
        let at = planner.loads().get(axis).map(|load| load.whole_steps());
        match range.zip(at) {
            Some(([low, _], at)) if at < low => -1,
            Some(([_, high], at)) if at > high => 1,
            _ => 0,
        }
    }

    /// Refuses to follow while an axis stands outside its travel, and while the limits of that
    /// place still apply. Coming back requires a command of its own.
    pub(super) fn require_inside(&self) -> Result<(), Denial> {
        let active = self.active.as_ref().ok_or(Denial::Unconfigured)?;
        let planner = self.planner.as_ref().ok_or(Denial::Unconfigured)?;
        let limits = planner.limits().axes().iter().zip(active.limits.axes());
        for (axis, (now, limits)) in (0_u8..).zip(limits) {
            if now != limits || self.outside(axis.into()) != 0 {
                return Err(Denial::OutsideTravel { axis });
            }
        }
        Ok(())
    }

    pub(super) fn setpoint(&mut self, position_um: [i32; 3]) -> Result<(), Denial> {
        self.require_ready()?;
        self.require_homed()?;
        let active = self.active.as_ref().ok_or(Denial::Unconfigured)?;
        let goals = active.fine_from_um(position_um).map(Some);
        self.start_move(goals)
    }

    pub(super) fn jog(&mut self, distance_um: [i32; 3]) -> Result<(), Denial> {
        self.require_ready()?;
        let active = self.active.as_ref().ok_or(Denial::Unconfigured)?;
        let planner = self.planner.as_ref().ok_or(Denial::Unconfigured)?;
        let distances = active.fine_from_um(distance_um);
        let width = active.fine_from_um([narrow(active.config.stage.window_um.into()); 3]);
        let from = self.position();
        let mut goals: Goals = [None; 3];
        let mut to = from;
        let axes = from
            .into_iter()
            .zip(distances)
            .zip(planner.stopping_distances());
        for ((goal, to), ((from, distance), stopping)) in goals.iter_mut().zip(&mut to).zip(axes) {
            // Not nearer than the stopping distance, or the axis would come back against the
            // direction of the jog.
            let distance = match distance.signum() {
                1 => distance.max(stopping),
                -1 => distance.min(stopping),
                _ => continue,
            };
            *to = from.saturating_add(distance);
            *goal = Some(*to);
        }
        if self.trust != Trust::Homed && !self.window.allows(from, to, width) {
            return Err(Denial::OutsideWindow);
        }
        self.start_move(goals)
    }

    /// Sends the named axes to their goals, rounded to whole steps and clamped to the soft limits.
    /// An axis that stands in its goal's step already does not move.
    fn start_move(&mut self, goals: Goals) -> Result<(), Denial> {
        let planner = self.planner.as_ref().ok_or(Denial::Unconfigured)?;
        let mut targets = [None; 3];
        let axes = planner.loads().into_iter().zip(planner.resting());
        for (((axis, target), goal), (load, rests)) in
            (0_u8..).zip(&mut targets).zip(goals).zip(axes)
        {
            let Some(goal) = goal else { continue };
            let stands =
                |goal| rests && Position::nearest_rest(goal).whole_steps() == load.whole_steps();
            if stands(goal) {
                continue;
            }
            let goal = self.inwards(axis, goal)?;
            self.require_free_way(axis.into(), Position::nearest_rest(goal))?;
            *target = (!stands(goal)).then(|| Position::nearest_rest(goal));
        }
        if let Some(planner) = &mut self.planner {
            planner.move_in_step(targets);
        }
        self.state = State::Moving;
        self.tracker.reset();
        Ok(())
    }

    /// Returns the goal of a named axis within its travel, or any goal while the position is
    /// unknown.
    ///
    /// # Errors
    /// [`Denial::OutsideTravel`] if the axis stands outside and the goal does not lie inwards.
    fn inwards(&self, axis: u8, goal: i64) -> Result<i64, Denial> {
        let index = usize::from(axis);
        let limits = self.active.as_ref().filter(|_| self.trust == Trust::Homed);
        let Some(limits) = limits.and_then(|active| active.limits.axes().get(index)) else {
            return Ok(goal);
        };
        let from = self.position().get(index).copied().unwrap_or_default();
        let [low, high] = limits.range().map(|end| times(end.into(), STEP));
        match self.outside(index) {
            0 => Ok(goal.clamp(low, high)),
            -1 if goal > from => Ok(goal.min(high)),
            1 if goal < from => Ok(goal.max(low)),
            _ => Err(Denial::OutsideTravel { axis }),
        }
    }

    /// Refuses a move that leads onto a tripped limit switch.
    pub(super) fn require_free_way(&self, axis: usize, target: Position) -> Result<(), Denial> {
        let planner = self.planner.as_ref().ok_or(Denial::Unconfigured)?;
        let (loads, limits) = (planner.loads(), self.inputs.limits);
        let Some((load, [negative, positive])) = loads.get(axis).zip(limits.get(axis)) else {
            return Ok(());
        };
        let distance = target.whole_steps().cmp(&load.whole_steps());
        match (*negative && distance.is_lt()) || (*positive && distance.is_gt()) {
            true => Err(Denial::LimitSwitch),
            false => Ok(()),
        }
    }
}
