//! Motions that the commands of this conversation may still keep alive.
//!
//! A host must end every motion that it starts, so it checks [`Motion::may_go_on`] before it closes
//! the line. The result is on the safe side. A motion counts as ended when its command was answered
//! and a status from that control tick or later says that the stage stands, or when a stop was
//! answered; until then it goes on. After the answer to a stop the stage is on its ramp
//! ([`Motion::is_on_its_ramp`]) until a status says that it stands.

use trinocular_core::frame::message::{Command, Status};

/// Number of stops whose answers are recognised: more than are sent before the patience ends.
const STOPS: usize = 256;

/// Latest command that moves the stage, and the stops since.
#[derive(Debug, Default)]
pub(super) struct Motion {
    moving: Option<Moving>,
    /// Motion before the latest command that moves: it goes on if that command is denied.
    before: Option<Moving>,
    /// Sequence numbers of the stops that were sent, the latest last.
    stops: std::collections::VecDeque<u16>,
    stopped_tick: Option<u32>,
    /// Control tick of the answer to the stop that ended a motion, until the stage stands.
    ramp: Option<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Moving {
    sequence: u16,
    /// Control tick of the command's answer.
    answered: Option<u32>,
}

/// Returns true if a command may set the stage in motion.
pub(super) fn moves(command: &Command) -> bool {
    match command {
        Command::Frame(_)
        | Command::Setpoint { .. }
        | Command::Jog { .. }
        | Command::Home { .. } => true,
        Command::Hello
        | Command::Config(_)
        | Command::Zero
        | Command::Stop
        | Command::Reset
        | Command::Ping { .. }
        | Command::Motors { .. }
        | Command::Trigger(_) => false,
    }
}

impl Motion {
    /// Records a command on its way.
    pub fn sent(&mut self, sequence: u16, command: &Command) {
        if moves(command) {
            let moving = Moving {
                sequence,
                answered: None,
            };
            self.before = self.moving.replace(moving);
        }
        if matches!(command, Command::Stop) {
            if self.stops.len() == STOPS {
                self.stops.pop_front();
            }
            self.stops.push_back(sequence);
        } else if !matches!(command, Command::Hello | Command::Ping { .. }) {
            // It may take back an earlier stop: only the answer to a later one counts.
            self.forget_stops();
        }
    }

    /// Records an answer; `is_denied` if it is a denial.
    pub fn answered(&mut self, sequence: u16, tick: u32, is_denied: bool) {
        if self.stops.contains(&sequence) {
            self.stopped_tick.get_or_insert(tick);
            if self.may_go_on() {
                self.ended();
                self.ramp = Some(tick);
            }
        }
        let is_latest = self
            .moving
            .is_some_and(|moving| moving.sequence == sequence);
        if is_latest && is_denied {
            self.moving = self.before.take();
        } else if is_latest {
            self.moving = Some(Moving {
                sequence,
                answered: Some(tick),
            });
        }
    }

    /// Records a status of the station.
    pub fn told(&mut self, status: &Status) {
        if status.state.is_moving() {
            return;
        }
        let is_later = |tick: u32| status.tick.wrapping_sub(tick) <= u32::MAX / 2;
        let stands_since = |moving: &mut Moving| moving.answered.is_some_and(is_later);
        self.moving.take_if(stands_since);
        self.before.take_if(stands_since);
        self.ramp.take_if(|tick| is_later(*tick));
    }

    /// Returns true if the stage may move because of this conversation.
    pub fn may_go_on(&self) -> bool {
        self.moving.is_some()
    }

    /// Returns true if a stop was answered and no status since says that the stage stands.
    pub fn is_on_its_ramp(&self) -> bool {
        self.ramp.is_some()
    }

    /// Returns true if the stage may move because of what was sent: a motion or its ramp.
    pub fn is_open(&self) -> bool {
        self.may_go_on() || self.is_on_its_ramp()
    }

    /// Marks every motion as ended, by other knowledge than a status.
    pub fn ended(&mut self) {
        self.moving = None;
        self.before = None;
        self.ramp = None;
    }

    /// Forgets the stops so far: only answers to later ones count.
    pub fn forget_stops(&mut self) {
        self.stops.clear();
        self.stopped_tick = None;
    }

    /// Returns the control tick of the answer to the first stop since the last command that might
    /// undo it.
    pub fn stopped_tick(&self) -> Option<u32> {
        self.stopped_tick
    }
}

#[cfg(test)]
mod tests;
