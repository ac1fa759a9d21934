//! The closed loop: cameras watch a target, and a station's stage follows it.
//!
//! ```text
//! frame set -> flow -> sums -> frame -> station -> stage
//!     ^                                              |
//!     +------------ cameras on the stage ------------+
//! ```
//!
//! * [`visual_servo`]: the loop itself, the same for all sources of images;
//! * [`frame_sets`]: frame sets from outside: live cameras, recorded images, a folder that grows;
//! * [`simulated`]: simulated cameras before the poster of a [`world`], which a [`path`] moves;
//! * [`station_link`]: the station, in this process or on a serial line; [`serial_station`]: frames
//!   for the latter; [`triggering`]: cameras that it triggers, with their [`trigger_listener`];
//! * [`observer`]: what sees every turn of the loop and has no part in it: [`live`] shows it on a
//!   page, [`recording`] records it;
//! * [`workbench`]: the loop behind a live page, which also jogs, zeroes, homes and resets;
//!   [`camera_bench`] has its live cameras, [`simulated_bench`] its rendered ones. [`stop_answer`]
//!   answers the STOP of a page.
//!
//! A [scenario](crate::scenario) takes the same loop apart, because it has several frames under
//! way at once.

pub mod camera_bench;
pub mod frame_sets;
pub mod live;
pub mod observer;
pub mod page_recording;
pub mod path;
pub mod recording;
pub mod serial_station;
pub mod simulated;
pub mod simulated_bench;
pub mod station_link;
pub mod stop_answer;
pub mod trigger_listener;
pub mod triggering;
pub mod visual_servo;
pub mod workbench;
pub mod world;

use trinocular_client::StationError;
use trinocular_rig::error::InputError;
use trinocular_vision::flow::FlowRefusal;
use trinocular_vision::images::SceneError;

/// A reason why a loop could not be run.
#[derive(Debug, thiserror::Error)]
pub enum ServoError {
    /// The scene cannot be rendered.
    #[error("scene")]
    Scene(#[from] SceneError),
    /// A station refused or faulted.
    #[error(transparent)]
    Station(#[from] StationError),
    /// The images do not come any more.
    #[error(transparent)]
    Images(#[from] InputError),
    /// The first images cannot be used as a keyframe.
    #[error("no usable reference: {0}")]
    Reference(FlowRefusal),
}
