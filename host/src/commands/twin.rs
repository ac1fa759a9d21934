//! `trinocular twin`: a simulated station that other programs connect to.

mod console;
#[cfg(unix)]
pub mod lab;

use crate::commands::cameras::per_camera_delays_ms;
use crate::commands::failure::Failure;
use crate::commands::range;
use crate::commands::scene::SceneOptions;
use clap::Args;
use console::{Console, Order};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use trinocular::servo::path::TargetPath;
use trinocular_client::ports;
use trinocular_client::stage::default_stage;
use trinocular_client::twin::far_end::{Plug, TcpPort};
use trinocular_client::twin::real_time::RealTimeTwin;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::Scene;

/// Simulate a station in real time, for other commands to connect to with `--port twin`
///
/// The station is the board's own code, with a simulated stage on rails, limit switches 5 mm beyond
/// the stage's travel and an emergency stop. Every command that takes a --port works against it, so
/// that all can be tried without hardware. It runs until Ctrl-C, and keeps to this computer's clock.
///
/// Lines on standard input change what the station senses: `press` and `release` the emergency
/// stop, `fault` and `clear` a motor driver, `unplug` and `plug` the line, `restart` the board;
/// `miss` and `double` the next image of the first camera; `where` prints the position of the stage
/// by the edges at its pins, `quit` ends.
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

    /// Simulate the rest of the bench, too: station A, which moves a poster along --path, and the
    /// rig file's cameras on the stage, for other programs to read with `--cameras twin`
    ///
    /// The cameras run freely at --fps until the station triggers them, as `[trigger]` in a rig
    /// file asks, and again 2 s after its last trigger.
    #[arg(long, conflicts_with = "tcp")]
    with_target: bool,

    /// Motion of the poster: steps, line, circle, lissajous or still (see `track`)
    #[arg(long, default_value_t = TargetPath::Circle, requires = "with_target", help_heading = LAB)]
    path: TargetPath,

    /// Frame sets per second
    #[arg(
        long,
        value_name = "HZ",
        default_value_t = 30.0,
        requires = "with_target",
        help_heading = LAB
    )]
    fps: f64,

    /// Delay of the images' time stamps, of all cameras or of each, ms [default: the rig file's
    /// `delay_ms`, or 0]
    #[arg(
        long,
        value_name = "MS,...",
        allow_negative_numbers = true,
        value_delimiter = ',',
        requires = "with_target",
        help_heading = LAB
    )]
    camera_delay: Option<Vec<f64>>,

    #[command(flatten, next_help_heading = LAB)]
    scene: SceneOptions,
}

const LAB: &str = "With --with-target";

const EXAMPLES: &str = "\
Examples, the first in one terminal and the others in another:
  trinocular twin --with-target
  trinocular status --port twin
  trinocular track --cameras twin --rig rig.toml --port twin
  trinocular track --sim --path line --port twin
  trinocular stop --port twin";

/// Runs until a signal or `quit`.
pub fn run(options: &TwinOptions, out: &mut impl Write) -> Result<(), Failure> {
    range::check("fps", options.fps, 1.0, 200.0)?;
    let rig = rig(options.rig.as_deref())?;
    let stage = rig.stage.clone().unwrap_or_else(default_stage);
    let delays_ms = per_camera_delays_ms(options.camera_delay.as_deref(), &rig)?;
    let stop = super::by_hand::on_interrupt()?;
    // Drawing takes seconds; a port that exists answers.
    let scene = match options.with_target {
        true => Some(options.scene.scene(&rig.rig)?),
        false => None,
    };
    let mut port = Port::open(options)?;
    let start = |scene| lab(options, scene, delays_ms, &port);
    let mut lab = scene.map(start).transpose()?;
    writeln!(out, "station simulated on {}; Ctrl-C ends it", port.name)?;
    out.flush()?;
    let mut twin = RealTimeTwin::power_on(&stage);
    let console = Console::start();
    let mut buffer = [0; 1024];
    while !stop.load(Ordering::Relaxed) {
        let count = port.end.read(&mut buffer)?;
        let bytes = twin.turn(&buffer[..count]);
        if !bytes.is_empty() {
            port.end.write(&bytes);
        }
        if let Some(lab) = &mut lab {
            lab.turn(&mut twin);
        }
        match console.order() {
            None => {}
            Some(Order::Quit) => break,
            Some(Order::Unplug) => port.end.unplug(),
            Some(Order::Plug) => port.plug()?,
            Some(Order::Where) => {
                let [x, y, z] = twin.position_mm();
                let steps = twin.steps();
                writeln!(out, "stage at {x:.4} {y:.4} {z:.4} mm, {steps:?} steps")?;
                out.flush()?;
            }
            Some(Order::Restart) => twin.power_cycle(),
            Some(Order::Disturb(disturbance)) => match &mut lab {
                Some(lab) => lab.disturb(disturbance),
                None => notice!("there are no cameras without --with-target"),
            },
            Some(Order::Switches(change)) => twin.set_switches(change(twin.switches())),
            Some(Order::Unknown(line)) => notice!("`{line}` is unknown; {}", console::ORDERS),
        }
    }
    Ok(())
}

