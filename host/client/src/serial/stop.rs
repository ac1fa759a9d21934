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
use super::super::allowance::{Allowance, Running};
use super::{Serial, Shared};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use trinocular_core::safety::State;
use trinocular_rig::notice;

/// Time for which a stop is repeated.
pub(super) const STOP_PATIENCE: Duration = Duration::from_secs(2);

// The two are statics, because a `Serial` stops the stage when it is dropped, in a panic too, and
// the program chooses its exit code when no `Serial` is left.

/// True once a stage was stopped because a run ended in motion.
static HAS_STOPPED: AtomicBool = AtomicBool::new(false);
/// True once a run ended without knowing that the stage stands.
static IS_UNKNOWN: AtomicBool = AtomicBool::new(false);

/// Condition in which the runs of this program have left the stages of their stations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// At rest, by themselves or by a stop of the command.
    Quiet,
    /// At rest, because a [`Serial`] was dropped in motion and stopped the stage.
    Stopped,
    /// Perhaps in motion.
    Unknown,
}

/// Returns the worst ending of all runs so far.
pub fn ending() -> Ending {
    if IS_UNKNOWN.load(Ordering::Relaxed) {
        Ending::Unknown
    } else if HAS_STOPPED.load(Ordering::Relaxed) {
        Ending::Stopped
    } else {
        Ending::Quiet
    }
}

/// Progress of a stop.
#[derive(Clone, Copy, Debug, Default)]
pub(super) enum Stop {
    /// Not wanted, or followed by a command that may move the stage.
    #[default]
    None,
    /// Being repeated: start, next packet, and number of stops sent.
    Asked {
        since: Instant,
        next: Instant,
        sent: u32,
    },
    /// Answered by the station.
    Answered,
    /// Given up after `sent` stops, and the heartbeat with it.
    Unanswered { sent: u32 },
}

/// Handle that stops the stage of a [`Serial`] from any thread.
#[derive(Clone)]
pub struct Stopper {
    shared: Arc<Shared>,
}

impl std::fmt::Debug for Stopper {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Stopper").finish_non_exhaustive()
    }
}

impl Stopper {
    /// Stops the stage at once, in the name of `by`. The stop is repeated until it is answered, and
    /// from now on every call of the [`Serial`] that waits or moves fails with
    /// [`StationError::StoppedByOther`].
    pub fn stop(&self, by: &str) {
        self.shared.line().stop_for(by.to_owned());
    }

    /// Waits until the station has answered the stop.
    ///
    /// # Errors
    /// As [`Serial::stop`].
    pub fn until_stopped(&self) -> Result<(), StationError> {
        self.shared.until_stopped()
    }
}

impl Shared {
    fn until_stopped(&self) -> Result<(), StationError> {
        loop {
            {
                let mut line = self.line();
                line.attend();
                match line.stop {
                    // The answer had come before this call, and a command has followed it.
                    Stop::None | Stop::Answered => return Ok(()),
                    Stop::Unanswered { sent } => return Err(StationError::Unstopped { sent }),
                    Stop::Asked { .. } if !line.is_up() => return line.check_link(),
                    Stop::Asked { .. } => {}
                }
            }
            std::thread::sleep(super::LOOK);
        }
    }
}

impl Serial {
    /// Returns a handle that stops the stage from any thread.
    pub fn stopper(&self) -> Stopper {
        Stopper {
            shared: Arc::clone(&self.shared),
        }
    }

    /// Lets commands move the stage again after a [`Stopper`] has stopped it. The station itself
    /// stays stopped until a reset.
    pub fn forgive_stop(&mut self) {
        self.shared.line().stopped_by = None;
    }

    /// Stops the stage: sends stop every 30 ms until one is answered. From then on the calls that
    /// wait report no signals.
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

    pub(super) fn until_stopped(&self) -> Result<(), StationError> {
        self.shared.until_stopped()
    }

    /// Waits until the station says that the stage stands after a stop that it has answered,
    /// whatever signals come and however the line was before.
    ///
    /// # Errors
    /// [`StationError::Restless`] if the station does not say so; [`StationError::Lost`] if the
    /// line is down.
    pub fn until_rest(&mut self) -> Result<State, StationError> {
        let mut ramp = Allowance::RAMP.start(Instant::now());
        loop {
            if let Some(state) = self.stands(&mut ramp)? {
                return Ok(state);
            }
            std::thread::sleep(super::LOOK);
        }
    }

    /// Looks once for what [`Serial::until_rest`] waits for; `ramp` has the time limits,
    /// [`Allowance::RAMP`] from the answer on. Returns `None` while the stage moves.
    ///
    /// # Errors
    /// As [`Serial::until_rest`].
    pub fn stands(&mut self, ramp: &mut Running) -> Result<Option<State>, StationError> {
        let mut line = self.shared.line();
        line.attend();
        if !line.is_up() {
            return Err(line
                .check()
                .err()
                .unwrap_or(StationError::Restless { waited_s: 0 }));
        }
        let client = &mut line.client;
        let status = client.status().copied();
        let motion = client.motion();
        if let Some(status) = &status
            && !motion.is_open()
            && !status.state.is_moving()
        {
            let is_later = |tick| status.tick.wrapping_sub(tick) <= u32::MAX / 2;
            if motion.stopped_tick().is_none_or(is_later) {
                return Ok(Some(status.state));
            }
        }
        if let Some(waited) = ramp.spent(Instant::now(), status.as_ref()) {
            // The caller gets the error. A second wait at the end of the run would add nothing.
            client.motion_mut().ended();
            return Err(self.unknown_rest(waited));
        }
        Ok(None)
    }

    fn unknown_rest(&self, waited: Duration) -> StationError {
        let waited_s = waited.as_secs();
        IS_UNKNOWN.store(true, Ordering::Relaxed);
        StationError::Restless { waited_s }
    }

    /// Stops a stage that may still move because of this conversation, and reports it, as dropping
    /// the connection does. Waits until a stage that was stopped stands.
    pub fn end_motion(&mut self) {
        let may_go_on = {
            let line = self.shared.line();
            let motion = line.client.motion();
            let may_go_on = motion.may_go_on();
            if matches!(line.stop, Stop::Unanswered { .. }) {
                // The error of that stop has said so.
                IS_UNKNOWN.store(true, Ordering::Relaxed);
                return;
            }
            if !motion.is_open() {
                return;
            }
            if !line.is_up() {
                // The run ended for that very reason, and its error says what the station does.
                IS_UNKNOWN.store(true, Ordering::Relaxed);
                return;
            }
            may_go_on
        };
        let path = self.path();
        match self.stop().and_then(|()| self.until_rest()) {
            // A stop of the command's own, or of a signal: its ramp has ended.
            Ok(_) if !may_go_on || self.ends_with_station => return,
            Ok(State::Stopped) => notice!(
                "{path}: the run ended in motion, so the stage was stopped on its ramp and stands; \
                 `trinocular reset` lets it move again"
            ),
            Ok(_) => notice!("{path}: the run ended in motion; the stage stands"),
            Err(error) => {
                IS_UNKNOWN.store(true, Ordering::Relaxed);
                notice!("{path}: the run ended in motion: {error}");
            }
        }
        HAS_STOPPED.store(true, Ordering::Relaxed);
    }
}
