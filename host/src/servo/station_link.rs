//! The link to the station: the twin on virtual time, or a station on a serial line in real time.
//!
//! A loop must know the position of the stage at each capture time. The twin gives it for any
//! instant, from the edges at its pins. A station on a line gives its position only in its reports:
//! after every frame, and ten times a second. So its reports trigger the simulated cameras: a
//! report names a position, and the images are taken at the instant, in the station's own time, at
//! which the pins stand there. Positions are neither interpolated nor guessed.

use super::ServoError;
use super::serial_station;
pub use super::serial_station::FrameRefusal;
use super::triggering::Triggering;
use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant as HostInstant};
use trinocular_client::observer::StationObserver;
use trinocular_client::serial::Serial;
use trinocular_client::stage::configuration_at;
use trinocular_client::twin::Twin;
use trinocular_client::{StationError, diagnosis, plausible};
use trinocular_core::frame::message::{Command, EstimateReport, Frame, Mounting, Status};
use trinocular_core::safety::Trust;
use trinocular_core::time::Instant;
use trinocular_rig::notice;
use trinocular_rig::rig_file::{Stage, Trigger};

/// Timeout for a report: thirty come in that time, and the client notices and reconnects a silent
/// line earlier.
const REPORT_PATIENCE: Duration = Duration::from_secs(3);

/// Returns the position that the start of a run has made zero, in words; `None` if that has changed
/// nothing that the station knew. `found` is the status before.
fn zeroed(found: &Status, stage: &Stage) -> Option<String> {
    let steps = found.position_steps;
    if found.trust == Trust::Unknown || steps == [0; 3] {
        return None;
    }
    let [x, y, z] = stage.in_mm(steps);
    let known = diagnosis::position(found.trust);
    Some(format!(
        "the present position is zero now; it was {x:.4} {y:.4} {z:.4} mm ({known})"
    ))
}

/// Name that the twin gives as its board.
pub const TWIN_B: &str = "twin B";

/// Place of the station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StationPlace<'a> {
    /// Twin in this process.
    Twin,
    /// Station on a serial port.
    Port {
        /// Path of the port.
        path: &'a str,
        /// Heartbeat timeout, ms, 20 to 10,000. The heartbeat comes every 20 ms, later on a loaded
        /// computer.
        heartbeat_ms: u16,
    },
    /// Station on a serial port that keeps its position, a stop and its faults; it only gets the
    /// configuration ([`Serial::take_over`]).
    Kept {
        /// Path of the port.
        path: &'a str,
        /// Heartbeat timeout, ms, as for [`StationPlace::Port`].
        heartbeat_ms: u16,
    },
    /// Station on a serial port that is only shown: nothing at it is changed ([`Serial::show`]).
    Shown {
        /// Path of the port.
        path: &'a str,
    },
}

/// Capture time of images, and the position of the cameras then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Instant on the loop's clock.
    pub at: Instant,
    /// Instant on the station's clock.
    pub station: Instant,
    /// Position of the cameras, mm from that at the station's start.
    pub camera_mm: [f64; 3],
}

/// A station on a serial line, and the scale and delay of its reports.
#[derive(Debug)]
pub struct Live {
    serial: Serial,
    steps_per_mm: [f64; 3],
    /// Time from a report's instant until the pins reach its position, µs.
    delay_us: u64,
    /// Triggers of the cameras, whose listener stays on the line.
    triggering: Option<Box<Triggering>>,
}

/// Station that a loop drives.
#[derive(Debug)]
pub enum StationLink {
    /// The station's own code in this process.
    Twin(Box<Twin>),
    /// A station on a serial line.
    Live(Live),
}

impl StationLink {
    /// Starts the station: configured, at rest, its position zero, its cameras on the stage.
    ///
    /// # Errors
    /// If the station cannot be reached or denies a command.
    pub fn start(place: StationPlace<'_>, stage: &Stage) -> Result<Self, StationError> {
        Self::start_as(place, stage, Mounting::OnStage)
    }

