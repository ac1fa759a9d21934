//! Shared parts of the commands that drive a station by hand: the port, the stage of the rig file,
//! and denials with their remedy.

use crate::commands::failure::Failure;
use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};
use trinocular_client::allowance::Allowance;
use trinocular_client::diagnosis::{self, remedy};
use trinocular_client::rest::{self, RestWatch};
use trinocular_client::serial::Serial;
use trinocular_client::stage::{HEARTBEAT_MS, configuration_at};
use trinocular_client::{StationError, ports};
use trinocular_core::frame::message::{Command, Denial, Mounting, Status};
use trinocular_core::safety::{Fault, State};
use trinocular_rig::error::InputError;
use trinocular_rig::interruption;
use trinocular_rig::notice;
use trinocular_rig::rig_file::{RigFile, Stage};

/// Timeout for a stage to come to rest.
const REST_PATIENCE: Duration = Duration::from_secs(10);

/// Polling period of a stage in motion.
const LOOK: Duration = Duration::from_millis(10);

/// Port of the station.
#[derive(Debug, Args)]
pub struct PortArgument {
    /// Port of the station, such as /dev/ttyACM0 or tcp://HOST:PORT; `auto` is the only station on
    /// USB, `twin` the one that `trinocular twin` simulates, `trinocular ports` lists all
    #[arg(long, value_name = "PATH")]
    pub port: String,
}

/// Stage of the station.
#[derive(Debug, Args)]
pub struct StageArgument {
    /// Configure the station with the `stage` section of this rig file first; without it the
    /// station keeps the configuration it has
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,

    /// Heartbeat timeout, ms: the station stops without a ping for this time. Raise it on a loaded
    /// computer
    #[arg(
        long,
        value_name = "MS",
        requires = "rig",
        default_value_t = HEARTBEAT_MS,
        value_parser = clap::value_parser!(u16).range(20..=10_000)
    )]
    heartbeat: u16,
}

impl StageArgument {
    /// Reads the stage of the rig file, if one was named.
    pub fn read(&self) -> Result<Option<Stage>, Failure> {
        let Some(path) = &self.rig else {
            return Ok(None);
        };
        let rig = RigFile::read(path)?;
        super::warnings::rig(path, &rig);
        self.stage_of(&rig).map(Some)
    }

    /// Returns the path of the rig file, for a command that requires one.
    pub fn path(&self) -> Result<&Path, Failure> {
        let path = self.rig.as_deref();
        path.ok_or_else(|| {
            Failure::Usage("--rig RIG.toml is missing: the command needs its [stage]".to_owned())
        })
    }

    /// Returns the stage of a rig file that was read.
    pub fn stage_of(&self, rig: &RigFile) -> Result<Stage, Failure> {
        let none = "has no [stage] section, which describes the axes that the station moves; \
                    `trinocular init` writes one";
        let path = self.rig.as_deref().unwrap_or(Path::new(""));
        let stage = rig.stage.clone();
        let stage = stage.ok_or_else(|| InputError::file(path, none))?;
        super::warnings::stage(path, &stage);
        Ok(stage)
    }
}

