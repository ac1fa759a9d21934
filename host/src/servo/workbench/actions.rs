//! Actions that pages ask for, and their outcomes.

use super::super::ServoError;
use super::desk::{PAGE, Request};
use super::{Bench, Outcome, REST_PATIENCE, Reset, Workbench};
use std::time::Instant as HostInstant;
use trinocular_client::below_step::check_steps;
use trinocular_client::serial::in_words;
use trinocular_client::shortened::shortened;
use trinocular_client::travel::check_travel;
use trinocular_client::{StationError, diagnosis};
use trinocular_core::frame::message::{Command, Denial, Status};
use trinocular_core::safety::{State, Trust};
use trinocular_live::controls::{Action, Reply};
use trinocular_rig::printable::printable;

/// Refusal of a motion while another is under way.
const STILL_MOVES: &str =
    "the stage still moves: wait until it stands, or stop it; this motion was not done";

/// Refusal of a request that the run did not come to in time.
const STALE: &str = "the run came to this too late, so it was not done: see what the stage does, \
                     and send it again";

impl<B: Bench> Workbench<B> {
    /// Does what a page asks for, and answers it.
    pub(super) fn act(&mut self, request: Request) -> Result<(), ServoError> {
        let is_stale = request.is_stale();
        let Request {
            action, reply, by, ..
        } = request;
        if is_stale {
            reply.send(Err(STALE.to_owned()));
            return Ok(());
        }
        match action {
            Action::Reset {} if self.servo.is_some() => {
                reply.send(self.refuse("end following first"));
            }
            Action::Reset {} => self.begin_reset(Some(reply), by),
            Action::Follow { on: true } if self.servo.is_none() => match self.begin() {
                Ok(()) => {
                    self.starting = Some(reply);
                    self.note_deed("following started", by);
                }
                refused => reply.send(refused),
            },
            Action::Mark { text } => {
                let text = printable(&text);
                reply.send(Ok(()));
                self.recording.event("mark", &text);
                self.hub.mark(text);
            }
            action => {
                let words = self.in_words(&action);
                let outcome = self.perform(action, by)?;
                if let (Ok(()), Some(words)) = (&outcome, words) {
                    self.note_deed(&words, by);
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
            Action::Go { position_um } => {
                let [x, y, z] = position_um.map(|um| f64::from(um) / 1e3);
                return Some(format!("go to x={x} y={y} z={z} mm"));
            }
            _ => return None,
        };
        in_words(&command)
    }

    fn homing(&self) -> Command {
        let axes = self.stage.care.has_home();
        Command::Home { axes }
    }

    /// Notes on all pages and in the recording what was done, and by whom.
    fn note_deed(&self, what: &str, by: &str) {
        let deed = format!("{what}, by {by}");
        self.recording.event("page", &deed);
        self.hub.note(deed);
    }

    fn begin_reset(&mut self, reply: Option<Reply>, by: &'static str) {
        self.cancel_reset("another reset follows");
        let deadline = HostInstant::now() + REST_PATIENCE;
        self.reset = Some(Reset {
            deadline,
            by,
            reply,
        });
    }

    /// Does an action whose outcome is known at its end.
    fn perform(&mut self, action: Action, by: &'static str) -> Result<Outcome, ServoError> {
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
                self.note_deed("following ended", by);
                // A stop and a reset: the stage comes to rest instead of running on to its
                // prediction, and is ready again.
                let stopped = self.send("stop", Command::Stop)?;
                self.begin_reset(None, by);
                return Ok(stopped);
            }
            Action::Record { on } => return Ok(self.record(on)),
            Action::Jog { .. }
            | Action::Go { .. }
            | Action::Zero {}
            | Action::Home {}
            | Action::MotorsOn {}
                if self.servo.is_some() =>
            {
                return Ok(self.refuse("end following first"));
            }
            Action::Jog { .. } | Action::Go { .. } if self.is_moving() => {
                return Ok(self.refuse(STILL_MOVES));
            }
            Action::Jog { distance_um } => return self.jog(distance_um),
            Action::Go { position_um } => return self.go(position_um),
            Action::Zero {} => return self.drive("zero", Command::Zero),
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

    /// Moves the stage to a position along its axes, which must lie within the soft limits.
    fn go(&mut self, position_um: [i32; 3]) -> Result<Outcome, ServoError> {
        let fresh = self.fresh_status();
        let Some(status) = fresh.or_else(|| self.bench.station().status()) else {
            return Ok(self.refuse("the station has not said yet where the stage is"));
        };
        if status.state != State::Idle || !status.motors {
            let state = diagnosis::state(status.state).name;
            let next = diagnosis::next_step(&status).unwrap_or_default();
            return Ok(self.refuse(&format!("the station is {state}; to do: {next}")));
        }
        if status.trust != Trust::Homed {
            return Ok(
                self.refuse("the station does not know where the stage is: zero or home it first")
            );
        }
        if let Err(beyond) = check_travel(&self.stage, position_um.map(|um| f64::from(um) / 1e3)) {
            return Ok(self.refuse(&beyond.to_string()));
        }
        // To the nearest step of the position: an axis that is there stays.
        let distance_um = core::array::from_fn(|axis| {
            let um_per_step = 1e3 / self.stage.steps_per_mm[axis];
            let steps = (f64::from(position_um[axis]) / um_per_step).round();
            let away = steps - f64::from(status.position_steps[axis]);
            (away * um_per_step).round() as i32
        });
        match distance_um {
            [0, 0, 0] => Ok(Ok(())),
            distance_um => self.jog(distance_um),
        }
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
        let (reply, by) = match self.reset.take() {
            Some(reset) => (reset.reply, reset.by),
            None => (None, PAGE),
        };
        let outcome = match outcome {
            Ok(()) => {
                self.note_deed("reset", by);
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