    /// Starts the station as [`StationLink::start`] does, with the cameras mounted as `mounting`
    /// states.
    ///
    /// # Errors
    /// As [`StationLink::start`].
    pub fn start_as(
        place: StationPlace<'_>,
        stage: &Stage,
        mounting: Mounting,
    ) -> Result<Self, StationError> {
        Self::start_observed(place, stage, mounting, None)
    }

    /// Starts the station as [`StationLink::start_as`] does; `observer` sees every byte between
    /// host and station.
    ///
    /// # Errors
    /// As [`StationLink::start`].
    pub fn start_observed(
        place: StationPlace<'_>,
        stage: &Stage,
        mounting: Mounting,
        observer: Option<Arc<dyn StationObserver>>,
    ) -> Result<Self, StationError> {
        match place {
            StationPlace::Twin => {
                let twin = Twin::start_observed(stage, TWIN_B, mounting, observer)?;
                Ok(Self::Twin(Box::new(twin)))
            }
            StationPlace::Port { path, heartbeat_ms } => {
                let configuration = configuration_at(stage, mounting, heartbeat_ms)?;
                let serial = Serial::start_observed(path, configuration, observer)?;
                if let Some(zeroed) = serial.found().and_then(|found| zeroed(&found, stage)) {
                    notice!("{path}: {zeroed}");
                }
                Ok(Self::live(serial, stage))
            }
            StationPlace::Kept { path, heartbeat_ms } => {
                let configuration = configuration_at(stage, mounting, heartbeat_ms)?;
                let serial = Serial::take_over(path, configuration, observer)?;
                Ok(Self::live(serial, stage))
            }
            StationPlace::Shown { path } => {
                let serial = Serial::show(path, observer)?;
                Ok(Self::live(serial, stage))
            }
        }
    }

    fn live(serial: Serial, stage: &Stage) -> Self {
        let delay_us = serial.who().map_or(0, |hello| u64::from(hello.delay_us));
        Self::Live(Live {
            serial,
            steps_per_mm: stage.steps_per_mm,
            delay_us,
            triggering: None,
        })
    }

    /// Sets the observer of every byte between host and station from now on. The built-in twin in
    /// virtual time keeps its first observer.
    pub fn set_observer(&mut self, observer: Option<Arc<dyn StationObserver>>) {
        if let Self::Live(live) = self {
            let observer = match &live.triggering {
                Some(triggering) => Some(triggering.listener(observer)),
                None => observer,
            };
            live.serial.set_observer(observer);
        }
    }

    /// Starts the triggers of the cameras, and listens to their reports from now on; `observer` sees
    /// every byte as before. Does nothing with a twin in virtual time.
    ///
    /// # Errors
    /// As [`Triggering::start`].
    pub fn trigger(
        &mut self,
        triggering: &Triggering,
        observer: Option<Arc<dyn StationObserver>>,
    ) -> Result<(), ServoError> {
        if let Self::Live(live) = self {
            live.triggering = Some(Box::new(triggering.clone()));
            self.set_observer(observer);
        }
        match self.serial_mut() {
            Some(serial) => triggering.start(serial),
            None => Ok(()),
        }
    }

    /// Returns the settings of the triggers that [`StationLink::trigger`] has started.
    pub fn triggering(&self) -> Option<Trigger> {
        match self {
            Self::Twin(_) => None,
            Self::Live(live) => live.triggering.as_ref().map(|it| it.trigger),
        }
    }

    /// Ends the triggers of the cameras, if [`StationLink::trigger`] has started them.
    pub fn end_triggers(&mut self) {
        if let Self::Live(live) = self
            && live.triggering.take().is_some()
        {
            Triggering::end(&mut live.serial);
        }
    }

