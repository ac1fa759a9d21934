//! The option that names a station's serial port, shared by the commands that may use one.

use crate::commands::failure::Failure;
use clap::Args;
use trinocular::servo::station_link::StationPlace;
use trinocular_client::ports;
use trinocular_client::stage::HEARTBEAT_MS;

/// Port of the station.
#[derive(Clone, Debug, Args)]
pub struct PortOption {
    /// Use the station on this port instead of the built-in twin, in real time; `auto` is the only
    /// one on USB, `twin` the one that `trinocular twin` simulates. Its present position becomes
    /// zero, and it moves at once
    #[arg(long, value_name = "PATH")]
    port: Option<String>,

    /// Heartbeat timeout, ms: the station on --port stops without a ping for this time. Raise it on
    /// a loaded computer
    #[arg(
        long,
        value_name = "MS",
        requires = "port",
        default_value_t = HEARTBEAT_MS,
        value_parser = clap::value_parser!(u16).range(20..=10_000)
    )]
    heartbeat: u16,
}

impl PortOption {
    /// Returns true if a port was named.
    pub fn is_given(&self) -> bool {
        self.port.is_some()
    }

    /// Returns the port as it was named.
    pub fn name(&self) -> Option<&str> {
        self.port.as_deref()
    }

    /// Returns the path of the port, if one was named.
    pub fn resolve(&self) -> Result<Option<String>, Failure> {
        let path = self.port.as_deref().map(ports::resolve).transpose();
        path.map_err(|error| Failure::of_station(None, error))
    }

    /// Returns the heartbeat timeout, ms.
    pub const fn heartbeat_ms(&self) -> u16 {
        self.heartbeat
    }

    /// Returns the place of the station.
    pub fn place<'a>(&self, port: Option<&'a str>) -> StationPlace<'a> {
        match port {
            None => StationPlace::Twin,
            Some(path) => StationPlace::Port {
                path,
                heartbeat_ms: self.heartbeat,
            },
        }
    }
}
