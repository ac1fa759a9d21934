//! `trinocular motors`: switches the motors on or off.

use std::io::Write;

use super::by_hand::{Hand, PortArgument, condition};
use super::json;
use crate::commands::failure::Failure;
use clap::{Args, ValueEnum};
use serde_json::json;
use trinocular_client::diagnosis;
use trinocular_core::frame::message::Command;

/// Switch the motors of the stage on or off
///
/// Works only at rest, on a station that has its configuration. Motors that are off hold nothing:
/// the stage can be moved by hand, and a vertical axis may sink. The station trusts its position
/// less from then on: run `home` or `zero` after `motors on`. With motors_off_after_s in the rig
/// file the station switches the motors off by itself.
#[derive(Debug, Args)]
pub struct MotorsOptions {
    /// New state of the motors
    #[arg(value_enum, ignore_case = true)]
    motors: Motors,

    #[command(flatten)]
    port: PortArgument,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// State of the motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Motors {
    /// Holding the stage, ready to move it
    On,
    /// Without current
    Off,
}

/// Runs the command.
pub fn run(options: &MotorsOptions, out: &mut impl Write) -> Result<(), Failure> {
    let mut hand = Hand::connect(&options.port)?;
    let on = options.motors == Motors::On;
    let status = hand.command_at_rest("motors", Command::Motors { on })?;
    if options.json {
        let mut object = condition(&status);
        object["next"] = json!(diagnosis::next_step(&status));
        return Ok(json::line(out, &object)?);
    }
    let motors = if status.motors { "on" } else { "off" };
    let known = diagnosis::position(status.trust);
    writeln!(out, "the motors are {motors}; the position is {known}")?;
    if let Some(next) = diagnosis::next_step(&status) {
        writeln!(out, "next: {next}")?;
    }
    Ok(())
}
