//! `trinocular latency`: measures the delay of each camera's time stamps from images of a stage that
//! goes to and fro.

mod live;
mod observed;
mod outcome;
mod simulated;

use super::by_hand::StageArgument;
use super::driven::{Driven, within_travel};
use super::scene::SceneOptions;
use crate::commands::failure::Failure;
use crate::commands::range;
use clap::{ArgGroup, Args};
use observed::Observed;
use outcome::Outcome;
use std::io::Write;
use std::path::PathBuf;
use trinocular_rig::error::InputError;
use trinocular_rig::output::{Output, Replace};
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::mistake::explain_keyframe;
use trinocular_vision::flow::{Flow, FlowSettings};
use trinocular_vision::hand_eye::delay;
use trinocular_vision::hand_eye::rewrite::with_delays;
use trinocular_vision::images::{FrameSet, Image};

/// Measure the delay of each camera's time stamps, from its images of a stage that goes to and fro
///
/// The stage goes to and fro along x, then along y, four times each, past a textured target at
/// rest. The image of each camera moves with the stage, but later by the stamp's delay: the time
/// from the middle of the exposure to the stamp that this computer gives the image. The command
/// finds it for each camera on its own, with its standard deviation, which includes that of the
/// station's clock.
///
/// The command warns of a delay that is not that of the rig file, and of cameras that are not
/// exposed together. With --out it writes the delays as `delay_ms` of the cameras; `track`, `serve`
/// and `calibrate-stage` then use them.
///
/// Cameras that the station triggers (`[trigger]` in the rig file) have no delay to measure: it
/// refuses them.
///
/// It refuses a delay that differs between passes, as on a computer that is too busy, and images
/// that move otherwise than the stage.
///
/// With --port the station must know its position (`home` or `zero`). The cameras may stand beside
/// the stage if the target is on it.
#[derive(Debug, Args)]
#[command(
    after_help = EXAMPLES,
    group = ArgGroup::new("bench").required(true).args(["sim", "port"])
)]
pub struct LatencyOptions {
    /// The rig file (TOML) with its stage
    #[command(flatten)]
    stage: StageArgument,

    /// Use a simulated stage with rendered cameras on it, whose stamps are late by --camera-delay
    #[arg(long)]
    sim: bool,

    /// Use the station on this port; `auto` is the only one on USB, `twin` the one that
    /// `trinocular twin` simulates
    #[arg(
        long,
        value_name = "PATH",
        conflicts_with = "sim",
        requires = "cameras"
    )]
    port: Option<String>,

    /// Live cameras, in the order of the rig file's, as for `track`; `twin` stands for those of
    /// `trinocular twin --with-target --path still` on --port
    #[arg(
        long,
        value_name = "DEVICE,...",
        requires = "port",
        conflicts_with = "sim",
        value_delimiter = ','
    )]
    cameras: Option<Vec<PathBuf>>,

    /// Images per second of each camera, 5 to 200. Take the rate of `track`: the delay of some
    /// cameras depends on it
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    fps: f64,

    /// Distance that the stage goes along x and y, either way, 0.1 to 100 mm
    #[arg(long, value_name = "MM", default_value_t = 5.0)]
    reach: f64,

    /// Write the rig file with the measured delays here: the same text with other `delay_ms`
    #[arg(long, value_name = "FILE.toml")]
    out: Option<PathBuf>,

    /// Replace the file given by --out if it exists
    #[arg(long, requires = "out")]
    force: bool,

    /// Print one JSON object instead
    #[arg(long)]
    json: bool,

    /// With --sim: delay of the time stamps, of all cameras or of each, ms [default: the rig file's
    /// `delay_ms`, or 0]
    #[arg(
        long,
        value_name = "MS,...",
        allow_negative_numbers = true,
        value_delimiter = ',',
        conflicts_with = "port"
    )]
    camera_delay: Option<Vec<f64>>,

    #[command(flatten, next_help_heading = "With --sim: the simulated target")]
    scene: SceneOptions,
}

const EXAMPLES: &str = "\
Examples:
  trinocular latency --sim --rig rig.toml --camera-delay 4,7.5,12 --fps 60
  trinocular latency --port auto --rig rig.toml --cameras rig --out rig.toml --force
  trinocular latency --port auto --rig rig.toml --cameras /dev/video0,/dev/video2,/dev/video4";

/// Refusal of a rig whose cameras the station triggers.
const TRIGGERED: &str = "has [trigger], so that there is no delay to measure: the capture time of \
                         a triggered image is that of its trigger, on the station's own clock, \
                         whatever its time stamp is; `calibrate-stage` checks `exposure_us`; \
                         remove [trigger] to measure the delays of cameras that run freely";

/// Axes of the stage that passes go along: two, so that one of them moves the image however the
/// cameras are mounted.
const AXES: [usize; 2] = [0, 1];

/// Ends of the passes along each axis, as shares of the reach, from -1 on.
const PASSES: [f64; 4] = [1.0, -1.0, 1.0, -1.0];

/// Number of images at rest: the keyframe, and those that show the noise.
const AT_REST: usize = 13;

