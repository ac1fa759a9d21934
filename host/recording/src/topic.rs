//! Topics of a recording, and the names of its other parts.

use crate::schema::{self, Schema};

/// Name of the metadata with the origin of the run.
pub const ORIGIN: &str = "trinocular";

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
