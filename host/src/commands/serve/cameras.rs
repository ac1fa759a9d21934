//! The page of a station with live cameras.

use super::Options;
use crate::commands::failure::Failure;
use crate::commands::track::live;
use std::net::TcpListener;
use std::path::PathBuf;
use trinocular_rig::rig_file::RigFile;

/// Runs until Ctrl-C.
#[cfg(all(feature = "camera", target_os = "linux"))]
pub fn run(
    options: &Options,
    listener: TcpListener,
    rig: &RigFile,
    devices: &[PathBuf],
) -> Result<(), Failure> {
    use crate::commands::by_hand::on_interrupt;
    use crate::commands::track::captures::offset_us;
    use host::servo::frame_sets::CameraBench;
    use host::servo::station_link::StationLink;
    use std::time::Duration;
    use trinocular_rig::error::InputError;
    use trinocular_rig::notice;
    use trinocular_vision::images::cameras::live::LiveCameras;

    let rig_path = options.rig.clone().unwrap_or_default();
    live::check_devices(devices, rig, &rig_path)?;
    let port = options.station.resolve()?;
    let (stage, mounting) = live::stage((port.is_some(), options.fixed), rig, &rig_path)?;
    // Open all cameras before the station, so that nothing moves if one is missing.
    let cameras = live::open(devices, rig, options.fps)?;
    let tell = |loss: &InputError| notice!("warning: {loss}; the others carry on");
    let window = Duration::from_secs_f64(options.window * 1e-3);
    let delay_us = (options.delay * 1e3).round() as i64;
    let live = LiveCameras::start(cameras, window, delay_us, on_interrupt()?, tell)?;
    let twin = super::simulated::twin_if_none(port.as_deref(), &stage)?;
    let path = port.as_deref().or(twin.as_ref().map(|twin| twin.path()));
    let station = StationLink::start_as(options.station.place(path), &stage, mounting)
        .map_err(|error| Failure::of_station(port.as_deref(), error))?;
    let offset_us = offset_us(|| station.now().micros(), || live.now_us());
    let bench = CameraBench::new(live, station, offset_us);
    let facts = (rig, &stage, mounting);
    super::serve(options, listener, facts, bench, port.as_deref())
}

/// Refuses, because this program was built without live cameras.
#[cfg(not(all(feature = "camera", target_os = "linux")))]
pub fn run(_: &Options, _: TcpListener, _: &RigFile, devices: &[PathBuf]) -> Result<(), Failure> {
    let first = devices.first().cloned().unwrap_or_default();
    Err(live::built_without(&first))
}
