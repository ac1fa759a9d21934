//! The loop with frame sets from outside: live cameras, recorded images, a folder that grows.

use super::ServoError;
use super::observer::ServoObserver;
use super::station_link::StationLink;
use super::visual_servo::{ServoStep, VisualServo};
use trinocular_client::StationError;
use trinocular_core::frame::message::Command;
use trinocular_core::rig::Rig;
use trinocular_core::time::Instant;
use trinocular_rig::pivot::Pivot;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::images::FrameSet;
use trinocular_vision::sums::Estimator;

/// Time after which any ramp and the last frame's motion have ended, µs.
const REST_US: u64 = 2_000_000;

/// Relation of capture times to the station's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CaptureClock {
    /// The station is a twin on virtual time: the first frame set is taken now, the others follow
    /// at their recorded intervals.
    Virtual {
        /// Time from the images to their frame at the station, µs.
        latency_us: u64,
        /// Time between two frame sets, µs. The stage's position is read just before the next one.
        period_us: u64,
    },
    /// Frame sets and station are real.
    Real {
        /// The [link's clock](StationLink::now) minus that of the capture times, µs. Both are
        /// clocks of the host and run at the same rate.
        offset_us: i64,
    },
    /// The station triggers the cameras, and the capture times are on its clock.
    Station,
}

/// One turn of the loop.
#[derive(Clone, Debug, PartialEq)]
pub struct Followed {
    /// Capture time, s since the first frame set.
    pub time_s: f64,
    /// Position of the stage then, mm from where the station was started.
    pub stage_mm: [f64; 3],
    /// Result of the turn.
    pub turn: ServoStep,
}

/// A [`VisualServo`] on frame sets from outside, one after another.
///
/// ```
/// use trinocular::servo::frame_sets::{CaptureClock, FrameSetServo};
/// use trinocular::servo::station_link::{StationLink, StationPlace};
/// use trinocular_client::stage::default_stage;
/// use trinocular_core::frame::message::Mounting;
/// use trinocular_core::rig::Rig;
/// use trinocular_vision::images::{Scene, SceneSettings, Texture};
/// use trinocular_vision::sums::Estimator;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// // Cameras beside the stage watch a target, whose motion the stage copies.
/// let rig = Rig::paper();
/// let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default())?;
/// let place = StationPlace::Twin;
/// let station = StationLink::start_as(place, &default_stage(), Mounting::Fixed)?;
/// let clock = CaptureClock::Virtual { latency_us: 20_000, period_us: 33_333 };
/// let mut servo = FrameSetServo::new(&rig, Estimator::Midpoint, clock, station)?;
/// for frame in 0..10 {
///     let frame_set = scene.render([0.2 * frame as f64, 0.0, 0.0], 33_333 * frame, frame);
///     let followed = servo.follow(&frame_set)?;
///     assert_eq!(followed.is_none(), frame == 0, "the first frame set is the keyframe");
/// }
/// let [x, y, _] = servo.stop()?;
/// assert!((1.0..3.0).contains(&x) && y.abs() < 0.1);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct FrameSetServo {
    servo: VisualServo,
    clock: CaptureClock,
    station: StationLink,
    /// Capture time of the first frame set, µs.
    first_us: Option<u64>,
}

impl FrameSetServo {
    /// Makes a loop around a station that has been started.
    ///
    /// # Errors
    /// [`ServoError::Reference`] if the rig has no two cameras in different places.
    pub fn new(
        rig: &Rig,
        estimator: Estimator,
        clock: CaptureClock,
        station: StationLink,
    ) -> Result<Self, ServoError> {
        Ok(Self {
            servo: VisualServo::new(rig, estimator).map_err(ServoError::Reference)?,
            clock,
            station,
            first_us: None,
        })
    }

    /// Restricts the points to regions of the cameras' images. Rectangles take effect at the next
    /// keyframe, masks at the next measurement.
    pub fn set_regions(&mut self, regions: Regions) {
        self.servo.set_regions(regions);
    }

    /// Estimates the rotation of the target from now on, as [`VisualServo::set_pivot`] does.
    pub fn set_pivot(&mut self, pivot: Option<Pivot>) {
        self.servo.set_pivot(pivot);
    }

    /// Adds an observer, which sees the keyframe and every turn from now on.
    pub fn add_observer(&mut self, observer: Box<dyn ServoObserver>) {
        self.servo.add_observer(observer);
    }

    /// Returns the station.
    pub fn station(&self) -> &StationLink {
        &self.station
    }

    /// Returns the station, to disturb it between two frame sets.
    pub fn station_mut(&mut self) -> &mut StationLink {
        &mut self.station
    }

    /// Follows the target into the next frame set. Returns `None` for the first one, which is the
    /// keyframe.
    ///
    /// # Errors
    /// [`ServoError::Reference`] if the first frame set cannot be used; [`ServoError::Station`] if
    /// the station cannot be reached or has a fault. A later frame set that cannot be used is no
    /// error.
    pub fn follow(&mut self, capture: &FrameSet) -> Result<Option<Followed>, ServoError> {
        let Some(first_us) = self.first_us else {
            self.servo
                .set_keyframe(capture)
                .map_err(ServoError::Reference)?;
            let taken = match self.clock {
                CaptureClock::Virtual { .. } => self.station.now(),
                CaptureClock::Real { offset_us } => self.real(capture.time_us, offset_us)?,
                CaptureClock::Station => Instant::from_micros(capture.time_us),
            };
            self.servo.set_keyframe_time(taken);
            self.first_us = Some(capture.time_us);
            return Ok(None);
        };
        let since_us = capture.time_us.saturating_sub(first_us);
        let (taken, arrival) = match self.clock {
            CaptureClock::Virtual { latency_us, .. } => {
                let taken = self.servo.keyframe_time().plus_micros(since_us);
                (taken, Some(taken.plus_micros(latency_us)))
            }
            CaptureClock::Real { offset_us } => (self.real(capture.time_us, offset_us)?, None),
            CaptureClock::Station => (Instant::from_micros(capture.time_us), None),
        };
        let turn = self
            .servo
            .step(&mut self.station, capture, taken, arrival)?;
        if let CaptureClock::Virtual { period_us, .. } = self.clock {
            self.station.advance(taken.plus_micros(period_us));
        }
        Ok(Some(Followed {
            time_s: since_us as f64 * 1e-6,
            stage_mm: turn.stage_mm,
            turn,
        }))
    }

    /// Lets the last frame's motion end; returns the stage's position then, mm.
    ///
    /// # Errors
    /// If the station cannot be reached.
    pub fn rest(&mut self) -> Result<[f64; 3], StationError> {
        let end = self.station.now().plus_micros(REST_US);
        self.station.advance(end);
        Ok(self.station.position_mm())
    }

    /// Stops the stage on its ramp instead of at the predicted position of the target; returns the
    /// stage's position then, mm.
    ///
    /// # Errors
    /// If the station cannot be reached.
    pub fn stop(&mut self) -> Result<[f64; 3], StationError> {
        self.station.command("stop", Command::Stop)?;
        self.rest()
    }

    /// Converts a real capture time to the station's clock.
    fn real(&self, time_us: u64, offset_us: i64) -> Result<Instant, StationError> {
        let here = Instant::from_micros(time_us.saturating_add_signed(offset_us));
        self.station.station_time(here)
    }
}
