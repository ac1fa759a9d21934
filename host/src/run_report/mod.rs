//! The page of a run, for every command that makes or reads one: plots over time with marks of the
//! events, the error in µm, the path in space, what the cameras saw, and the data.
//!
//! ```text
//! recording, read ---\
//!                     > Story -> RunCurves -> parts of a report::Page
//! frame sets, live --/              ^
//! true positions of a simulation ---'
//! ```
//!
//! * [`story`] collects the frame sets of a run as they come: from a recording, or from a loop;
//! * [`reading`] reads a recording;
//! * [`curves`] are the plain values of a run, and make the parts of its page;
//! * [`page`] is the whole page of a recording or of a run of `track`;
//! * [`foreign`] is the page of a recording that this program did not make;
//! * [`provenance`] is where a run came from.

mod album;
pub mod curves;
pub mod foreign;
mod marks;
pub mod page;
pub mod provenance;
pub mod reading;
pub mod story;

pub use curves::RunCurves;
pub use provenance::Provenance;
pub use story::{HandEye, Story, StoryTaker};
