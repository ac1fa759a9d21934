//! A stop that is repeated until it is answered, and the end of every motion by one.
//!
//! A stop may be lost on the line, and the heartbeat would keep the motion alive meanwhile. So the
//! [`Line`](super::line::Line) sends stop after stop until one is answered. If none is, it ends the
//! heartbeat, and the station ramps down by itself.
//!
//! Whatever ends a run, the stage must not go on: an error, a panic, a closed pipe. So a
//! [`Serial`] that is dropped while its commands may still move the stage stops it first. Ctrl-C
//! and the other signals do so at once, whatever the caller is busy with.

use super::super::StationError;
use super::{REST_PATIENCE, Serial};
use crate::notice;
use shared::safety::State;
use std::time::{Duration, Instant};

/// How long stops are repeated.
pub(super) const STOP_PATIENCE: Duration = Duration::from_secs(2);

/// How far a stop is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) enum Stop {
    /// Not wanted, or followed by a command that may move the stage.
    #[default]
    None,
    /// Repeated since, when next, and how many were sent.
    Asked {
        since: Instant,
        next: Instant,
        sent: u32,
    },
    /// The station has answered one.
    Answered,
    /// Given up, and the heartbeat with it, after so many.
    Unanswered { sent: u32 },
}

impl Serial {
    /// Stops the stage: sends stop every 30 ms until one is answered. From then on no signal is
    /// reported by the calls that wait.
    ///
    /// # Errors
    /// [`StationError::Unstopped`] if none is answered within 2 s: then the heartbeat is ended, so
    /// that the station stops by itself. [`StationError::Lost`] if the line is down; then no
    /// heartbeat gets through either.
    pub fn stop(&mut self) -> Result<(), StationError> {
        self.stops = true;
        self.shared.line().begin_stop();
        self.until_stopped()
    }

    fn until_stopped(&self) -> Result<(), StationError> {
        loop {
            {
                let mut line = self.shared.line();
                line.attend();
                match line.stop {
                    // The answer had come before this call, and a command has followed it.
                    Stop::None | Stop::Answered => return Ok(()),
                    Stop::Unanswered { sent } => return Err(StationError::Unstopped { sent }),
                    Stop::Asked { .. } if !line.is_up() => return line.check(),
                    Stop::Asked { .. } => {}
                }
            }
            std::thread::sleep(super::LOOK);
        }
    }

    /// Waits until the station says that the stage stands after a stop.
    fn until_rest(&self) -> Result<State, StationError> {
        let end = Instant::now() + REST_PATIENCE;
        let rest = self.wait_through(end, |client| {
            let tick = client.motion().stopped_tick()?;
            let status = client.status()?;
            let is_later = status.tick.wrapping_sub(tick) <= u32::MAX / 2;
            (is_later && !status.state.is_moving()).then_some(status.state)
        })?;
        rest.ok_or_else(|| self.silence("status", REST_PATIENCE))
    }

    /// Stops a stage that may still move because of this conversation, and says so.
    pub(super) fn end_motion(&mut self) {
        {
            let line = self.shared.line();
            let is_given_up = matches!(line.stop, Stop::Unanswered { .. });
            let motion = line.client.motion();
            if is_given_up || !(motion.may_go_on() || motion.is_on_its_ramp()) {
                return;
            }
        }
        let path = self.path();
        match self.stop().and_then(|()| self.until_rest()) {
            Ok(State::Stopped) => notice!(
                "{path}: the run ended in motion, so the stage was stopped on its ramp and stands; \
                 `trinocular reset` lets it move again"
            ),
            Ok(_) => notice!("{path}: the run ended in motion; the stage stands"),
            // The run ended for that very reason.
            Err(StationError::Lost { .. } | StationError::Interrupted { .. }) => {}
            Err(error) => notice!("{path}: the run ended in motion: {error}"),
        }
    }
}
