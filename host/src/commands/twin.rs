//! `trinocular twin`: a simulated station that other programs connect to.

mod console;

use crate::commands::failure::Failure;
use clap::Args;
use console::{Console, Order};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;
use trinocular_client::ports;
use trinocular_client::stage::default_stage;
use trinocular_client::twin::far_end::{FarEnd, TcpPort};
use trinocular_client::twin::real_time::RealTimeTwin;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::{RigFile, Stage};

/// Simulate a station in real time, for other commands to connect to with `--port twin`
///
/// The station is the board's own code, with a simulated stage on rails, limit switches 5 mm beyond
/// the stage's travel and an emergency stop. Every command that takes a --port works against it, so
/// that all can be tried without hardware. It runs until Ctrl-C, and keeps to this computer's clock.
///
/// Lines on standard input change what the station senses: `press` and `release` the emergency
/// stop, `fault` and `clear` a motor driver, `unplug` and `plug` the line, `restart` the board;
/// `where` prints the position of the stage by the edges at its pins, `quit` ends.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct TwinOptions {
    /// Simulate the stage of this rig file; without it, one of 80 steps/mm and 100 mm/s with a
    /// travel of 60 mm each way
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,

    /// Make this symbolic link to the station's pseudo-terminal, for several twins at once
    /// [default: one in a folder of the user's own, which `--port twin` knows]
    #[arg(long, value_name = "PATH", conflicts_with = "tcp")]
    link: Option<PathBuf>,

    /// Serve one TCP connection at a time instead, for `--port tcp://HOST:PORT`; port 0 is any free
    /// one
    ///
    /// There is no password: an address other than 127.0.0.1 lets the whole network in.
    #[arg(long, value_name = "HOST:PORT")]
    tcp: Option<String>,
}

const EXAMPLES: &str = "\
Examples, the first in one terminal and the others in another:
  trinocular twin
  trinocular status --port twin
  trinocular track --sim --path line --port twin
  trinocular stop --port twin";

/// Runs until a signal or `quit`.
pub fn run(options: &TwinOptions, out: &mut impl Write) -> Result<(), Failure> {
    let stage = stage(options.rig.as_deref())?;
    let stop = super::by_hand::on_interrupt()?;
    let mut line = Line::open(options)?;
    writeln!(out, "station simulated on {}; Ctrl-C ends it", line.port)?;
    out.flush()?;
    let mut twin = RealTimeTwin::power_on(&stage);
    let console = Console::start();
    let mut buffer = [0; 1024];
    while !stop.load(Ordering::Relaxed) {
        let count = line.read(&mut buffer)?;
        let bytes = twin.turn(&buffer[..count]);
        line.write(&bytes);
        match console.order() {
            None => {}
            Some(Order::Quit) => break,
            Some(Order::Unplug) => line.end = None,
            Some(Order::Plug) => line.plug()?,
            Some(Order::Where) => {
                let [x, y, z] = twin.position_mm();
                let steps = twin.steps();
                writeln!(out, "stage at {x:.4} {y:.4} {z:.4} mm, {steps:?} steps")?;
                out.flush()?;
            }
            Some(Order::Restart) => twin.power_cycle(),
            Some(Order::Bench(change)) => twin.set_bench(change(twin.bench())),
            Some(Order::Unknown(line)) => notice!("`{line}` is unknown; {}", console::ORDERS),
        }
    }
    Ok(())
}

fn stage(rig: Option<&Path>) -> Result<Stage, Failure> {
    let Some(path) = rig else {
        return Ok(default_stage());
    };
    let rig = RigFile::read(path)?;
    let none = "has no [stage] section, which says what the station moves";
    Ok(rig.stage.ok_or_else(|| InputError::file(path, none))?)
}

/// The far end of the line, and the way to open it again.
struct Line<'a> {
    options: &'a TwinOptions,
    end: Option<Box<dyn FarEnd>>,
    /// Value of --port for the other programs.
    port: String,
}

impl<'a> Line<'a> {
    fn open(options: &'a TwinOptions) -> Result<Self, Failure> {
        let (end, port) = far_end(options, options.tcp.as_deref())?;
        Ok(Self {
            options,
            end: Some(end),
            port,
        })
    }

    fn plug(&mut self) -> Result<(), Failure> {
        if self.end.is_none() {
            // The same address again, if the system chose it before.
            let (end, _) = far_end(self.options, self.port.strip_prefix("tcp://"))?;
            self.end = Some(end);
        }
        Ok(())
    }

    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Failure> {
        match &mut self.end {
            Some(end) => Ok(end.read(buffer)?),
            None => {
                std::thread::sleep(Duration::from_millis(1));
                Ok(0)
            }
        }
    }

    fn write(&mut self, bytes: &[u8]) {
        if let Some(end) = &mut self.end
            && !bytes.is_empty()
        {
            end.write(bytes);
        }
    }
}

/// Opens the far end; returns it with the value of --port for the other programs.
fn far_end(options: &TwinOptions, tcp: Option<&str>) -> Result<(Box<dyn FarEnd>, String), Failure> {
    if let Some(address) = tcp {
        let failed = |cause: io::Error| {
            let reason = format!("cannot be listened on: {cause}");
            Failure::from(InputError::file(Path::new(address), reason))
        };
        let port = TcpPort::open(address).map_err(failed)?;
        let address = port.address().map_err(failed)?;
        return Ok((Box::new(port), format!("tcp://{address}")));
    }
    pseudo_terminal(options.link.as_deref())
}

#[cfg(unix)]
fn pseudo_terminal(link: Option<&Path>) -> Result<(Box<dyn FarEnd>, String), Failure> {
    use trinocular_client::twin::far_end::PseudoTerminal;
    let default = ports::twin_link();
    let path = match link {
        Some(link) => link.to_owned(),
        None => default.map_err(|cause| InputError::file(Path::new("twin"), cause.to_string()))?,
    };
    let end = PseudoTerminal::open(&path).map_err(|cause| {
        let reason = match cause.kind() {
            io::ErrorKind::ResourceBusy => {
                "another `trinocular twin` uses this link; end that one, or name another --link"
                    .to_owned()
            }
            io::ErrorKind::AlreadyExists => {
                "is there and no link to a pseudo-terminal; name another --link".to_owned()
            }
            _ => format!("cannot be made a link to a pseudo-terminal: {cause}"),
        };
        InputError::file(&path, reason)
    })?;
    let port = match link {
        Some(link) => link.display().to_string(),
        None => ports::TWIN.to_owned(),
    };
    Ok((Box::new(end), port))
}

#[cfg(not(unix))]
fn pseudo_terminal(_: Option<&Path>) -> Result<(Box<dyn FarEnd>, String), Failure> {
    let reason = "this system has no pseudo-terminals; use --tcp 127.0.0.1:5333";
    Err(Failure::Usage(reason.to_owned()))
}
