//! The station: a stage on a port, or the built-in twin.

use crate::errors::{station, value};
use crate::rig::Rig;
use pyo3::prelude::*;
use serde_json::json;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use trinocular_client::allowance::Allowance;
use trinocular_client::serial::Serial;
use trinocular_client::stage::{configuration, setpoint};
use trinocular_client::twin::TwinOnPort;
use trinocular_client::{StationError, diagnosis, ports};
use trinocular_core::frame::message::{Command, Config, Denial, Mounting, Status};
use trinocular_core::safety::{Fault, State};
use trinocular_rig::rig_file::Stage;

/// Polling period of a stage in motion.
const LOOK: Duration = Duration::from_millis(10);
/// Timeout for a stage to come to rest after a stop.
const REST_PATIENCE: Duration = Duration::from_secs(10);

/// Native twin: the station's own code with a simulated stage, behind a pseudo-terminal.
#[pyclass(frozen, module = "trinocular._trinocular")]
pub struct Twin {
    twin: TwinOnPort,
}

fn stage_of(rig: &Rig) -> PyResult<Stage> {
    rig.file.stage.clone().ok_or_else(|| {
        value(
            "the rig has no [stage] section, which describes the axes that the station moves; \
             `trinocular init` writes one",
        )
    })
}

#[pymethods]
impl Twin {
    #[new]
    fn new(rig: &Rig) -> PyResult<Self> {
        let twin = TwinOnPort::start(&stage_of(rig)?).map_err(|error| station(&error))?;
        Ok(Self { twin })
    }

    #[getter]
    fn path(&self) -> &str {
        self.twin.path()
    }

    /// Steps that the pins made since the start, backward ones subtracted.
    #[getter]
    fn steps(&self) -> [i64; 3] {
        self.twin.steps()
    }
}

/// Native connection to a station.
#[pyclass(frozen, module = "trinocular._trinocular")]
pub struct Station {
    serial: Mutex<Option<Serial>>,
    stage: Option<Stage>,
    /// Process that has the line: a child after a fork has only a copy of this value.
    process: u32,
}

impl Drop for Station {
    fn drop(&mut self) {
        if std::process::id() != self.process {
            // The line and its threads are the parent's.
            std::mem::forget(self.lock().take());
        }
    }
}

impl Station {
    fn lock(&self) -> MutexGuard<'_, Option<Serial>> {
        self.serial.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs `work` with the line, without the interpreter's lock.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Serial) -> Result<T, StationError> + Send,
    ) -> PyResult<T> {
        if std::process::id() != self.process {
            return Err(value(
                "this station was opened by the parent process; open another in this one",
            ));
        }
        let outcome = py.detach(|| self.lock().as_mut().map(work));
        let outcome = outcome.ok_or_else(|| value("the station is closed"))?;
        outcome.map_err(|error| station(&error))
    }

    fn send(&self, py: Python<'_>, name: &'static str, command: Command) -> PyResult<Status> {
        self.with(py, |serial| {
            serial.command(name, command)?;
            serial.fresh_status(true)
        })
    }

    /// Sends a command to move to a stage that stands.
    fn start(
        &self,
        py: Python<'_>,
        name: &'static str,
        command: Command,
        may_move: bool,
    ) -> PyResult<()> {
        self.with(py, |serial| {
            if !may_move && serial.fresh_status(false)?.state.is_moving() {
                let denial = Denial::Moving;
                return Err(StationError::Denied {
                    command: name,
                    denial,
                });
            }
            serial.command(name, command)
        })
    }

    fn stop_and_rest(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |serial| {
            serial.stop()?;
            serial.until_rest().map(drop)
        })
    }

    /// Waits until the stage stands. Ctrl-C stops it on a ramp and is raised then.
    fn until_rest(&self, py: Python<'_>, allowance: Allowance) -> PyResult<()> {
        let mut allowance = allowance.start(Instant::now());
        loop {
            if let Err(raised) = py.check_signals() {
                self.stop_and_rest(py)?;
                return Err(raised);
            }
            let status = self.with(py, |serial| serial.fresh_status(true))?;
            if !status.state.is_moving() && status.state != State::Stopping {
                return why_it_stands(&status);
            }
            if let Some(waited) = allowance.spent(Instant::now(), Some(&status)) {
                self.stop_and_rest(py)?;
                let waited_s = waited.as_secs();
                return Err(station(&StationError::Overdue { waited_s }));
            }
            py.detach(|| std::thread::sleep(LOOK));
        }
    }

    fn allowance(&self, distance_mm: [f64; 3]) -> Allowance {
        self.stage.as_ref().map_or(Allowance::UNKNOWN, |stage| {
            Allowance::of_distance(stage, distance_mm)
        })
    }

    fn json(&self, status: &Status, port: &str) -> String {
        let in_mm = |steps: [i32; 3]| {
            let stage = self.stage.as_ref()?;
            let mm = |axis: usize| f64::from(steps[axis]) / stage.steps_per_mm[axis];
            Some([0, 1, 2].map(mm))
        };
        let fault = |fault: Fault| {
            let name = diagnosis::fault(fault).name;
            json!({"number": fault.number(), "name": name})
        };
        let faults: Vec<_> = status.faults.iter().map(fault).collect();
        json!({
            "state": diagnosis::state(status.state).name,
            "fault": status.fault.map(fault),
            "faults": faults,
            "motors": status.motors,
            "trust": diagnosis::trust(status.trust),
            "position_steps": status.position_steps,
            "target_steps": status.target_steps,
            "position_mm": in_mm(status.position_steps),
            "target_mm": in_mm(status.target_steps),
            "port": port,
            "time_us": status.time.micros(),
            "next": diagnosis::next_step(status),
        })
        .to_string()
    }
}

