//! The loop with simulated cameras: they look at the poster of a [`SimulatedWorld`] at a steady
//! rate, and time passes as it would.

use super::ServoError;
use super::observer::ServoObserver;
use super::visual_servo::{ServoOutcome, ServoStep, VisualServo};
use super::world::{Exposure, SimulatedWorld};
use trinocular_core::rig::Rig;
use trinocular_core::time::Instant;
use trinocular_rig::pivot::Pivot;
use trinocular_vision::sums::Estimator;

/// Rate and latency of the loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoTiming {
    /// Frame sets per second; a station on a serial line takes them by its reports, up to twice as
    /// often.
    pub frames_per_s: f64,
    /// Time from the images to the frame's arrival at the station, µs: exposure, flow, link. The
    /// least latency for a station on a serial line.
    pub latency_us: u64,
}

impl Default for ServoTiming {
    /// Returns 30 frame sets per second with a latency of 20 ms.
    fn default() -> Self {
        Self {
            frames_per_s: 30.0,
            latency_us: 20_000,
        }
    }
}

/// One turn of the loop, and the true positions behind it.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedStep {
    /// Capture time, s since the keyframe.
    pub time_s: f64,
    /// Position of the target then, mm.
    pub target_mm: [f64; 3],
    /// Position of the cameras then, mm.
    pub camera_mm: [f64; 3],
    /// Result of the turn.
    pub turn: ServoStep,
}

/// A [`VisualServo`] that looks at a simulated world.
#[derive(Debug)]
pub struct SimulatedServo {
    servo: VisualServo,
    timing: ServoTiming,
    keyframe: Instant,
    /// Positions of target and cameras at the keyframe, mm.
    origin_mm: [[f64; 3]; 2],
    taken: u64,
    last: Instant,
}

impl SimulatedServo {
    /// Takes the keyframe: the view to be kept.
    ///
    /// # Errors
    /// [`ServoError::Reference`] if the first images cannot be used; if the station cannot be
    /// reached.
    pub fn start(
        world: &mut SimulatedWorld,
        rig: &Rig,
        timing: ServoTiming,
        estimator: Estimator,
    ) -> Result<Self, ServoError> {
        Self::start_observed(world, rig, timing, estimator, Vec::new())
    }

    /// Takes the keyframe as [`SimulatedServo::start`] does; `observers` see it and every turn.
    ///
    /// # Errors
    /// As [`SimulatedServo::start`].
    pub fn start_observed(
        world: &mut SimulatedWorld,
        rig: &Rig,
        timing: ServoTiming,
        estimator: Estimator,
        observers: Vec<Box<dyn ServoObserver>>,
    ) -> Result<Self, ServoError> {
        let mut servo = VisualServo::new(rig, estimator).map_err(ServoError::Reference)?;
        for observer in observers {
            servo.add_observer(observer);
        }
        let Exposure {
            moment,
            target_mm,
            capture,
        } = world.expose(world.now())?;
        servo
            .set_keyframe(&capture)
            .map_err(ServoError::Reference)?;
        servo.set_keyframe_time(moment.station);
        Ok(Self {
            servo,
            timing,
            keyframe: moment.at,
            origin_mm: [target_mm, moment.camera_mm],
            taken: 0,
            last: moment.at,
        })
    }

    /// Estimates the rotation of the target from now on, as [`VisualServo::set_pivot`] does.
    pub fn set_pivot(&mut self, pivot: Option<Pivot>) {
        self.servo.set_pivot(pivot);
    }

    /// Returns the time since the keyframe, s.
    pub fn time_s(&self, world: &SimulatedWorld) -> f64 {
        world.now().since(self.keyframe) as f64 * 1e-6
    }

    /// Returns the positions of target and cameras now, mm from those at the keyframe.
    pub fn positions_mm(&self, world: &SimulatedWorld) -> [[f64; 3]; 2] {
        self.since_keyframe(world.positions_mm())
    }

    fn since_keyframe(&self, positions_mm: [[f64; 3]; 2]) -> [[f64; 3]; 2] {
        std::array::from_fn(|s| std::array::from_fn(|i| positions_mm[s][i] - self.origin_mm[s][i]))
    }

    /// Returns the instant at which the next frame set is due.
    pub fn next_capture(&self, world: &SimulatedWorld) -> Instant {
        let period_us = 1e6 / self.timing.frames_per_s;
        if let Some(grace_us) = world.b.grace_us(period_us as u64) {
            return self.last.plus_micros(grace_us);
        }
        let elapsed = (self.taken + 1) as f64 * period_us;
        self.keyframe.plus_micros(elapsed.round() as u64)
    }

    /// Lets time pass to the next frame set, takes it, and lets time pass until the frame has
    /// arrived and been answered.
    ///
    /// # Errors
    /// [`ServoError::Station`] if the station faulted or cannot be reached.
    pub fn step(&mut self, world: &mut SimulatedWorld) -> Result<SimulatedStep, ServoError> {
        let due = self.next_capture(world);
        let Exposure {
            moment,
            target_mm,
            capture,
        } = match world.expose(due) {
            Err(ServoError::Station(lost)) => {
                world.b.resume(lost)?;
                world.expose(due)?
            }
            exposed => exposed?,
        };
        self.taken += 1;
        self.last = moment.at;
        let time_s = moment.at.since(self.keyframe) as f64 * 1e-6;
        let [target_mm, camera_mm] = self.since_keyframe([target_mm, moment.camera_mm]);
        let arrival = moment.at.plus_micros(self.timing.latency_us);
        let turn = self
            .servo
            .step(&mut world.b, &capture, moment.station, Some(arrival))?;
        if !matches!(turn.outcome, ServoOutcome::Refused(_)) {
            // The target has lived through the latency, too.
            world.a.advance(arrival);
        }
        Ok(SimulatedStep {
            time_s,
            target_mm,
            camera_mm,
            turn,
        })
    }
}
