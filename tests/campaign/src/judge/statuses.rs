//! Checks of statuses against the observed motion, switches and packets.

use super::Judge;
use crate::laws::Law;
use trinocular_core::frame::message::{Command, Status};
use trinocular_core::safety::{Fault, Faults, State, Trust};

/// Every fault in order of rank: faults that forbid motion, faults that may have lost steps, faults
/// that leave the position valid.
const RANKED: [Fault; 11] = [
    Fault::EmergencyStop,
    Fault::Driver,
    Fault::Limit,
    Fault::Underrun,
    Fault::Restart,
    Fault::LostSteps,
    Fault::SwitchStuck,
    Fault::SwitchNotFound,
    Fault::Unstable,
    Fault::FollowingError,
    Fault::Heartbeat,
];

impl Judge {
    /// Checks a status of the station.
    pub(super) fn told(&mut self, status: &Status) {
        self.note_change(status);
        self.dropped = counted(status);
        self.check_position(status);
        self.check_faults(status);
        self.check_trust(status);
        self.check_stop(status);
        if matches!(status.state, State::Idle | State::Stopped | State::Faulted) {
            // At rest the requested motion has been done or abandoned.
            self.requests.clear();
            self.rested = status.position_steps.map(i64::from);
        }
        self.resting = match status.state {
            state @ (State::Unconfigured | State::Stopped | State::Faulted) => Some(state),
            _ => None,
        };
        self.homing = match status.state {
            State::Homing => true,
            // The stop's ramp may still last.
            State::Stopping => self.homing,
            _ => false,
        };
        self.status = Some(*status);
    }

    fn check_stop(&mut self, status: &Status) {
        let moves = matches!(
            status.state,
            State::Idle | State::Moving | State::Following | State::Homing
        );
        // The tick that obeys has passed.
        if let Some(stop) = self.stop
            && moves
            && self.now_us > stop.obeyed_us
        {
            let state = status.state;
            self.breaks(Law::LastWord, || {
                format!("{state:?} after a stop, without a later reset")
            });
        }
    }

    fn note_change(&self, status: &Status) {
        let key = |status: &Status| {
            (
                status.state,
                status.fault,
                status.trust,
                status.position_steps,
            )
        };
        if self.status.as_ref().map(key) != Some(key(status)) {
            self.note(self.now_us, || {
                let (state, fault, trust) = (status.state, status.fault, status.trust);
                let place = status.position_steps;
                format!(
                    "  status {state:?} {fault:?} {trust:?} at {place:?} to {:?}",
                    status.target_steps
                )
            });
        }
    }

    fn check_position(&mut self, status: &Status) {
        let reported = status.position_steps.map(i64::from);
        let was_homing = self.homing || status.state == State::Homing;
        let zeroes = self
            .sent
            .values()
            .any(|sent| matches!(sent.command, Command::Zero));
        let origin = std::array::from_fn(|axis| self.load[axis] - reported[axis]);
        match self.origin {
            Some(known) if !(was_homing || zeroes && reported == [0; 3]) => {
                self.counts.comparisons += 3;
                let differs = (0..3).find(|axis| {
                    let off = (origin[*axis] - known[*axis]).abs();
                    // Within a tick the motor may have pushed the load by a step that the planner
                    // does not see.
                    off > i64::from(self.play(*axis) > 0)
                });
                if let Some(axis) = differs {
                    let counted = self.load[axis] - known[axis];
                    self.breaks(Law::Position, || {
                        format!(
                            "axis {axis} is reported at {}, counted {counted}",
                            reported[axis]
                        )
                    });
                    self.origin = Some(origin);
                }
            }
            _ => self.origin = Some(origin),
        }
    }

    fn check_faults(&mut self, status: &Status) {
        let named = faults(status);
        let is_named = |fault| named.contains(&fault);
        self.told.extend(&named);
        self.owed.retain(|fault| !is_named(*fault));
        let abrupt = [
            Fault::EmergencyStop,
            Fault::Limit,
            Fault::Driver,
            Fault::Underrun,
        ];
        if abrupt.into_iter().any(is_named) {
            self.named_us = Some(self.now_us);
            self.unnamed_us = None;
        }
        self.counts.comparisons += 2;
        if status.fault != named.first().copied() {
            let shown = status.fault;
            self.breaks(Law::Worst, || {
                format!("of {named:?} the status shows {shown:?}")
            });
        }
        if self.emergency.is_seen() && status.fault != Some(Fault::EmergencyStop) {
            let shown = status.fault;
            self.breaks(Law::Worst, || {
                format!("the emergency stop is pressed, shown is {shown:?}")
            });
        }
    }

    fn check_trust(&mut self, status: &Status) {
        let homed = status.trust == Trust::Homed;
        let ended = self.homing && !matches!(status.state, State::Homing | State::Stopping);
        if homed && ended {
            self.abrupt = false;
        }
        let zeroes = self
            .sent
            .values()
            .any(|sent| matches!(sent.command, Command::Zero));
        self.counts.comparisons += 1;
        if homed && self.abrupt && !self.homing && !zeroes {
            self.breaks(Law::Trust, || {
                "homed after an abrupt end of motion".to_string()
            });
        }
        if self.trust == Trust::Homed && !homed {
            self.anchors = vec![self.mm];
        }
        if ended && !homed {
            // A homed axis has its window around its home switch, from which it has backed off.
            let back_off = self
                .config
                .map_or(0.0, |config| f64::from(config.stage.back_off_um) / 1e3);
            for way in [-back_off, 0.0, back_off] {
                self.anchors.push(self.mm.map(|mm| mm + way));
            }
        }
        self.trust = status.trust;
    }
}

/// Returns the number of commands that the station states it dropped without an answer.
fn counted(status: &Status) -> u64 {
    u64::from(status.drops.overflow) + u64::from(status.drops.answers)
}

/// Returns the faults that a status names.
fn faults(status: &Status) -> Vec<Fault> {
    let all = RANKED.into_iter();
    all.filter(|fault| status.faults.contains(*fault)).collect()
}

/// Removes the faults from a status, as a station that hides them would.
pub fn hide_faults(status: &mut Status) {
    status.fault = None;
    status.faults = Faults::NONE;
}
