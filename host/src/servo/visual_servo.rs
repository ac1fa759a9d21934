//! The closed loop itself: images of one instant to flow sums, flow sums to the station, and the
//! station's answer.

use super::observer::{ServoEvent, ServoObserver};
use super::station_link::{FrameRefusal, StationLink};
use trinocular_client::StationError;
use trinocular_core::estimate::midpoint;
use trinocular_core::frame::message::{EstimateReport, Frame, Sums as FrameSums};
use trinocular_core::rig::Rig;
use trinocular_core::safety::Trust;
use trinocular_core::time::Instant;
use trinocular_rig::pivot::Pivot;
use trinocular_vision::flow::CameraRefusal;
use trinocular_vision::flow::LastPose;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::flow::{self, Correspondence, Flow, FlowSettings, Measurement, TargetTurn};
use trinocular_vision::images::FrameSet;
use trinocular_vision::measure::{MeasureRefusal, measure};
use trinocular_vision::sums::{Estimator, Sums};

/// Result of one turn of the loop.
#[derive(Clone, Debug, PartialEq)]
pub enum ServoOutcome {
    /// The station used the frame.
    Used(Box<ServoEstimate>),
    /// The images gave no frame.
    Refused(MeasureRefusal),
    /// The frame was sent, but it is unknown whether the station used it.
    Unused(FrameRefusal),
}

/// The station's own estimate from one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoEstimate {
    /// Displacement of the target since the keyframe, mm.
    pub displacement_mm: [f64; 3],
    /// Standard deviation of the displacement, mm; `None` for the closed form.
    pub sigma_mm: Option<[f64; 3]>,
    /// Covariance of the displacement, mm², as the host computes it; `None` for the closed form.
    pub covariance_mm2: Option<[[f64; 3]; 3]>,
    /// Points behind the estimate.
    pub points: usize,
    /// Points left out.
    pub rejected: usize,
    /// Time from the images to the first step that they could change, µs.
    pub latency_us: u32,
    /// Rotation of the target, if it is estimated; the displacement is then that of the pivot.
    pub turn: Option<TargetTurn>,
}

impl ServoEstimate {
    /// Combines the station's report with the measurement that it got.
    pub fn new(report: &EstimateReport, measured: &Measured) -> Self {
        let sigma_mm = report.sigma_mm();
        let measurement = measured.measurement.as_ref();
        Self {
            displacement_mm: report.displacement_mm(),
            sigma_mm,
            covariance_mm2: sigma_mm.and(measured.covariance_mm2),
            points: measured.points,
            rejected: measurement.map_or(0, |measurement| measurement.rejected.total()),
            latency_us: report.latency_us,
            turn: measurement.and_then(|measurement| measurement.turn),
        }
    }
}

impl ServoOutcome {
    /// Returns the station's estimate, if it used the frame.
    pub fn estimate(&self) -> Option<&ServoEstimate> {
        match self {
            Self::Used(estimate) => Some(estimate),
            Self::Refused(_) | Self::Unused(_) => None,
        }
    }

    /// Returns true if the station used the frame.
    pub fn is_used(&self) -> bool {
        self.estimate().is_some()
    }

    /// Returns the reason why the images had no effect, if they had none.
    pub fn refusal(&self) -> Option<String> {
        match self {
            Self::Used(_) => None,
            Self::Refused(refusal) => Some(refusal.to_string()),
            Self::Unused(refusal) => Some(refusal.to_string()),
        }
    }
}

/// One turn of the loop.
#[derive(Clone, Debug, PartialEq)]
pub struct ServoStep {
    /// Result of the turn.
    pub outcome: ServoOutcome,
    /// Cameras that took no part, from 0, each with its reason.
    pub absent: Vec<(usize, CameraRefusal)>,
    /// Trust in the station's position, by its latest status.
    pub trust: Trust,
    /// Position of the stage when the images were taken, mm from that at the station's start. A
    /// station on a line reports it every 100 ms and after each frame; between two reports it is
    /// interpolated.
    pub stage_mm: [f64; 3],
}

