//! A command and its answer over a line that loses packets.
//!
//! Either may be lost, and the host cannot tell which. So a command that may be repeated without
//! harm is repeated until it is answered, each time as a new packet, because the station drops a
//! packet whose number it has seen:
//!
//! * a stop: see [`stop`](super::stop);
//! * a configuration, a zero, motors on or off, and a position to go to: the second time changes
//!   nothing, because whatever is sent later also arrives later;
//! * a reset: only while the station still says that it has the same fault or stop as before, or
//!   the repetition might clear another one that has been latched since;
//! * a jog, a homing or a frame: never, because it would move the stage twice. When such an answer
//!   is lost, the error says what the station's status tells of it.

use super::super::{StationError, diagnosis};
use super::{PATIENCE, Serial};
use std::time::{Duration, Instant};
use trinocular_core::frame::message::{Command, Status};
use trinocular_core::safety::{Fault, State};

/// Time from a command to its repetition. An answer comes within a few ms.
const REPEAT: Duration = Duration::from_millis(200);

/// Rule for repeating a command that was not answered.
enum Repetition {
    Never,
    Always,
    /// Repeat while the station is in this state and has this fault.
    While(State, Option<Fault>),
}

impl Serial {
    /// Sends a command and waits for the answer; repeats it if that does no harm.
    ///
    /// # Errors
    /// [`StationError::Denied`] with the station's reason, [`StationError::Silent`] or
    /// [`StationError::Unanswered`] without an answer; on a line that is or was lost
    /// [`StationError::Lost`], [`StationError::Interrupted`], [`StationError::Restarted`] or
    /// [`StationError::Mismatch`]. For a stop, as [`Serial::stop`].
    pub fn command(&mut self, name: &'static str, command: Command) -> Result<(), StationError> {
        if matches!(command, Command::Stop) {
            return self.stop();
        }
        let before = self.status();
        let repetition = repetition(&command, before.as_ref());
        let end = Instant::now() + PATIENCE;
        let mut sent = vec![self.send(command)];
        loop {
            let pause = match repetition {
                Repetition::Never => end,
                _ => end.min(Instant::now() + REPEAT),
            };
            let answer = self.wait_until(pause, |client| {
                sent.iter().find_map(|sequence| client.answer(*sequence))
            })?;
            match answer {
                Some(Ok(())) => return Ok(()),
                Some(Err(denial)) => {
                    return Err(StationError::Denied {
                        command: name,
                        denial,
                    });
                }
                None if Instant::now() >= end => return Err(self.unanswered(name, before)),
                None if self.may_repeat(&repetition) => sent.push(self.send(command)),
                None => {}
            }
        }
    }

    fn may_repeat(&self, repetition: &Repetition) -> bool {
        match repetition {
            Repetition::Never => false,
            Repetition::Always => true,
            Repetition::While(state, fault) => self
                .status()
                .is_some_and(|status| status.state == *state && status.fault == *fault),
        }
    }

    /// Returns the error for a command whose answer did not come, with the station's status if
    /// there is one.
    fn unanswered(&self, command: &'static str, before: Option<Status>) -> StationError {
        let waited_ms = PATIENCE.as_millis() as u64;
        let mut line = self.shared.line();
        line.take_in();
        let now = line.client.status_since_hello().copied();
        let (Some(before), Some(now)) = (before, now) else {
            drop(line);
            return self.silence(command, PATIENCE);
        };
        if now.time.since(before.time) < PATIENCE.as_micros() as u64 / 2 {
            drop(line);
            return self.silence(command, PATIENCE);
        }
        if !now.state.is_moving() {
            line.client.motion_mut().ended();
        }
        StationError::Unanswered {
            command,
            waited_ms,
            known: known(&before, &now),
        }
    }
}

fn repetition(command: &Command, before: Option<&Status>) -> Repetition {
    match (command, before) {
        (
            Command::Config(_)
            | Command::Zero
            | Command::Setpoint { .. }
            | Command::Motors { .. }
            | Command::Trigger(_),
            _,
        ) => Repetition::Always,
        (Command::Reset, Some(before)) => Repetition::While(before.state, before.fault),
        _ => Repetition::Never,
    }
}

/// Describes the fate of a command from a status before it and one long after it.
fn known(before: &Status, now: &Status) -> String {
    let state = diagnosis::state(now.state).name;
    let steps = |[x, y, z]: [i32; 3]| format!("{x} {y} {z} steps");
    let (was, is) = (steps(before.position_steps), steps(now.position_steps));
    if now.state.is_moving() {
        let target = steps(now.target_steps);
        return format!(
            "its status came: {state}, now at {is} on the way to {target}, so the command arrived \
             and its answer was lost"
        );
    }
    match before.position_steps == now.position_steps {
        true => format!("its status came: {state} at {is}, where it was before"),
        false => format!(
            "its status came: {state} at {is}, it was at {was} before, so the command arrived \
             and its answer was lost"
        ),
    }
}
