//! `trinocular calibrate-stage`: measures the hand-eye matrix from images taken along the stage's
//! axes.

mod live;
mod real;
mod simulated;
mod timing;

use std::io::Write;
use std::path::PathBuf;
use timing::Timing;

use super::by_hand::{AxisName, StageArgument};
use super::driven::{Driven, within_travel};
use super::scene::SceneOptions;
use crate::commands::failure::Failure;
use clap::{ArgGroup, Args};
use serde_json::json;
use trinocular::report::{Cell, Table};
use trinocular_rig::notice;
use trinocular_rig::output::{Output, Replace};
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::hand_eye::fit::{Fit, Sample, fit};
use trinocular_vision::hand_eye::plan::{FARTHEST, Stop, stops};
use trinocular_vision::hand_eye::rewrite::with_matrix;
use trinocular_vision::hand_eye::watch::Watch;
use trinocular_vision::images::FrameSet;

/// Measure how the cameras sit on the stage: the matrix of the rig file, from images of a target
/// at rest
///
/// The stage goes along each of its axes, a few mm either way, and stops for images of a textured
/// target at rest. The command fits the matrix to the displacements and prints it with its standard
/// deviation; it refuses a fit whose residuals are larger than noise. The matrix covers the
/// cameras' rotation, a reversed axis, and an error of steps_per_mm.
///
/// The stage then passes the target, and the command measures the delay of the cameras' time
/// stamps, for `track --delay`, or what is left of it beyond the rig file's `delay_ms`; not with
/// --images, which have none. `latency` measures the delay of each camera.
///
/// With [trigger] in the rig file the station triggers the --cameras. There is no delay then; the
/// command measures the time from the trigger to the middle of the exposure, and warns of an
/// `exposure_us` that does not fit.
///
/// With --port the station must know its position (`home` or `zero`). The images come from live
/// --cameras, or the operator puts a frame set into --images at every stop, when the program asks
/// for it.
#[derive(Debug, Args)]
#[command(
    visible_alias = "hand-eye",
    after_help = EXAMPLES,
    group = ArgGroup::new("driven").required(true).args(["sim", "port"])
)]
pub struct CalibrateStageOptions {
    /// The rig file (TOML) with its stage
    #[command(flatten)]
    stage: StageArgument,

    /// Use a simulated stage with rendered cameras on it, mounted by --turned, --scaled and
    /// --mirrored
    #[arg(long)]
    sim: bool,

    /// Use the station on this port; `auto` is the only one on USB, `twin` the one that
    /// `trinocular twin` simulates
    #[arg(long, value_name = "PATH", conflicts_with = "sim", requires = "eyes")]
    port: Option<String>,

    /// Live cameras, in the order of the rig file's, as for `track`; `twin` stands for those of
    /// `trinocular twin --with-target --path still` on --port
    #[arg(
        long,
        value_name = "DEVICE,...",
        requires = "port",
        conflicts_with = "sim",
        value_delimiter = ',',
        group = "eyes"
    )]
    cameras: Option<Vec<PathBuf>>,

    /// Folder of the frame sets: one subfolder per camera, equal file names for one instant.
    /// Frame sets that already exist are not used
    #[arg(
        long,
        value_name = "DIR",
        requires = "port",
        conflicts_with = "sim",
        group = "eyes"
    )]
    images: Option<PathBuf>,

    /// Timeout for a frame set, s
    #[arg(
        long,
        value_name = "S",
        default_value_t = 120,
        value_parser = clap::value_parser!(u16).range(1..=3_600)
    )]
    patience: u16,

    /// Distance that the stage goes along each axis, either way, mm
    #[arg(long, value_name = "MM", default_value_t = 5.0)]
    reach: f64,

    /// Write the corrected rig file here: the same text with another matrix
    #[arg(long, value_name = "FILE.toml")]
    out: Option<PathBuf>,

    /// Replace the file given by --out if it exists
    #[arg(long, requires = "out")]
    force: bool,

    /// Print one JSON object instead
    #[arg(long)]
    json: bool,

    /// Rotation of the simulated cameras against the stage about x, y, z, degrees
    #[arg(
        long,
        value_name = "DEG",
        num_args = 3,
        default_values_t = [2.0, -3.0, 3.5],
        allow_negative_numbers = true,
        conflicts_with = "port"
    )]
    turned: Vec<f64>,

    /// True motion of the simulated stage per commanded mm, mm
    #[arg(
        long,
        value_name = "FACTOR",
        default_value_t = 1.0,
        conflicts_with = "port"
    )]
    scaled: f64,

    /// Reversed axis of the simulated stage
    #[arg(long, value_enum, value_name = "AXIS", conflicts_with = "port")]
    mirrored: Option<AxisName>,

    /// Delay of the simulated cameras' time stamps, ms
    #[arg(
        long,
        value_name = "MS",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        conflicts_with = "port"
    )]
    late: f64,

    #[command(flatten)]
    scene: SceneOptions,
}