/// Time for which a pass goes on after the motion, ms: more than the longest delay.
const AFTER_MS: u64 = 400;

/// Cameras and a stage that can move.
trait Bench {
    /// Returns the position of the stage, mm from zero.
    fn position_mm(&mut self) -> Result<[f64; 3], Failure>;

    /// Moves to a position, mm from zero, and waits until the stage stands.
    fn go(&mut self, position_mm: [f64; 3]) -> Result<(), Failure>;

    /// Gives `see` this many images of each camera at rest, with the number of the camera and the
    /// stamp, s.
    fn rest(&mut self, count: usize, see: &mut See<'_>) -> Result<(), Failure>;

    /// Moves to a position, mm from zero, and gives `see` the images on the way. Returns the path of
    /// the stage on the clock of the stamps, and the bound of that clock's error, ms; `None` if the
    /// station's clock has jumped meanwhile.
    fn pass(
        &mut self,
        position_mm: [f64; 3],
        see: &mut See<'_>,
    ) -> Result<Option<(delay::Path, f64)>, Failure>;
}

/// Receiver of images: camera, stamp, s, and image.
type See<'a> = dyn FnMut(usize, f64, &Image) + 'a;

/// Runs the command.
pub fn run(options: &LatencyOptions, out: &mut impl Write) -> Result<(), Failure> {
    range::check("reach", options.reach, 0.1, 100.0)?;
    range::check("fps", options.fps, 5.0, 200.0)?;
    let path = options.stage.path()?;
    let (rig, text) = RigFile::read_with_text(path)?;
    if rig.trigger.is_some() {
        return Err(InputError::file(path, TRIGGERED).into());
    }
    super::warnings::rig(path, &rig);
    let stage = options.stage.stage_of(&rig)?;
    if let Some(to) = &options.out {
        // Check before the work, which would be lost otherwise.
        super::destination::refuse_existing(to, options.force, path)?;
    }
    let mut bench: Box<dyn Bench> = match (&options.port, &options.cameras) {
        (Some(port), Some(devices)) => {
            let driven = || Driven::connect(&options.stage, port, &stage);
            Box::new(live::bench(options, devices, &rig, &stage, driven)?)
        }
        _ => Box::new(simulated::bench(options, &rig, &stage)?),
    };
    let centre_mm = bench.position_mm()?;
    let farthest_mm = std::array::from_fn(|axis| match AXES.contains(&axis) {
        true => options.reach,
        false => 0.0,
    });
    within_travel(&stage, centre_mm, farthest_mm)?;
    let observed = observe(options, &rig, bench.as_mut(), centre_mm)?;
    let outcome = Outcome::of(&observed, &rig)?;
    outcome.warn(1e3 / options.fps);
    if let Some(to) = &options.out {
        let text = with_delays(path, &text, outcome.delays_ms())?;
        Output::open_successor(to, Replace::Anything, path)?.write(&text)?;
    }
    match options.json {
        true => super::json::line(out, &outcome.json())?,
        false => outcome.print(options.out.as_deref(), out)?,
    }
    Ok(())
}

/// Moves the stage to and fro and follows the points of each camera.
fn observe(
    options: &LatencyOptions,
    rig: &RigFile,
    bench: &mut dyn Bench,
    centre_mm: [f64; 3],
) -> Result<Observed, Failure> {
    let mut first: Vec<Option<Image>> = vec![None; rig.names.len()];
    bench.rest(1, &mut |camera, _, image| {
        first[camera] = Some(image.clone());
    })?;
    let images = first.into_iter().flatten().collect();
    let keyframe = FrameSet { time_us: 0, images };
    let mut observed = Observed::start(rig, &keyframe.images)?;
    check_cameras(rig, &keyframe)?;
    bench.rest(AT_REST - 1, &mut |camera, _, image| {
        observed.at_rest(camera, image);
    })?;
    let at = |axis: usize, share: f64| {
        let mut position_mm = centre_mm;
        position_mm[axis] += share * options.reach;
        position_mm
    };
    for axis in AXES {
        bench.go(at(axis, -1.0))?;
        for share in PASSES {
            let pass = observed.begin_pass(axis);
            let passed = bench.pass(at(axis, share), &mut |camera, stamp_s, image| {
                observed.passing(camera, pass, stamp_s, image);
            })?;
            observed.end_pass(pass, passed);
        }
        bench.go(centre_mm)?;
    }
    observed.check_clock()?;
    Ok(observed)
}

/// Refuses images that are not those of the rig file's cameras, in this order.
fn check_cameras(rig: &RigFile, keyframe: &FrameSet) -> Result<(), Failure> {
    let mut flow = Flow::new(&rig.rig, FlowSettings::default())
        .map_err(|refusal| Failure::Images(refusal.to_string()))?;
    flow.set_keyframe(keyframe).map_err(|refusal| {
        let reason = explain_keyframe(&rig.rig, &rig.names, keyframe, &refusal);
        Failure::Images(format!("the first images cannot be used: {reason}"))
    })
}
