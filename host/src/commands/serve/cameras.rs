//! The page of a station with live cameras.

use super::ServeOptions;
use super::station::Station;
use crate::commands::by_hand::on_interrupt;
use crate::commands::cameras;
use crate::commands::failure::Failure;
use crate::commands::live_cameras::{self, Free};
use crate::commands::track::live;
use std::net::TcpListener;
use std::path::PathBuf;
use std::sync::mpsc::channel;
use std::time::Duration;
use trinocular::servo::camera_bench::CameraBench;
use trinocular::servo::page_recording::PageRecording;
use trinocular::servo::station_link::StationLink;
use trinocular_client::serial::Holder;
use trinocular_rig::rig_file::RigFile;

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
    let free = [
        ("--delay", options.delay.is_some()),
        ("--window", options.window.is_some()),
    ];
    let triggering = live_cameras::triggering(rig, is_real, &free)?;
    // Open all cameras before the station, so that nothing moves if one is missing.
    let opened = cameras::open(&devices, (rig, &rig_path), options.fps)?;
    let free = Free {
        window: Duration::from_secs_f64(options.window_ms() * 1e-3),
        delay_ms: options.delay,
        rig,
    };
    let (tell, told) = channel();
    let stop = on_interrupt()?;
    let live = live_cameras::start(opened, triggering.as_ref(), &free, stop, Some(tell))?;
    let station = Station::open(options, &stage)?;
    let observer = recording.station_observer();
    let place = station.place(options);
    let mut link = StationLink::start_observed(place, &stage, mounting, observer.clone())
        .map_err(|error| Failure::of_station(station.port(), error))?;
    if let Some(triggering) = &triggering {
        refuse_guest(&link, options)?;
        let triggered = link.trigger(triggering, observer);
        triggered.map_err(|error| Failure::of_servo(station.port(), error))?;
    }
    let drops = cameras::drop_source(&live);
    let count = live.counter();
    let window_ms = triggering.is_none().then(|| options.window_ms());
    let bench = CameraBench::new(live, link, triggering, told);
    let facts = (rig, &stage, mounting);
    let outcome = super::serve(
        options,
        listener,
        facts,
        bench,
        station.port(),
        recording,
        Some(drops),
    );
    live_cameras::print_counts((&devices, &rig.names), count(), window_ms);
    outcome
}

/// Refuses to trigger through another program for a page that only shows: that program passes no
/// command on.
fn refuse_guest(link: &StationLink, options: &ServeOptions) -> Result<(), Failure> {
    let owner = link.serial().and_then(|serial| serial.owner());
    match owner.filter(|_| options.only_shows()) {
        Some(Holder { pid, command }) => Err(Failure::Usage(format!(
            "`{command}` (process {pid}) has the port, and a page that only shows can trigger no \
             cameras through it: end that program, add --control, or give a rig file without \
             [trigger]"
        ))),
        None => Ok(()),
    }
}