const EXAMPLES: &str = "\
Examples:
  trinocular calibrate-stage --sim --rig rig.toml
  trinocular calibrate-stage --port auto --rig rig.toml --cameras /dev/video0,/dev/video2
  trinocular calibrate-stage --port auto --rig rig.toml --images captures/ --out rig.toml --force";

/// A stage that can move, and cameras on it.
trait StageBench {
    /// Returns the position of the stage, mm from zero.
    fn position_mm(&mut self) -> Result<[f64; 3], Failure>;

    /// Moves to a position, mm from zero, and waits until the stage stands; returns the position
    /// reached.
    fn go(&mut self, position_mm: [f64; 3]) -> Result<[f64; 3], Failure>;

    /// Takes a frame set.
    fn look(&mut self) -> Result<FrameSet, Failure>;

    /// Moves to a position, mm from zero, and takes frame sets on the way; `None` if the cameras
    /// cannot.
    fn pass(&mut self, _position_mm: [f64; 3]) -> Result<Option<Pass>, Failure> {
        Ok(None)
    }
}

/// Path of the stage, and the frame sets that were taken on it.
#[derive(Default)]
struct Pass {
    /// Times, s, and positions of the stage, mm.
    path: Vec<(f64, [f64; 3])>,
    /// Frame sets with their time stamps.
    captures: Vec<FrameSet>,
}

/// Runs the command.
pub fn run(options: &CalibrateStageOptions, out: &mut impl Write) -> Result<(), Failure> {
    if !(options.reach >= 0.1 && options.reach <= 100.0) {
        return Err(Failure::Usage(
            "--reach must be from 0.1 to 100 mm".to_owned(),
        ));
    }
    if !(options.late.abs() <= 100.0) {
        return Err(Failure::Usage(
            "--late must be from -100 to 100 ms".to_owned(),
        ));
    }
    let path = options.stage.path()?;
    let (rig, text) = RigFile::read_with_text(path)?;
    super::warnings::rig(path, &rig);
    let stage = options.stage.stage_of(&rig)?;
    if let Some(to) = &options.out {
        // Check before the work, which would be lost otherwise.
        super::destination::refuse_existing(to, options.force, path)?;
    }
    let mut bench: Box<dyn StageBench> = match &options.port {
        None => Box::new(simulated::bench(options, &rig, &stage)?),
        Some(port) => {
            let driven = || Driven::connect(&options.stage, port, &stage);
            match (&options.cameras, &options.images) {
                (Some(devices), _) => {
                    Box::new(live::bench(options, devices, &rig, &stage, driven)?)
                }
                (None, Some(folder)) => Box::new(real::bench(options, folder, &rig, driven)?),
                (None, None) => {
                    let needs = "--port needs --cameras or --images";
                    return Err(Failure::Usage(needs.to_owned()));
                }
            }
        }
    };
    let (samples, fit, timing) = measure(options, &rig, &stage, bench.as_mut())?;
    if let Some(to) = &options.out {
        let text = with_matrix(path, &text, &fit.matrix)?;
        Output::open_successor(to, Replace::Anything, path)?.write(&text)?;
    }
    if options.json {
        let delay = timing.as_ref().and_then(Timing::delay);
        let mut object = json!({"fit": fit, "delay": delay, "samples": samples});
        if let Some((file_ms, middle_ms)) = timing.as_ref().and_then(Timing::middle_ms) {
            object["trigger"] = json!({"middle_ms": middle_ms, "file_ms": file_ms});
        }
        super::json::line(out, &object)?;
    } else {
        print(options, &samples, &fit, &stage, out)?;
        if let Some(timing) = timing {
            timing.print(out)?;
        }
    }
    Ok(())
}

