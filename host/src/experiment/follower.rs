//! Station B, wherever it is: the twin on virtual time, or a station on a serial line, whose time
//! is everybody's.
//!
//! What the experiment must know of it is where it stood when a picture was taken. The twin is
//! asked for any instant, by the edges at its pins. A station on a line says where it stands in its
//! reports: after every frame, and ten times a second. So the simulated cameras of such a station
//! are triggered by its reports: a report names a position, and the picture is taken at the
//! instant, in the station's own time, at which the pins stand there. Nothing is interpolated or
//! guessed.

use crate::rig_file::Stage;
use crate::station::serial::Serial;
use crate::station::stage::configuration;
use crate::station::twin::Twin;
use crate::station::{StationError, plausible};
use shared::frame::message::{Command, Config, Denial, EstimateReport, Frame, Mounting, Status};
use shared::time::Instant;
use std::thread::sleep;
use std::time::{Duration, Instant as HostInstant};

/// How long a report may be awaited: thirty come in that time, and a line that fell silent is
/// noticed and looked for before.
const REPORT_PATIENCE: Duration = Duration::from_secs(3);

/// How long the answer to a frame may be awaited; after that it was lost on the line, and the next
/// frame does better.
const ANSWER_PATIENCE: Duration = Duration::from_millis(250);

/// Where station B is to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place<'a> {
    /// In this process.
    Twin,
    /// On a serial port.
    Port {
        /// Which.
        path: &'a str,
        /// After so much silence of ours the station stops, ms, 20 to 10000. The heartbeat comes
        /// every 20 ms, if this computer finds the time.
        heartbeat_ms: u16,
    },
}

/// The moment at which a picture is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// On the experiment's clock.
    pub at: Instant,
    /// On the station's.
    pub station: Instant,
    /// Where the cameras are, mm from where the station was started.
    pub camera_mm: [f64; 3],
}

/// Why a frame that was sent is not known to have been used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unused {
    /// The station did not use it.
    #[error("{0}")]
    Denied(Denial),
    /// No answer came.
    #[error("no answer from the station")]
    Unanswered,
    /// The line broke for a short while.
    #[error("the line was interrupted")]
    Interrupted,
    /// The answer came, and its status did not.
    #[error("the station did not say what it saw")]
    Unreported,
}

/// A station on a serial line, and what its reports mean.
#[derive(Debug)]
pub struct Live {
    serial: Serial,
    steps_per_mm: [f64; 3],
    /// From a report's instant to the pins being where it says, µs.
    delay_us: u64,
}

/// Station B.
#[derive(Debug)]
pub enum Follower {
    /// The station's own code in this process.
    Twin(Box<Twin>),
    /// A station on a serial line.
    Live(Live),
}

impl Follower {
    /// Starts the station: configured, at rest, its position zero, its cameras on the stage.
    ///
    /// # Errors
    /// If it cannot be reached or refuses.
    pub fn start(place: Place<'_>, stage: &Stage) -> Result<Self, StationError> {
        Self::start_as(place, stage, Mounting::OnStage)
    }

    /// As [`Follower::start`], with the cameras where `mounting` says.
    ///
    /// # Errors
    /// As [`Follower::start`].
    pub fn start_as(
        place: Place<'_>,
        stage: &Stage,
        mounting: Mounting,
    ) -> Result<Self, StationError> {
        match place {
            Place::Twin => {
                let twin = Twin::start(stage, "twin B", mounting)?;
                Ok(Self::Twin(Box::new(twin)))
            }
            Place::Port { path, heartbeat_ms } => {
                let configuration = Config {
                    heartbeat_ms,
                    ..configuration(stage, mounting)?
                };
                let serial = Serial::start_as(path, configuration)?;
                let delay_us = serial.who().map_or(0, |hello| u64::from(hello.delay_us));
                Ok(Self::Live(Live {
                    serial,
                    steps_per_mm: stage.steps_per_mm,
                    delay_us,
                }))
            }
        }
    }

    /// What and where it is, for people.
    pub fn name(&self) -> String {
        match self {
            Self::Twin(_) => "the built-in twin".to_owned(),
            Self::Live(live) => {
                let board = live.serial.who().map(|hello| hello.board);
                format!("{} on {}", board.unwrap_or_default(), live.serial.path())
            }
        }
    }

    /// The twin, if it is one.
    pub fn twin(&self) -> Option<&Twin> {
        match self {
            Self::Twin(twin) => Some(twin),
            Self::Live(_) => None,
        }
    }

    /// Its clock as the experiment's: virtual time, or the host's since the line was opened.
    pub fn now(&self) -> Instant {
        match self {
            Self::Twin(twin) => twin.now(),
            Self::Live(live) => Instant::from_micros(live.serial.now_us()),
        }
    }

