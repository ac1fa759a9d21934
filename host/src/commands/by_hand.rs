//! What the commands that drive a station by hand share: the port, the stage of the rig file, and
//! refusals that say what to do next.

use clap::{Args, ValueEnum};
use host::error::{Failure, InputError};
use host::interruption;
use host::rig_file::{RigFile, Stage};
use host::station::allowance::Allowance;
use host::station::diagnosis::{self, remedy};
use host::station::serial::Serial;
use host::station::stage::{HEARTBEAT_MS, configuration};
use host::station::{StationError, ports};
use serde_json::{Value, json};
use shared::frame::message::{Command, Denial, Mounting, Status};
use shared::safety::{Fault, State};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// How long a stage may take to come to rest.
const REST_PATIENCE: Duration = Duration::from_secs(10);

/// How long a station in motion may say nothing of itself: twenty statuses come in that time.
const STATUS_PATIENCE: Duration = Duration::from_secs(2);

/// How often a stage in motion is looked at.
const LOOK: Duration = Duration::from_millis(10);

/// Where the station is.
#[derive(Debug, Args)]
pub struct PortArgument {
    /// The serial port, such as /dev/ttyACM0; `auto` is the only station on USB, `trinocular ports`
    /// lists all
    #[arg(long, value_name = "PATH")]
    pub port: String,
}

/// What the station moves.
#[derive(Debug, Args)]
pub struct StageArgument {
    /// Configure the station with the `stage` section of this rig file first; without it the
    /// station keeps the configuration it has
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,

    /// The station stops when it hears nothing for so long, ms. More on a busy computer
    #[arg(long, value_name = "MS", requires = "rig", default_value_t = HEARTBEAT_MS, value_parser = clap::value_parser!(u16).range(20..=10_000))]
    heartbeat: u16,
}

impl StageArgument {
    /// The stage of the rig file, if one was named.
    pub fn read(&self) -> Result<Option<Stage>, Failure> {
        let Some(path) = &self.rig else {
            return Ok(None);
        };
        self.stage_of(&RigFile::read(path)?).map(Some)
    }

    /// The rig file, for a command that cannot do without.
    pub fn path(&self) -> Result<&Path, Failure> {
        let path = self.rig.as_deref();
        path.ok_or_else(|| Failure::Usage("it needs --rig RIG.toml".to_owned()))
    }

    /// The stage of the rig file that was read.
    pub fn stage_of(&self, rig: &RigFile) -> Result<Stage, Failure> {
        let none = "has no [stage]: it says what the station moves";
        let stage = rig.stage.clone();
        Ok(stage
            .ok_or_else(|| InputError::file(self.rig.as_deref().unwrap_or(Path::new("")), none))?)
    }
}

/// An axis of the stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Axis {
    X,
    Y,
    Z,
}

/// A connected station.
pub struct Hand {
    serial: Serial,
    port: String,
}

impl Hand {
    /// Asks who is there; a station of other firmware is refused.
    pub fn connect(argument: &PortArgument) -> Result<Self, Failure> {
        let hand = Self::connect_to_any(argument)?;
        let mismatches = hand.serial.who().map(|hello| hello.mismatches());
        match mismatches.unwrap_or_default() {
            list if list.is_empty() => Ok(hand),
            list => Err(hand.failed(StationError::Mismatch(list.to_vec()))),
        }
    }

    /// As [`Hand::connect`], for a command that means the same to every firmware.
    pub fn connect_to_any(argument: &PortArgument) -> Result<Self, Failure> {
        Self::connect_by(argument, Serial::connect)
    }

    /// As [`Hand::connect_to_any`], and stops the stage with the first packets.
    pub fn connect_and_stop(argument: &PortArgument) -> Result<Self, Failure> {
        Self::connect_by(argument, Serial::connect_and_stop)
    }

    fn connect_by(
        argument: &PortArgument,
        connect: impl Fn(&str) -> Result<Serial, StationError>,
    ) -> Result<Self, Failure> {
        let port = ports::resolve(&argument.port).map_err(super::station_failed)?;
        let serial = connect(&port).map_err(|error| super::failed_at(Some(&port), error.into()))?;
        Ok(Self { serial, port })
    }

    /// The conversation.
    pub fn serial(&self) -> &Serial {
        &self.serial
    }

    /// The port's path.
    pub fn port(&self) -> &str {
        &self.port
    }

    /// How the station is now.
    pub fn status(&self) -> Result<Status, Failure> {
        self.serial
            .fresh_status(false)
            .map_err(|error| self.failed(error))
    }

    /// Sends a command; returns how the station is after it.
    pub fn command(&mut self, name: &'static str, command: Command) -> Result<Status, Failure> {
        self.try_command(name, command)
            .map_err(|error| self.failed(error))
    }

    fn try_command(
        &mut self,
        name: &'static str,
        command: Command,
    ) -> Result<Status, StationError> {
        self.serial.command(name, command)?;
        self.serial.fresh_status(true)
    }