fn measure(
    options: &CalibrateStageOptions,
    rig: &RigFile,
    stage: &Stage,
    bench: &mut dyn StageBench,
) -> Result<(Vec<Sample>, Fit, Option<Timing>), Failure> {
    let centre_mm = bench.position_mm()?;
    within_travel(stage, centre_mm, [FARTHEST * options.reach; 3])?;
    let stops = stops(centre_mm, options.reach);
    let looks = stops.iter().filter(|stop| stop.looks).count();
    let mut watch = None;
    let mut samples = Vec::new();
    for Stop { position_mm, looks } in stops {
        let stands_mm = bench.go(position_mm)?;
        if !looks {
            continue;
        }
        let capture = bench.look()?;
        let Some(watch) = &mut watch else {
            let started = Watch::start(&rig.rig, &capture).map_err(|refusal| {
                Failure::Images(format!("the first images cannot be used: {refusal}"))
            })?;
            watch = Some(started);
            continue;
        };
        match watch.look(stands_mm, &capture) {
            Ok(sample) => samples.push(sample),
            Err(refusal) => notice!("at {stands_mm:.3?} mm: {refusal}"),
        }
    }
    // The keyframe is no sample: all others are measured against it.
    let fit = fit(&samples, looks - 1).map_err(|refusal| Failure::Images(refusal.to_string()))?;
    let timing = |watch| Timing::measure(options, rig, bench, watch, centre_mm, &fit);
    let timing = watch.as_mut().map(timing).transpose()?;
    Ok((samples, fit, timing))
}

fn print(
    options: &CalibrateStageOptions,
    samples: &[Sample],
    fit: &Fit,
    stage: &Stage,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let mut stops = Table::new(
        "What each stop showed, mm",
        [
            "stage",
            "target displaced, along camera axes",
            "off the fit",
        ],
    );
    for (sample, residual) in samples.iter().zip(&fit.residuals_mm) {
        stops = stops.row([
            Cell::vector(&sample.position_mm, 3, 8),
            Cell::vector(&sample.displacement_mm, 4, 8),
            Cell::vector(residual, 4, 8),
        ]);
    }
    writeln!(out, "{}", stops.to_text())?;
    let mut matrix = Table::new(
        "Camera axes to stage axes",
        [
            "stage axis",
            "matrix",
            "standard deviation",
            "in the rig file",
        ],
    );
    for axis in 0..3 {
        matrix = matrix.row([
            Cell::text(["x", "y", "z"][axis]),
            Cell::vector(&fit.matrix[axis], 5, 9),
            Cell::vector(&fit.sigma[axis], 5, 8),
            Cell::vector(&stage.matrix[axis], 5, 9),
        ]);
    }
    writeln!(out, "{}", matrix.to_text())?;
    let [x, y, z] = fit.scatter_mm;
    writeln!(
        out,
        "{:>16}: {x:.4} {y:.4} {z:.4} mm along the camera axes",
        "scatter"
    )?;
    let [x, y, z] = fit.scale;
    writeln!(
        out,
        "{:>16}: {x:.4} {y:.4} {z:.4} mm seen for a mm sent",
        "scale"
    )?;
    let hand = match fit.mirrored {
        true => "an odd number of axes runs the wrong way; the matrix makes up for it",
        false => "every axis runs the right way, or two the wrong one",
    };
    writeln!(out, "{:>16}: {hand}", "handedness")?;
    if let Some(path) = &options.out {
        writeln!(out, "{:>16}: {}", "corrected rig", path.display())?;
    }
    Ok(())
}
