//! `trinocular bench`: times the flow on this machine.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::frames::{Frames, RecordingInput, Rigged, rig_missing};
use super::region::RegionOption;
use crate::commands::failure::Failure;
use crate::commands::folder_input::PairOption;
use clap::{Args, Subcommand};
use serde::Serialize;
use serde_json::{Map, Value, json};
use trinocular_core::rig::Rig;
use trinocular_recording::read::is_recording;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::{Flow, FlowRefusal, FlowSettings, PipelineStage};
use trinocular_vision::images::{FrameSet, Image};
use trinocular_vision::stage_timings::{StageTimings, with_fresh_keyframe, with_kept_keyframe};

/// Time the image processing of this program and measure its accuracy
#[derive(Debug, Args)]
pub struct BenchOptions {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Flow(FlowOptions),
    Pose(super::bench_pose::PoseBenchOptions),
    Robustness(super::robustness::RobustnessOptions),
}

/// Time the flow from images to correspondences
///
/// The time of a frame set is that from one frame set to the next when all points are chosen anew:
/// filter the new images, choose points in the previous middle image, match them in the other two,
/// follow them into the new images of all cameras. With a keyframe, the points are those of the
/// first frame set: filter, and follow. Reading the files is not timed.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
struct FlowOptions {
    /// A folder of frame sets: left/ middle/ right/ (or the rig's cameras) with equal file names; or
    /// a recording (MCAP, ROS 2 bag)
    ///
    /// Each frame set follows the one before it; a single one follows itself. All are kept in
    /// memory, so their pixels may take 1 GB at most.
    folder: PathBuf,

    /// The rig file of the cameras that took the frame sets; a recording may hold it
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,

    #[command(flatten)]
    pair: PairOption,

    #[command(flatten)]
    region: RegionOption,

    #[command(flatten)]
    recording: RecordingInput,

    /// Number of passes through the whole folder
    #[arg(
        long,
        value_name = "N",
        default_value_t = 10,
        value_parser = clap::value_parser!(u32).range(1..=100_000)
    )]
    repeat: u32,

    /// Threads that share the work
    #[arg(
        long,
        value_name = "T",
        default_value_t = 1,
        value_parser = clap::value_parser!(u8).range(1..=64)
    )]
    threads: u8,

    /// Largest number of points to choose
    #[arg(
        long,
        value_name = "N",
        default_value_t = 200,
        value_parser = clap::value_parser!(u16).range(8..=4000)
    )]
    corners: u16,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Times are of this machine as busy as it is: the least is the one to compare.

Examples:
  trinocular bench flow captures/ --rig rig.toml
  trinocular bench flow captures/ --rig rig.toml --threads 3 --repeat 100 --json";

/// Runs the command.
pub fn run(options: &BenchOptions, out: &mut impl Write) -> Result<(), Failure> {
    match &options.what {
        What::Flow(options) => run_flow(options, out),
        What::Pose(options) => super::bench_pose::run(options, out),
        What::Robustness(options) => super::robustness::run(options, out),
    }
}

fn run_flow(options: &FlowOptions, out: &mut impl Write) -> Result<(), Failure> {
    let (rig, frame_sets) = open(options)?;
    let settings = FlowSettings {
        max_corners: usize::from(options.corners),
        max_points: usize::from(options.corners),
        threads: usize::from(options.threads),
        ..FlowSettings::default()
    };
    let refused =
        |refusal: FlowRefusal| Failure::Images(format!("{}: {refusal}", options.folder.display()));
    let mut flow = Flow::new(&rig.rig, settings).map_err(refused)?;
    flow.set_regions(options.region.regions(&rig)?);
    let mut timing = Timing::default();
    for _ in 0..options.repeat {
        timing.go_through(&flow, &frame_sets);
    }
    if let (Some(refusal), true) = (timing.refusal.take(), timing.sets.is_empty()) {
        return Err(refused(refusal));
    }
    let report = timing.report(options, &rig.rig, frame_sets.len());
    if options.json {
        super::json::line(out, &report)?;
    } else {
        report.print(out)?;
    }
    Ok(())
}

