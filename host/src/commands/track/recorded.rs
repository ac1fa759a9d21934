//! Tracking with a folder of images, complete or growing; the cameras are beside the stage.

use super::captures::{Captures, Summary};
use super::{Estimator, TrackOptions};
use crate::commands::by_hand::on_interrupt;
use crate::commands::failure::Failure;
use crate::commands::frames::Rigged;
use crate::commands::reference_view::{ReferenceView, put_before};
use std::cell::Cell;
use std::io::Write;
use std::path::Path;
use std::time::Duration;
use trinocular_client::stage::default_stage;
use trinocular_core::frame::message::Mounting;
use trinocular_rig::error::InputError;
use trinocular_rig::interruption;
use trinocular_rig::notice;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::folder::watch::{Settings, Watch};

/// Shortest and longest time between two frame sets of a recording, µs: as --fps allows.
const LEAST_PERIOD_US: u64 = 5_000;
const MOST_PERIOD_US: u64 = 1_000_000;

/// Feeds every frame set to the twin at its capture time; prints the path of the stage.
pub fn run(
    options: &TrackOptions,
    folder: &Path,
    rig_path: &Path,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let rig = options.read_rig(rig_path)?;
    in_folder(options, folder, (rig, rig_path), out)
}

/// Runs as [`run`] does, with the rig of the view of --reference.
pub fn of_view(
    options: &TrackOptions,
    folder: &Path,
    view: &Path,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let mut rig = ReferenceView::open(view)?.rig;
    options.turn(&mut rig)?;
    if options.method == Estimator::ClosedForm {
        RigFile::parse_in_line(view, &rig.to_toml())?;
    }
    in_folder(options, folder, (rig, view), out)
}

fn in_folder(
    options: &TrackOptions,
    folder: &Path,
    (rig, rig_path): (RigFile, &Path),
    out: &mut impl Write,
) -> Result<(), Failure> {
    let view = options.view(&rig, rig_path)?;
    let least = least(&view);
    let mut captures = options.pair.open(folder, &rig)?;
    if let (None, Some(period_us)) = (options.fps, captures.video_period_us()) {
        let period_us = period_us.clamp(LEAST_PERIOD_US, MOST_PERIOD_US);
        options.recorded_period_us.set(Some(period_us));
    }
    captures.set_period_us(options.period_us());
    if let Some(count) = captures.count().filter(|count| *count < least) {
        return Err(few(folder, count, least));
    }
    let (came, unread) = (Cell::new(0), Cell::new(0));
    let counted = captures.frame_sets().inspect(|_| came.set(came.get() + 1));
    let captures = readable(counted, view, options, &unread);
    let summary = follow(options, rig, folder, captures, out)?;
    if came.get() < least {
        return Err(few(folder, came.get(), least));
    }
    judged(folder, summary, unread.get())
}

/// Runs as [`run`] does, for a recording.
pub fn replay(
    options: &TrackOptions,
    recording: &Path,
    rig_path: Option<&Path>,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let rig = rig_path
        .map(|path| options.method.read_rig(path))
        .transpose()?;
    let Rigged { frames, mut rig } = options.recording.open(recording, rig)?;
    options.turn(&mut rig)?;
    if options.method == Estimator::ClosedForm {
        RigFile::parse_in_line(recording, &rig.to_toml())?;
    }
    options.recorded_period_us.set(Some(
        frames.period_us().clamp(LEAST_PERIOD_US, MOST_PERIOD_US),
    ));
    let view = options.view(&rig, rig_path.unwrap_or(recording))?;
    let least = least(&view);
    let (came, unread) = (Cell::new(0), Cell::new(0));
    let counted = frames.frame_sets().inspect(|_| came.set(came.get() + 1));
    let captures = readable(counted, view, options, &unread);
    let summary = follow(options, rig, recording, captures, out)?;
    if came.get() < least {
        return Err(few(recording, came.get(), least));
    }
    judged(recording, summary, unread.get())
}

