//! Actions that pages ask for, and their outcomes.

use super::super::ServoError;
use super::desk::{PAGE, Request};
use super::{Bench, Outcome, REST_PATIENCE, Reset, Workbench};
use std::time::Instant as HostInstant;
use trinocular_client::below_step::check_steps;
use trinocular_client::serial::in_words;
use trinocular_client::shortened::shortened;
use trinocular_client::{StationError, diagnosis};
use trinocular_core::frame::message::{Command, Denial, Status};
use trinocular_core::safety::State;
use trinocular_live::controls::{Action, Reply};

/// Refusal of a jog in motion.
const STILL_MOVES: &str =
    "the stage still moves: wait until it stands, or stop it; this jog was not done";

/// Refusal of a request that the run did not come to in time.
const STALE: &str = "the run came to this too late, so it was not done: see what the stage does, \
                     and send it again";

impl<B: Bench> Workbench<B> {
    /// Does what a page asks for, and answers it.
    pub(super) fn act(&mut self, request: Request) -> Result<(), ServoError> {
        let is_stale = request.is_stale();
        let Request { action, reply, .. } = request;
        if is_stale {
            reply.send(Err(STALE.to_owned()));
            return Ok(());
        }
        match action {
            Action::Reset {} if self.servo.is_some() => {
                reply.send(self.refuse("end following first"));
            }
            Action::Reset {} => self.begin_reset(Some(reply)),
            Action::Follow { on: true } if self.servo.is_none() => match self.begin() {
                Ok(()) => self.starting = Some(reply),
                refused => reply.send(refused),
            },
            Action::Mark { text } => {
                reply.send(Ok(()));
                self.recording.event("mark", &text);
                self.hub.mark(text);
            }
            action => {
                let words = self.in_words(&action);
                let outcome = self.perform(action)?;
                if let (Ok(()), Some(words)) = (&outcome, words) {
                    self.record_deed(&words);
                }
                reply.send(outcome);
            }
        }
        Ok(())
    }

    /// Returns the command that a page asks for, in words, for a recording.
    fn in_words(&self, action: &Action) -> Option<String> {
        let command = match *action {
            Action::Jog { distance_um } => Command::Jog { distance_um },
            Action::Zero {} => Command::Zero,
            Action::Home {} => self.homing(),
            Action::MotorsOn {} => Command::Motors { on: true },
            _ => return None,
        };
        in_words(&command)
    }

    fn homing(&self) -> Command {
        let axes = self.stage.care.home.map(|home| home.is_some());
        Command::Home { axes }
    }

    /// Notes in the recording what this program's page has done.
    fn record_deed(&self, what: &str) {
        self.recording.event("page", &format!("{what}, by {PAGE}"));
    }

    fn begin_reset(&mut self, reply: Option<Reply>) {
        self.cancel_reset("another reset follows");
        let deadline = HostInstant::now() + REST_PATIENCE;
        self.reset = Some(Reset { deadline, reply });
    }

    /// Does an action whose outcome is known at its end.
    fn perform(&mut self, action: Action) -> Result<Outcome, ServoError> {
        match action {
            Action::Stop {} => {
                // A reset from before the stop must not undo it.
                self.cancel_reset("a stop came after it");
                // Stopped already from the thread of the page; this notices it if nothing moves.
                let station = self.bench.station();
                match station.serial().map(|serial| serial.check()) {
                    Some(Err(error)) => self.forgive(error)?,
                    _ => return self.send("stop", Command::Stop),
                }
            }
            Action::Follow { on: false } if self.servo.is_some() => {
                self.end_following("following was ended".to_owned());
                self.hub.note("following ended");
                // A stop and a reset: the stage comes to rest instead of running on to its
                // prediction, and is ready again.
                let stopped = self.send("stop", Command::Stop)?;
                self.begin_reset(None);
                return Ok(stopped);
            }
            Action::Record { on } => return Ok(self.record(on)),
            Action::Jog { .. } | Action::Zero {} | Action::Home {} | Action::MotorsOn {}
                if self.servo.is_some() =>
            {
                return Ok(self.refuse("end following first"));
            }
            Action::Jog { .. } if self.is_moving() => return Ok(self.refuse(STILL_MOVES)),
            Action::Jog { distance_um } => return self.jog(distance_um),
            Action::Zero {} => {
                let outcome = self.drive("zero", Command::Zero)?;
                if outcome.is_ok() {
                    self.hub.note("zero is here");
                }
                return Ok(outcome);
            }
            Action::Home {} => return self.drive("home", self.homing()),
            Action::MotorsOn {} => return self.drive("motors", Command::Motors { on: true }),
            // Following is as it should be already; the others have their own ways.
            Action::Follow { .. } | Action::Reset {} | Action::Mark { .. } => {}
        }
        Ok(Ok(()))
    }

