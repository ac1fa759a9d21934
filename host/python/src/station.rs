//! The station: a stage on a port.
//!
//! *Invariant:* the line is locked for single calls only, never while something is waited for that
//! the stage does: a stop from another thread goes out at once.

use crate::errors::{station, stopped, value};
use crate::rig::Rig;
use pyo3::prelude::*;
use serde_json::json;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use trinocular_client::allowance::Allowance;
use trinocular_client::below_step::check_steps;
use trinocular_client::rest::{self, RestWatch};
use trinocular_client::serial::Serial;
use trinocular_client::stage::{configuration_at, setpoint};
use trinocular_client::travel::check_travel;
use trinocular_client::{StationError, diagnosis, ports};
use trinocular_core::frame::message::{Command, Denial, Mounting, Status};
use trinocular_core::safety::{Fault, State};
use trinocular_rig::rig_file::Stage;

/// Polling period of a stage in motion.
const LOOK: Duration = Duration::from_millis(10);
/// Timeout for a stage to come to rest before a reset.
const REST_PATIENCE: Duration = Duration::from_secs(10);

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

/// Returns the stage of a rig.
///
/// # Errors
/// `ValueError` if it has none.
pub fn stage_of(rig: &Rig) -> PyResult<Stage> {
    rig.file.stage.clone().ok_or_else(|| {
        value(
            "the rig has no [stage] section, which describes the axes that the station moves; \
             `trinocular init` writes one",
        )
    })
}

impl Station {
    fn lock(&self) -> MutexGuard<'_, Option<Serial>> {
        self.serial.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs `work` with the line, without the interpreter's lock.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Serial) -> T + Send,
    ) -> PyResult<T> {
        if std::process::id() != self.process {
            return Err(value(
                "this station was opened by the parent process; open another in this one",
            ));
        }
        let outcome = py.detach(|| self.lock().as_mut().map(work));
        outcome.ok_or_else(|| value("the station is closed"))
    }

    /// Runs `work` with the line as [`Station::with`] does; its error is raised.
    pub fn call<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Serial) -> Result<T, StationError> + Send,
    ) -> PyResult<T> {
        self.with(py, work)?.map_err(|error| station(&error))
    }

    /// Returns the position of the stage in mm, if the stage is known.
    pub fn in_mm(&self, steps: [i32; 3]) -> Option<[f64; 3]> {
        self.stage.as_ref().map(|stage| stage.in_mm(steps))
    }

    /// Raises what ended a motion or a loop: a fault, a restart, a stop. `status` is that of a
    /// stage that stands.
    pub fn check_end(&self, py: Python<'_>, status: &Status) -> PyResult<()> {
        let port = self.with(py, |serial| serial.path())?;
        match rest::ended(status, &port).map_err(|error| station(&error))? {
            true => Err(stopped()),
            false => Ok(()),
        }
    }

    /// Sends a command to move to a stage that stands.
    fn start(
        &self,
        py: Python<'_>,
        name: &'static str,
        command: Command,
        may_move: bool,
    ) -> PyResult<()> {
        self.call(py, |serial| {
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
        self.call(py, Serial::stop)?;
        let mut ramp = Allowance::RAMP.start(Instant::now());
        while self.call(py, |serial| serial.stands(&mut ramp))?.is_none() {
            py.detach(|| std::thread::sleep(LOOK));
        }
        Ok(())
    }

    /// Waits until the stage stands. Ctrl-C stops it on a ramp and is raised then; so is whatever
    /// else ends the wait.
    fn until_rest(&self, py: Python<'_>, allowance: Allowance) -> PyResult<()> {
        let mut motion = RestWatch::begin(allowance, Instant::now());
        loop {
            let looked = py.check_signals().and_then(|()| {
                self.call(py, |serial| {
                    let status = serial.fresh_status(true)?;
                    let is_over = motion.is_over(Instant::now(), &status)?;
                    Ok(is_over.then_some(status))
                })
            });
            match looked {
                Ok(Some(status)) => return self.check_end(py, &status),
                Ok(None) => py.detach(|| std::thread::sleep(LOOK)),
                Err(raised) => {
                    self.stop_and_rest(py)?;
                    return Err(raised);
                }
            }
        }
    }

    fn allowance(&self, distance_mm: [f64; 3]) -> Allowance {
        self.stage.as_ref().map_or(Allowance::UNKNOWN, |stage| {
            Allowance::of_distance(stage, distance_mm)
        })
    }

    fn json(&self, status: &Status, port: &str) -> String {
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
            "position_mm": self.in_mm(status.position_steps),
            "target_mm": self.in_mm(status.target_steps),
            "port": port,
            "time_us": status.time.micros(),
            "next": diagnosis::next_step(status),
        })
        .to_string()
    }
}