/// Returns the error behind a motion that did not end by itself.
fn why_it_stands(status: &Status) -> PyResult<()> {
    if let Some(fault) = status.fault {
        return Err(station(&StationError::Faulted(fault)));
    }
    if status.state == State::Stopped {
        let next = diagnosis::state(status.state).action;
        return Err(crate::errors::StationError::new_err(format!(
            "stopped by another command; next: {next}"
        )));
    }
    Ok(())
}

#[pymethods]
impl Station {
    #[new]
    fn new(py: Python<'_>, port: &str, rig: Option<&Rig>, heartbeat_ms: u16) -> PyResult<Self> {
        let stage = rig.map(stage_of).transpose()?;
        let connect = || {
            let path = ports::resolve(port)?;
            let mut serial = Serial::connect(&path)?;
            let mismatches = serial.who().map(|hello| hello.mismatches());
            let mismatches = mismatches.unwrap_or_default();
            if !mismatches.is_empty() {
                return Err(StationError::Mismatch(mismatches.to_vec()));
            }
            if let Some(stage) = &stage {
                let config = configuration(stage, Mounting::OnStage)?;
                let config = Command::Config(Config {
                    heartbeat_ms,
                    ..config
                });
                serial.command("config", config)?;
            }
            serial.start_heartbeat()?;
            Ok(serial)
        };
        let serial = py.detach(connect).map_err(|error| station(&error))?;
        Ok(Self {
            serial: Mutex::new(Some(serial)),
            stage,
            process: std::process::id(),
        })
    }

    /// Status in JSON.
    fn status(&self, py: Python<'_>) -> PyResult<String> {
        let (status, port) = self.with(py, |serial| {
            Ok((serial.fresh_status(false)?, serial.path()))
        })?;
        Ok(self.json(&status, &port))
    }

    fn jog(&self, py: Python<'_>, distance_mm: [f64; 3], wait: bool) -> PyResult<()> {
        let distance_um = distance_mm.map(|mm| (mm * 1e3).round() as i32);
        self.start(py, "jog", Command::Jog { distance_um }, false)?;
        match wait {
            true => self.until_rest(py, self.allowance(distance_mm)),
            false => Ok(()),
        }
    }

    fn move_to(&self, py: Python<'_>, position_mm: [f64; 3], wait: bool) -> PyResult<()> {
        self.start(py, "setpoint", setpoint(position_mm), true)?;
        match wait {
            true => self.until_rest(py, Allowance::UNKNOWN),
            false => Ok(()),
        }
    }

    fn home(&self, py: Python<'_>, axes: Option<[bool; 3]>) -> PyResult<()> {
        let of_stage = |stage: &Stage| stage.care.home.map(|home| home.is_some());
        let chosen = axes.or_else(|| self.stage.as_ref().map(of_stage));
        let axes = chosen.unwrap_or([true; 3]);
        self.start(py, "home", Command::Home { axes }, false)?;
        let allowance = self.stage.as_ref().map_or(Allowance::UNKNOWN, |stage| {
            Allowance::of_homing(stage, axes)
        });
        self.until_rest(py, allowance)
    }

    fn wait(&self, py: Python<'_>) -> PyResult<()> {
        self.until_rest(py, Allowance::UNKNOWN)
    }

    fn zero(&self, py: Python<'_>) -> PyResult<()> {
        self.send(py, "zero", Command::Zero).map(drop)
    }

    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        self.stop_and_rest(py)
    }

    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        let end = Instant::now() + REST_PATIENCE;
        self.with(py, |serial| {
            loop {
                match serial.command("reset", Command::Reset) {
                    // The ramp, or the report of a fault, is still under way.
                    Err(error) if error.is_passing() && Instant::now() < end => {
                        std::thread::sleep(LOOK);
                    }
                    outcome => return outcome,
                }
            }
        })
    }

    /// Stops a motion and closes the line.
    fn close(&self, py: Python<'_>) {
        if std::process::id() == self.process {
            py.detach(|| drop(self.lock().take()));
        }
    }
}
