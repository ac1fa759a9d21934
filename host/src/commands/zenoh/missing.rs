//! The refusal of a program that was built without topics.

use crate::commands::failure::Failure;
use std::sync::Arc;
use trinocular::servo::recording::FrameSetTaker;
use trinocular_live::Controls;
use trinocular_recording::queue::Pace;

/// Publisher that cannot be opened.
#[derive(Debug)]
pub enum Publishing {}

impl Publishing {
    /// Refuses.
    pub fn open(
        _: &str,
        _: u32,
        _: &[String],
        _: Pace,
        _: Option<Arc<dyn Controls>>,
    ) -> Result<Self, Failure> {
        let reason = "this program was built without topics of ROS 2: build it with \
                      `cargo build --release --features trinocular/zenoh`";
        Err(Failure::Usage(reason.to_owned()))
    }

    /// Returns the taker of frame sets.
    pub fn taker(&self) -> Arc<dyn FrameSetTaker> {
        match *self {}
    }

    /// Ends the session.
    pub fn finish(self) {
        match self {}
    }
}
