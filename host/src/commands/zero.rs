//! `trinocular zero`: makes the present position zero.

use std::io::Write;

use super::by_hand::{Hand, PortArgument, StageArgument, position};
use crate::commands::failure::Failure;
use clap::Args;
use shared::frame::message::Command;

/// Make the present position zero on all axes
///
/// From then on the station trusts its position: it moves at full speed and keeps to the soft
/// limits of its stage. Works only at rest; moves nothing.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    port: PortArgument,

    #[command(flatten)]
    stage: StageArgument,
}

/// Runs the command.
pub fn run(options: &Options, out: &mut impl Write) -> Result<(), Failure> {
    let stage = options.stage.read()?;
    let mut hand = Hand::connect(&options.port)?;
    let before = hand.status()?.position_steps;
    hand.configure(stage.as_ref(), &options.stage)?;
    hand.command("zero", Command::Zero)?;
    let before = position(before, stage.as_ref());
    writeln!(out, "zero is here; it was at {before}")?;
    Ok(())
}
