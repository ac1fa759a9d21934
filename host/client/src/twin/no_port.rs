//! The twin on a port where there are no pseudo-terminals.

use crate::StationError;
use std::time::Instant;
use trinocular_rig::rig_file::Stage;

/// Station in real time; this system has none.
#[derive(Debug)]
pub struct TwinOnPort {
    never: std::convert::Infallible,
}

impl TwinOnPort {
    /// Switches a station on.
    ///
    /// # Errors
    /// Always: this system has no pseudo-terminals.
    pub fn start(_: &Stage) -> Result<Self, StationError> {
        Err(StationError::Port {
            path: "the built-in twin".to_owned(),
            reason: "it needs a pseudo-terminal, which this system does not have; name a --port"
                .to_owned(),
        })
    }

    /// Returns the path of the port that leads to the station.
    pub fn path(&self) -> &str {
        match self.never {}
    }

    /// Returns the steps that the pins made since the start.
    pub fn steps(&self) -> [i64; 3] {
        match self.never {}
    }

    /// Returns the steps, and the instant at which the pins had made them.
    pub fn steps_at(&self) -> ([i64; 3], Instant) {
        match self.never {}
    }

    /// Returns the time of the last edge at the step pins.
    pub fn last_edge(&self) -> Instant {
        match self.never {}
    }
}
