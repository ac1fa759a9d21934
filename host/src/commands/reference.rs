//! `trinocular reference`: saves a view of the target, from which later displacements count.

use super::frames::{RecordingInput, Rigged, rig_missing};
use super::reference_view;
use super::region::RegionOption;
use super::{json, warnings};
use crate::commands::failure::Failure;
use crate::commands::folder_input::PairOption;
use crate::commands::record::{Opened, Origin};
use clap::Args;
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;
use trinocular_recording::message::{Measurement, Outcome};
use trinocular_recording::read::is_recording;
use trinocular_rig::error::InputError;
use trinocular_rig::output::{Output, Replace};
use trinocular_rig::printable::printable;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::images::FrameSet;
use trinocular_vision::sums::Estimator;

/// Save a view of the target, to measure later how far it has moved since
///
/// The file is a small recording with one frame set and the rig. `estimate --reference FILE` and
/// `track --reference FILE` measure displacements from it, after months and with other exposure.
/// Every recording of --record serves as well: its first frame set counts. The regions of --roi and
/// --mask are kept in the file.
///
/// The cameras must stand as they did: a camera that was moved against the others in the meantime
/// is named, but motion of the whole rig looks like motion of the target.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ReferenceOptions {
    /// A folder of frame sets, or a recording (MCAP, ROS 2 bag), as for `estimate`
    input: PathBuf,

    /// The rig file (TOML); without it a recording must hold one
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,

    /// Write the reference view here
    #[arg(long, value_name = "FILE.mcap")]
    out: PathBuf,

    /// Replace the file given by --out if it exists
    #[arg(long)]
    force: bool,

    /// Number of the frame set to save, from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: usize,

    /// Print one JSON object instead
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    pair: PairOption,

    #[command(flatten)]
    region: RegionOption,

    #[command(flatten)]
    recording: RecordingInput,
}

const EXAMPLES: &str = "\
Examples:
  trinocular reference captures/ --rig rig.toml --out bridge.mcap
  trinocular estimate today/ --reference bridge.mcap
  trinocular track --cameras rig --rig rig.toml --seconds 1 --record bridge.mcap
  trinocular track --cameras rig --rig rig.toml --reference bridge.mcap";

/// Runs the command.
pub fn run(options: &ReferenceOptions, out: &mut impl Write) -> Result<(), Failure> {
    let (frame_set, rig) = read(options)?;
    let regions = options.region.regions(&rig)?;
    let points = reference_view::points(&rig, &frame_set, &regions);
    let counts = reference_view::counted(&points)
        .map_err(|reason| InputError::file(&options.input, reason))?;
    let replace = Replace::Nothing.or_forced(options.force);
    let output = Output::open(&options.out, replace)?;
    // The old file stays until the new one is whole.
    output.write(&recorded(options, rig, &frame_set, regions)?)?;
    let path = printable(options.out.display()).to_string();
    if options.json {
        let known = points.iter().filter_map(|(_, points)| points.as_ref().ok());
        let all: usize = known.sum();
        json::line(out, &json!({"file": path, "points": all}))?;
    } else {
        writeln!(out, "saved a reference view of {counts} in {path}")?;
    }
    out.flush()?;
    Ok(())
}

/// Returns the file: a recording of the frame set.
fn recorded(
    options: &ReferenceOptions,
    rig: RigFile,
    frame_set: &FrameSet,
    regions: Regions,
) -> Result<Vec<u8>, Failure> {
    let origin = Origin {
        rig,
        rig_text: None,
        estimator: Estimator::Midpoint,
        twin: None,
        is_real: false,
        seed: None,
        regions,
    };
    let folder = tempfile::tempdir();
    let folder = folder.map_err(|cause| InputError::io(&options.out, "prepare", &cause))?;
    let path = folder.path().join("view.mcap");
    let recording = Opened::new(&path)?.start(&origin)?;
    if let Some(tap) = recording.tap() {
        let keyframe = Measurement {
            stamp_us: frame_set.time_us,
            outcome: Outcome::Keyframe,
            ..Measurement::default()
        };
        tap.frame_set(Some(frame_set), keyframe);
        tap.end(frame_set.time_us);
    }
    recording.finish()?;
    let read = std::fs::read(&path);
    Ok(read.map_err(|cause| InputError::io(&options.out, "prepare", &cause))?)
}

/// Reads the frame set to save, and its rig.
fn read(options: &ReferenceOptions) -> Result<(FrameSet, RigFile), Failure> {
    let path = &options.input;
    let is_folder = path.is_dir() && !is_recording(path);
    options.pair.goes_with(is_folder, "a folder")?;
    let rig = options.rig.as_ref().map(|path| {
        let rig = RigFile::read(path)?;
        warnings::rig(path, &rig);
        Ok::<_, InputError>(rig)
    });
    let rig = rig.transpose()?;
    let chosen = |frame_sets: &mut dyn Iterator<Item = Result<FrameSet, InputError>>| {
        let missing = || {
            let frame = options.frame;
            InputError::file(
                path,
                format!("has no frame set {frame}; they are counted from 0"),
            )
        };
        frame_sets.nth(options.frame).ok_or_else(missing)?
    };
    if !is_folder {
        let Rigged { frames, rig } = options.recording.open(path, rig)?;
        return Ok((chosen(&mut frames.frame_sets())?, rig));
    }
    let Some(rig) = rig else {
        return Err(rig_missing(
            "reference INPUT --rig <RIG.toml> --out <FILE.mcap>",
        ));
    };
    let folder = options.pair.open(path, &rig)?;
    Ok((chosen(&mut folder.frame_sets())?, rig))
}
