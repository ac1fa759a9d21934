//! The page of a station with live cameras.

use super::ServeOptions;
use super::station::Station;
use crate::commands::by_hand::on_interrupt;
use crate::commands::cameras;
use crate::commands::failure::Failure;
use crate::commands::track::live;
use std::net::TcpListener;
use std::path::PathBuf;
use std::time::Duration;
use trinocular::servo::frame_sets::CameraBench;
use trinocular::servo::page_recording::PageRecording;
use trinocular::servo::station_link::StationLink;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::cameras::live::LiveCameras;
use trinocular_vision::images::cameras::stamp::offset_us;

/// Runs until Ctrl-C.
pub fn run(
    options: &ServeOptions,
    listener: TcpListener,
    rig: &RigFile,
    devices: &[PathBuf],
    recording: PageRecording,
) -> Result<(), Failure> {
    let rig_path = options.rig.clone().unwrap_or_default();
    let devices = cameras::per_camera(devices, options.station.name(), (rig, &rig_path))?;
    let is_real = options.station.is_given();
    let (stage, mounting) = live::stage((is_real, options.fixed), rig, &rig_path)?;
    // Open all cameras before the station, so that nothing moves if one is missing.
    let cameras = cameras::open(&devices, (rig, &rig_path), options.fps)?;
    let tell = |loss: &InputError| notice!("warning: {loss}; the others carry on");
    let window = Duration::from_secs_f64(options.window_ms() * 1e-3);
    let delays_us = cameras::delays_us(options.delay, rig);
    let live = LiveCameras::start(cameras, window, &delays_us, on_interrupt()?, tell)?;
    let station = Station::open(options, &stage)?;
    let observer = recording.station_observer();
    let link = StationLink::start_observed(station.place(options), &stage, mounting, observer)
        .map_err(|error| Failure::of_station(station.port(), error))?;
    let offset_us = offset_us(|| link.now().micros(), || live.now_us());
    let drops = cameras::drop_source(&live);
    let bench = CameraBench::new(live, link, offset_us);
    let facts = (rig, &stage, mounting);
    super::serve(
        options,
        listener,
        facts,
        bench,
        station.port(),
        recording,
        Some(drops),
    )
}
