//! The paper's apparatus: station A, a twin, carries the target; station B, a twin or a station on
//! a serial line, carries the cameras.
//!
//! * [`follower`]: station B, wherever it is;
//! * [`world`]: both stations on one clock, and the pictures that B's cameras take of A's poster;
//! * [`frame`]: from pictures to the sums of a flow frame;
//! * [`servo`]: B's loop, from picture to flow frame, and what happened in every frame;
//! * [`pursuit`]: the same for captures that come from outside;
//! * [`path`]: where A goes;
//! * [`tracking`]: section 4.3, five moves in closed loop (Table 6, Figs. 7 and 8);
//! * [`moves`]: section 4.2, single moves seen by resting cameras (Table 5);
//! * [`present`]: tables and figures of both.

pub mod follower;
pub mod frame;
pub mod moves;
pub mod path;
pub mod present;
pub mod pursuit;
pub mod servo;
pub mod tracking;
pub mod world;

use crate::flow::FlowRefusal;
use crate::images::SceneError;
use crate::station::StationError;

/// Why an experiment could not be run.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene cannot be rendered.
    #[error("scene")]
    Scene(#[from] SceneError),
    /// A station refused or faulted.
    #[error(transparent)]
    Station(#[from] StationError),
    /// The first pictures cannot be used as a reference.
    #[error("no usable reference: {0}")]
    Reference(FlowRefusal),
}
