//! Observers of a running loop: recorders, live pages, and whatever else must see what the loop saw
//! and did, without a part in it.

use super::visual_servo::{Measured, ServoStep};
use trinocular_core::frame::message::Status;
use trinocular_core::time::Instant;
use trinocular_vision::flow::LastPose;
use trinocular_vision::images::FrameSet;

/// One event of a running loop.
#[derive(Clone, Copy, Debug)]
pub enum ServoEvent<'a> {
    /// The keyframe was taken.
    Keyframe {
        /// Images of all cameras.
        images: &'a FrameSet,
        /// Pose that was measured last against it, if the keyframe is not new.
        last_pose: Option<LastPose>,
    },
    /// One turn of the loop ended.
    Step {
        /// Images of all cameras.
        images: &'a FrameSet,
        /// Capture time of the images, station time.
        taken: Instant,
        /// Capture time of the keyframe, station time.
        reference: Instant,
        /// Sums and measurement, unless the images were refused.
        measured: Option<&'a Measured>,
        /// Result of the turn.
        step: &'a ServoStep,
        /// Latest status of the station.
        status: Option<&'a Status>,
    },
}

/// Observer of a running loop.
///
/// It is called on the loop's own thread, between two frame sets: it copies what it needs and
/// returns at once.
pub trait ServoObserver: std::fmt::Debug + Send {
    /// Takes in one event.
    fn observe(&mut self, event: &ServoEvent<'_>);
}