/// Reads the rig file and all frame sets of the folder.
fn open(options: &FlowOptions) -> Result<(RigFile, Vec<FrameSet>), Failure> {
    let rig = options.rig.as_deref().map(RigFile::read).transpose()?;
    if let (Some(path), Some(rig)) = (&options.rig, &rig) {
        super::warnings::rig(path, rig);
    }
    let is_recorded = is_recording(&options.folder);
    options.pair.goes_with(!is_recorded, "a folder")?;
    if is_recorded {
        let Rigged { frames, rig } = options.recording.open(&options.folder, rig)?;
        let sets = recorded(options, &frames, &rig)?;
        return Ok((rig, sets));
    }
    let Some(file) = rig else {
        return Err(rig_missing("bench flow FOLDER --rig <RIG.toml>"));
    };
    let folder = options.pair.open(&options.folder, &file)?.complete()?;
    let cameras = file.names.len();
    let check = |count| fits_memory(&options.folder, count, cameras, file.rig.image_size_px);
    check(folder.count().unwrap_or(0))?;
    let mut frame_sets = Vec::new();
    for frame_set in folder.frame_sets() {
        frame_sets.push(frame_set?);
        check(frame_sets.len())?;
    }
    Ok((file, frame_sets))
}

/// Reads the whole frame sets of a recording.
fn recorded(
    options: &FlowOptions,
    frames: &Frames,
    rig: &RigFile,
) -> Result<Vec<FrameSet>, InputError> {
    let mut sets = Vec::new();
    for set in frames.frame_sets() {
        let set = set?;
        if set.images.iter().any(Image::is_missing) {
            let reason = "a frame set lacks an image of a camera: bench takes whole ones";
            return Err(InputError::file(&options.folder, reason));
        }
        sets.push(set);
        let size_px = rig.rig.image_size_px;
        fits_memory(&options.folder, sets.len(), rig.names.len(), size_px)?;
    }
    match sets.is_empty() {
        true => Err(InputError::file(&options.folder, "holds no frame set")),
        false => Ok(sets),
    }
}

/// Largest size of the pixels of all frame sets, bytes.
const MEMORY: u64 = 1 << 30;

/// Refuses more frame sets than fit into memory. Reading their files is not timed, so they are not
/// read again for each repetition.
fn fits_memory(
    path: &Path,
    count: usize,
    cameras: usize,
    size_px: [u32; 2],
) -> Result<(), InputError> {
    let [width, height] = size_px.map(u64::from);
    let each = (width * height).saturating_mul(cameras as u64).max(1);
    let (count, most) = (count as u64, MEMORY / each);
    if count <= most {
        return Ok(());
    }
    let reason = format!(
        "{count} frame sets of {cameras} x {width} x {height} px take {} MB, but bench keeps them \
         in memory, {} MB at most; give a folder of {most} frame sets or fewer",
        count.saturating_mul(each) >> 20,
        MEMORY >> 20
    );
    Err(InputError::file(path, reason))
}

/// All measured times.
#[derive(Default)]
struct Timing {
    sets: Vec<StageTimings>,
    keyframes: Vec<StageTimings>,
    points: Vec<usize>,
    attempts: usize,
    refusal: Option<FlowRefusal>,
}

