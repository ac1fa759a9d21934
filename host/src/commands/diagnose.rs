//! `trinocular diagnose`: explains states and faults, or finds the problem of a station.

use std::io::Write;

use super::by_hand::{Hand, PortArgument};
use super::{json, status};
use crate::commands::failure::Failure;
use clap::Args;
use serde_json::{Value, json};
use trinocular_client::diagnosis;
use trinocular_core::safety::{Fault, State};

/// Explain the station's states and numbered faults; with --port also find the problem of a
/// station
///
/// Changes nothing. The exit code is 0 whatever the station's state is, and 3 if the station does
/// not answer or its firmware does not fit.
#[derive(Debug, Args)]
pub struct DiagnoseOptions {
    /// Also ask the station on this serial port; `auto` is the only one on USB
    #[arg(long, value_name = "PATH")]
    port: Option<String>,

    /// Print the table only, as without --port
    #[arg(long, conflicts_with = "port")]
    list: bool,

    /// Print one JSON object: states, faults, and the station's status
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(options: &DiagnoseOptions, out: &mut impl Write) -> Result<(), Failure> {
    let Some(port) = &options.port else {
        if options.json {
            return Ok(json::line(out, &to_json(Value::Null))?);
        }
        out.write_all(diagnosis::table().as_bytes())?;
        return Ok(());
    };
    let hand = Hand::connect_to_watch(&PortArgument { port: port.clone() })?;
    let (hello, last) = status::who(&hand)?;
    let now = hand.status()?;
    if options.json {
        let station = status::to_json(&hand, &hello, last.as_ref(), &now);
        return Ok(json::line(out, &to_json(station))?);
    }
    out.write_all(diagnosis::table().as_bytes())?;
    writeln!(out, "\n{} on {}", hello.board, hand.port())?;
    for (name, value) in status::lines(&hello, last.as_ref(), &now, None) {
        writeln!(out, "{name:<12}  {value}")?;
    }
    if diagnosis::next_step(&now).is_none() {
        writeln!(out, "{:<12}  nothing: it is ready", "next")?;
    }
    Ok(())
}

/// Returns the table of states and faults, and the status of a station.
fn to_json(station: Value) -> Value {
    let state = |state: State| {
        let text = diagnosis::state(state);
        json!({
            "number": state.number(),
            "name": text.name,
            "meaning": text.meaning,
            "action": text.action,
        })
    };
    let fault = |fault: Fault| {
        let text = diagnosis::fault(fault);
        json!({
            "number": fault.number(),
            "name": text.name,
            "cause": text.cause,
            "action": text.action,
            "position": text.position,
        })
    };
    json!({
        "states": State::ALL.map(state),
        "faults": Fault::ALL.map(fault),
        "station": station,
    })
}
