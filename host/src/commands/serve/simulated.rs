//! The page of a station with rendered cameras before a moving poster.

use super::{ServeOptions, serve};
use crate::commands::failure::Failure;
use std::net::TcpListener;
use trinocular::servo::page_recording::PageRecording;
use trinocular::servo::simulated_bench::SimulatedBench;
use trinocular::servo::station_link::StationPlace;
use trinocular::servo::world::SimulatedWorld;
use trinocular_client::stage::default_stage;
use trinocular_client::twin::TwinOnPort;
use trinocular_core::frame::message::Mounting;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::images::Texture;

/// Heartbeat timeout of the built-in twin, ms. It moves nothing that a silent host could endanger.
const HEARTBEAT_MS: u16 = 5_000;

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
            Self::Port(path) => options.station.place(Some(path)),
            Self::Twin(twin) => StationPlace::Port {
                path: twin.path(),
                heartbeat_ms: HEARTBEAT_MS,
            },
        }
    }
}

/// Runs until Ctrl-C.
pub fn run(
    options: &ServeOptions,
    listener: TcpListener,
    rig: &RigFile,
    recording: PageRecording,
) -> Result<(), Failure> {
    let stage = rig.stage.clone().unwrap_or_else(default_stage);
    let station = Station::open(options, &stage)?;
    let world = SimulatedWorld::new_observed(
        &rig.rig,
        &stage,
        station.place(options),
        &Texture::of_kind(options.scene.texture, options.scene.seed),
        options.scene.settings(),
        options.scene.seed,
        recording.station_observer(),
    );
    let world = world.map_err(|error| Failure::of_servo(station.port(), error))?;
    let bench = SimulatedBench::new(world, options.path, options.fps);
    let facts = (rig, &stage, Mounting::OnStage);
    serve(
        options,
        listener,
        facts,
        bench,
        station.port(),
        recording,
        None,
    )
}
