//! The publisher of a run, as a taker of its frame sets.

use crate::commands::failure::Failure;
use std::path::Path;
use std::sync::Arc;
use trinocular::servo::recording::FrameSetTaker;
use trinocular_recording::message::Measurement;
use trinocular_recording::queue::Pace;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_ros::publisher::{Feed, Publisher, PublisherError, Settings};
use trinocular_vision::images::FrameSet;

/// Open publisher.
#[derive(Debug)]
pub struct Publishing(Publisher);

impl Publishing {
    /// Opens the session.
    pub fn open(
        endpoint: &str,
        domain: u32,
        cameras: &[String],
        pace: Pace,
    ) -> Result<Self, Failure> {
        let publisher = Publisher::open(&Settings {
            endpoint: endpoint.to_owned(),
            domain,
            cameras: cameras.to_vec(),
            pace,
        });
        let publisher = publisher.map_err(|error| match error {
            PublisherError::Endpoint { .. } | PublisherError::Name(_) => {
                Failure::Usage(error.to_string())
            }
            error => InputError::file(Path::new(endpoint), error.to_string()).into(),
        })?;
        notice!("publishing in ROS domain {domain} through {endpoint}");
        Ok(Self(publisher))
    }

    /// Returns the taker of frame sets.
    pub fn taker(&self) -> Arc<dyn FrameSetTaker> {
        Arc::new(Taker(self.0.feed()))
    }

    /// Ends the session and prints the account.
    pub fn finish(self) {
        let account = self.0.finish();
        let mut text = format!("published {} messages", account.messages);
        if account.dropped > 0 {
            let dropped = account.dropped;
            text += &format!("; dropped because the network was too slow: {dropped}");
        }
        if account.failed > 0 {
            text += &format!("; not taken by Zenoh: {}", account.failed);
        }
        notice!("{text}");
    }
}

/// Taker that passes frame sets to the publisher.
#[derive(Debug)]
struct Taker(Arc<Feed>);

impl FrameSetTaker for Taker {
    fn take(&self, images: Option<&FrameSet>, measurement: Measurement) {
        self.0.take(images, measurement);
    }
}
