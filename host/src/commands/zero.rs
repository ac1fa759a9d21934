//! `trinocular zero`: makes the present position zero.

use std::io::Write;

use super::by_hand::{Hand, PortArgument, StageArgument, condition, position};
use super::json;
use crate::commands::failure::Failure;
use clap::Args;
use serde_json::json;
use trinocular_core::frame::message::Command;

/// Make the present position zero on all axes
///
/// From then on the station trusts its position: it moves at full speed and keeps to the soft
/// limits of its stage. Works only at rest; moves nothing.
#[derive(Debug, Args)]
pub struct ZeroOptions {
    #[command(flatten)]
    port: PortArgument,

    #[command(flatten)]
    stage: StageArgument,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(options: &ZeroOptions, out: &mut impl Write) -> Result<(), Failure> {
    let stage = options.stage.read()?;
    let mut hand = Hand::connect(&options.port)?;
    let before = hand.status()?.position_steps;
    hand.configure(stage.as_ref(), &options.stage)?;
    let status = hand.command("zero", Command::Zero)?;
    if options.json {
        let mut object = condition(&status);
        object["was_at_steps"] = json!(before);
        object["was_at_mm"] = json!(stage.map(|stage| stage.in_mm(before)));
        return Ok(json::line(out, &object)?);
    }
    let before = position(before, stage.as_ref());
    writeln!(out, "zero is here; it was at {before}")?;
    Ok(())
}
