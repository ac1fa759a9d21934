//! Tracking with live cameras.

use super::Options;
use crate::commands::failure::Failure;
use shared::frame::message::Mounting;
use std::io::Write;
use std::path::{Path, PathBuf};
use trinocular_client::stage::default_stage;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::{RigFile, Stage};

/// Returns the stage and the mounting of the cameras. A real stage must be in the rig file.
pub fn stage(
    (is_real, is_fixed): (bool, bool),
    rig: &RigFile,
    rig_path: &Path,
) -> Result<(Stage, Mounting), Failure> {
    let mounting = match is_real && !is_fixed {
        true => Mounting::OnStage,
        // The twin's stage carries no cameras.
        false => Mounting::Fixed,
    };
    match (&rig.stage, is_real) {
        (Some(stage), _) => Ok((stage.clone(), mounting)),
        (None, false) => Ok((default_stage(), mounting)),
        (None, true) => {
            let reason = "has no [stage] section, which says what the station on --port drives";
            Err(InputError::file(rig_path, reason).into())
        }
    }
}

/// Checks that there is one device per camera.
pub fn check_devices(devices: &[PathBuf], rig: &RigFile, rig_path: &Path) -> Result<(), Failure> {
    if devices.len() != rig.names.len() {
        return Err(Failure::Usage(format!(
            "--cameras names {} devices, but {} has {} cameras: {}, in this order",
            devices.len(),
            rig_path.display(),
            rig.names.len(),
            rig.names.join(", ")
        )));
    }
    refuse_twins(devices, &rig.names)
}

/// Refuses one device for two cameras, even if different names or links lead to it.
fn refuse_twins(devices: &[PathBuf], names: &[String]) -> Result<(), Failure> {
    let real = |device: &PathBuf| device.canonicalize().unwrap_or_else(|_| device.clone());
    let real: Vec<PathBuf> = devices.iter().map(real).collect();
    for (later, device) in real.iter().enumerate() {
        if let Some(first) = real[..later].iter().position(|before| before == device) {
            return Err(Failure::Usage(format!(
                "--cameras names one device twice: {} for {} and {} for {}",
                devices[first].display(),
                names[first],
                devices[later].display(),
                names[later]
            )));
        }
    }
    Ok(())
}

/// Follows the target until Ctrl-C, or for --seconds.
pub fn run(
    options: &Options,
    devices: &[PathBuf],
    rig_path: &Path,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let rig = options.method.read_rig(rig_path)?;
    check_devices(devices, &rig, rig_path)?;
    let is_real = options.station.is_given();
    let stage = stage((is_real, options.fixed), &rig, rig_path)?;
    follow(options, devices, &rig, stage, out)
}

/// Opens the cameras, and prints their formats.
#[cfg(all(feature = "camera", target_os = "linux"))]
pub fn open(
    devices: &[PathBuf],
    rig: &RigFile,
    fps: f64,
) -> Result<Vec<trinocular_vision::images::cameras::device::V4l2>, Failure> {
    use trinocular_rig::notice;
    use trinocular_vision::images::cameras::device::V4l2;
    use trinocular_vision::images::cameras::stamp::Source;

    let cameras = devices
        .iter()
        .zip(&rig.names)
        .map(|(device, name)| {
            let who = format!("{name} ({})", device.display());
            let notice = Box::new(move |source: Source| match source {
                Source::Driver(_) => notice!("{who}: {source}"),
                Source::Arrival(_) => notice!("warning: {who}: {source}"),
            });
            V4l2::open(device, rig.rig.image_size_px, fps, notice)
        })
        .collect::<Result<Vec<_>, _>>()?;
    for ((device, camera), name) in devices.iter().zip(&cameras).zip(&rig.names) {
        notice!("{name} is {}, {:?}", device.display(), camera.format());
    }
    Ok(cameras)
}

#[cfg(all(feature = "camera", target_os = "linux"))]
fn follow(
    options: &Options,
    devices: &[PathBuf],
    rig: &RigFile,
    (stage, mounting): (Stage, Mounting),
    out: &mut impl Write,
) -> Result<(), Failure> {
    use super::captures::Captures;
    use crate::commands::by_hand::on_interrupt;
    use std::time::Duration;
    use trinocular_rig::notice;
    use trinocular_vision::images::FrameSet;
    use trinocular_vision::images::cameras::live::LiveCameras;

    let port = options.station.resolve()?;
    // Open all cameras before the station, so that nothing moves if one is missing.
    let cameras = open(devices, rig, options.fps)?;
    let ms = |ms: f64| Duration::from_secs_f64(ms * 1e-3);
    let stop = on_interrupt()?;
    let delay_us = (options.delay * 1e3).round() as i64;
    let tell = |loss: &InputError| notice!("warning: {loss}; the others carry on");
    let mut live = LiveCameras::start(cameras, ms(options.window_ms()), delay_us, stop, tell)?;
    let now_us = || live.now_us();
    let all: Vec<String> = (devices.iter().map(|device| device.display().to_string())).collect();
    let all = PathBuf::from(all.join(","));
    let captures = Captures::new(
        options,
        rig,
        (&stage, mounting),
        port.as_deref(),
        &all,
        Some(&now_us),
    )?;
    let end_us = options
        .seconds
        .map(|seconds| live.now_us() + (seconds * 1e6) as u64);
    let is_in_time = |capture: &Result<FrameSet, InputError>| {
        let time_us = capture.as_ref().map_or(0, |capture| capture.time_us);
        end_us.is_none_or(|end_us| time_us < end_us)
    };
    let outcome = captures.follow(live.by_ref().take_while(is_in_time), out);
    for ((device, tally), name) in devices.iter().zip(live.tallies()).zip(&rig.names) {
        let matching = tally.matching;
        notice!(
            "{name} ({}): {} pictures, {} used, {} overtaken by newer ones, {} without partners \
             within {} ms, {} stale, {} damaged, {} out of order; its driver lost {}",
            device.display(),
            matching.arrived + tally.stale + tally.damaged,
            matching.used,
            matching.overtaken,
            matching.unmatched,
            options.window_ms(),
            tally.stale,
            tally.damaged,
            matching.disordered,
            tally.lost
        );
    }
    let summary = outcome?;
    notice!(
        "{} of {} captures not used",
        summary.refused,
        summary.frames
    );
    Ok(())
}

#[cfg(not(all(feature = "camera", target_os = "linux")))]
fn follow(
    _: &Options,
    devices: &[PathBuf],
    _: &RigFile,
    _: (Stage, Mounting),
    _: &mut impl Write,
) -> Result<(), Failure> {
    let first = devices.first().cloned().unwrap_or_default();
    Err(built_without(&first))
}

/// Returns the failure of a program that was built without live cameras.
#[cfg(not(all(feature = "camera", target_os = "linux")))]
pub fn built_without(device: &Path) -> Failure {
    let reason = "this program was built without live cameras: build it on Linux with \
                  `cargo build --release --features host/camera`";
    InputError::file(device, reason).into()
}
