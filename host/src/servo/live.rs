//! Observer of a loop that shows its turns on the live page.

use super::observer::{ServoEvent, ServoObserver};
use super::visual_servo::ServoOutcome;
use std::sync::Arc;
use trinocular_core::frame::message::Denial;
use trinocular_live::hub::Estimate;
use trinocular_live::{Hub, Turn};
use trinocular_vision::measure::MeasureRefusal;

/// Observer that hands every turn to the hub of a live page.
#[derive(Clone, Debug)]
pub struct LiveObserver {
    hub: Arc<Hub>,
}

impl LiveObserver {
    /// Makes an observer.
    pub fn new(hub: Arc<Hub>) -> Self {
        Self { hub }
    }
}

impl ServoObserver for LiveObserver {
    fn observe(&mut self, event: &ServoEvent<'_>) {
        match event {
            ServoEvent::Keyframe { .. } => self.hub.note("following from this view"),
            ServoEvent::Step {
                images,
                taken,
                reference: _,
                measured,
                step,
                status,
            } => {
                let sentence = step.outcome.refusal();
                let name = refusal_name(&step.outcome);
                self.hub.turn(&Turn {
                    taken_us: taken.micros(),
                    images,
                    measurement: measured.and_then(|measured| measured.measurement.as_ref()),
                    estimate: step.outcome.estimate().map(|estimate| Estimate {
                        displacement_mm: estimate.displacement_mm,
                        sigma_mm: estimate.sigma_mm,
                        points: estimate.points,
                        latency_us: estimate.latency_us,
                    }),
                    refusal: name.zip(sentence.as_deref()),
                    absent: &step.absent,
                    stage_mm: step.stage_mm,
                    status: *status,
                });
            }
        }
    }
}

/// Returns the name of the reason why images had no effect, for counts.
fn refusal_name(outcome: &ServoOutcome) -> Option<&'static str> {
    use super::station_link::FrameRefusal;
    match outcome {
        ServoOutcome::Used(_) => None,
        ServoOutcome::Refused(MeasureRefusal::Flow(refusal)) => Some(refusal.name()),
        ServoOutcome::Refused(MeasureRefusal::Sums(_)) => Some("no estimate"),
        ServoOutcome::Refused(MeasureRefusal::NothingSeen) => Some("nothing seen"),
        ServoOutcome::Unused(FrameRefusal::Denied(denial)) => Some(match denial {
            Denial::Outlier => "denied: outlier",
            Denial::CaptureTooOld => "denied: too old",
            Denial::CaptureOutOfOrder => "denied: out of order",
            Denial::CaptureInFuture => "denied: in the future",
            Denial::Estimate(_) => "denied: no estimate",
            _ => "denied: the station does not follow",
        }),
        ServoOutcome::Unused(FrameRefusal::Unanswered) => Some("not answered"),
        ServoOutcome::Unused(FrameRefusal::Interrupted) => Some("line interrupted"),
        ServoOutcome::Unused(FrameRefusal::Unreported) => Some("not reported"),
    }
}
