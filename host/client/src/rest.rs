//! Waiting until a stage that a command moves stands by itself.
//!
//! A station may report "moving" for ever, or report nothing any more: [`RestWatch`] gives both up.
//! [`ended`] says how the motion ended.

use super::StationError;
use super::allowance::{Allowance, Running};
use std::time::{Duration, Instant};
use trinocular_core::frame::message::Status;
use trinocular_core::safety::State;

/// Timeout for the status of a station in motion: twenty come in that time.
const STATUS_PATIENCE: Duration = Duration::from_secs(2);

/// Watch over a motion by the station's status.
#[derive(Clone, Copy, Debug)]
pub struct RestWatch {
    running: Running,
    /// Tick of the latest status, and when it came.
    latest: Option<u32>,
    heard: Instant,
}

impl RestWatch {
    /// Starts to watch a motion with these time limits.
    pub fn begin(allowance: Allowance, now: Instant) -> Self {
        Self {
            running: allowance.start(now),
            latest: None,
            heard: now,
        }
    }

    /// Takes in the latest status, which may be an old one; returns true once the stage stands.
    ///
    /// # Errors
    /// [`StationError::Overdue`] if the motion exceeds a limit: the caller has to stop it.
    /// [`StationError::Silent`] if no new status came for two seconds.
    pub fn is_over(&mut self, now: Instant, status: &Status) -> Result<bool, StationError> {
        if !status.state.is_moving() {
            return Ok(true);
        }
        if let Some(waited) = self.running.spent(now, Some(status)) {
            let waited_s = waited.as_secs();
            return Err(StationError::Overdue { waited_s });
        }
        if self.latest.replace(status.tick) != Some(status.tick) {
            self.heard = now;
        } else if now.duration_since(self.heard) > STATUS_PATIENCE {
            return Err(StationError::Silent {
                command: "status",
                waited_ms: STATUS_PATIENCE.as_millis() as u64,
            });
        }
        Ok(false)
    }
}

/// Returns true if a stage that stands was stopped by a command, false if its motion has ended by
/// itself. `port` is the path that errors name.
///
/// # Errors
/// [`StationError::Faulted`] with the station's fault; [`StationError::Restarted`] if the station
/// has lost its configuration.
pub fn ended(status: &Status, port: &str) -> Result<bool, StationError> {
    if let Some(fault) = status.fault {
        return Err(StationError::Faulted(fault));
    }
    if status.state == State::Unconfigured {
        // No command takes a configuration away.
        return Err(StationError::Restarted {
            path: port.to_owned(),
            cause: "in motion",
        });
    }
    Ok(status.state == State::Stopped)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::default_stage;
    use crate::twin::Twin;
    use trinocular_core::frame::message::Mounting;
    use trinocular_core::safety::Fault;

    fn status(state: State, tick: u32) -> Status {
        let twin = Twin::start(&default_stage(), "twin", Mounting::OnStage).unwrap();
        let status = *twin.status().unwrap();
        Status {
            state,
            tick,
            fault: None,
            ..status
        }
    }

    #[test]
    fn silent_and_endless_motions_are_given_up() {
        let start = Instant::now();
        let at = |seconds| start + Duration::from_secs(seconds);
        let mut watch = RestWatch::begin(Allowance::RAMP, start);
        let moving = |tick| status(State::Moving, tick);
        assert!(matches!(watch.is_over(at(1), &moving(7)), Ok(false)));
        assert!(matches!(watch.is_over(at(2), &moving(7)), Ok(false)));
        let silent = watch.is_over(at(4), &moving(7));
        assert!(matches!(silent, Err(StationError::Silent { .. })));
        assert!(matches!(watch.is_over(at(5), &moving(8)), Ok(false)));
        let overdue = watch.is_over(at(12), &moving(9));
        assert!(matches!(overdue, Err(StationError::Overdue { .. })));
        let stands = watch.is_over(at(12), &status(State::Idle, 10));
        assert!(matches!(stands, Ok(true)));
    }

    #[test]
    fn end_of_motion_has_its_cause() {
        let end = |state| ended(&status(state, 1), "/dev/ttyACM0");
        assert!(matches!(end(State::Idle), Ok(false)));
        assert!(matches!(end(State::Stopped), Ok(true)));
        let restarted = end(State::Unconfigured).unwrap_err().to_string();
        assert!(restarted.starts_with("/dev/ttyACM0: the station restarted"));
        let faulted = Status {
            fault: Some(Fault::Restart),
            ..status(State::Stopped, 1)
        };
        let found = ended(&faulted, "port");
        assert!(matches!(found, Err(StationError::Faulted(Fault::Restart))));
    }
}
