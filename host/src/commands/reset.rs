//! `trinocular reset`: lets a stopped or faulted station move again.

use std::io::Write;

use super::by_hand::{Hand, PortArgument, condition, named};
use super::json;
use crate::commands::failure::Failure;
use clap::Args;
use serde_json::json;
use trinocular_client::diagnosis::{self, next_step};

/// Clear a stop, or a fault whose cause is gone
///
/// Moves nothing, and prints the next step for the operator. The station refuses it while the cause
/// of the fault is still there. Waits while the stage ramps down.
#[derive(Debug, Args)]
pub struct ResetOptions {
    #[command(flatten)]
    port: PortArgument,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(options: &ResetOptions, out: &mut impl Write) -> Result<(), Failure> {
    let mut hand = Hand::connect(&options.port)?;
    let before = hand.status()?;
    let status = hand.reset()?;
    if options.json {
        let mut object = condition(&status);
        object["cleared"] = before.faults.iter().map(named).collect();
        object["next"] = json!(next_step(&status));
        return Ok(json::line(out, &object)?);
    }
    for fault in before.faults.iter() {
        let cause = diagnosis::fault(fault).cause;
        writeln!(out, "cleared fault {}: {cause}", fault.number())?;
    }
    let state = diagnosis::state(status.state);
    writeln!(out, "{}: {}", state.name, state.meaning)?;
    if let Some(next) = next_step(&status) {
        writeln!(out, "next: {next}")?;
    }
    Ok(())
}
