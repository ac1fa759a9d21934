//! `trinocular hello`: identifies the station on a serial line.

use std::io::Write;

use crate::commands::failure::Failure;
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};
use trinocular_client::serial::Serial;
use trinocular_client::{StationError, diagnosis, ports, reset_cause};
use trinocular_core::frame::message::{End, Hello, LastRun, Mismatch};

/// Ask the station on a serial port who it is
///
/// Sends a hello and nothing else: no configuration, no motion. When the firmware does not fit this
/// program, every field that differs is named and the exit code is 3. After a crash of the
/// station's program it also prints the command that finds the lines of source.
#[derive(Debug, Args)]
pub struct HelloOptions {
    /// Serial port of the station, such as /dev/ttyACM0; `auto` is the only station on USB,
    /// `trinocular ports` lists all
    #[arg(long, value_name = "PATH")]
    port: String,

    /// Image that was flashed, for the command that looks up a crash in it
    #[arg(
        long,
        value_name = "ELF",
        default_value = "firmware/target/thumbv7em-none-eabihf/release/station-b"
    )]
    elf: PathBuf,

    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(options: &HelloOptions, out: &mut impl Write) -> Result<(), Failure> {
    let port = ports::resolve(&options.port).map_err(|error| Failure::of_station(None, error))?;
    let failed = |error: StationError| Failure::of_station(Some(&port), error);
    let serial = Serial::connect_to_watch(&port).map_err(failed)?;
    let Some(hello) = serial.who() else {
        return Err(Failure::Station(format!("{port}: no hello").into()));
    };
    let mismatches = hello.mismatches();
    let last = serial.last_run().map_err(failed)?;
    if options.json {
        let object = to_json(&port, &hello, last.as_ref(), &mismatches);
        super::json::line(out, &object)?;
    } else {
        print(out, &port, &hello)?;
        if let Some(last) = &last {
            print_last_run(out, &hello, last, &options.elf)?;
        }
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

fn print_last_run(
    out: &mut impl Write,
    hello: &Hello,
    last: &LastRun,
    elf: &Path,
) -> Result<(), Failure> {
    if last.starts > 0 {
        writeln!(out, "starts        {} since power on", last.starts)?;
    }
    if let Some(ended) = diagnosis::last_run(hello, last) {
        writeln!(out, "before that   {ended}")?;
    }
    let places = diagnosis::places(last);
    if !places.is_empty() {
        let places: Vec<_> = places.iter().map(|place| format!("{place:#x}")).collect();
        writeln!(
            out,
            "to see where  addr2line -fie {} {}",
            elf.display(),
            places.join(" ")
        )?;
    }
    Ok(())
}

/// Returns the station's report of its last run.
pub fn last_run_json(last: &LastRun) -> serde_json::Value {
    let end = match last.end {
        End::Outside => "outside",
        End::Panic => "panic",
        End::HardFault => "hard_fault",
    };
    json!({
        "starts": last.starts,
        "fault": last.fault.map(|fault| fault.number()),
        "end": end,
        "addresses": diagnosis::places(last),
    })
}

fn to_json(
    port: &str,
    hello: &Hello,
    last: Option<&LastRun>,
    mismatches: &[Mismatch],
) -> serde_json::Value {
    let mismatch = |m: &Mismatch| json!({"field": m.field, "station": m.station, "host": m.host});
    json!({
        "port": port,
        "board": hello.board.as_str(),
        "firmware": version(hello),
        "protocol": hello.protocol,
        "schema": hello.schema,
        "word_rate_hz": hello.word_rate_hz,
        "delay_us": hello.delay_us,
        "session": hello.session,
        "reset_cause": reset_cause(hello.reset_cause).replace(' ', "_"),
        "last_run": last.map(last_run_json),
        "mismatches": mismatches.iter().map(mismatch).collect::<Vec<_>>(),
    })
}
