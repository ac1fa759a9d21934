//! The page of a station with rendered cameras before a moving poster.

use super::{Options, serve, twin_failed};
use crate::commands::failure::Failure;
use host::servo::ServoError;
use host::servo::path::TargetPath;
use host::servo::station_link::StationLink;
use host::servo::workbench::{Bench, Shot};
use host::servo::world::SimulatedWorld;
use shared::frame::message::Mounting;
use shared::time::Instant;
use std::net::TcpListener;
use trinocular_client::stage::{default_stage, setpoint};
use trinocular_client::twin::RealTimeTwin;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::images::Texture;

/// Rendered cameras on the stage of a station in real time.
struct SimulatedBench {
    world: SimulatedWorld,
    path: TargetPath,
    /// Time from the last frame set to the earliest next one, µs.
    grace_us: u64,
    start: Option<Instant>,
    last: Instant,
}

impl Bench for SimulatedBench {
    fn next_shot(&mut self) -> Result<Option<Shot>, ServoError> {
        let start = *self.start.get_or_insert(self.world.now());
        let time_s = self.world.now().since(start) as f64 * 1e-6;
        self.world.a.send(setpoint(self.path.at(time_s)));
        let due = self.last.plus_micros(self.grace_us);
        let exposure = self.world.expose(due)?;
        self.last = exposure.moment.at;
        Ok(Some(Shot {
            images: exposure.capture,
            taken: exposure.moment.station,
        }))
    }

    fn station(&mut self) -> &mut StationLink {
        &mut self.world.b
    }
}

/// Starts the built-in twin in real time, unless the station is on a port.
pub fn twin_if_none(port: Option<&str>, stage: &Stage) -> Result<Option<RealTimeTwin>, Failure> {
    match port {
        Some(_) => Ok(None),
        None => RealTimeTwin::start(stage, "twin")
            .map(Some)
            .map_err(twin_failed),
    }
}

/// Runs until Ctrl-C.
pub fn run(options: &Options, listener: TcpListener, rig: &RigFile) -> Result<(), Failure> {
    let stage = rig.stage.clone().unwrap_or_else(default_stage);
    let port = options.station.resolve()?;
    let twin = twin_if_none(port.as_deref(), &stage)?;
    let path = port.as_deref().or(twin.as_ref().map(RealTimeTwin::path));
    let world = SimulatedWorld::new(
        &rig.rig,
        &stage,
        options.station.place(path),
        &Texture::of_kind(options.scene.texture, options.scene.seed),
        options.scene.settings(),
        options.scene.seed,
    );
    let world = world.map_err(|error| Failure::of_servo(port.as_deref(), error))?;
    let bench = SimulatedBench {
        last: world.now(),
        world,
        path: options.path,
        grace_us: (0.5e6 / options.fps) as u64,
        start: None,
    };
    let facts = (rig, &stage, Mounting::OnStage);
    serve(options, listener, facts, bench, port.as_deref())
}
