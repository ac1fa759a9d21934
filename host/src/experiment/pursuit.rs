//! Captures from outside, one after another, and what the station makes of them: the
//! [servo](super::servo) without a simulated world.

use super::Error;
use super::follower::Follower;
use super::frame;
use crate::flow::CameraRefusal;
use crate::flow::{Flow, FlowSettings};
use crate::images::FrameSet;
use crate::station::StationError;
use crate::sums::Estimator;
use shared::frame::message::{Command, Frame, Sums as FrameSums};
use shared::rig::Rig;
use shared::safety::Trust;
use shared::time::Instant;

/// Any ramp, and the last frame's motion, is over after so long, µs.
const REST_US: u64 = 2_000_000;

/// How the captures' times become the station's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// The station is a twin, its time virtual: the first capture is taken now, the others follow
    /// as they did.
    Virtual {
        /// From a picture to its frame at the station, µs.
        latency_us: u64,
        /// The time between two pictures, µs: the stage is looked at just before the next one.
        period_us: u64,
    },
    /// Captures and station are real: the [follower's clock](Follower::now) minus the captures',
    /// µs.
    Real {
        /// Difference of the clocks, which run alike: both are the host's.
        offset_us: i64,
    },
}

/// What became of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct Followed {
    /// When it was taken, s since the first.
    pub time_s: f64,
    /// The station's own estimate of the target's displacement since the first capture, mm; or why
    /// the capture was not used.
    pub displacement_mm: Result<[f64; 3], String>,
    /// Where the stage is, mm from where the station was started.
    pub stage_mm: [f64; 3],
    /// How far that can be trusted, by the station's last word.
    pub trust: Trust,
    /// Cameras that did not take part, from 0, and why.
    pub absent: Vec<(usize, CameraRefusal)>,
}

/// A target that is followed.
#[derive(Debug)]
pub struct Pursuit {
    rig: Rig,
    flow: Flow,
    estimator: Estimator,
    clock: Clock,
    station: Follower,
    start: Option<Start>,
}

/// The first capture's time, by its clock and by the station's. The latter is kept: the station
/// knows a reference by its exact instant, and the estimate of its clock wanders.
#[derive(Clone, Copy, Debug)]
struct Start {
    first_us: u64,
    reference: Instant,
}

impl Pursuit {
    /// With a station that has been started.
    ///
    /// # Errors
    /// [`Error::Reference`] if the rig has not two cameras in different places.
    pub fn new(
        rig: &Rig,
        estimator: Estimator,
        clock: Clock,
        station: Follower,
    ) -> Result<Self, Error> {
        Ok(Self {
            rig: rig.clone(),
            flow: Flow::new(rig, FlowSettings::default()).map_err(Error::Reference)?,
            estimator,
            clock,
            station,
            start: None,
        })
    }

    /// The station.
    pub fn station(&self) -> &Follower {
        &self.station
    }

    /// The next capture. The first gives nothing: it is the view to be kept.
    ///
    /// # Errors
    /// [`Error::Reference`] if the first cannot be used; [`Error::Station`] if the station cannot
    /// be reached or has a fault. A later capture that cannot be used is no error.
    pub fn follow(&mut self, capture: &FrameSet) -> Result<Option<Followed>, Error> {
        let Some(start) = self.start else {
            self.flow.set_keyframe(capture).map_err(Error::Reference)?;
            let reference = match self.clock {
                Clock::Virtual { .. } => self.station.now(),
                Clock::Real { offset_us } => self.real(capture.time_us, offset_us)?,
            };
            let first_us = capture.time_us;
            self.start = Some(Start {
                first_us,
                reference,
            });
            return Ok(None);
        };
        let since_us = capture.time_us.saturating_sub(start.first_us);
        let taken = match self.clock {
            Clock::Virtual { .. } => start.reference.plus_micros(since_us),
            Clock::Real { offset_us } => self.real(capture.time_us, offset_us)?,
        };
        let measured = frame::measure(&mut self.flow, &self.rig, capture, self.estimator);
        let (displacement_mm, absent) = match measured {
            Ok((measured, sums)) => (
                self.send(taken, start.reference, sums)?,
                measured.refused_cameras,
            ),
            Err(reason) => (Err(reason), Vec::new()),
        };
        let status = self.station.status();
        if let Some(fault) = status.and_then(|status| status.fault) {
            return Err(StationError::Faulted(fault).into());
        }
        if let Clock::Virtual { period_us, .. } = self.clock {
            self.station.advance(taken.plus_micros(period_us));
        }
        Ok(Some(Followed {
            time_s: since_us as f64 * 1e-6,
            displacement_mm,
            stage_mm: self.station.position_mm(),
            trust: status.map_or(Trust::Unknown, |status| status.trust),
            absent,
        }))
    }

    /// Lets the last frame's motion end; where the stage stands then, mm.
    ///
    /// # Errors
    /// If the station cannot be reached.
    pub fn rest(&mut self) -> Result<[f64; 3], StationError> {
        let end = self.station.now().plus_micros(REST_US);
        self.station.advance(end);
        Ok(self.station.position_mm())
    }

    /// Stops the stage on its ramp, and not where it was led to expect the target next; where it
    /// stands then, mm.
    ///
    /// # Errors
    /// If the station cannot be reached.
    pub fn stop(&mut self) -> Result<[f64; 3], StationError> {
        self.station.command("stop", Command::Stop)?;
        self.rest()
    }

    /// A real capture's time, in the station's.
    fn real(&self, time_us: u64, offset_us: i64) -> Result<Instant, StationError> {
        let here = Instant::from_micros(time_us.saturating_add_signed(offset_us));
        self.station.station_time(here)
    }

    /// Sends a frame: the station's estimate, mm; the inner error is why the station did not use
    /// it.
    fn send(
        &mut self,
        capture: Instant,
        reference: Instant,
        sums: FrameSums,
    ) -> Result<Result<[f64; 3], String>, StationError> {
        if let Clock::Virtual { latency_us, .. } = self.clock {
            self.station.advance(capture.plus_micros(latency_us));
        }
        let offered = self.station.offer(Frame {
            capture,
            reference,
            sums,
        })?;
        Ok(offered
            .map(|estimate| estimate.displacement_nm.map(|nm| f64::from(nm) * 1e-6))
            .map_err(|unused| unused.to_string()))
    }
}
