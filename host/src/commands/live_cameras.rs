//! Live cameras of a command, which run freely or are triggered by the station: the same for
//! `track`, `serve` and `calibrate-stage`.

use crate::commands::cameras;
use crate::commands::failure::Failure;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Sender;
use std::time::Duration;
use trinocular::servo::triggering::Triggering;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::cameras::live::{Camera, LiveCameras, Tally};

/// Number of missed, doubled and doubtful images that a run names.
const NAMED: usize = 20;

/// Returns the triggers of the cameras, if the rig file has them and a station on a port is there to
/// give them. `options` are those of free-running cameras, by name, and whether they were given.
pub fn triggering(
    rig: &RigFile,
    has_port: bool,
    options: &[(&str, bool)],
) -> Result<Option<Triggering>, Failure> {
    let Some(trigger) = rig.trigger else {
        return Ok(None);
    };
    if !has_port {
        notice!("[trigger] of the rig file has no effect without --port: cameras run freely");
        return Ok(None);
    }
    match options.iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => Err(Failure::Usage(format!(
            "{option} has no effect with [trigger] in the rig file: the capture time is the \
             trigger's instant on the station's own clock; leave {option} out, or remove \
             [trigger]"
        ))),
        None => Ok(Some(Triggering::new(trigger))),
    }
}

/// Settings of free-running cameras.
#[derive(Clone, Copy, Debug)]
pub struct Free<'a> {
    /// Largest difference of capture times within a frame set.
    pub window: Duration,
    /// Delay of all cameras instead of the rig file's, ms.
    pub delay_ms: Option<f64>,
    /// Rig file with the cameras' delays.
    pub rig: &'a RigFile,
}

/// Starts opened cameras. Lost cameras and missed, doubled and doubtful images are printed and go to
/// `told`, of the images the first ones only, because a camera with wrong settings has one at every
/// trigger.
///
/// # Errors
/// If a thread cannot be started.
pub fn start(
    opened: Vec<Box<dyn Camera>>,
    triggering: Option<&Triggering>,
    free: &Free<'_>,
    stop: Arc<AtomicBool>,
    told: Option<Sender<String>>,
) -> Result<LiveCameras, InputError> {
    let tell = move |told: &Option<Sender<String>>, text: String| {
        notice!("warning: {text}");
        if let Some(told) = told {
            // Without a receiver the command ends.
            let _ = told.send(text);
        }
    };
    let of_images = told.clone();
    let tell_loss = move |loss: &InputError| tell(&told, format!("{loss}; the others carry on"));
    let Some(Triggering { triggers, .. }) = triggering else {
        let delays_us = cameras::delays_us(free.delay_ms, free.rig);
        return LiveCameras::start(opened, free.window, &delays_us, stop, tell_loss);
    };
    let mut number = 0;
    let tell_anomaly = move |anomaly: &InputError| {
        number += 1;
        match number {
            ..NAMED => tell(&of_images, anomaly.to_string()),
            NAMED => {
                let text = format!("{anomaly}; further ones are only counted");
                tell(&of_images, text);
            }
            _ => (),
        }
    };
    LiveCameras::start_triggered(opened, triggers, stop, tell_loss, tell_anomaly)
}

/// Prints the fate of the images of each camera. `window_ms` is that of free-running cameras.
pub fn print_counts(
    (devices, names): (&[PathBuf], &[String]),
    tallies: Vec<Tally>,
    window_ms: Option<f64>,
) {
    for ((device, tally), name) in devices.iter().zip(tallies).zip(names) {
        let matching = tally.matching;
        let (within, of_triggers) = match window_ms {
            None => {
                let (missed, doubled) = (tally.missed, tally.doubled);
                let counts = format!(
                    "; {missed} triggers missed, {doubled} images doubled, {} doubtful, {} of \
                     triggers that were not reported",
                    tally.doubtful, tally.unreported
                );
                (String::new(), counts)
            }
            Some(window_ms) => (format!(" within {window_ms} ms"), String::new()),
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
}

/// Returns the names of devices as one path, which errors name.
pub fn source(devices: &[PathBuf]) -> PathBuf {
    let names = devices.iter().map(|device| device.display().to_string());
    Path::new(&names.collect::<Vec<_>>().join(",")).to_owned()
}
