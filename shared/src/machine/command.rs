//! Execution of commands, or the reasons for their denial.

use super::Machine;
use super::active::Active;
use super::window::Window;
use crate::fixed::times;
use crate::frame::message::{Command, Config, Denial};
use crate::safety::{Faults, State, Trust};
use crate::track::StepVector;

impl Machine {
    pub(super) fn apply(&mut self, sequence: u16, command: &Command) -> Result<(), Denial> {
        match command {
            Command::Config(config) => self.configure(config),
            Command::Frame(frame) => {
                let outcome = self.follow(sequence, frame);
                let counter = if outcome.is_ok() {
                    &mut self.frames_used
                } else {
                    &mut self.frames_refused
                };
                *counter = counter.wrapping_add(1);
                if outcome.is_ok() {
                    self.rests = self.tick;
                }
                outcome
            }
            Command::Setpoint { position_um } => self.setpoint(*position_um),
            Command::Jog { distance_um } => self.jog(*distance_um),
            Command::Zero => self.zero(),
            Command::Reset => self.reset(),
            Command::Home { axes } => self.home(*axes),
            Command::Motors { on } => self.switch_motors(*on),
            Command::Trigger(trigger) => self.start_triggers(trigger),
            // Handled on arrival.
            Command::Hello | Command::Stop | Command::Ping { .. } => Ok(()),
        }
    }

    fn configure(&mut self, config: &Config) -> Result<(), Denial> {
        self.require_rest()?;
        let active = Active::new(config, self.board.word_rate).map_err(Denial::Config)?;
        let first = self.active.is_none();
        self.rescale(config);
        self.active = Some(active);
        let before = self.position();
        self.use_limits();
        // Another backlash can change the load's position without a step of the motor.
        let after = self.position();
        let jump = core::array::from_fn(|axis| {
            let of = |place: StepVector| place.get(axis).copied().unwrap_or_default();
            of(after).saturating_sub(of(before))
        });
        self.window.shift(jump);
        self.tracker.reset();
        if first {
            self.motors = true;
            self.rests = self.tick;
        }
        if matches!(self.state, State::Unconfigured | State::Following) {
            self.state = State::Idle;
        }
        Ok(())
    }

    /// Converts positions to the steps of a new configuration. A known position becomes unknown
    /// when its scale changes.
    fn rescale(&mut self, new: &Config) {
        let old = self.active.as_ref().map(|active| active.config.axes);
        let Some(old) = old else { return };
        let at = self.position();
        let mut changed = false;
        for (axis, ((old, new), at)) in old.iter().zip(&new.axes).zip(at).enumerate() {
            let scales = [old.steps_per_m, new.steps_per_m];
            let turned = old.invert != new.invert;
            if scales[0] != scales[1] || turned {
                changed = true;
                self.window.rescale(axis, at, scales, turned);
            }
        }
        if changed {
            self.lose_trust();
        }
    }

    /// Marks the position as no longer trusted.
    pub(super) fn lose_trust(&mut self) {
        if self.trust == Trust::Homed {
            self.trust = Trust::Degraded;
            self.window = Window::around(self.position());
        }
        self.referenced = [false; 3];
    }

    fn zero(&mut self) -> Result<(), Denial> {
        self.require_rest()?;
        let planner = self.planner.as_ref().ok_or(Denial::Unconfigured)?;
        if self.state == State::Faulted {
            return Err(Denial::Faulted);
        }
        if !self.motors {
            return Err(Denial::MotorsOff);
        }
        let by = planner.loads().map(|p| -i64::from(p.whole_steps()));
        self.move_origin(by);
        self.referenced = [true; 3];
        self.trust = Trust::Homed;
        self.use_limits();
        self.tracker.reset();
        if self.state == State::Following {
            self.state = State::Idle;
        }
        Ok(())
    }

    /// Moves the origin at rest: every position grows by `by_steps`. Only whole steps, so that the
    /// generator's phase stays the same.
    pub(super) fn move_origin(&mut self, by_steps: [i64; 3]) {
        if let Some(planner) = &mut self.planner {
            *planner = planner.shifted(by_steps);
        }
        self.history
            .shift(by_steps.map(|steps| times(steps, 1 << 32)));
    }

    fn reset(&mut self) -> Result<(), Denial> {
        self.require_rest()?;
        if self.forbidden {
            return Err(Denial::CauseRemains);
        }
        if !self.faults.is_within(self.reported_faults) {
            return Err(Denial::FaultUnread);
        }
        self.faults = Faults::NONE;
        // Homing may have left other limits.
        self.use_limits();
        self.tracker.reset();
        self.state = if self.active.is_some() {
            State::Idle
        } else {
            State::Unconfigured
        };
        Ok(())
    }

    pub(super) fn require_rest(&self) -> Result<(), Denial> {
        match self.stands() && self.state != State::Homing {
            true => Ok(()),
            false => Err(Denial::Moving),
        }
    }

    pub(super) fn require_ready(&self) -> Result<(), Denial> {
        match self.state {
            State::Unconfigured => Err(Denial::Unconfigured),
            State::Stopping | State::Stopped => Err(Denial::Stopped),
            State::Faulted => Err(Denial::Faulted),
            State::Homing => Err(Denial::Moving),
            State::Idle | State::Moving | State::Following if !self.motors => {
                Err(Denial::MotorsOff)
            }
            State::Idle | State::Moving | State::Following => self.require_heartbeat(),
        }
    }

    fn require_heartbeat(&self) -> Result<(), Denial> {
        match self.has_heartbeat() {
            true => Ok(()),
            false => Err(Denial::NoHeartbeat),
        }
    }

    pub(super) fn require_homed(&self) -> Result<(), Denial> {
        match self.trust {
            Trust::Homed => Ok(()),
            Trust::Unknown | Trust::Degraded => Err(Denial::PositionUnknown),
        }
    }
}