#[pymethods]
impl Station {
    #[new]
    fn new(
        py: Python<'_>,
        port: &str,
        rig: Option<&Rig>,
        heartbeat_ms: u16,
        fixed: bool,
    ) -> PyResult<Self> {
        let stage = rig.map(stage_of).transpose()?;
        let mounting = match fixed {
            true => Mounting::Fixed,
            false => Mounting::OnStage,
        };
        let connect = || {
            let path = ports::resolve(port)?;
            let mut serial = Serial::connect(&path)?;
            let mismatches = serial.who().map(|hello| hello.mismatches());
            let mismatches = mismatches.unwrap_or_default();
            if !mismatches.is_empty() {
                return Err(StationError::Mismatch(mismatches.to_vec()));
            }
            if let Some(stage) = &stage {
                let config = configuration_at(stage, mounting, heartbeat_ms)?;
                serial.command("config", Command::Config(config))?;
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
        let (status, port) = self.call(py, |serial| {
            Ok((serial.fresh_status(false)?, serial.path()))
        })?;
        Ok(self.json(&status, &port))
    }

    /// Position of the stage in mm, if the stage is known.
    fn position_mm(&self, py: Python<'_>) -> PyResult<Option<[f64; 3]>> {
        let status = self.call(py, |serial| serial.fresh_status(false))?;
        Ok(self.in_mm(status.position_steps))
    }

    /// The line's clock, µs, on which capture times of frames are.
    fn now_us(&self, py: Python<'_>) -> PyResult<u64> {
        self.with(py, |serial| serial.now_us())
    }

    fn jog(&self, py: Python<'_>, distance_mm: [f64; 3], wait: bool) -> PyResult<()> {
        let distance_um = distance_mm.map(|mm| (mm * 1e3).round() as i32);
        let is_lost = |axis: usize| distance_mm[axis] != 0.0 && distance_um[axis] == 0;
        if let Some(axis) = (0..3).find(|axis| is_lost(*axis)) {
            let (name, mm) = (['x', 'y', 'z'][axis], distance_mm[axis]);
            return Err(value(format!("{name}={mm} is shorter than 0.001 mm")));
        }
        if let Some(stage) = &self.stage {
            check_steps(stage, distance_um).map_err(value)?;
        }
        self.start(py, "jog", Command::Jog { distance_um }, false)?;
        match wait {
            true => self.until_rest(py, self.allowance(distance_mm)),
            false => Ok(()),
        }
    }

    fn move_to(&self, py: Python<'_>, position_mm: [f64; 3], wait: bool) -> PyResult<()> {
        if let Some(stage) = &self.stage {
            check_travel(stage, position_mm).map_err(value)?;
        }
        self.start(py, "setpoint", setpoint(position_mm), true)?;
        match wait {
            true => self.until_rest(py, Allowance::UNKNOWN),
            false => Ok(()),
        }
    }

    fn home(&self, py: Python<'_>, axes: Option<[bool; 3]>) -> PyResult<()> {
        let of_stage = |stage: &Stage| stage.care.has_home();
        let chosen = axes.or_else(|| self.stage.as_ref().map(of_stage));
        let axes = chosen.unwrap_or([true; 3]);
        self.start(py, "home", Command::Home { axes }, false)?;
        let allowance = self.stage.as_ref().map_or(Allowance::UNKNOWN, |stage| {
            Allowance::of_homing(stage, axes)
        });
        self.until_rest(py, allowance)
    }

    fn wait(&self, py: Python<'_>) -> PyResult<()> {
        self.call(py, |serial| match serial.fresh_status(false)?.state {
            State::Unconfigured => Err(StationError::Denied {
                command: "to wait",
                denial: Denial::Unconfigured,
            }),
            _ => Ok(()),
        })?;
        self.until_rest(py, Allowance::UNKNOWN)
    }

    fn zero(&self, py: Python<'_>) -> PyResult<()> {
        self.call(py, |serial| {
            serial.command("zero", Command::Zero)?;
            serial.fresh_status(true).map(drop)
        })
    }

    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        self.stop_and_rest(py)
    }

    /// Stops a stage that moves, or may move because of a command; nothing else.
    fn stop_motion(&self, py: Python<'_>) -> PyResult<()> {
        let is_open = py.detach(|| self.lock().is_some());
        match is_open && self.with(py, |serial| serial.is_moving())? {
            true => self.stop_and_rest(py),
            false => Ok(()),
        }
    }

    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        let end = Instant::now() + REST_PATIENCE;
        loop {
            py.check_signals()?;
            let reset = |serial: &mut Serial| {
                let outcome = serial.command("reset", Command::Reset);
                let status = serial.fresh_status(true).ok();
                outcome.map_err(|error| (error.reset_may_wait(status.as_ref()), error))
            };
            match self.with(py, reset)? {
                Err((true, _)) if Instant::now() < end => {
                    py.detach(|| std::thread::sleep(LOOK));
                }
                outcome => return outcome.map_err(|(_, error)| station(&error)),
            }
        }
    }

    /// Stops a motion and closes the line.
    fn close(&self, py: Python<'_>) {
        if std::process::id() == self.process {
            py.detach(|| {
                // Taken out first: the stop of the motion takes its time.
                let serial = self.lock().take();
                drop(serial);
            });
        }
    }
}
