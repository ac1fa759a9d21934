//! `trinocular diagnose`: what states and faults mean, and what is the matter with a station.

use std::io::Write;

use super::by_hand::{Hand, PortArgument};
use super::status;
use clap::Args;
use host::error::Failure;
use host::station::diagnosis;
use shared::safety::{Fault, State};

/// Explain the station's states and numbered faults; with --port also what is the matter with a station
///
/// Changes nothing. Exit code 0 whatever the station's state is, 3 if it does not answer or its firmware does not fit.
#[derive(Debug, Args)]
pub struct Options {
    /// Also ask the station on this serial port; `auto` is the only one on USB
    #[arg(long, value_name = "PATH")]
    port: Option<String>,
}

/// Runs the command.
pub fn run(options: &Options, out: &mut impl Write) -> Result<(), Failure> {
    let Some(port) = &options.port else {
        return table(out);
    };
    let hand = Hand::connect(&PortArgument { port: port.clone() })?;
    let (hello, last) = status::who(&hand)?;
    let now = hand.status()?;
    table(out)?;
    writeln!(out, "\n{} on {}", hello.board, hand.port())?;
    for (name, value) in status::lines(&hello, last.as_ref(), &now) {
        writeln!(out, "{name:<12}  {value}")?;
    }
    if diagnosis::next_step(&now).is_none() {
        writeln!(out, "{:<12}  nothing: it is ready", "next")?;
    }
    Ok(())
}

fn table(out: &mut impl Write) -> Result<(), Failure> {
    writeln!(out, "States")?;
    for state in State::ALL {
        let text = diagnosis::state(state);
        writeln!(
            out,
            "  {} {:<14}  {}",
            state.number(),
            text.name,
            text.meaning
        )?;
        writeln!(out, "{:20}do: {}", "", text.action)?;
    }
    writeln!(out, "\nFaults")?;
    for fault in Fault::ALL {
        let text = diagnosis::fault(fault);
        writeln!(
            out,
            "  {} {:<14}  {}",
            fault.number(),
            text.name,
            text.cause
        )?;
        writeln!(out, "{:20}do: {}", "", text.action)?;
        writeln!(out, "{:20}position: {}", "", text.position)?;
    }
    Ok(())
}