impl Timing {
    /// Times each pair of consecutive frame sets, then all of them against the first. `flow` has no
    /// keyframe and has seen no frame set; every series starts with a clone of it.
    fn go_through(&mut self, flow: &Flow, frame_sets: &[FrameSet]) {
        let last = frame_sets.len().saturating_sub(1);
        let pairs = (0..last.max(1)).map(|i| (&frame_sets[i], &frame_sets[(i + 1).min(last)]));
        let (mut filter, mut fresh) = (flow.clone(), flow.clone());
        for (before, now) in pairs {
            self.attempts += 1;
            let done = filter
                .filter(before)
                .and_then(|before| with_fresh_keyframe(&mut fresh, before, now));
            match done {
                Ok(done) => {
                    self.sets.push(done.timings);
                    self.points.push(done.measurement.correspondences.len());
                }
                Err(refusal) => self.refusal = Some(refusal),
            }
        }
        let mut kept = flow.clone();
        if kept.set_keyframe(&frame_sets[0]).is_err() {
            return;
        }
        for now in &frame_sets[last.min(1)..] {
            if let Ok((_, timings)) = with_kept_keyframe(&mut kept, now) {
                self.keyframes.push(timings);
            }
        }
    }

    fn report(mut self, options: &FlowOptions, rig: &Rig, captures: usize) -> Report {
        self.points.sort_unstable();
        let spent = |timings: &[StageTimings]| Spread::of(timings.iter().map(StageTimings::total));
        let stages = PipelineStage::ALL.map(|stage| {
            let median = Spread::of(self.sets.iter().map(|timings| timings.of(stage)));
            (
                stage.name().to_owned(),
                json!(median.map_or(f64::NAN, |s| s.median)),
            )
        });
        Report {
            frame_set_ms: spent(&self.sets),
            stages_ms: stages.into_iter().collect(),
            keyframe_ms: spent(&self.keyframes),
            points: self.points.get(self.points.len() / 2).copied().unwrap_or(0),
            corners: options.corners,
            image_size_px: rig.image_size_px,
            captures,
            frame_sets: self.sets.len(),
            refused: self.attempts - self.sets.len(),
            threads: options.threads,
        }
    }
}

/// Statistics of times, ms.
#[derive(Clone, Copy, Debug, Serialize)]
struct Spread {
    median: f64,
    min: f64,
}

impl Spread {
    /// Computes the statistics; `None` without times.
    fn of(times: impl Iterator<Item = Duration>) -> Option<Self> {
        let mut ms: Vec<f64> = times.map(|t| t.as_secs_f64() * 1e3).collect();
        ms.sort_by(f64::total_cmp);
        let round = |ms: f64| (ms * 1e4).round() / 1e4;
        Some(Self {
            median: round(*ms.get(ms.len() / 2)?),
            min: round(*ms.first()?),
        })
    }
}

/// Result as it is printed.
#[derive(Debug, Serialize)]
struct Report {
    frame_set_ms: Option<Spread>,
    /// Median time of each stage, ms.
    stages_ms: Map<String, Value>,
    keyframe_ms: Option<Spread>,
    /// Number of consistent points in the median frame set.
    points: usize,
    corners: u16,
    image_size_px: [u32; 2],
    captures: usize,
    frame_sets: usize,
    refused: usize,
    threads: u8,
}

impl Report {
    fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        let [width, height] = self.image_size_px;
        writeln!(
            out,
            "{} frame sets of {width} x {height} px, {} corners, threads: {}",
            self.captures, self.corners, self.threads
        )?;
        writeln!(out, "{:12} {:>9} {:>9}", "", "median ms", "least ms")?;
        let rows = [
            ("frame set", &self.frame_set_ms),
            ("keyframe", &self.keyframe_ms),
        ];
        for (name, spread) in rows {
            if let Some(Spread { median, min }) = spread {
                writeln!(out, "{name:12} {median:9.3} {min:9.3}")?;
            }
        }
        for stage in PipelineStage::ALL {
            let median = self.stages_ms[stage.name()].as_f64().unwrap_or(f64::NAN);
            writeln!(out, "  {:10} {median:9.3}", stage.name())?;
        }
        writeln!(
            out,
            "{} points in the median frame set; {} timed, {} refused",
            self.points, self.frame_sets, self.refused
        )
    }
}
