//! Tracking with live cameras.

use super::TrackOptions;
use super::captures::{Captures, LiveClock};
use crate::commands::by_hand::on_interrupt;
use crate::commands::cameras;
use crate::commands::failure::Failure;
use crate::commands::reference_view::put_before;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;
use trinocular::servo::triggering::Triggering;
use trinocular_client::stage::default_stage;
use trinocular_core::frame::message::Mounting;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::cameras::live::{LiveCameras, Tally};

/// Number of missed, doubled and doubtful images that are printed.
const PRINTED: usize = 20;

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

/// Follows the target until Ctrl-C, or for --seconds.
pub fn run(
    options: &TrackOptions,
    devices: &[PathBuf],
    rig_path: &Path,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let rig = options.read_rig(rig_path)?;
    let devices = cameras::per_camera(devices, options.station.name(), (&rig, rig_path))?;
    let is_real = options.station.is_given();
    let stage = stage((is_real, options.fixed), &rig, rig_path)?;
    follow(options, &devices, (&rig, rig_path), stage, out)
}

/// Returns the triggers of the cameras, if the rig file has them and a station is there to give
/// them.
fn triggering(options: &TrackOptions, rig: &RigFile) -> Result<Option<Triggering>, Failure> {
    let Some(trigger) = rig.trigger else {
        return Ok(None);
    };
    if !options.station.is_given() {
        notice!("[trigger] of the rig file has no effect without --port: cameras run freely");
        return Ok(None);
    }
    for (option, is_given) in [
        ("--delay", options.delay.is_some()),
        ("--window", options.window.is_some()),
    ] {
        if is_given {
            return Err(Failure::Usage(format!(
                "{option} has no effect with [trigger] in the rig file: the capture time is the \
                 trigger's instant on the station's own clock; leave {option} out, or remove \
                 [trigger]"
            )));
        }
    }
    Ok(Some(Triggering::new(trigger)))
}

/// Returns a printer of missed, doubled and doubtful images. It prints the first ones only, because
/// a camera with wrong settings has one at every trigger.
fn anomalies() -> impl FnMut(&InputError) {
    let mut printed = 0;
    move |anomaly| {
        printed += 1;
        match printed {
            ..PRINTED => notice!("warning: {anomaly}"),
            PRINTED => notice!("warning: {anomaly}; further ones are only counted"),
            _ => (),
        }
    }
}

fn follow(
    options: &TrackOptions,
    devices: &[PathBuf],
    (rig, rig_path): (&RigFile, &Path),
    (stage, mounting): (Stage, Mounting),
    out: &mut impl Write,
) -> Result<(), Failure> {
    let triggering = triggering(options, rig)?;
    let view = options.view(rig, rig_path)?;
    let port = options.station.resolve()?;
    // Open all cameras before the station, so that nothing moves if one is missing.
    let cameras = cameras::open(devices, (rig, rig_path), options.fps())?;
    let ms = |ms: f64| Duration::from_secs_f64(ms * 1e-3);
    let stop = on_interrupt()?;
    let tell = |loss: &InputError| notice!("warning: {loss}; the others carry on");
    let mut live = match &triggering {
        Some(Triggering { triggers, .. }) => {
            LiveCameras::start_triggered(cameras, triggers, stop, tell, anomalies())?
        }
        None => {
            let delays_us = cameras::delays_us(options.delay, rig);
            LiveCameras::start(cameras, ms(options.window_ms()), &delays_us, stop, tell)?
        }
    };
    let now_us = || live.now_us();
    let all: Vec<String> = (devices.iter().map(|device| device.display().to_string())).collect();
    let all = PathBuf::from(all.join(","));
    let recording = options.recording(&RigFile {
        stage: Some(stage.clone()),
        ..rig.clone()
    })?;
    let mut captures = Captures::new(
        options,
        rig,
        (&stage, mounting),
        port.as_deref(),
        &all,
        Some(match &triggering {
            Some(triggering) => LiveClock::Station(triggering),
            None => LiveClock::Host(&now_us),
        }),
        recording.tap(),
    )?;
    captures.count_drops(cameras::drop_source(&live));
    let count = live.counter();
    captures.tell_drops(move || {
        let tallies = count();
        let drops = tallies.iter().flat_map(Tally::drops);
        drops.map(|(_, count)| count).sum()
    });
    let seconds_us = options.seconds.map(|seconds| (seconds * 1e6) as u64);
    // The station's clock is known with the first frame set.
    let mut begun_us = triggering.is_none().then(|| live.now_us());
    let is_in_time = |capture: &Result<FrameSet, InputError>| {
        let time_us = capture.as_ref().map_or(0, |capture| capture.time_us);
        let begun_us = *begun_us.get_or_insert(time_us);
        seconds_us.is_none_or(|seconds_us| time_us < begun_us + seconds_us)
    };
    let frame_sets = live.by_ref().take_while(is_in_time);
    let frame_sets = put_before(view, frame_sets, options.period_us());
    let outcome = captures.follow(frame_sets, out);
    for ((device, tally), name) in devices.iter().zip(live.tallies()).zip(&rig.names) {
        let matching = tally.matching;
        let (within, of_triggers) = match &triggering {
            Some(_) => {
                let (missed, doubled) = (tally.missed, tally.doubled);
                let counts = format!(
                    "; {missed} triggers missed, {doubled} images doubled, {} doubtful, {} of \
                     triggers that were not reported",
                    tally.doubtful, tally.unreported
                );
                (String::new(), counts)
            }
            None => (format!(" within {} ms", options.window_ms()), String::new()),
        };
        notice!(
            "{name} ({}): {} images, {} used, {} overtaken by newer ones, {} without partners{}, \
             {} stale, {} damaged, {} incomplete, {} out of order; its driver lost {}{}",
            device.display(),
            tally.images(),
            matching.used,
            matching.overtaken,
            matching.unmatched,
            within,
            tally.stale,
            tally.damaged,
            tally.incomplete,
            matching.disordered,
            tally.lost,
            of_triggers
        );
    }
    if let Ok(summary) = &outcome {
        let (refused, frames) = (summary.refused, summary.frames);
        notice!("{refused} of {frames} frame sets not used");
    }
    recording.close(outcome).map(drop)
}
