//! `trinocular hello`: who is at the end of a serial line.

use std::io::Write;

use clap::Args;
use host::error::Failure;
use host::station::serial::Serial;
use host::station::{StationError, ports, reset_cause};
use serde_json::json;
use shared::frame::message::{Hello, Mismatch};

/// Ask the station on a serial port who it is
///
/// Sends a hello and nothing else: no configuration, no motion. When the firmware does not fit this program, every field
/// that differs is named and the exit code is 3.
#[derive(Debug, Args)]
pub struct Options {
    /// The serial port, such as /dev/ttyACM0; `auto` is the only station on USB, `trinocular ports` lists all
    #[arg(long, value_name = "PATH")]
    port: String,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(options: &Options, out: &mut impl Write) -> Result<(), Failure> {
    let port = ports::resolve(&options.port).map_err(super::station_failed)?;
    let failed = |error: StationError| super::failed_at(Some(&port), error.into());
    let serial = Serial::connect(&port).map_err(failed)?;
    let Some(hello) = serial.who() else {
        return Err(Failure::Station(format!("{port}: no hello")));
    };
    let mismatches = hello.mismatches();
    if options.json {
        writeln!(out, "{}", to_json(&port, &hello, &mismatches))?;
    } else {
        print(out, &port, &hello)?;
    }
    if mismatches.is_empty() {
        Ok(())
    } else {
        Err(failed(StationError::Mismatch(mismatches.to_vec())))
    }
}

fn version(hello: &Hello) -> String {
    hello.version.map(|part| part.to_string()).join(".")
}

fn print(out: &mut impl Write, port: &str, hello: &Hello) -> Result<(), Failure> {
    writeln!(
        out,
        "{} on {port}, firmware {}",
        hello.board,
        version(hello)
    )?;
    writeln!(
        out,
        "protocol      {}, schema {:08x}",
        hello.protocol, hello.schema
    )?;
    writeln!(out, "port words    {} Hz", hello.word_rate_hz)?;
    writeln!(out, "output delay  {} us", hello.delay_us)?;
    writeln!(out, "session       {}", hello.session)?;
    writeln!(out, "last start    {}", reset_cause(hello.reset_cause))?;
    Ok(())
}

fn to_json(port: &str, hello: &Hello, mismatches: &[Mismatch]) -> serde_json::Value {
    let mismatch = |m: &Mismatch| json!({"field": m.field, "station": m.station, "host": m.host});
    json!({
        "port": port,
        "board": hello.board.as_str(),
        "version": version(hello),
        "protocol": hello.protocol,
        "schema": hello.schema,
        "word_rate_hz": hello.word_rate_hz,
        "delay_us": hello.delay_us,
        "session": hello.session,
        "reset_cause": reset_cause(hello.reset_cause).replace(' ', "_"),
        "mismatches": mismatches.iter().map(mismatch).collect::<Vec<_>>(),
    })
}