    /// As [`Hand::command`], and once more while the stage still ramps down or a fault has not been
    /// told.
    pub fn command_at_rest(
        &mut self,
        name: &'static str,
        command: Command,
    ) -> Result<Status, Failure> {
        let end = Instant::now() + REST_PATIENCE;
        loop {
            let outcome = self.try_command(name, command);
            let denied = matches!(
                outcome,
                Err(StationError::Denied {
                    denial: Denial::Moving | Denial::FaultUnread,
                    ..
                })
            );
            if !denied || Instant::now() >= end {
                return outcome.map_err(|error| self.failed(error));
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Gives the station its stage, if one was named.
    pub fn configure(
        &mut self,
        stage: Option<&Stage>,
        argument: &StageArgument,
    ) -> Result<(), Failure> {
        let (Some(stage), Some(path)) = (stage, &argument.rig) else {
            return Ok(());
        };
        let config = configuration(stage, Mounting::OnStage)
            .map_err(|error| InputError::file(path, error.to_string()))?;
        let heartbeat_ms = argument.heartbeat;
        let config = Command::Config(shared::frame::message::Config {
            heartbeat_ms,
            ..config
        });
        self.command("config", config).map(|_| ())
    }

    /// Starts the heartbeat, and waits until the station has heard it.
    pub fn start_heartbeat(&mut self) -> Result<(), Failure> {
        let heard = self.serial.start_heartbeat();
        heard.map_err(|error| self.failed(error))
    }

    /// Stops the stage and waits until it stands.
    pub fn stop(&mut self) -> Result<(), Failure> {
        let stood = self.serial.stop().and_then(|()| self.serial.until_rest());
        stood.map(|_| ()).map_err(|error| self.failed(error))
    }

    /// Waits until the stage stands; a signal stops it on a ramp, and so does the end of the time
    /// that the motion is given. `watch` sees every status meanwhile. Also says whether a signal
    /// came.
    pub fn wait_for_rest(
        &mut self,
        allowance: Allowance,
        mut watch: impl FnMut(&Status),
    ) -> Result<(Status, bool), Failure> {
        let mut interrupted = false;
        let mut allowance = allowance.start(Instant::now());
        let (mut last, mut heard) = (None, Instant::now());
        loop {
            if interruption::is_requested() && !interrupted {
                interrupted = true;
                self.stop()?;
            }
            let status = match self.serial.fresh_status(true) {
                Err(StationError::Cancelled) => continue,
                status => status.map_err(|error| self.failed(error))?,
            };
            if !status.state.is_moving() {
                return Ok((status, interrupted));
            }
            if let Some(waited) = allowance.spent(Instant::now(), Some(&status)) {
                self.stop()?;
                let waited_s = waited.as_secs();
                return Err(self.failed(StationError::Overdue { waited_s }));
            }
            watch(&status);
            if last.replace(status.tick) != Some(status.tick) {
                heard = Instant::now();
            } else if heard.elapsed() > STATUS_PATIENCE {
                return Err(self.failed(StationError::Silent {
                    command: "status",
                    waited_ms: STATUS_PATIENCE.as_millis() as u64,
                }));
            }
            std::thread::sleep(LOOK);
        }
    }

    /// How it is before a command that moves it: at rest, and with a configuration or about to get
    /// one.
    pub fn ready_to_move(
        &self,
        command: &'static str,
        brings_stage: bool,
    ) -> Result<Status, Failure> {
        let status = self.status()?;
        let denial = match status.state {
            // Whoever set it moving is gone or busy: our heartbeat must not keep it going.
            state if state.is_moving() => Denial::Moving,
            State::Unconfigured if !brings_stage => Denial::Unconfigured,
            _ => return Ok(status),
        };
        Err(self.failed(StationError::Denied { command, denial }))
    }

    /// The failure, with the port it happened on and what to do next.
    pub fn failed(&self, error: StationError) -> Failure {
        let next = match &error {
            StationError::Denied { denial, .. } => remedy(*denial),
            _ => None,
        };
        match (super::failed_at(Some(&self.port), error.into()), next) {
            (Failure::Station(reason), Some(next)) => Failure::Station(format!("{reason}; {next}")),
            (failure, _) => failure,
        }
    }
}

/// The flag that a signal sets. A second signal ends the program at once, and the station stops
/// without its heartbeat.
pub fn on_interrupt() -> Result<Arc<AtomicBool>, Failure> {
    interruption::watch().map_err(|cause| Failure::Scene(cause.to_string()))
}

/// The failure behind a motion that did not end by itself.
pub fn why_it_stands(hand: &Hand, end: &Status, interrupted: bool) -> Result<(), Failure> {
    if let Some(fault) = end.fault {
        return Err(hand.failed(StationError::Faulted(fault)));
    }
    if end.state == State::Stopped {
        let who = if interrupted {
            "interrupted"
        } else {
            "stopped by somebody else"
        };
        let next = diagnosis::state(end.state).action;
        return Err(Failure::Station(format!("{who}; next: {next}")));
    }
    Ok(())
}

/// Whole steps, and mm where the stage is known.
pub fn position(steps: [i32; 3], stage: Option<&Stage>) -> String {
    let [x, y, z] = steps;
    match stage.map(|stage| in_mm(steps, stage)) {
        Some([a, b, c]) => format!("{a:.4} {b:.4} {c:.4} mm ({x} {y} {z} steps)"),
        None => format!("{x} {y} {z} steps"),
    }
}

/// Whole steps in mm.
pub fn in_mm(steps: [i32; 3], stage: &Stage) -> [f64; 3] {
    std::array::from_fn(|axis| f64::from(steps[axis]) / stage.steps_per_mm[axis])
}

/// State, motors, trust and faults by name; the faults also by number, the worst first.
pub fn condition(status: &Status) -> Value {
    let named =
        |fault: Fault| json!({"number": fault.number(), "name": diagnosis::fault(fault).name});
    json!({
        "state": diagnosis::state(status.state).name,
        "fault": status.fault.map(named),
        "faults": status.faults.iter().map(named).collect::<Vec<_>>(),
        "motors": status.motors,
        "trust": diagnosis::trust(status.trust),
        "position_steps": status.position_steps,
        "target_steps": status.target_steps,
    })
}