    /// Returns the board's name and its place, for messages.
    pub fn name(&self) -> String {
        match self {
            Self::Twin(_) => "the built-in twin".to_owned(),
            Self::Live(live) => {
                let board = live.serial.who().map(|hello| hello.board);
                format!("{} on {}", board.unwrap_or_default(), live.serial.path())
            }
        }
    }

    /// Returns the twin, if the station is one.
    pub fn twin(&self) -> Option<&Twin> {
        match self {
            Self::Twin(twin) => Some(twin),
            Self::Live(_) => None,
        }
    }

    /// Returns the twin, if the station is one, to press its switches.
    pub fn twin_mut(&mut self) -> Option<&mut Twin> {
        match self {
            Self::Twin(twin) => Some(twin),
            Self::Live(_) => None,
        }
    }

    /// Returns the loop's clock: virtual time, or the host's since the line was opened.
    pub fn now(&self) -> Instant {
        match self {
            Self::Twin(twin) => twin.now(),
            Self::Live(live) => Instant::from_micros(live.serial.now_us()),
        }
    }

    /// Converts an instant of the loop's clock to the station's clock.
    ///
    /// # Errors
    /// If the line breaks, or no reply to a ping comes for three seconds: before the first, the
    /// station's clock is unknown.
    pub fn station_time(&self, at: Instant) -> Result<Instant, StationError> {
        match self {
            Self::Twin(twin) => twin.station_time(at).ok_or(SILENT),
            Self::Live(live) => serial_station::station_time(&live.serial, at),
        }
    }

    /// Lets time pass until `end`.
    pub fn advance(&mut self, end: Instant) {
        match self {
            Self::Twin(twin) => twin.advance(end),
            Self::Live(live) => sleep(Duration::from_micros(
                end.since(Instant::from_micros(live.serial.now_us())),
            )),
        }
    }

    /// Returns the first moment from `due` on for which the position of the cameras is known.
    ///
    /// # Errors
    /// If the line breaks or the station sends no report for three seconds.
    pub fn moment(&mut self, due: Instant) -> Result<Moment, StationError> {
        match self {
            Self::Twin(twin) => {
                twin.advance(due);
                let at = twin.now();
                Ok(Moment {
                    at,
                    station: twin.station_time(at).ok_or(SILENT)?,
                    camera_mm: twin.position_mm(),
                })
            }
            Self::Live(live) => live.moment(due),
        }
    }

    /// Sends a command without waiting; returns its sequence number.
    pub fn send(&mut self, command: Command) -> u16 {
        match self {
            Self::Twin(twin) => twin.send(command),
            Self::Live(live) => live.serial.send(command),
        }
    }

    /// Sends a command and waits for the answer.
    ///
    /// # Errors
    /// If the station denies the command or does not answer.
    pub fn command(&mut self, name: &'static str, command: Command) -> Result<(), StationError> {
        match self {
            Self::Twin(twin) => twin.command(name, command),
            Self::Live(live) => live.serial.command(name, command),
        }
    }

    /// Sends a frame and waits for the station's estimate; the inner error is the reason for a
    /// missing one.
    ///
    /// # Errors
    /// If the link is down for longer than the heartbeat timeout.
    pub fn offer(
        &mut self,
        frame: Frame,
    ) -> Result<Result<EstimateReport, FrameRefusal>, StationError> {
        match self {
            Self::Twin(twin) => {
                let sequence = twin.send(Command::Frame(frame));
                // It takes effect at the next tick, and the answer follows right after.
                twin.advance(twin.now().plus_micros(2_000));
                let answer = twin.answer(sequence);
                Ok(serial_station::estimate(
                    answer,
                    twin.status().copied(),
                    sequence,
                ))
            }
            Self::Live(live) => serial_station::offer(&mut live.serial, frame),
        }
    }

    /// Returns the latest status.
    pub fn status(&self) -> Option<Status> {
        match self {
            Self::Twin(twin) => twin.status().copied(),
            Self::Live(live) => live.serial.status(),
        }
    }

