//! `trinocular jog`: moves the stage by a distance.

use std::io::Write;

use super::by_hand::{
    Hand, PortArgument, StageArgument, condition, in_mm, position, why_it_stands,
};
use super::progress::Progress;
use crate::commands::failure::Failure;
use clap::Args;
use serde_json::json;
use shared::frame::message::{Command, Status};
use shared::safety::Trust;
use trinocular_client::allowance::Allowance;
use trinocular_client::diagnosis;
use trinocular_rig::notice;
use trinocular_rig::rig_file::Stage;

/// Longest jog, mm: a longer one is taken for a wrong unit.
const LONGEST_MM: f64 = 1000.0;

/// Move the stage by a distance along its axes, in mm, and wait until it stands
///
/// While the position is unknown it moves slowly, only as far as unknown_window_mm of the rig file
/// (10 mm), and knows no soft limits: keep an eye on it. Afterwards the soft limits shorten the
/// move. Ctrl-C stops the stage on a ramp.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Options {
    /// Distances, mm: x=1.5 y=-2; axes that are not named stand still
    #[arg(value_name = "AXIS=MM", required = true)]
    distances: Vec<Distance>,

    #[command(flatten)]
    port: PortArgument,

    #[command(flatten)]
    stage: StageArgument,

    /// Print one JSON object at the end
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  trinocular jog x=1 --port auto --rig rig.toml   # the first after the station's start
  trinocular jog y=-0.5 z=10 --port /dev/ttyACM0";

/// A distance along one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Distance {
    axis: usize,
    um: i32,
}

/// Reason why a text is no [`Distance`].
#[derive(Clone, Debug, thiserror::Error)]
enum WrongDistance {
    #[error("write an axis, =, and mm: x=1.5")]
    Form,
    #[error("no axis `{0}`: x, y, z")]
    Axis(String),
    #[error("`{0}` is not a number")]
    NotANumber(String),
    #[error("must be -{LONGEST_MM} to {LONGEST_MM} mm")]
    TooLong,
    #[error("shorter than 0.001 mm")]
    TooShort,
}

impl std::str::FromStr for Distance {
    type Err = WrongDistance;

    fn from_str(text: &str) -> Result<Self, WrongDistance> {
        let parts = text.split_once('=');
        let (axis, mm) = parts.ok_or(WrongDistance::Form)?;
        let axis = ["x", "y", "z"]
            .into_iter()
            .position(|name| axis.eq_ignore_ascii_case(name))
            .ok_or_else(|| WrongDistance::Axis(axis.to_owned()))?;
        let wrong = |_| WrongDistance::NotANumber(mm.to_owned());
        let mm: f64 = mm.parse().map_err(wrong)?;
        if !(mm.abs() <= LONGEST_MM) {
            return Err(WrongDistance::TooLong);
        }
        let um = (mm * 1e3).round() as i32;
        if um == 0 && mm != 0.0 {
            return Err(WrongDistance::TooShort);
        }
        Ok(Self { axis, um })
    }
}

/// Collects one distance per axis, µm.
fn along_axes(distances: &[Distance]) -> Result<[i32; 3], Failure> {
    let mut um = [None; 3];
    for distance in distances {
        if um[distance.axis].replace(distance.um).is_some() {
            let name = ['x', 'y', 'z'][distance.axis];
            return Err(Failure::Usage(format!("axis {name} is named twice")));
        }
    }
    Ok(um.map(Option::unwrap_or_default))
}

/// Runs the command.
pub fn run(options: &Options, out: &mut impl Write) -> Result<(), Failure> {
    let distance_um = along_axes(&options.distances)?;
    let stage = options.stage.read()?;
    let mut hand = Hand::connect(&options.port)?;
    let before = hand.ready_to_move("jog", stage.is_some())?;
    hand.configure(stage.as_ref(), &options.stage)?;
    hand.start_heartbeat()?;
    let started = hand.command("jog", Command::Jog { distance_um })?;
    if started.trust != Trust::Homed {
        notice!(
            "the position is {}: slowly, and without soft limits",
            diagnosis::trust(started.trust)
        );
    }
    let mut progress = Progress::new("moving");
    let watch = |status: &Status| progress.at(share(&before, status));
    let allowance = stage.as_ref().map_or(Allowance::UNKNOWN, |stage| {
        Allowance::of_distance(stage, distance_um.map(|um| f64::from(um) * 1e-3))
    });
    let (end, stopping) = hand.wait_for_rest(allowance, watch)?;
    drop(progress);
    tell(options, &before, &end, stage.as_ref(), out)?;
    why_it_stands(&hand, &end, stopping)?;
    if let Some(stage) = &stage {
        warn_of_soft_limits(distance_um, &before, &end, stage);
    }
    Ok(())
}

fn share(before: &Status, now: &Status) -> f64 {
    let far =
        |axis: usize, to: [i32; 3]| f64::from(to[axis]) - f64::from(before.position_steps[axis]);
    let shares = (0..3).map(|axis| far(axis, now.position_steps) / far(axis, now.target_steps));
    // An axis at rest has no share.
    shares.filter(|share| share.is_finite()).fold(1.0, f64::min)
}

fn tell(
    options: &Options,
    before: &Status,
    end: &Status,
    stage: Option<&Stage>,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let moved = moved_steps(before, end);
    if options.json {
        let mut object = condition(end);
        object["moved_steps"] = json!(moved);
        object["moved_mm"] = json!(stage.map(|stage| in_mm(moved, stage)));
        object["position_mm"] = json!(stage.map(|stage| in_mm(end.position_steps, stage)));
        writeln!(out, "{object}")?;
    } else {
        writeln!(out, "moved by  {}", position(moved, stage))?;
        let trust = diagnosis::trust(end.trust);
        writeln!(
            out,
            "now at    {}, {trust}",
            position(end.position_steps, stage)
        )?;
    }
    Ok(())
}

fn moved_steps(before: &Status, end: &Status) -> [i32; 3] {
    std::array::from_fn(|axis| end.position_steps[axis].wrapping_sub(before.position_steps[axis]))
}

fn warn_of_soft_limits(distance_um: [i32; 3], before: &Status, end: &Status, stage: &Stage) {
    let moved_mm = in_mm(moved_steps(before, end), stage);
    for axis in 0..3 {
        let short_mm = (f64::from(distance_um[axis]) * 1e-3 - moved_mm[axis]).abs();
        if short_mm * stage.steps_per_mm[axis] > 1.0 {
            let name = ['x', 'y', 'z'][axis];
            let [least, greatest] = stage.travel_mm[axis];
            notice!(
                "{name} was shortened by {short_mm:.4} mm: its soft limits are {least} to \
                 {greatest} mm"
            );
        }
    }
}
