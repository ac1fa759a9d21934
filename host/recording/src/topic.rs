//! Topics of a recording, and the names of its other parts.

use crate::read::survey::Message;
use crate::schema::{self, Schema};

/// Name of the metadata with the origin of the run.
pub const ORIGIN: &str = "trinocular";

/// Entry of [`ORIGIN`] that says when the stage was where a measurement says. Recordings from before
/// it have the position after the station's answer.
pub const STAGE: (&str, &str) = ("stage_mm", "at the capture");

/// Name of the metadata with the counts at the end.
pub const END: &str = "trinocular.end";

/// Name of the attachment with the rig file.
pub const RIG: &str = "rig.toml";

/// Returns the topic of a camera's images.
pub fn image(camera: &str) -> String {
    format!("/{camera}/image_raw")
}

/// Returns the topic of a camera's PNG files.
pub fn compressed(camera: &str) -> String {
    format!("/{camera}/image_raw/compressed")
}

/// Topics of each camera's images.
///
/// ```
/// use trinocular_recording::topic::ImageTopics;
///
/// let topics = ImageTopics::new(&["left".to_owned(), "right".to_owned()]);
/// assert_eq!(topics.camera("/right/image_raw/compressed"), Some(1));
/// assert_eq!(topics.camera("/status"), None);
/// ```
#[derive(Clone, Debug)]
pub struct ImageTopics(Vec<[String; 2]>);

impl ImageTopics {
    /// Makes the topics of the cameras with these names.
    pub fn new(cameras: &[String]) -> Self {
        let both = |name: &String| [image(name), compressed(name)];
        Self(cameras.iter().map(both).collect())
    }

    /// Returns the camera whose images, raw or compressed, come on `topic`.
    pub fn camera(&self, topic: &str) -> Option<usize> {
        let is_its = |both: &[String; 2]| both.iter().any(|known| known == topic);
        self.0.iter().position(is_its)
    }

    /// Returns the number of cameras.
    pub fn cameras(&self) -> usize {
        self.0.len()
    }
}

/// Topics beside the images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Topic {
    /// Result of each frame set.
    Measurement,
    /// Displacement of the target, for viewers.
    Displacement,
    /// Status reports of the station.
    Status,
    /// Events of the run.
    Events,
    /// Inputs of the station.
    Input,
    /// Outputs of the station.
    Output,
    /// Edges at the pins of a twin.
    Edges,
}

impl Topic {
    /// All topics.
    pub const ALL: [Self; 7] = [
        Self::Measurement,
        Self::Displacement,
        Self::Status,
        Self::Events,
        Self::Input,
        Self::Output,
        Self::Edges,
    ];

    /// Returns the name in the file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Measurement => "/measurement",
            Self::Displacement => "/displacement",
            Self::Status => "/status",
            Self::Events => "/events",
            Self::Input => "/station/input",
            Self::Output => "/station/output",
            Self::Edges => "/station/edges",
        }
    }

    /// Returns true if a message is on this topic and of its type.
    pub fn is_of(self, message: &Message<'_>) -> bool {
        message.topic == self.name() && message.kind == self.schema().short_name()
    }

    /// Returns the schema of its messages.
    pub const fn schema(self) -> &'static Schema {
        match self {
            Self::Measurement => &schema::MEASUREMENT,
            Self::Displacement => &schema::POSE,
            Self::Status => &schema::STATUS,
            Self::Events => &schema::EVENT,
            Self::Input | Self::Output | Self::Edges => &schema::ENTRY,
        }
    }
}
