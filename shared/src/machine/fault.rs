//! Faults and stops: the checks of every tick, and the ends of motion.

use super::active::Active;
use super::{MAX_LAG_US, Machine, SEGMENTS};
use crate::motion::Planner;
use crate::safety::{Fault, State};

impl Machine {
    /// Returns true if the stage is at rest and no motion is planned.
    pub(super) fn stands(&self) -> bool {
        self.planner.as_ref().is_none_or(Planner::has_arrived)
    }

    pub(super) fn check_switches(&mut self) {
        let latched = core::mem::take(&mut self.latched_inputs);
        let emergency_stop = self.inputs.emergency_stop || latched.emergency_stop;
        let driver_fault = self.inputs.driver_fault || latched.driver_fault;
        self.forbidden = emergency_stop || driver_fault;
        if emergency_stop {
            self.fail(Fault::EmergencyStop);
        }
        if driver_fault {
            self.fail(Fault::Driver);
        }
        if self.runs_onto_a_switch() {
            self.fail(Fault::Limit);
        }
        let lag = self.words_planned.saturating_sub(self.inputs.words_emitted);
        // In word periods times a million rather than in µs, which needs no division.
        let most_us = u64::from(self.board.delay_us) + MAX_LAG_US;
        let most = most_us * u64::from(self.board.word_rate.hz());
        if lag.saturating_mul(1_000_000) > most && !self.stands() {
            self.fail(Fault::Underrun);
        }
    }

    /// Returns true if an axis moves towards a tripped switch, or makes a step towards it within
    /// the coming tick.
    pub(super) fn runs_onto_a_switch(&self) -> bool {
        let switches = self.switches_to_obey();
        let Some(planner) = &self.planner else {
            return false;
        };
        if switches == [[false; 2]; 3] || planner.has_arrived() {
            return false;
        }
        let onto = |displacements: [i64; 3]| {
            let mut axes = displacements.into_iter().zip(switches);
            axes.any(|(by, [negative, positive])| (negative && by < 0) || (positive && by > 0))
        };
        if onto(planner.speeds()) {
            return true;
        }
        let mut coming = planner.clone();
        let steps = |planner: &Planner| planner.positions().map(|at| i64::from(at.whole_steps()));
        let mut before = steps(planner);
        // An axis keeps its direction within a segment.
        (0..SEGMENTS).any(|_| {
            coming.plan_segment();
            let after = steps(&coming);
            let [x, y, z] = core::mem::replace(&mut before, after);
            let [a, b, c] = after;
            onto([a - x, b - y, c - z])
        })
    }

    pub(super) fn check_heartbeat(&mut self) {
        if self.state.is_commanded() && !self.has_heartbeat() {
            self.fail(Fault::Heartbeat);
        }
    }

    /// Returns true if a ping came within the heartbeat timeout.
    pub(super) fn has_heartbeat(&self) -> bool {
        let longest = self.active.as_ref().map_or(0, Active::heartbeat_ticks);
        self.last_ping_tick
            .is_some_and(|last_ping| self.tick.saturating_sub(last_ping) <= longest)
    }

    /// Latches a fault beside those already latched, and stops.
    pub(super) fn fail(&mut self, fault: Fault) {
        self.faults.insert(fault);
        if fault.is_abrupt() {
            if !self.stands() {
                self.lose_trust();
                self.use_limits();
            }
            self.tracker.reset();
            self.give_up_homing();
            self.state = State::Faulted;
        } else {
            if fault.loses_steps() {
                self.lose_trust();
            }
            self.halt_on_ramp();
        }
    }

    /// Ramps down. [`Machine::settle`] enters the next state when the stage is at rest.
    pub(super) fn halt_on_ramp(&mut self) {
        if let Some(planner) = &mut self.planner {
            planner.stop();
        }
        self.tracker.reset();
        self.give_up_homing();
        if self.state != State::Faulted {
            self.state = State::Stopping;
        }
    }

    /// Enters the state that follows when the stage is at rest.
    pub(super) fn settle(&mut self) {
        if !self.stands() {
            return;
        }
        self.abandoned_switch = None;
        if self.state == State::Moving {
            self.renew_limits();
        }
        self.state = match self.state {
            State::Moving => State::Idle,
            State::Stopping if !self.faults.is_empty() => State::Faulted,
            State::Stopping => State::Stopped,
            state => state,
        };
    }
}
