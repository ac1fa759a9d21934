//! `trinocular ports`: the serial ports of this computer.

use std::io::Write;

use super::json;
use crate::commands::failure::Failure;
use clap::Args;
use trinocular_client::ports::{Candidate, candidates};

/// List the serial ports that a station may be on
///
/// Ports with the USB vendor and product of Trinocular's boards come first, marked with a star. No
/// port is opened, because an unknown device may react to any byte. The pseudo-terminal of an
/// emulated station is not listed; give its path to --port.
#[derive(Debug, Args)]
pub struct PortsOptions {
    /// Print one JSON object per port and line
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(options: &PortsOptions, out: &mut impl Write) -> Result<(), Failure> {
    let list = candidates().map_err(|error| Failure::of_station(None, error))?;
    if options.json {
        for port in &list {
            json::line(out, port)?;
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
