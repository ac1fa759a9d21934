//! What a command does, or why it is denied.

use super::Machine;
use super::active::Active;
use crate::fixed::{narrow, times};
use crate::frame::message::{Command, Config, Denial};
use crate::motion::{Limits, Planner};
use crate::safety::{Fault, State, Trust};
use crate::steps::Position;
use crate::track::{Fine, add};

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
                outcome
            }
            Command::Setpoint { position_um } => self.setpoint(*position_um),
            Command::Jog { distance_um } => self.jog(*distance_um),
            Command::Zero => self.zero(),
            Command::Reset => self.reset(),
            Command::Home { axes } => self.home(*axes),
            // Handled on arrival.
            Command::Hello | Command::Stop | Command::Ping { .. } => Ok(()),
        }
    }

    fn configure(&mut self, config: &Config) -> Result<(), Denial> {
        self.require_rest()?;
        let active = Active::new(config, self.board.word_rate).map_err(Denial::Config)?;
        let same_scale = self.active.as_ref().is_some_and(|old| {
            let scale = |config: &Config| config.axes.map(|axis| (axis.steps_per_m, axis.invert));
            scale(&old.config) == scale(config)
        });
        self.active = Some(active);
        if !same_scale {
            self.lose_trust();
        }
        self.use_limits();
        self.tracker.reset();
        if self.state == State::Unconfigured {
            self.state = State::Idle;
        }
        Ok(())
    }

    /// Plans anew from where the stage stands, with the limits that go with the present trust.
    pub(super) fn use_limits(&mut self) {
        let Some(active) = &self.active else { return };
        let limits = if self.trust == Trust::Homed {
            active.limits
        } else {
            active.slow
        };
        self.limit_to(limits);
    }

    /// Plans anew from where the stage stands, with these limits.
    pub(super) fn limit_to(&mut self, limits: Limits) {
        self.planner = Some(match &self.planner {
            Some(planner) => planner.relimited(limits),
            None => Planner::new(limits, [Position::centre(0); 3]),
        });
    }

    /// What is known of the position holds no more.
    pub(super) fn lose_trust(&mut self) {
        if self.trust == Trust::Homed {
            self.trust = Trust::Degraded;
        }
        self.referenced = [false; 3];
        self.anchor = self.position();
    }

    fn setpoint(&mut self, position_um: [i32; 3]) -> Result<(), Denial> {
        self.require_ready()?;
        self.require_homed()?;
        let active = self.active.as_ref().ok_or(Denial::Unconfigured)?;
        let target = active.fine_from_um(position_um);
        self.go(target, State::Moving)?;
        self.tracker.reset();
        Ok(())
    }

    fn jog(&mut self, distance_um: [i32; 3]) -> Result<(), Denial> {
        self.require_ready()?;
        let active = self.active.as_ref().ok_or(Denial::Unconfigured)?;
        let distance = active.fine_from_um(distance_um);
        let window = active.fine_from_um([narrow(active.config.stage.window_um.into()); 3]);
        let from = self.position();
        let target = add(from, distance);
        if self.trust != Trust::Homed && !is_near(self.anchor, from, target, window) {
            return Err(Denial::OutsideWindow);
        }
        self.go(target, State::Moving)?;
        self.tracker.reset();
        Ok(())
    }

    /// Sends the stage to `target`, 2⁻³² steps from zero, rounded to whole steps and clamped to the soft limits.
    pub(super) fn go(&mut self, target: Fine, state: State) -> Result<(), Denial> {
        let target = target.map(to_centre);
        self.require_free_way(target)?;
        let planner = self.planner.as_mut().ok_or(Denial::Unconfigured)?;
        planner.move_in_step(target);
        self.state = state;
        Ok(())
    }

    fn zero(&mut self) -> Result<(), Denial> {
        self.require_rest()?;
        let planner = self.planner.as_ref().ok_or(Denial::Unconfigured)?;
        let by = planner.loads().map(|p| -i64::from(p.whole_steps()));
        self.move_origin(by);
        self.referenced = [true; 3];
        self.trust = Trust::Homed;
        self.use_limits();
        self.tracker.reset();
        Ok(())
    }

    /// At rest: every position grows by these. Whole steps only: the generator's phase stays as it is.
    pub(super) fn move_origin(&mut self, by_steps: [i64; 3]) {
        if let Some(planner) = &mut self.planner {
            *planner = planner.shifted(by_steps);
        }
        self.history
            .shift(by_steps.map(|steps| times(steps, 1 << 32)));
    }

    fn reset(&mut self) -> Result<(), Denial> {
        self.require_rest()?;
        let remains = match self.fault {
            Some(Fault::EmergencyStop) => self.inputs.emergency_stop,
            Some(Fault::Driver) => self.inputs.driver_fault,
            _ => false,
        };
        if remains {
            return Err(Denial::CauseRemains);
        }
        self.fault = None;
        // Homing may have left others.
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
            State::Idle | State::Moving | State::Following => Ok(()),
        }
    }

    pub(super) fn require_homed(&self) -> Result<(), Denial> {
        match self.trust {
            Trust::Homed => Ok(()),
            Trust::Unknown | Trust::Degraded => Err(Denial::PositionUnknown),
        }
    }
}

/// Whether no axis goes more than half a step farther than `window` from `anchor`. The way back to it is always open.
fn is_near(anchor: Fine, from: Fine, to: Fine, window: Fine) -> bool {
    let ends = from.into_iter().zip(to);
    let mut axes = ends.zip(anchor.into_iter().zip(window));
    axes.all(|((from, to), (anchor, window))| {
        let far = to.abs_diff(anchor);
        far <= window.unsigned_abs().saturating_add(1 << 31) || far <= from.abs_diff(anchor)
    })
}

/// The resting position nearest to a distance from zero.
pub(super) fn to_centre(fine: i64) -> Position {
    let nearest = Position::from_fine(fine.saturating_add(Position::centre(0).fine()));
    Position::centre(nearest.whole_steps())
}