    /// Returns the position of a stage on a line at an instant of the station's clock that has
    /// passed, mm, from the reports around it. `None` for the twin, whose time stands where the
    /// loop has brought it.
    pub fn position_at(&self, at: Instant) -> Option<[f64; 3]> {
        match self {
            Self::Twin(_) => None,
            Self::Live(live) => live.position_at(at),
        }
    }

    /// Returns the position of the cameras, mm from that at the station's start, from edges counted
    /// at the pins or from the latest report.
    pub fn position_mm(&self) -> [f64; 3] {
        match self {
            Self::Twin(twin) => twin.position_mm(),
            Self::Live(live) => live
                .serial
                .status()
                .map_or([0.0; 3], |status| live.position_mm(&status)),
        }
    }

    /// Returns the steps counted at the pins since the start; `None` for a station on a line.
    pub fn counted_steps(&self) -> Option<[i64; 3]> {
        self.twin().map(Twin::steps_from_zero)
    }

    /// Returns the least time from the last frame set to the next, µs, at a period of `period_us`.
    /// `None` for exact capture times.
    ///
    /// The reports of a station on a line are early or late, and one follows every frame. With half
    /// a period's grace, that report triggers the cameras.
    pub fn grace_us(&self, period_us: u64) -> Option<u64> {
        match self {
            Self::Twin(_) => None,
            Self::Live(_) => Some(period_us / 2),
        }
    }

    /// Resumes after `lost`, if that was a disconnect shorter than the heartbeat timeout.
    ///
    /// # Errors
    /// `lost` in all other cases: the line is not back, the station restarted, or it stopped.
    pub fn resume(&mut self, lost: StationError) -> Result<(), StationError> {
        let is_back = match (&lost, self) {
            (StationError::Interrupted { .. }, Self::Live(live)) => live.serial.resume().is_ok(),
            _ => false,
        };
        is_back.then_some(()).ok_or(lost)
    }

    /// Returns the serial line to the station, if there is one.
    pub fn serial(&self) -> Option<&Serial> {
        match self {
            Self::Twin(_) => None,
            Self::Live(live) => Some(&live.serial),
        }
    }

    /// Returns the serial line to the station for changes, if there is one.
    pub fn serial_mut(&mut self) -> Option<&mut Serial> {
        match self {
            Self::Twin(_) => None,
            Self::Live(live) => Some(&mut live.serial),
        }
    }
}

const SILENT: StationError = StationError::Silent {
    command: "where it is",
    waited_ms: REPORT_PATIENCE.as_millis() as u64,
};

impl Live {
    fn moment(&self, due: Instant) -> Result<Moment, StationError> {
        let end = HostInstant::now()
            + Duration::from_micros(due.since(Instant::from_micros(self.serial.now_us())))
            + REPORT_PATIENCE;
        let found = self.serial.wait_until(end, |client| {
            let status = client.status()?;
            let station = status.time.plus_micros(self.delay_us);
            let at = Instant::from_micros(client.clock().host_us(station.micros())?);
            (at >= due).then(|| Moment {
                at,
                station,
                camera_mm: self.position_mm(status),
            })
        })?;
        let moment: Moment = found.ok_or(SILENT)?;
        // The world is run forward to it.
        plausible::check_moment(moment.at.micros(), self.serial.now_us())?;
        Ok(moment)
    }

    /// Returns the position at the pins at an instant of the station's clock, mm.
    fn position_at(&self, at: Instant) -> Option<[f64; 3]> {
        let reported = at.micros().saturating_sub(self.delay_us);
        let steps = self
            .serial
            .position_steps_at(Instant::from_micros(reported))?;
        Some(std::array::from_fn(|axis| {
            steps[axis] / self.steps_per_mm[axis]
        }))
    }

    fn position_mm(&self, status: &Status) -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(status.position_steps[axis]) / self.steps_per_mm[axis])
    }
}
