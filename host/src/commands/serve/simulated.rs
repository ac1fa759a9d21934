//! The page of a station with rendered cameras before a moving poster.

use super::station::Station;
use super::{ServeOptions, serve};
use crate::commands::failure::Failure;
use std::net::TcpListener;
use trinocular::servo::page_recording::PageRecording;
use trinocular::servo::simulated_bench::SimulatedBench;
use trinocular::servo::world::SimulatedWorld;
use trinocular_client::stage::default_stage;
use trinocular_core::frame::message::Mounting;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::Texture;

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