/// Flow sums of one instant.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Sums for the station's estimator.
    pub sums: FrameSums,
    /// Points behind the sums.
    pub points: usize,
    /// Covariance of the displacement, mm².
    pub covariance_mm2: Option<[[f64; 3]; 3]>,
    /// Cameras that took no part, from 0, each with its reason.
    pub absent: Vec<(usize, CameraRefusal)>,
    /// The measurement in the images; `None` for ideal correspondences.
    pub measurement: Option<Measurement>,
}

fn covariance_mm2(sums: &Sums) -> Option<[[f64; 3]; 3]> {
    let midpoint = midpoint::solve(&sums.centred).ok()?;
    Some(midpoint.covariance_mm2)
}

/// The closed loop of images, flow, station and stage.
///
/// [`VisualServo::step`] is one whole turn. A caller with several frames under way at once takes
/// it apart: [`VisualServo::measure`], then [`VisualServo::frame`], which it sends by itself.
///
/// ```
/// use trinocular::servo::station_link::{StationLink, StationPlace};
/// use trinocular::servo::visual_servo::VisualServo;
/// use trinocular_client::stage::default_stage;
/// use trinocular_core::rig::Rig;
/// use trinocular_vision::images::{Scene, SceneSettings, Texture};
/// use trinocular_vision::sums::Estimator;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let rig = Rig::paper();
/// let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default())?;
/// let mut station = StationLink::start(StationPlace::Twin, &default_stage())?;
/// let mut servo = VisualServo::new(&rig, Estimator::Midpoint)?;
///
/// let start = station.moment(station.now())?;
/// servo.set_keyframe(&scene.render([0.0; 3], 0, 1))?;
/// servo.set_keyframe_time(start.station);
///
/// // 33 ms later the target is 1 mm farther right.
/// let taken = station.moment(start.at.plus_micros(33_333))?;
/// let images = scene.render([1.0, 0.0, 0.0], 33_333, 2);
/// let step = servo.step(&mut station, &images, taken.station, None)?;
/// let estimate = step.outcome.estimate().expect("the station used the frame");
/// assert!((estimate.displacement_mm[0] - 1.0).abs() < 0.05);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct VisualServo {
    rig: Rig,
    flow: Flow,
    estimator: Estimator,
    /// Instant of the keyframe on the station's clock. Kept, because the station identifies a
    /// keyframe by its exact instant, and the estimate of the station's clock drifts.
    keyframe: Instant,
    observers: Vec<Box<dyn ServoObserver>>,
}

impl VisualServo {
    /// Makes a loop without a keyframe.
    ///
    /// # Errors
    /// [`flow::FlowRefusal::WrongRig`] if the rig has no two cameras in different places.
    pub fn new(rig: &Rig, estimator: Estimator) -> Result<Self, flow::FlowRefusal> {
        Ok(Self {
            rig: rig.clone(),
            flow: Flow::new(rig, FlowSettings::default())?,
            estimator,
            keyframe: Instant::default(),
            observers: Vec::new(),
        })
    }

    /// Restricts the points to regions of the cameras' images. Rectangles take effect at the next
    /// keyframe, masks at the next measurement.
    pub fn set_regions(&mut self, regions: Regions) {
        self.flow.set_regions(regions);
    }

    /// Estimates the rotation of the target and follows this point of it; with `None`, a target that
    /// turns is refused.
    pub fn set_pivot(&mut self, pivot: Option<Pivot>) {
        self.flow.set_pivot(pivot);
    }

    /// Returns the last pose of a target that turns, since the keyframe.
    pub fn last_pose(&self) -> Option<LastPose> {
        self.flow.last_pose()
    }

    /// Adds an observer, which sees the keyframe and every [`VisualServo::step`] from now on.
    pub fn add_observer(&mut self, observer: Box<dyn ServoObserver>) {
        self.observers.push(observer);
    }

    /// Replaces all observers from now on.
    pub fn set_observers(&mut self, observers: Vec<Box<dyn ServoObserver>>) {
        self.observers = observers;
    }

