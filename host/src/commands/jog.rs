//! `trinocular jog`: moves the stage by a distance.

use std::io::Write;

use super::by_hand::{Hand, PortArgument, StageArgument, condition, position, why_it_stands};
use super::json;
use super::progress::Progress;
use crate::commands::failure::Failure;
use clap::Args;
use serde_json::json;
use trinocular_client::allowance::Allowance;
use trinocular_client::below_step::check_steps;
use trinocular_client::diagnosis;
use trinocular_client::shortened::{Shortened, shortened};
use trinocular_core::frame::message::{Command, Status};
use trinocular_core::safety::{State, Trust};
use trinocular_rig::choice::unknown;
use trinocular_rig::notice;
use trinocular_rig::rig_file::Stage;

/// Longest jog, mm: a longer one is taken for a wrong unit.
const LONGEST_MM: f64 = 1000.0;

/// Names of the axes.
const NAMES: [char; 3] = ['x', 'y', 'z'];

/// Move the stage by a distance along its axes, in mm, and wait until it stands
///
/// While the position is unknown it moves slowly, only as far as unknown_window_mm of the rig file
/// (10 mm), and knows no soft limits: keep an eye on it. Afterwards the soft limits shorten the
/// move, which is reported. Ctrl-C stops the stage on a ramp.
///
/// Give the --rig that the station was configured with: only with it the command can report mm, and
/// that a soft limit has shortened the move. The station itself reports steps. With it a distance of
/// less than half a step is refused, and nothing moves; the exit code is then 2.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct JogOptions {
    /// Distances, mm: x=1.5 y=-2mm z=250um; axes that are not named stand still
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

const AXES: [&str; 3] = ["x", "y", "z"];

/// Reason why a text is no [`Distance`].
#[derive(Clone, Debug, thiserror::Error)]
enum WrongDistance {
    #[error("write an axis, =, and mm: x=1.5")]
    Form,
    #[error("{}", unknown("axis", .0, &AXES))]
    Axis(String),
    #[error("`{0}` is not a number; write mm with a decimal point: x=1.5 or x=1.5mm")]
    NotANumber(String),
    #[error("`{0}` is no unit of jog: leave it out for mm, or write mm, um or cm")]
    Unit(String),
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
        let axis = AXES
            .into_iter()
            .position(|name| axis.eq_ignore_ascii_case(name))
            .ok_or_else(|| WrongDistance::Axis(axis.to_owned()))?;
        let (number, factor) = in_unit(mm)?;
        let wrong = |_| WrongDistance::NotANumber(mm.to_owned());
        let mm = factor * number.parse::<f64>().map_err(wrong)?;
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

/// Splits a distance into its number, and the mm of its unit.
fn in_unit(text: &str) -> Result<(&str, f64), WrongDistance> {
    let (number, unit) = text.split_at(text.find(char::is_alphabetic).unwrap_or(text.len()));
    let factor = match unit {
        "" | "mm" => 1.0,
        "um" | "µm" | "μm" => 1e-3,
        "cm" => 10.0,
        // Words such as `far`, and exponents as in `1e-1`, are read as numbers.
        _ if number.is_empty() || unit.starts_with(['e', 'E']) => return Ok((text, 1.0)),
        _ => return Err(WrongDistance::Unit(unit.to_owned())),
    };
    Ok((number.trim_end(), factor))
}

/// Collects one distance per axis, µm.
fn along_axes(distances: &[Distance]) -> Result<[i32; 3], Failure> {
    let mut um = [None; 3];
    for distance in distances {
        if um[distance.axis].replace(distance.um).is_some() {
            let name = NAMES[distance.axis];
            return Err(Failure::Usage(format!("axis {name} is named twice")));
        }
    }
    Ok(um.map(Option::unwrap_or_default))
}

/// Runs the command.
pub fn run(options: &JogOptions, out: &mut impl Write) -> Result<(), Failure> {
    let distance_um = along_axes(&options.distances)?;
    let stage = options.stage.read()?;
    if let Some(stage) = &stage {
        let check = check_steps(stage, distance_um);
        check.map_err(|below| Failure::Usage(below.to_string()))?;
    }
    let mut hand = Hand::connect(&options.port)?;
    let before = hand.ready_to_move("jog", stage.is_some())?;
    hand.configure(stage.as_ref(), &options.stage)?;
    hand.start_heartbeat()?;
    let started = hand.command("jog", Command::Jog { distance_um })?;
    if started.trust != Trust::Homed {
        notice!(
            "the position is {}: slowly, and without soft limits",
            diagnosis::position(started.trust)
        );
    }
    let mut progress = Progress::new("moving");
    let watch = |status: &Status| progress.at(share(&before, status));
    let allowance = stage.as_ref().map_or(Allowance::UNKNOWN, |stage| {
        Allowance::of_distance(stage, distance_um.map(|um| f64::from(um) * 1e-3))
    });
    let rest = hand.wait_for_rest(allowance, watch)?;
    drop(progress);
    let jog = Jog {
        distance_um,
        before,
        end: rest.status,
        stage: stage.as_ref(),
    };
    jog.tell(options, out)?;
    why_it_stands(&hand, rest)?;
    jog.warn();
    Ok(())
}

fn share(before: &Status, now: &Status) -> f64 {
    let far =
        |axis: usize, to: [i32; 3]| f64::from(to[axis]) - f64::from(before.position_steps[axis]);
    let shares = (0..3).map(|axis| far(axis, now.position_steps) / far(axis, now.target_steps));
    // An axis at rest has no share.
    shares.filter(|share| share.is_finite()).fold(1.0, f64::min)
}

/// A jog that has ended.
struct Jog<'a> {
    distance_um: [i32; 3],
    before: Status,
    end: Status,
    stage: Option<&'a Stage>,
}