    /// An instant of that clock, as the station's.
    ///
    /// # Errors
    /// If the line breaks, or no heartbeat comes back for three seconds: until the first the
    /// station's clock is not known.
    pub fn station_time(&self, at: Instant) -> Result<Instant, StationError> {
        let station = match self {
            Self::Twin(twin) => twin.station_time(at),
            Self::Live(live) => live
                .serial
                .wait_until(HostInstant::now() + REPORT_PATIENCE, |client| {
                    client.clock().station_us(at.micros())
                })?
                .map(Instant::from_micros),
        };
        station.ok_or(SILENT)
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

    /// The first moment from `due` on at which it is known where the cameras are.
    ///
    /// # Errors
    /// If the line breaks or the station says nothing for three seconds.
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
    /// If it is refused, or does not come.
    pub fn command(&mut self, name: &'static str, command: Command) -> Result<(), StationError> {
        match self {
            Self::Twin(twin) => twin.command(name, command),
            Self::Live(live) => live.serial.command(name, command),
        }
    }

    /// Sends a frame and waits for what the station makes of it; the inner error is why there is
    /// nothing.
    ///
    /// # Errors
    /// If the line breaks for longer than the station bears.
    pub fn offer(&mut self, frame: Frame) -> Result<Result<EstimateReport, Unused>, StationError> {
        let sequence = self.send(Command::Frame(frame));
        let answer = match self.outcome(sequence) {
            Ok(answer) => answer,
            Err(lost) => {
                self.resume(lost)?;
                return Ok(Err(Unused::Interrupted));
            }
        };
        Ok(match answer {
            None => Err(Unused::Unanswered),
            Some(Err(denial)) => Err(Unused::Denied(denial)),
            Some(Ok(())) => self
                .status()
                .and_then(|status| status.estimate)
                .filter(|estimate| estimate.sequence == sequence)
                .ok_or(Unused::Unreported),
        })
    }

    /// What became of a frame, and the status that followed; `None` if no answer came. The frame
    /// takes effect at the next tick, and the answer is on the line right after.
    fn outcome(&mut self, sequence: u16) -> Result<Option<Result<(), Denial>>, StationError> {
        match self {
            Self::Twin(twin) => {
                twin.advance(twin.now().plus_micros(2_000));
                Ok(twin.answer(sequence))
            }
            Self::Live(live) => {
                let end = HostInstant::now() + ANSWER_PATIENCE;
                let answer = live
                    .serial
                    .wait_until(end, |client| client.answer(sequence))?;
                if answer == Some(Ok(())) {
                    // The status comes right behind the answer.
                    live.serial.wait_until(end, |client| {
                        let estimate = client.status()?.estimate?;
                        (estimate.sequence == sequence).then_some(())
                    })?;
                }
                Ok(answer)
            }
        }
    }

    /// The latest status.
    pub fn status(&self) -> Option<Status> {
        match self {
            Self::Twin(twin) => twin.status().copied(),
            Self::Live(live) => live.serial.status(),
        }
    }

    /// Where the cameras are, mm from where the station was started: edges counted at the pins, or
    /// the latest report.
    pub fn position_mm(&self) -> [f64; 3] {
        match self {
            Self::Twin(twin) => twin.position_mm(),
            Self::Live(live) => live
                .serial
                .status()
                .map_or([0.0; 3], |status| live.position_mm(&status)),
        }
    }

    /// Steps that left the pins since the start, if anything counts them.
    pub fn counted_steps(&self) -> Option<[i64; 3]> {
        self.twin().map(Twin::steps_from_zero)
    }

    /// How long after the last picture the next may be taken, µs, for pictures `period_us` apart.
    /// `None`: at the exact time.
    ///
    /// A station on a line is late or early by its reports, one of which follows every frame. With
    /// half a period's grace that one is taken.
    pub fn grace_us(&self, period_us: u64) -> Option<u64> {
        match self {
            Self::Twin(_) => None,
            Self::Live(_) => Some(period_us / 2),
        }
    }

    /// Goes on after `lost`, if that was a short break of the line that the station did not even
    /// notice.
    ///
    /// # Errors
    /// `lost`, if it was anything else: the line is not back, the station restarted, or it stopped.
    pub fn resume(&mut self, lost: StationError) -> Result<(), StationError> {
        let is_back = match (&lost, self) {
            (StationError::Interrupted { .. }, Self::Live(live)) => live.serial.resume().is_ok(),
            _ => false,
        };
        is_back.then_some(()).ok_or(lost)
    }

    /// The line to the station, if there is one.
    pub fn serial(&self) -> Option<&Serial> {
        match self {
            Self::Twin(_) => None,
            Self::Live(live) => Some(&live.serial),
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

    fn position_mm(&self, status: &Status) -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(status.position_steps[axis]) / self.steps_per_mm[axis])
    }
}
