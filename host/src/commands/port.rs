//! The option that names a station's serial port, shared by the commands that may use one.

use clap::Args;
use host::error::Failure;
use host::experiment::follower::Place;
use host::station::ports;
use host::station::stage::HEARTBEAT_MS;

/// Where the station is.
#[derive(Clone, Debug, Args)]
pub struct PortOption {
    /// A station on this serial port instead of the built-in twin, in real time; `auto` is the only
    /// one on USB. Its present position becomes zero, and it moves at once
    #[arg(long, value_name = "PATH")]
    port: Option<String>,

    /// The station on --port stops when it hears nothing for so long, ms. More on a busy computer
    #[arg(long, value_name = "MS", requires = "port", default_value_t = HEARTBEAT_MS, value_parser = clap::value_parser!(u16).range(20..=10_000))]
    heartbeat: u16,
}

impl PortOption {
    /// Whether one was named.
    pub fn is_given(&self) -> bool {
        self.port.is_some()
    }

    /// The port's path, if one was named.
    pub fn resolve(&self) -> Result<Option<String>, Failure> {
        let path = self.port.as_deref().map(ports::resolve).transpose();
        path.map_err(super::station_failed)
    }

    /// What the experiments take.
    pub fn place<'a>(&self, port: Option<&'a str>) -> Place<'a> {
        match port {
            None => Place::Twin,
            Some(path) => Place::Port {
                path,
                heartbeat_ms: self.heartbeat,
            },
        }
    }
}