/// An axis of the stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AxisName {
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
    /// Connects to the station; refuses one with other firmware.
    pub fn connect(argument: &PortArgument) -> Result<Self, Failure> {
        Self::connect_to_any(argument)?.checked()
    }

    fn checked(self) -> Result<Self, Failure> {
        let mismatches = self.serial.who().map(|hello| hello.mismatches());
        match mismatches.unwrap_or_default() {
            list if list.is_empty() => Ok(self),
            list => Err(self.failed(StationError::Mismatch(list.to_vec()))),
        }
    }

    /// Connects as [`Hand::connect`] does, only to read the station's reports: also while another
    /// run of this program has the port.
    pub fn connect_to_watch(argument: &PortArgument) -> Result<Self, Failure> {
        Self::connect_by(argument, Serial::connect_to_watch)?.checked()
    }

    /// Connects as [`Hand::connect`] does, for a command that every firmware understands.
    pub fn connect_to_any(argument: &PortArgument) -> Result<Self, Failure> {
        Self::connect_by(argument, Serial::connect)
    }

    /// Connects as [`Hand::connect_to_any`] does, and stops the stage with the first packets.
    pub fn connect_and_stop(argument: &PortArgument) -> Result<Self, Failure> {
        Self::connect_by(argument, Serial::connect_and_stop)
    }

    fn connect_by(
        argument: &PortArgument,
        connect: impl Fn(&str) -> Result<Serial, StationError>,
    ) -> Result<Self, Failure> {
        let port =
            ports::resolve(&argument.port).map_err(|error| Failure::of_station(None, error))?;
        let serial = connect(&port).map_err(|error| Failure::of_station(Some(&port), error))?;
        Ok(Self { serial, port })
    }

    /// Returns the connection to the station.
    pub fn serial(&self) -> &Serial {
        &self.serial
    }

    /// Returns the connection to the station for changes.
    pub fn serial_mut(&mut self) -> &mut Serial {
        &mut self.serial
    }

    /// Returns the path of the port.
    pub fn port(&self) -> &str {
        &self.port
    }

    /// Returns a fresh status of the station.
    pub fn status(&self) -> Result<Status, Failure> {
        self.serial
            .fresh_status(false)
            .map_err(|error| self.failed(error))
    }

    /// Sends a command; returns the status after it.
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

    /// Sends a command as [`Hand::command`] does, and repeats it while the stage still ramps down
    /// or a fault has not been reported.
    pub fn command_at_rest(
        &mut self,
        name: &'static str,
        command: Command,
    ) -> Result<Status, Failure> {
        let end = Instant::now() + REST_PATIENCE;
        loop {
            let outcome = self.try_command(name, command);
            let is_passing = outcome.as_ref().is_err_and(StationError::is_passing);
            if !is_passing || Instant::now() >= end {
                return outcome.map_err(|error| self.failed(error));
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Resets the station; waits for the end of a ramp after a stop or a fault, and for no other
    /// motion.
    pub fn reset(&mut self) -> Result<Status, Failure> {
        let end = Instant::now() + REST_PATIENCE;
        loop {
            let error = match self.try_command("reset", Command::Reset) {
                Ok(status) => return Ok(status),
                Err(error) => error,
            };
            let status = self.serial.fresh_status(true).ok();
            if !error.reset_may_wait(status.as_ref()) || Instant::now() >= end {
                return Err(self.failed(error));
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Configures the station with a stage, if one was named.
    pub fn configure(
        &mut self,
        stage: Option<&Stage>,
        argument: &StageArgument,
    ) -> Result<(), Failure> {
        let (Some(stage), Some(path)) = (stage, &argument.rig) else {
            return Ok(());
        };
        let config = configuration_at(stage, Mounting::OnStage, argument.heartbeat)
            .map_err(|error| InputError::file(path, error.to_string()))?;
        self.command("config", Command::Config(config)).map(|_| ())
    }

    /// Starts the heartbeat, and waits until the station has answered a ping.
    pub fn start_heartbeat(&mut self) -> Result<(), Failure> {
        let heard = self.serial.start_heartbeat();
        heard.map_err(|error| self.failed(error))
    }

    /// Stops the stage and waits until it stands.
    pub fn stop(&mut self) -> Result<(), Failure> {
        let stood = self.serial.stop().and_then(|()| self.serial.until_rest());
        stood.map(|_| ()).map_err(|error| self.failed(error))
    }

    /// Stops the stage, waits until it stands, and returns its status then. A stop of another program
    /// meanwhile asks for the same.
    ///
    /// # Errors
    /// If the stop is not answered, or the place where the stage stands does not become known.
    pub fn stop_beside_others(&mut self) -> Result<Status, Failure> {
        loop {
            let stood = self.serial.stop().and_then(|()| self.serial.until_rest());
            match stood.and_then(|_| self.serial.fresh_status(false)) {
                Err(StationError::StoppedByOther { .. }) => self.serial.forgive_stop(),
                outcome => return outcome.map_err(|error| self.failed(error)),
            }
        }
    }

    /// Waits until the stage stands. A signal stops it on a ramp, and so does the end of the
    /// motion's allowance. `watch` gets every status meanwhile.
    ///
    /// # Errors
    /// If the place where the stage stands does not become known.
    pub fn wait_for_rest(
        &mut self,
        allowance: Allowance,
        mut watch: impl FnMut(&Status),
    ) -> Result<Rest, Failure> {
        let mut interrupted = false;
        let mut motion = RestWatch::begin(allowance, Instant::now());
        loop {
            if interruption::is_requested() && !interrupted {
                interrupted = true;
                self.stop()?;
            }
            let status = match self.serial.fresh_status(true) {
                Err(StationError::Cancelled) => continue,
                Err(error @ StationError::StoppedByOther { .. }) => {
                    return self.rest_after(error);
                }
                Err(error @ StationError::Interrupted { .. }) => {
                    // The station may have moved on for the heartbeat timeout, and move still.
                    self.stop()?;
                    return self.rest_after(error);
                }
                Err(error @ StationError::Restarted { .. }) => {
                    let status = self.serial.status().ok_or_else(|| self.failed(error))?;
                    let end = End::Own;
                    return Ok(Rest { status, end });
                }
                status => status.map_err(|error| self.failed(error))?,
            };
            match motion.is_over(Instant::now(), &status) {
                Ok(true) => {
                    let end = match interrupted {
                        true => End::Interrupted,
                        false => End::Own,
                    };
                    return Ok(Rest { status, end });
                }
                Ok(false) => watch(&status),
                Err(error @ StationError::Overdue { .. }) => {
                    self.stop()?;
                    return self.rest_after(error);
                }
                Err(error) => return Err(self.failed(error)),
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Waits for the end of the ramp of a stop, which came because of `error`.
    fn rest_after(&mut self, error: StationError) -> Result<Rest, Failure> {
        let stands = self.serial.until_rest();
        stands.map_err(|error| self.failed(error))?;
        match self.serial.status() {
            Some(status) => {
                let end = End::Error(error);
                Ok(Rest { status, end })
            }
            None => Err(self.failed(error)),
        }
    }

    /// Checks that the station may get a command that moves it: it must be at rest, and have a
    /// configuration or be about to get one. Returns its status.
    pub fn ready_to_move(
        &self,
        command: &'static str,
        brings_stage: bool,
    ) -> Result<Status, Failure> {
        let status = self.status()?;
        let denial = match status.state {
            // The host that started the motion is gone or busy: this heartbeat must not keep it up.
            state if state.is_moving() => Denial::Moving,
            State::Unconfigured if !brings_stage => Denial::Unconfigured,
            _ => return Ok(status),
        };
        Err(self.failed(StationError::Denied { command, denial }))
    }

    /// Makes a failure with its port and the operator's next action.
    pub fn failed(&self, error: StationError) -> Failure {
        let next = match &error {
            StationError::Denied { denial, .. } => remedy(*denial),
            _ => None,
        };
        match Failure::of_station(Some(&self.port), error) {
            Failure::Station(failure) => Failure::Station(failure.with_next(next)),
            failure => failure,
        }
    }
}

/// Returns the flag that a signal sets. A second signal ends the program at once, and the station
/// stops without its heartbeat.
pub fn on_interrupt() -> Result<Arc<AtomicBool>, Failure> {
    interruption::watch().map_err(Failure::Signals)
}

/// Stage that stands after a motion.
pub struct Rest {
    /// Status of the station at rest.
    pub status: Status,
    end: End,
}

/// End of a motion.
enum End {
    /// By itself, by a fault, or by a stop that did not go through this program.
    Own,
    /// By a signal.
    Interrupted,
    /// By a stop with this reason.
    Error(StationError),
}

/// Returns the failure behind a motion that did not end by itself.
pub fn why_it_stands(hand: &Hand, rest: Rest) -> Result<(), Failure> {
    let Rest { status, end } = rest;
    let is_stopped = match (rest::ended(&status, hand.port()), &end) {
        (Ok(is_stopped), _) => is_stopped,
        (Err(fault), End::Error(lost @ StationError::Interrupted { .. })) => {
            notice!("{lost}");
            return Err(hand.failed(fault));
        }
        (Err(error), _) => return Err(hand.failed(error)),
    };
    let who = match end {
        End::Error(error @ (StationError::Overdue { .. } | StationError::Interrupted { .. })) => {
            return Err(hand.failed(error));
        }
        End::Error(error) => error.to_string(),
        End::Interrupted if is_stopped => "interrupted".to_owned(),
        End::Own if is_stopped => "stopped by another command".to_owned(),
        End::Interrupted | End::Own => return Ok(()),
    };
    let next = diagnosis::state(status.state).action;
    Err(Failure::Station(format!("{who}; next: {next}").into()))
}

/// Formats a position in whole steps, and in mm if the stage is known.
pub fn position(steps: [i32; 3], stage: Option<&Stage>) -> String {
    let [x, y, z] = steps;
    match stage.map(|stage| stage.in_mm(steps)) {
        Some([a, b, c]) => format!("{a:.4} {b:.4} {c:.4} mm ({x} {y} {z} steps)"),
        None => format!("{x} {y} {z} steps"),
    }
}

/// Returns number and name of a fault.
pub fn named(fault: Fault) -> Value {
    json!({"number": fault.number(), "name": diagnosis::fault(fault).name})
}

/// Returns state, motors, trust and faults by name; the faults also by number, the worst first.
pub fn condition(status: &Status) -> Value {
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
