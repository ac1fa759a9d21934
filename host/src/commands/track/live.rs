//! Tracking with live cameras.

use super::TrackOptions;
use super::captures::{Captures, LiveClock};
use crate::commands::by_hand::on_interrupt;
use crate::commands::cameras;
use crate::commands::failure::Failure;
use crate::commands::live_cameras::{self, Free};
use crate::commands::reference_view::put_before;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;
use trinocular_client::stage::default_stage;
use trinocular_core::frame::message::Mounting;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::cameras::live::Tally;

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

fn follow(
    options: &TrackOptions,
    devices: &[PathBuf],
    (rig, rig_path): (&RigFile, &Path),
    (stage, mounting): (Stage, Mounting),
    out: &mut impl Write,
) -> Result<(), Failure> {
    let free = [
        ("--delay", options.delay.is_some()),
        ("--window", options.window.is_some()),
    ];
    let triggering = live_cameras::triggering(rig, options.station.is_given(), &free)?;
    let view = options.view(rig, rig_path)?;
    let port = options.station.resolve()?;
    // Open all cameras before the station, so that nothing moves if one is missing.
    let opened = cameras::open(devices, (rig, rig_path), options.fps())?;
    let free = Free {
        window: Duration::from_secs_f64(options.window_ms() * 1e-3),
        delay_ms: options.delay,
        rig,
    };
    let stop = on_interrupt()?;
    let mut live = live_cameras::start(opened, triggering.as_ref(), &free, stop, None)?;
    let now_us = || live.now_us();
    let all = live_cameras::source(devices);
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
    let window_ms = triggering.is_none().then(|| options.window_ms());
    live_cameras::print_counts((devices, &rig.names), live.tallies(), window_ms);
    if let Ok(summary) = &outcome {
        let (refused, frames) = (summary.refused, summary.frames);
        notice!("{refused} of {frames} frame sets not used");
    }
    recording.close(outcome).map(drop)
}
