//! B's loop: take pictures, measure the flow, send a frame; time passes as it would.

use super::Error;
use super::follower::{Moment, Unused};
use super::frame;
use super::world::{Exposure, World};
use crate::flow::CameraRefusal;
use crate::flow::{Flow, FlowSettings};
use crate::station::StationError;
use crate::sums::Estimator;
use shared::frame::message::{Denial, Frame, Sums as FrameSums};
use shared::rig::Rig;
use shared::safety::Trust;
use shared::time::Instant;

/// When things happen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Pictures per second; a station on a serial line takes them by its reports, up to twice as
    /// often.
    pub frames_per_s: f64,
    /// From the picture to the frame's arrival at the station, µs: exposure, flow, link. A station
    /// on a serial line waits at least so long.
    pub latency_us: u64,
}

impl Default for Timing {
    /// 30 pictures per second, 20 ms.
    fn default() -> Self {
        Self {
            frames_per_s: 30.0,
            latency_us: 20_000,
        }
    }
}

/// What became of one picture.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// A frame was sent, and the station used it.
    Used {
        /// The station's own estimate of the target's displacement since the keyframe, mm.
        displacement_mm: [f64; 3],
        /// Its standard deviation, mm; `None` for the closed form.
        sigma_mm: Option<[f64; 3]>,
        /// Points behind it.
        points: usize,
        /// From the picture to the first step that it could change, µs.
        latency_us: u32,
    },
    /// The pictures gave no frame.
    Refused(String),
    /// The station did not use the frame.
    Denied(Denial),
    /// The station had not answered by the next picture.
    Unanswered,
}

/// One picture and what followed.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// When it was taken, s since the servo started.
    pub time_s: f64,
    /// Where the target was then, mm.
    pub target_mm: [f64; 3],
    /// Where the cameras were then, mm.
    pub camera_mm: [f64; 3],
    /// What became of it.
    pub outcome: Outcome,
    /// Cameras that did not take part, from 0, and why.
    pub absent: Vec<(usize, CameraRefusal)>,
    /// How far the station's position can be trusted, by its last word.
    pub trust: Trust,
}

/// The loop.
#[derive(Debug)]
pub struct Servo {
    rig: Rig,
    flow: Flow,
    timing: Timing,
    estimator: Estimator,
    keyframe: Instant,
    /// The keyframe in station time. Kept: the station knows a reference by its exact instant, and
    /// the clock's estimate wanders.
    reference: Instant,
    /// Where both stood at the keyframe, mm.
    origin_mm: [[f64; 3]; 2],
    taken: u64,
    last: Instant,
}

impl Servo {
    /// Takes the keyframe: the view to be kept.
    ///
    /// # Errors
    /// [`Error::Reference`] if the first pictures cannot be used; if the station cannot be reached.
    pub fn start(
        world: &mut World,
        rig: &Rig,
        timing: Timing,
        estimator: Estimator,
    ) -> Result<Self, Error> {
        let mut flow = Flow::new(rig, FlowSettings::default()).map_err(Error::Reference)?;
        let Exposure {
            moment,
            target_mm,
            capture,
        } = world.expose(world.now())?;
        flow.set_keyframe(&capture).map_err(Error::Reference)?;
        Ok(Self {
            rig: rig.clone(),
            flow,
            timing,
            estimator,
            keyframe: moment.at,
            reference: moment.station,
            origin_mm: [target_mm, moment.camera_mm],
            taken: 0,
            last: moment.at,
        })
    }

    /// Seconds since the keyframe.
    pub fn time_s(&self, world: &World) -> f64 {
        world.now().since(self.keyframe) as f64 * 1e-6
    }

    /// Where target and cameras are now, mm from where they were at the keyframe.
    pub fn positions_mm(&self, world: &World) -> [[f64; 3]; 2] {
        self.since_keyframe(world.positions_mm())
    }

    fn since_keyframe(&self, positions_mm: [[f64; 3]; 2]) -> [[f64; 3]; 2] {
        std::array::from_fn(|s| std::array::from_fn(|i| positions_mm[s][i] - self.origin_mm[s][i]))
    }

    /// When the next picture is due.
    pub fn next_picture(&self, world: &World) -> Instant {
        let period_us = 1e6 / self.timing.frames_per_s;
        if let Some(grace_us) = world.b.grace_us(period_us as u64) {
            return self.last.plus_micros(grace_us);
        }
        let elapsed = (self.taken + 1) as f64 * period_us;
        self.keyframe.plus_micros(elapsed.round() as u64)
    }

    /// Lets time pass to the next picture, takes it, and lets time pass until the frame has arrived
    /// and been answered.
    ///
    /// # Errors
    /// [`Error::Station`] if the station faulted or cannot be reached.
    pub fn step(&mut self, world: &mut World) -> Result<Step, Error> {
        let due = self.next_picture(world);
        let Exposure {
            moment,
            target_mm,
            capture,
        } = match world.expose(due) {
            Err(Error::Station(lost)) => {
                world.b.resume(lost)?;
                world.expose(due)?
            }
            exposed => exposed?,
        };
        self.taken += 1;
        self.last = moment.at;
        let time_s = moment.at.since(self.keyframe) as f64 * 1e-6;
        let [target_mm, camera_mm] = self.since_keyframe([target_mm, moment.camera_mm]);
        let measured = frame::measure(&mut self.flow, &self.rig, &capture, self.estimator);
        let (outcome, absent) = match measured {
            Err(reason) => (Outcome::Refused(reason), Vec::new()),
            Ok((measured, sums)) => {
                let outcome = self.send(world, &moment, sums, measured.correspondences.len())?;
                (outcome, measured.refused_cameras)
            }
        };
        let status = world.b.status();
        match status.and_then(|status| status.fault) {
            Some(fault) => Err(Error::Station(StationError::Faulted(fault))),
            None => Ok(Step {
                time_s,
                target_mm,
                camera_mm,
                outcome,
                absent,
                trust: status.map_or(Trust::Unknown, |status| status.trust),
            }),
        }
    }

    fn send(
        &self,
        world: &mut World,
        moment: &Moment,
        sums: FrameSums,
        points: usize,
    ) -> Result<Outcome, StationError> {
        world.advance(moment.at.plus_micros(self.timing.latency_us));
        let offered = world.b.offer(Frame {
            capture: moment.station,
            reference: self.reference,
            sums,
        });
        let estimate = match offered? {
            Ok(estimate) => estimate,
            Err(Unused::Denied(denial)) => return Ok(Outcome::Denied(denial)),
            Err(Unused::Unanswered | Unused::Interrupted | Unused::Unreported) => {
                return Ok(Outcome::Unanswered);
            }
        };
        let mm = |nm: f64| nm * 1e-6;
        Ok(Outcome::Used {
            displacement_mm: estimate.displacement_nm.map(|nm| mm(f64::from(nm))),
            sigma_mm: estimate
                .sigma_nm
                .map(|sigma| sigma.map(|nm| mm(f64::from(nm)))),
            points,
            latency_us: estimate.latency_us,
        })
    }
}
