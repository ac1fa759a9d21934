//! `trinocular track`: the servo on the twin, in closed loop with the simulator or driven by recorded images.

mod recorded;
mod simulated;

use super::port::PortOption;
use super::scene::SceneOptions;
use clap::{Args, ValueEnum};
use host::error::Failure;
use host::experiment::path::Path;
use host::sums;
use std::io::Write;
use std::path::PathBuf;

/// Where the pictures come from.
#[derive(Debug, Args)]
#[group(id = "source", required = true, multiple = false)]
pub struct Source {
    /// Rendered cameras on the stage, in closed loop
    #[arg(long)]
    sim: bool,

    /// A folder of captures: one subfolder per camera, named as in the rig file, equal file names for one instant
    #[arg(long, value_name = "DIR", requires = "rig")]
    images: Option<PathBuf>,
}

/// Follow a target: simulated cameras in closed loop, or recorded images
///
/// The station is the built-in twin: the controller board's own code on virtual time; or, for --sim, one on a serial --port, in real time.
/// With --sim the cameras ride on the stage and see a poster
/// that moves along --path. With --images the pictures come from a folder; since they cannot react to the stage, the cameras count as
/// fixed, and the stage copies the target's motion. One line per picture goes to standard output.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Options {
    #[command(flatten)]
    source: Source,

    /// The rig file (TOML); with a `stage` section that stage is used, else 80 steps/mm, 100 mm/s
    #[arg(long, value_name = "RIG.toml", conflicts_with = "sim")]
    rig: Option<PathBuf>,

    #[command(flatten)]
    station: PortOption,

    /// How the simulated target moves: steps, line, circle, lissajous or still
    #[arg(long, default_value_t = Path::Circle)]
    path: Path,

    /// How long to follow the simulated target, s
    #[arg(long, value_name = "S", default_value_t = 8.0)]
    seconds: f64,

    /// Pictures per second
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    fps: f64,

    /// From picture to frame at the station, ms (simulated)
    #[arg(long, value_name = "MS", default_value_t = 20)]
    latency: u64,

    /// The station's estimator
    #[arg(long, value_enum, default_value_t = Estimator::Midpoint)]
    method: Estimator,

    /// Print one JSON object per picture and line
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    scene: SceneOptions,
}

/// The station's estimators.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Estimator {
    /// The paper's eq. 9
    ClosedForm,
    /// Exact for finite displacements
    Midpoint,
}

impl From<Estimator> for sums::Estimator {
    fn from(estimator: Estimator) -> Self {
        match estimator {
            Estimator::ClosedForm => Self::ClosedForm,
            Estimator::Midpoint => Self::Midpoint,
        }
    }
}

const EXAMPLES: &str = "\
Examples:
  trinocular track --sim
  trinocular track --sim --path lissajous --seconds 16 --json > run.jsonl
  trinocular track --sim --port /dev/ttyACM0 --path still
  trinocular track --images captures/ --rig rig.toml";

/// Runs the command.
pub fn run(options: &Options, out: &mut impl Write) -> Result<(), Failure> {
    let range = |name: &str, value: f64, low: f64, high: f64| match (low..=high).contains(&value) {
        true => Ok(()),
        false => Err(Failure::Usage(format!(
            "--{name} is {value}, must be {low} to {high}"
        ))),
    };
    range("fps", options.fps, 1.0, 200.0)?;
    range("seconds", options.seconds, 0.1, 3600.0)?;
    let longest_ms = (1000.0 / options.fps - 3.0).max(1.0).floor();
    range("latency", options.latency as f64, 0.0, longest_ms)?;
    match (&options.source.images, &options.rig) {
        (Some(_), Some(_)) if options.station.is_given() => Err(Failure::Usage(
            "--port goes with --sim: recorded images are followed by the twin".to_owned(),
        )),
        (Some(folder), Some(rig)) => recorded::run(options, folder, rig, out),
        _ => simulated::run(options, out),
    }
}