    /// Moves the stage by a distance; warns if soft limits shorten it.
    fn jog(&mut self, distance_um: [i32; 3]) -> Result<Outcome, ServoError> {
        if let Err(below) = check_steps(&self.stage, distance_um) {
            return Ok(self.refuse(&below.to_string()));
        }
        let before = self.fresh_status();
        let outcome = self.drive("jog", Command::Jog { distance_um })?;
        if outcome.is_ok()
            && let Some((before, now)) = before.zip(self.fresh_status())
        {
            let [from, to] = [before.position_steps, now.target_steps];
            let steps = core::array::from_fn(|axis| to[axis].wrapping_sub(from[axis]));
            for short in shortened(&self.stage, distance_um, steps) {
                self.hub.warn(short.to_string());
            }
        }
        Ok(outcome)
    }

    fn refuse(&self, reason: &str) -> Outcome {
        self.hub.warn(reason);
        Err(reason.to_owned())
    }

    fn is_moving(&mut self) -> bool {
        let station = self.bench.station();
        match station.serial() {
            Some(serial) => serial.is_moving(),
            None => station
                .status()
                .is_some_and(|status| status.state.is_moving()),
        }
    }

    /// Sends a command that needs the station for this run.
    fn drive(&mut self, name: &'static str, command: Command) -> Result<Outcome, ServoError> {
        let outcome = match self.take_over() {
            Ok(()) => self.send(name, command)?,
            refused => refused,
        };
        self.share();
        Ok(outcome)
    }

    /// Sends a command and waits for the answer; a refusal also becomes a warning on the page.
    fn send(&mut self, name: &'static str, command: Command) -> Result<Outcome, ServoError> {
        match self.bench.station().command(name, command) {
            Ok(()) => Ok(Ok(())),
            Err(error @ StationError::Denied { denial, .. }) => {
                Ok(Err(self.refused(&error, denial)))
            }
            Err(error) => {
                let reason = error.to_string();
                self.forgive(error)?;
                Ok(Err(reason))
            }
        }
    }

    /// Warns of a refusal, with its remedy; returns both in words.
    pub(super) fn refused(&self, error: &StationError, denial: Denial) -> String {
        let remedy = diagnosis::remedy(denial).map(|remedy| format!("; {remedy}"));
        let text = format!("{error}{}", remedy.unwrap_or_default());
        self.hub.warn(text.clone());
        text
    }

    /// Resets the station once its stage stands.
    pub(super) fn try_reset(&mut self) -> Result<(), ServoError> {
        let Some(end) = self.reset.as_ref().map(|reset| reset.deadline) else {
            return Ok(());
        };
        let station = self.bench.station();
        let state = station.status().map(|status: Status| status.state);
        let is_on_its_ramp = matches!(state, None | Some(State::Stopping));
        if is_on_its_ramp && HostInstant::now() < end {
            return Ok(());
        }
        let outcome = match station.command("reset", Command::Reset) {
            Err(error) if error.is_passing() && HostInstant::now() < end => {
                let fresh = self.fresh_status();
                let status = fresh.or_else(|| self.bench.station().status());
                match error.reset_may_wait(status.as_ref()) {
                    true => return Ok(()),
                    false => Err(error),
                }
            }
            outcome => outcome,
        };
        let reply = self.reset.take().and_then(|reset| reset.reply);
        let outcome = match outcome {
            Ok(()) => {
                self.record_deed("reset");
                Ok(())
            }
            Err(error @ StationError::Denied { denial, .. }) => Err(self.refused(&error, denial)),
            Err(error) => {
                let reason = error.to_string();
                self.forgive(error)?;
                Err(reason)
            }
        };
        if let Some(reply) = reply {
            reply.send(outcome);
        }
        Ok(())
    }
}