fn rig(path: Option<&Path>) -> Result<RigFile, Failure> {
    let Some(path) = path else {
        return Ok(RigFile::paper());
    };
    let rig = RigFile::read(path)?;
    super::warnings::rig(path, &rig);
    if rig.stage.is_none() {
        let none = "has no [stage] section, which says what the station moves";
        return Err(InputError::file(path, none).into());
    }
    Ok(rig)
}

#[cfg(unix)]
fn lab(
    options: &TwinOptions,
    scene: Scene,
    delays_ms: Vec<f64>,
    port: &Port,
) -> Result<lab::Lab, Failure> {
    let setup = lab::LabSetup {
        scene,
        delays_ms,
        seed: options.scene.seed,
        path: options.path,
        fps: options.fps,
    };
    lab::Lab::start(setup, &port.link)
}

#[cfg(not(unix))]
fn lab(_: &TwinOptions, _: Scene, _: Vec<f64>, _: &Port) -> Result<NoLab, Failure> {
    let reason = "--with-target needs local sockets, which this system does not have";
    Err(Failure::Usage(reason.to_owned()))
}

/// The bench of a system on which it cannot be simulated: there is none.
#[cfg(not(unix))]
enum NoLab {}

#[cfg(not(unix))]
impl NoLab {
    fn turn(&mut self, _: &mut RealTimeTwin) {
        match *self {}
    }

    fn disturb(&mut self, _: console::Disturbance) {
        match *self {}
    }
}

/// The simulated port.
struct Port {
    end: Box<dyn Plug>,
    /// Value of --port for the other programs.
    name: String,
    /// Link to the pseudo-terminal; empty with TCP.
    link: PathBuf,
}

impl Port {
    fn open(options: &TwinOptions) -> Result<Self, Failure> {
        let link = link(options)?;
        let (end, name) = far_end(options, &link)?;
        Ok(Self { end, name, link })
    }

    fn plug(&mut self) -> Result<(), Failure> {
        self.end.plug().map_err(|cause| {
            let reason = format!("cannot be plugged in again: {cause}");
            InputError::file(Path::new(&self.name), reason).into()
        })
    }
}

/// Opens the far end; returns it with the value of --port for the other programs.
fn far_end(options: &TwinOptions, link: &Path) -> Result<(Box<dyn Plug>, String), Failure> {
    if let Some(address) = &options.tcp {
        let failed = |cause: io::Error| {
            let reason = format!("cannot listen: {cause}");
            Failure::from(InputError::file(Path::new(address), reason))
        };
        let port = TcpPort::open(address).map_err(failed)?;
        let address = port.address();
        return Ok((Box::new(port), format!("tcp://{address}")));
    }
    let end = pseudo_terminal(link)?;
    let port = match options.link {
        Some(_) => link.display().to_string(),
        None => ports::TWIN.to_owned(),
    };
    Ok((end, port))
}

/// Returns the link to the pseudo-terminal, the user's or the default one.
fn link(options: &TwinOptions) -> Result<PathBuf, Failure> {
    match (&options.link, &options.tcp) {
        (Some(link), _) => Ok(link.clone()),
        (None, Some(_)) => Ok(PathBuf::new()),
        (None, None) => Ok(ports::twin_link()
            .map_err(|cause| InputError::file(Path::new(ports::TWIN), cause.to_string()))?),
    }
}

#[cfg(unix)]
fn pseudo_terminal(link: &Path) -> Result<Box<dyn Plug>, Failure> {
    use trinocular_client::twin::far_end::PseudoTerminal;
    let end = PseudoTerminal::open(link).map_err(|cause| {
        let reason = match cause.kind() {
            io::ErrorKind::ResourceBusy => {
                "another `trinocular twin` uses this link; end that one, or name another --link"
                    .to_owned()
            }
            io::ErrorKind::AlreadyExists => {
                "exists and is not a link to a pseudo-terminal; name another --link".to_owned()
            }
            _ => format!("cannot be made a link to a pseudo-terminal: {cause}"),
        };
        InputError::file(link, reason)
    })?;
    Ok(Box::new(end))
}

#[cfg(not(unix))]
fn pseudo_terminal(_: &Path) -> Result<Box<dyn Plug>, Failure> {
    let reason = "this system has no pseudo-terminals; use --tcp 127.0.0.1:5333";
    Err(Failure::Usage(reason.to_owned()))
}
