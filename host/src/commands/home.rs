//! `trinocular home`: searches the home switches of axes.

use std::io::Write;

use super::by_hand::{
    AxisName, Hand, PortArgument, StageArgument, condition, position, why_it_stands,
};
use super::json;
use super::progress::Progress;
use crate::commands::failure::Failure;
use clap::Args;
use serde_json::json;
use trinocular_client::allowance::Allowance;
use trinocular_client::diagnosis;
use trinocular_core::frame::message::{Command, Status};
use trinocular_core::safety::{State, Trust};
use trinocular_rig::notice;
use trinocular_rig::rig_file::Stage;

/// Find the home switches, and with them the position
///
/// One axis after the other, Z first: fast onto the switch, back off, slowly onto it again, back
/// off. Soft limits do not hold meanwhile: see that the path is free. A switch that is not found
/// within five quarters of the axis's travel, or does not release, ends the homing with a fault.
/// Ctrl-C stops the stage on a ramp. The rig file lists the axes with a home switch, its end, and
/// its position.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct HomeOptions {
    /// Axes to home [default: all that have a home switch in the rig file; all three without --rig]
    #[arg(value_enum, ignore_case = true)]
    axes: Vec<AxisName>,

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
  trinocular home --port auto --rig rig.toml    # the first after the station's start: configure it
  trinocular home z --port /dev/ttyACM0         # one axis anew";

fn chosen(axes: &[AxisName], stage: Option<&Stage>) -> [bool; 3] {
    match (axes, stage) {
        ([], None) => [true; 3],
        ([], Some(stage)) => stage.care.has_home(),
        (axes, _) => [AxisName::X, AxisName::Y, AxisName::Z].map(|axis| axes.contains(&axis)),
    }
}

/// Returns what makes the other axes known, after these were homed.
fn unknown_axes(homed: [bool; 3], stage: Option<&Stage>) -> String {
    let has_switch = stage.map_or([true; 3], |stage| stage.care.has_home());
    let names = ["x", "y", "z"]
        .into_iter()
        .zip(homed.iter().zip(has_switch));
    let others: Vec<&str> = names
        .filter(|(_, (homed, has_switch))| !**homed && *has_switch)
        .map(|(name, _)| name)
        .collect();
    match (others.is_empty(), stage) {
        (false, Some(_)) => {
            let axes = others.join(" ");
            format!("the other axes are not known yet: `home {axes}` finds them")
        }
        (false, None) => {
            let words = "the other axes are not known yet: `home` finds those with a home switch; \
                         for one without, `zero`, then `home` again";
            words.to_owned()
        }
        (true, _) => "the axes without a home switch are not known yet: `zero` makes the present \
                      position zero, then `home` again"
            .to_owned(),
    }
}

/// Runs the command.
pub fn run(options: &HomeOptions, out: &mut impl Write) -> Result<(), Failure> {
    let stage = options.stage.read()?;
    let axes = chosen(&options.axes, stage.as_ref());
    let mut hand = Hand::connect(&options.port)?;
    hand.ready_to_move("home", stage.is_some())?;
    hand.configure(stage.as_ref(), &options.stage)?;
    hand.start_heartbeat()?;
    hand.command("home", Command::Home { axes })?;
    let progress = Progress::new("homing");
    let allowance = stage.as_ref().map_or(Allowance::UNKNOWN, |stage| {
        Allowance::of_homing(stage, axes)
    });
    let rest = hand.wait_for_rest(allowance, |_| {})?;
    let end = rest.status;
    drop(progress);
    tell(options, &end, stage.as_ref(), out)?;
    why_it_stands(&hand, rest)?;
    if end.state == State::Idle && end.trust != Trust::Homed {
        notice!("{}", unknown_axes(axes, stage.as_ref()));
    }
    Ok(())
}

fn tell(
    options: &HomeOptions,
    end: &Status,
    stage: Option<&Stage>,
    out: &mut impl Write,
) -> Result<(), Failure> {
    if options.json {
        let mut object = condition(end);
        object["position_mm"] = json!(stage.map(|stage| stage.in_mm(end.position_steps)));
        json::line(out, &object)?;
    } else {
        let known = diagnosis::position(end.trust);
        writeln!(
            out,
            "now at  {}, {known}",
            position(end.position_steps, stage)
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_client::stage::default_stage;
    use trinocular_core::frame::message::Side;
    use trinocular_rig::rig_file::HomeSwitch;

    #[test]
    fn axes_with_a_switch_are_homed_and_not_zeroed() {
        let mut stage = default_stage();
        let switch = HomeSwitch {
            side: Side::Negative,
            position_mm: 0.0,
        };
        stage.care.home = [Some(switch), Some(switch), None];
        let words = unknown_axes([true, false, false], Some(&stage));
        assert!(
            words.contains("`home y`") && !words.contains("zero"),
            "{words}"
        );
        let words = unknown_axes([true, true, false], Some(&stage));
        assert!(
            words.contains("without a home switch") && words.contains("`zero`"),
            "{words}"
        );
        let words = unknown_axes([true, false, false], None);
        assert!(words.contains("`home` finds those"), "{words}");
    }
}
