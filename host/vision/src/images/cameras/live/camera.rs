//! Camera that delivers images one by one.

use crate::images::Image;
use std::path::PathBuf;
use std::time::Instant;
use trinocular_rig::error::InputError;

/// Result of one wait for an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CameraEvent {
    /// Image with its time stamp.
    Image(Instant, Image),
    /// Image of unknown time.
    Stale,
    /// Image that the camera or its line has damaged.
    Damaged,
    /// Image of which packets are missing.
    Incomplete,
    /// No image yet.
    Nothing,
}

/// Camera that delivers images one by one.
pub trait Camera: Send + 'static {
    /// Returns the path of the device, for messages.
    fn path(&self) -> PathBuf;

    /// Waits for the next image, for a fraction of a second at most, so that the thread can end.
    ///
    /// # Errors
    /// [`InputError`] if the camera will deliver no more images.
    fn next_image(&mut self) -> Result<CameraEvent, InputError>;

    /// Returns the number of images that the driver has lost so far, as far as it is known.
    fn lost(&self) -> u64 {
        0
    }

    /// Returns true if no program can use the camera until this one has released it.
    fn needs_release(&self) -> bool {
        false
    }
}

impl Camera for Box<dyn Camera> {
    fn path(&self) -> PathBuf {
        self.as_ref().path()
    }

    fn next_image(&mut self) -> Result<CameraEvent, InputError> {
        self.as_mut().next_image()
    }

    fn lost(&self) -> u64 {
        self.as_ref().lost()
    }

    fn needs_release(&self) -> bool {
        self.as_ref().needs_release()
    }
}