    /// Takes the keyframe: the view to be kept.
    ///
    /// # Errors
    /// If the images cannot be a keyframe, with the reason.
    pub fn set_keyframe(&mut self, images: &FrameSet) -> Result<(), flow::FlowRefusal> {
        self.flow.set_keyframe(images)?;
        for observer in &mut self.observers {
            observer.observe(&ServoEvent::Keyframe {
                images,
                last_pose: None,
            });
        }
        Ok(())
    }

    /// Sets the instant of the keyframe on the station's clock.
    pub fn set_keyframe_time(&mut self, taken: Instant) {
        self.keyframe = taken;
    }

    /// Returns the instant of the keyframe on the station's clock.
    pub fn keyframe_time(&self) -> Instant {
        self.keyframe
    }

    /// Measures images against the keyframe.
    ///
    /// # Errors
    /// If the images give no sums, with the reason.
    pub fn measure(&mut self, images: &FrameSet) -> Result<Measured, MeasureRefusal> {
        let (measured, sums) = measure(&mut self.flow, &self.rig, images)?;
        let of_pivot = measured.turn.map(|turn| turn.covariance_mm2);
        Ok(Measured {
            sums: sums.frame(self.estimator)?,
            points: measured.correspondences.len(),
            covariance_mm2: of_pivot.or_else(|| covariance_mm2(&sums)),
            absent: measured.refused_cameras.clone(),
            measurement: Some(measured),
        })
    }

    /// Turns ideal correspondences, which need no images, into sums.
    ///
    /// # Errors
    /// If the correspondences give no sums, with the reason.
    pub fn measure_points(&self, points: &[Correspondence]) -> Result<Measured, MeasureRefusal> {
        let sums = Sums::new(&self.rig, points)?;
        Ok(Measured {
            sums: sums.frame(self.estimator)?,
            points: points.len(),
            covariance_mm2: covariance_mm2(&sums),
            absent: Vec::new(),
            measurement: None,
        })
    }

    /// Makes the frame of images that were taken at `taken` on the station's clock.
    pub fn frame(&self, taken: Instant, sums: FrameSums) -> Frame {
        Frame {
            capture: taken,
            reference: self.keyframe,
            sums,
        }
    }

    /// Measures images that were taken at `taken` on the station's clock, sends their frame and
    /// waits for the answer. With an `arrival`, time passes until then before the frame is sent.
    ///
    /// # Errors
    /// If the station cannot be reached or has a fault. Images that cannot be used are no error.
    pub fn step(
        &mut self,
        station: &mut StationLink,
        images: &FrameSet,
        taken: Instant,
        arrival: Option<Instant>,
    ) -> Result<ServoStep, StationError> {
        // The twin's time stands at the capture; a station on a line reports around it.
        let twin_mm = station.position_mm();
        let measured = self.measure(images);
        let outcome = match &measured {
            Err(refusal) => ServoOutcome::Refused(refusal.clone()),
            Ok(measured) => {
                if let Some(arrival) = arrival {
                    station.advance(arrival);
                }
                match station.offer(self.frame(taken, measured.sums))? {
                    Ok(report) => {
                        ServoOutcome::Used(Box::new(ServoEstimate::new(&report, measured)))
                    }
                    Err(refusal) => ServoOutcome::Unused(refusal),
                }
            }
        };
        let measured = measured.ok();
        let status = station.status();
        let step = ServoStep {
            outcome,
            absent: (measured.as_ref()).map_or(Vec::new(), |measured| measured.absent.clone()),
            trust: status.map_or(Trust::Unknown, |status| status.trust),
            stage_mm: station.position_at(taken).unwrap_or(twin_mm),
        };
        let event = ServoEvent::Step {
            images,
            taken,
            reference: self.keyframe,
            measured: measured.as_ref(),
            step: &step,
            status: status.as_ref(),
        };
        for observer in &mut self.observers {
            observer.observe(&event);
        }
        match status.and_then(|status| status.fault) {
            Some(fault) => Err(StationError::Faulted(fault)),
            None => Ok(step),
        }
    }
}
