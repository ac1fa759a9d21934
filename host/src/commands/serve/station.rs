//! Station of the page: on a port, or the built-in twin.

use super::ServeOptions;
use crate::commands::failure::Failure;
use clap::Args;
use std::path::Path;
use trinocular::servo::station_link::{StationLink, StationPlace};
use trinocular_client::diagnosis;
use trinocular_client::ports;
use trinocular_client::stage::HEARTBEAT_MS;
use trinocular_client::twin::TwinOnPort;
use trinocular_core::safety::State;
use trinocular_rig::printable::printable;
use trinocular_rig::rig_file::Stage;

/// Heartbeat timeout of the built-in twin, ms. It moves nothing that a silent host could endanger.
const TWIN_HEARTBEAT_MS: u16 = 5_000;

/// Port of the station.
#[derive(Clone, Debug, Args)]
pub struct StationOption {
    /// Show the station on this port instead of the built-in twin, in real time; `auto` is the only
    /// one on USB, `twin` the one that `trinocular twin` simulates
    ///
    /// Without --control and --follow nothing at the station is changed: no configuration, no
    /// reset, no zero. With one of them it is configured; a known position, a stop and faults stay
    /// as they are, and a position that was never known becomes zero.
    #[arg(long, value_name = "PATH")]
    port: Option<String>,

    /// Heartbeat timeout, ms: the station on --port stops without a ping for this time. Raise it on
    /// a loaded computer. A page that only shows does not set it
    #[arg(
        long,
        value_name = "MS",
        requires = "port",
        default_value_t = HEARTBEAT_MS,
        value_parser = clap::value_parser!(u16).range(20..=10_000)
    )]
    heartbeat: u16,
}

impl StationOption {
    /// Returns true if a port was named.
    pub fn is_given(&self) -> bool {
        self.port.is_some()
    }
}

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
        match &options.station.port {
            Some(port) => ports::resolve(port).map(Self::Port),
            None => TwinOnPort::start(stage).map(Self::Twin),
        }
        .map_err(|error| Failure::of_station(None, error))
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
                heartbeat_ms: options.station.heartbeat,
            },
            Self::Twin(twin) => StationPlace::Port {
                path: twin.path(),
                heartbeat_ms: TWIN_HEARTBEAT_MS,
            },
        }
    }
}

/// Returns the changes at a station on a port that the start of the page has made, in words, and
/// the state in which it is.
pub fn arrival(station: &StationLink, options: &ServeOptions) -> String {
    let rig = source(options.rig.as_deref());
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
        (false, _) => format!("{name} was configured with {rig}"),
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
    format!("{done}; {position}{condition}")
}

/// Returns the origin of the page's mm and limits, in words. A station does not report its own.
pub fn scale(options: &ServeOptions) -> Option<String> {
    (options.station.is_given() && options.only_shows()).then(|| {
        format!(
            "mm and limits are those of {}: the station does not report its own",
            source(options.rig.as_deref())
        )
    })
}

fn source(rig: Option<&Path>) -> String {
    match rig {
        Some(path) => format!("the stage of {}", printable(path.display())),
        None => "the default stage (80 steps/mm), because no --rig is given".to_owned(),
    }
}
