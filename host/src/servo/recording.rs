//! The observer that passes the turns of a loop to a recording.

use super::observer::{ServoEvent, ServoObserver};
use super::visual_servo::{Measured, ServoEstimate, ServoOutcome};
use std::sync::Arc;
use trinocular_core::frame::message::Status;
use trinocular_core::rig::Rig;
use trinocular_recording::message::{Measurement, Outcome, absent};
use trinocular_recording::recorder::Tap;
use trinocular_vision::images::FrameSet;
use trinocular_vision::measure::MeasureRefusal;

/// Taker of frame sets and their measurements: a recording, or a report.
pub trait FrameSetTaker: std::fmt::Debug + Send + Sync {
    /// Takes in a frame set, whose images may be missing, and its measurement.
    fn take(&self, images: Option<&FrameSet>, measurement: Measurement);

    /// Takes in the latest status of the station, just before the frame set. A recording has all
    /// packets and needs none.
    fn status(&self, status: &Status) {
        let _ = status;
    }
}

impl FrameSetTaker for Tap {
    fn take(&self, images: Option<&FrameSet>, measurement: Measurement) {
        self.frame_set(images, measurement);
    }
}

/// Takers of the frame sets of a run.
pub type Takers = Vec<Arc<dyn FrameSetTaker>>;

/// Observer of a loop whose run is recorded or reported.
#[derive(Debug)]
pub struct RecordingObserver {
    tap: Arc<dyn FrameSetTaker>,
    rig: Rig,
}

impl RecordingObserver {
    /// Makes the observer of a loop with the cameras of `rig`.
    pub fn new(tap: Arc<dyn FrameSetTaker>, rig: &Rig) -> Self {
        Self {
            tap,
            rig: rig.clone(),
        }
    }
}

/// Returns the observers of a loop: one if its run is recorded, otherwise none.
pub fn observers(tap: Option<Arc<Tap>>, rig: &Rig) -> Vec<Box<dyn ServoObserver>> {
    let tap = tap.map(|tap| tap as Arc<dyn FrameSetTaker>);
    observers_of(tap, rig)
}

/// Returns one observer of a loop per taker of its frame sets.
pub fn observers_of(
    takers: impl IntoIterator<Item = Arc<dyn FrameSetTaker>>,
    rig: &Rig,
) -> Vec<Box<dyn ServoObserver>> {
    let observer = |taker| Box::new(RecordingObserver::new(taker, rig)) as Box<dyn ServoObserver>;
    takers.into_iter().map(observer).collect()
}

/// Converts the result of measuring one frame set to the message of a recording.
pub fn measurement(rig: &Rig, measured: Result<&Measured, &MeasureRefusal>) -> Measurement {
    let mut message = Measurement::default();
    match measured {
        Ok(measured) => {
            if let Some(measurement) = &measured.measurement {
                message.measured(rig, measurement);
            }
        }
        Err(refusal) => {
            message.outcome = Outcome::Refused;
            message.reason = refusal.to_string();
        }
    }
    message
}

impl ServoObserver for RecordingObserver {
    fn observe(&mut self, event: &ServoEvent<'_>) {
        match event {
            ServoEvent::Keyframe { images, last_pose } => {
                let mut message = Measurement {
                    stamp_us: images.time_us,
                    outcome: Outcome::Keyframe,
                    ..Measurement::default()
                };
                message.set_last_pose(*last_pose);
                self.tap.take(Some(images), message);
            }
            ServoEvent::Step {
                images,
                taken,
                reference,
                measured,
                step,
                status,
            } => {
                if let Some(status) = status {
                    self.tap.status(status);
                }
                let mut message = match (measured, &step.outcome) {
                    (Some(measured), _) => measurement(&self.rig, Ok(measured)),
                    (None, ServoOutcome::Refused(refusal)) => measurement(&self.rig, Err(refusal)),
                    (None, _) => Measurement::default(),
                };
                message.stamp_us = images.time_us;
                message.capture_us = taken.micros();
                message.reference_us = reference.micros();
                message.stage_mm = step.stage_mm;
                match &step.outcome {
                    ServoOutcome::Used(estimate) => used(&mut message, estimate),
                    ServoOutcome::Refused(_) => {}
                    ServoOutcome::Unused(refusal) => {
                        message.outcome = Outcome::Unused;
                        message.reason = refusal.to_string();
                    }
                }
                if message.absent.is_empty() {
                    message.absent = absent(&step.absent);
                }
                self.tap.take(Some(images), message);
            }
        }
    }
}

fn used(message: &mut Measurement, estimate: &ServoEstimate) {
    message.outcome = Outcome::Used;
    message.station_mm = estimate.displacement_mm;
    message.station_sigma_mm = estimate.sigma_mm.unwrap_or_default();
    message.latency_us = estimate.latency_us;
}
