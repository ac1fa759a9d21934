//! `trinocular ports`: the serial ports of this computer.

use std::io::Write;

use clap::Args;
use host::error::Failure;
use host::station::ports::{Candidate, candidates};

/// List the serial ports a station may be on
///
/// Ports whose USB vendor and product are those of our boards come first, marked with a star. None
/// is opened: what an unknown device does with bytes is not known. The emulated station's
/// pseudo-terminal is not listed; its path is known to whoever started it.
#[derive(Debug, Args)]
pub struct Options {
    /// Print one JSON object per port and line
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(options: &Options, out: &mut impl Write) -> Result<(), Failure> {
    let list = candidates().map_err(super::station_failed)?;
    if options.json {
        for port in &list {
            let line = serde_json::to_string(port).map_err(std::io::Error::from)?;
            writeln!(out, "{line}")?;
        }
    } else if list.is_empty() {
        writeln!(out, "no serial ports")?;
    } else {
        for port in &list {
            writeln!(out, "{}", line(port))?;
        }
    }
    Ok(())
}

fn line(port: &Candidate) -> String {
    let mark = if port.is_station { '*' } else { ' ' };
    let ids = port
        .usb
        .map(|(vendor, product)| format!("{vendor:04x}:{product:04x}"));
    let parts = [ids, port.product.clone(), port.serial_number.clone()];
    let about = parts.into_iter().flatten().collect::<Vec<_>>().join("  ");
    format!("{mark} {:<20} {about}", port.path)
        .trim_end()
        .to_owned()
}
