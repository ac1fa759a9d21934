//! Station of the page: on a port, or the built-in twin.

use super::ServeOptions;
use crate::commands::failure::Failure;
use std::path::Path;
use trinocular::servo::station_link::{StationLink, StationPlace};
use trinocular_client::diagnosis;
use trinocular_client::twin::TwinOnPort;
use trinocular_core::safety::State;
use trinocular_rig::printable::printable;
use trinocular_rig::rig_file::{RigFile, Stage};

/// Heartbeat timeout of the built-in twin, ms. It moves nothing that a silent host could endanger.
const TWIN_HEARTBEAT_MS: u16 = 5_000;

/// Station of the page: on a port, or the built-in twin in real time.
pub enum Station {
    /// Path of the port.
    Port(String),
    /// The twin, which ends with this value.
    Twin(TwinOnPort),
}

impl Station {
    /// Starts the built-in twin, unless the user has named a port.
    pub fn open(options: &ServeOptions, stage: &Stage) -> Result<Self, Failure> {
        match options.station.resolve()? {
            Some(path) => Ok(Self::Port(path)),
            None => TwinOnPort::start(stage)
                .map(Self::Twin)
                .map_err(|error| Failure::of_station(None, error)),
        }
    }

    /// Returns the path of the port, if the user has named one.
    pub fn port(&self) -> Option<&str> {
        match self {
            Self::Port(path) => Some(path),
            Self::Twin(_) => None,
        }
    }

    /// Returns the place of the station.
    pub fn place<'a>(&'a self, options: &ServeOptions) -> StationPlace<'a> {
        match self {
            Self::Port(path) if options.only_shows() => StationPlace::Shown { path },
            Self::Port(path) => StationPlace::Kept {
                path,
                heartbeat_ms: options.station.heartbeat_ms(),
            },
            Self::Twin(twin) => StationPlace::Port {
                path: twin.path(),
                heartbeat_ms: TWIN_HEARTBEAT_MS,
            },
        }
    }
}

/// Returns the changes at a station on a port that the start of the page has made, in words, and
/// the state in which it is. `stage` is the source of its stage, as [`source`] says.
pub fn arrival(station: &StationLink, options: &ServeOptions, stage: &str) -> String {
    let name = station.name();
    let Some((serial, status)) = station.serial().zip(station.status()) else {
        return format!("{name} has sent no status yet");
    };
    let state = diagnosis::state(status.state);
    let done = match (options.only_shows(), status.state) {
        (true, State::Unconfigured) => format!(
            "{name} has no configuration, and this page gives it none: `trinocular serve \
             --control` and `trinocular jog --rig RIG.toml` do"
        ),
        (true, _) => format!("{name} was not changed, because this page only shows it"),
        (false, _) => format!("{name} was configured with {stage}"),
    };
    let position = match serial.is_zeroed() {
        true => "its present position is zero".to_owned(),
        false => format!("its position is {}", diagnosis::position(status.trust)),
    };
    let condition = match status.state {
        State::Stopped | State::Faulted => {
            format!(
                "; it is {}: {}; to do: {}",
                state.name, state.meaning, state.action
            )
        }
        _ => String::new(),
    };
    let triggers = match station.triggering() {
        Some(trigger) => format!(
            "; it triggers the cameras {} times per second until this page ends, which moves \
             nothing",
            trigger.rate_hz
        ),
        None => String::new(),
    };
    format!("{done}; {position}{condition}{triggers}")
}

/// Returns the origin of the page's mm and limits, in words, if the page does not configure the
/// station: a station does not report its own. `stage` is the source of the page's stage.
pub fn scale(options: &ServeOptions, stage: &str) -> Option<String> {
    options
        .only_shows()
        .then(|| format!("mm and limits are those of {stage}: the station does not report its own"))
}

/// Returns the source of the stage, in words: the rig file if it has a stage.
pub fn source(path: Option<&Path>, rig: &RigFile) -> String {
    match path.filter(|_| rig.stage.is_some()) {
        Some(path) => format!("the stage of {}", printable(path.display())),
        None => {
            "the default stage (80 steps/mm), because no --rig with a [stage] is given".to_owned()
        }
    }
}