impl Jog<'_> {
    /// Returns true if the station restarted on the way: it counts positions anew, so that the
    /// distance is unknown.
    fn is_lost(&self) -> bool {
        self.end.state == State::Unconfigured
    }

    fn moved_steps(&self) -> [i32; 3] {
        let [to, from] = [self.end.position_steps, self.before.position_steps];
        std::array::from_fn(|axis| to[axis].wrapping_sub(from[axis]))
    }

    /// Returns the axes that went less far than they should.
    fn shortened(&self) -> Vec<Shortened> {
        self.stage.map_or_else(Vec::new, |stage| {
            shortened(stage, self.distance_um, self.moved_steps())
        })
    }

    fn tell(&self, options: &JogOptions, out: &mut impl Write) -> Result<(), Failure> {
        let (moved, at, stage) = (self.moved_steps(), self.end.position_steps, self.stage);
        if options.json {
            let mut object = condition(&self.end);
            let shortened = self.shortened();
            object["asked_mm"] = json!(self.distance_um.map(|um| f64::from(um) * 1e-3));
            let known = stage.filter(|_| !self.is_lost());
            object["moved_steps"] = json!((!self.is_lost()).then_some(moved));
            object["moved_mm"] = json!(known.map(|stage| stage.in_mm(moved)));
            object["position_mm"] = json!(known.map(|stage| stage.in_mm(at)));
            object["shortened"] = json!(stage.map(|_| {
                let names = shortened.iter().map(|short| NAMES[short.axis]);
                names.collect::<Vec<_>>()
            }));
            json::line(out, &object)?;
        } else if self.is_lost() {
            writeln!(
                out,
                "moved by  an unknown distance: the station restarted on the way"
            )?;
        } else {
            writeln!(out, "moved by  {}", position(moved, stage))?;
            let known = diagnosis::position(self.end.trust);
            writeln!(out, "now at    {}, {known}", position(at, stage))?;
        }
        Ok(())
    }

    /// Reports that soft limits shortened the move, or that this cannot be known.
    fn warn(&self) {
        if self.stage.is_none() {
            let asked = self
                .distance_um
                .into_iter()
                .zip(self.moved_steps())
                .zip(NAMES);
            for ((_, _), name) in asked.filter(|((um, steps), _)| *um != 0 && *steps == 0) {
                notice!(
                    "{name} did not move: its distance is less than half a step, or a soft limit \
                     is in the way"
                );
            }
            notice!(
                "a soft limit may have shortened the move: with --rig RIG.toml this command \
                 reports that, and mm"
            );
        }
        for short in self.shortened() {
            notice!("{short}");
        }
    }
}
