//! Switching the motors on and off.
//!
//! The motors are off until the first configuration, and then until they are switched on again
//! after a command or a rest that was long enough. Motors without current can be moved by hand and
//! snap to another step when they are switched on, so the position is no longer trusted.

use super::{Machine, TICK_US};
use crate::frame::message::Denial;
use crate::safety::State;

/// Control ticks per second.
const TICKS_PER_S: u64 = 1_000_000 / TICK_US;

impl Machine {
    pub(super) fn switch_motors(&mut self, on: bool) -> Result<(), Denial> {
        self.require_rest()?;
        if self.active.is_none() {
            return Err(Denial::Unconfigured);
        }
        if on && self.forbidden {
            return Err(Denial::CauseRemains);
        }
        if on {
            self.motors = true;
            self.rests = self.tick;
        } else {
            self.release_motors();
        }
        Ok(())
    }

    /// Switches the motors off after the time at rest that the configuration sets.
    ///
    /// A stage that follows is at rest when it stands and no frame is used: its host may have lost
    /// the cameras or the target while the heartbeat goes on.
    pub(super) fn rest_motors(&mut self) {
        if !self.stands() || matches!(self.state, State::Moving | State::Homing) {
            self.rests = self.tick;
        }
        let Some(active) = &self.active else { return };
        let after_s = u64::from(active.config.stage.motors_off_after_s);
        let rested = self.tick.saturating_sub(self.rests);
        if self.motors && after_s > 0 && rested >= after_s * TICKS_PER_S {
            self.release_motors();
        }
    }

    fn release_motors(&mut self) {
        if self.motors {
            self.motors = false;
            self.lose_trust();
            self.use_limits();
        }
        self.tracker.reset();
        if self.state == State::Following {
            self.state = State::Idle;
        }
    }
}