/// Follows the frame sets, and records the run if that was requested.
fn follow(
    options: &TrackOptions,
    mut rig: RigFile,
    source: &Path,
    captures: impl Iterator<Item = Result<FrameSet, InputError>>,
    out: &mut impl Write,
) -> Result<Summary, Failure> {
    let stage = rig.stage.get_or_insert_with(default_stage);
    // The stage shall end at the target's last measured position, not at a predicted one.
    stage.tracking.prediction = false;
    let stage = (stage.clone(), Mounting::Fixed);
    let stage = (&stage.0, stage.1);
    let recording = options.recording(&rig)?;
    let station = Captures::new(options, &rig, stage, None, source, None, recording.tap());
    let summary = station.and_then(|station| station.follow(captures, out));
    recording.close(summary)
}

/// Runs as [`run`] does, for a folder that grows: until Ctrl-C, or until no image has come for
/// --idle seconds.
pub fn watch(
    options: &TrackOptions,
    folder: &Path,
    rig_path: &Path,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let rig = options.read_rig(rig_path)?;
    let view = options.view(&rig, rig_path)?;
    let least = least(&view);
    let stop = on_interrupt()?;
    let settings = Settings {
        period_us: options.period_us(),
        idle: options.idle.map(Duration::from_secs_f64),
        stop,
    };
    let tell = |passed_over: &InputError| notice!("{passed_over}");
    let size_px = rig.rig.image_size_px;
    let captures = Watch::open(folder, &rig.names, size_px, settings, tell)?;
    notice!(
        "waiting for images in the folders {} of {}; Ctrl-C ends",
        rig.names.join(", "),
        folder.display()
    );
    let (mut came, unread) = (0, Cell::new(0));
    let captures = captures.inspect(|_| came += 1);
    let captures = readable(captures, view, options, &unread);
    let summary = follow(options, rig, folder, captures, out)?;
    if came < least {
        return Err(few(folder, came, least));
    }
    judged(folder, summary, unread.get())?;
    // All frame sets so far are printed; the exit code tells a script why there are no more.
    interruption::signal().map_or(Ok(()), |signal| Err(Failure::Interrupted(signal)))
}

/// Returns the least number of frame sets: the first is the keyframe if there is no view.
fn least(view: &Option<ReferenceView>) -> usize {
    if view.is_some() { 1 } else { 2 }
}

/// Puts the view before the frame sets. Skips frame sets that cannot be read, with a warning, and
/// counts them in `unread`. If the first cannot be read and would be the keyframe, the run ends.
fn readable(
    captures: impl Iterator<Item = Result<FrameSet, InputError>>,
    view: Option<ReferenceView>,
    options: &TrackOptions,
    unread: &Cell<usize>,
) -> impl Iterator<Item = Result<FrameSet, InputError>> {
    let mut has_reference = view.is_some();
    let period_us = options.period_us();
    // A view has its time before the first frame set's, which may be zero.
    let delay_us = if has_reference { period_us } else { 0 };
    let captures = captures.map(move |capture| {
        capture.map(|capture| FrameSet {
            time_us: capture.time_us.saturating_add(delay_us),
            ..capture
        })
    });
    let captures = captures.filter(move |capture| match capture {
        Err(error) if has_reference => {
            notice!("refused: {error}");
            unread.set(unread.get() + 1);
            false
        }
        _ => {
            has_reference = true;
            true
        }
    });
    put_before(view, captures, period_us)
}

fn few(folder: &Path, count: usize, least: usize) -> Failure {
    let reason = match (count, least) {
        (0, 1) => "no frame set",
        (0, _) => "no frame set; following takes at least two",
        _ => "one frame set; following takes at least two",
    };
    InputError::file(folder, reason).into()
}

/// Returns the failure of a run with refused or unreadable frames, each of which has been reported
/// in its own line.
fn judged(folder: &Path, summary: Summary, unread: usize) -> Result<(), Failure> {
    let (frames, refused) = (summary.frames + unread, summary.refused + unread);
    if refused == 0 {
        return Ok(());
    }
    Err(Failure::Refused {
        file: folder.to_owned(),
        refused,
        frames,
    })
}
