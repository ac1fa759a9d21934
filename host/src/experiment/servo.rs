//! B's loop: take pictures, measure the flow, send a frame; time passes as it would.

use super::Error;
use super::world::World;
use crate::flow::{Flow, Settings};
use crate::sums::{Estimator, Sums};
use shared::frame::message::{Command, Denial, Frame, Sums as FrameSums};
use shared::rig::Rig;
use shared::safety::Fault;
use shared::time::Instant;

/// When things happen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Pictures per second.
    pub frames_per_s: f64,
    /// From the picture to the frame's arrival at the station, µs: exposure, flow, link.
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
    /// When it was taken, s of virtual time since the servo started.
    pub time_s: f64,
    /// Where the target was then, mm.
    pub target_mm: [f64; 3],
    /// Where the cameras were then, mm.
    pub camera_mm: [f64; 3],
    /// What became of it.
    pub outcome: Outcome,
}

/// The loop.
#[derive(Debug)]
pub struct Servo {
    rig: Rig,
    flow: Flow,
    timing: Timing,
    estimator: Estimator,
    keyframe: Instant,
    /// The keyframe in station time. Converted once: the station knows a reference by its exact instant, and the clock's estimate wanders.
    reference: Option<Instant>,
    /// Where both stood at the keyframe, mm.
    origin_mm: [[f64; 3]; 2],
    taken: u64,
}

impl Servo {
    /// Takes the keyframe: the view to be kept.
    ///
    /// # Errors
    /// [`Error::Reference`] if the first pictures cannot be used.
    pub fn start(
        world: &mut World,
        rig: &Rig,
        timing: Timing,
        estimator: Estimator,
    ) -> Result<Self, Error> {
        let mut flow = Flow::new(rig, Settings::default()).map_err(Error::Reference)?;
        let keyframe = world.now();
        flow.set_reference(&world.capture())
            .map_err(Error::Reference)?;
        let origin_mm = world.positions_mm();
        Ok(Self {
            rig: rig.clone(),
            flow,
            timing,
            estimator,
            keyframe,
            reference: None,
            origin_mm,
            taken: 0,
        })
    }

    /// Seconds since the keyframe.
    pub fn time_s(&self, world: &World) -> f64 {
        world.now().since(self.keyframe) as f64 * 1e-6
    }

    /// Where target and cameras are now, mm from where they were at the keyframe.
    pub fn positions_mm(&self, world: &World) -> [[f64; 3]; 2] {
        let now = world.positions_mm();
        std::array::from_fn(|s| std::array::from_fn(|i| now[s][i] - self.origin_mm[s][i]))
    }

    /// When the next picture is due.
    pub fn next_picture(&self) -> Instant {
        let elapsed = (self.taken + 1) as f64 * 1e6 / self.timing.frames_per_s;
        self.keyframe.plus_micros(elapsed.round() as u64)
    }

    /// Lets time pass to the next picture, takes it, and lets time pass until the frame has arrived and been answered.
    ///
    /// # Errors
    /// [`Error::Station`] if the station faulted.
    pub fn step(&mut self, world: &mut World) -> Result<Step, Error> {
        world.advance(self.next_picture());
        self.taken += 1;
        let capture = world.now();
        let time_s = self.time_s(world);
        let [target_mm, camera_mm] = self.positions_mm(world);
        let picture = world.capture();
        let outcome = match self.sums(&picture) {
            Err(reason) => Outcome::Refused(reason),
            Ok((sums, points)) => self.send(world, capture, sums, points),
        };
        match world.b.status().and_then(|status| status.fault) {
            Some(fault) => Err(Error::Station(station_fault(fault))),
            None => Ok(Step {
                time_s,
                target_mm,
                camera_mm,
                outcome,
            }),
        }
    }

    fn sums(&mut self, picture: &crate::images::Capture) -> Result<(FrameSums, usize), String> {
        let measured = self
            .flow
            .measure(picture)
            .map_err(|refusal| refusal.to_string())?;
        let frame = Sums::of(&self.rig, &measured).and_then(|sums| sums.frame(self.estimator));
        frame
            .map(|frame| (frame, measured.tracks.len()))
            .map_err(|refusal| refusal.to_string())
    }

    fn send(
        &mut self,
        world: &mut World,
        capture: Instant,
        sums: FrameSums,
        points: usize,
    ) -> Outcome {
        world.advance(capture.plus_micros(self.timing.latency_us));
        let clock = world.b.client().clock();
        let station = |host: Instant| clock.station_us(host.micros()).map(Instant::from_micros);
        let reference = self.reference.or_else(|| station(self.keyframe));
        let (Some(capture), Some(reference)) = (station(capture), reference) else {
            return Outcome::Unanswered;
        };
        self.reference = Some(reference);
        let sequence = world.b.send(Command::Frame(Frame {
            capture,
            reference,
            sums,
        }));
        // The frame takes effect at the next tick; its answer is on the line right after.
        world.advance(world.now().plus_micros(2_000));
        match world.b.answer(sequence) {
            None => Outcome::Unanswered,
            Some(Err(denial)) => Outcome::Denied(denial),
            Some(Ok(())) => {
                let estimate = world
                    .b
                    .status()
                    .and_then(|status| status.estimate)
                    .filter(|e| e.sequence == sequence);
                let Some(estimate) = estimate else {
                    return Outcome::Unanswered;
                };
                Outcome::Used {
                    displacement_mm: estimate.displacement_nm.map(|nm| f64::from(nm) * 1e-6),
                    sigma_mm: estimate
                        .sigma_nm
                        .map(|sigma| sigma.map(|nm| f64::from(nm) * 1e-6)),
                    points,
                    latency_us: estimate.latency_us,
                }
            }
        }
    }
}

fn station_fault(fault: Fault) -> crate::station::StationError {
    crate::station::StationError::Faulted(fault)
}
