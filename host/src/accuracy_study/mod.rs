//! Accuracy study for developers: measures rendered posters under each of a list of adverse
//! conditions and compares the results with the truth and with their own sigma.
//!
//! * [`condition`] holds scene, disturbance and required result as data;
//! * [`trial`] renders and measures once;
//! * [`tally`] counts the results and judges them;
//! * [`sweep`] runs all conditions on a few threads;
//! * [`phase`] measures the tracker's bias at every sub-pixel phase;
//! * [`present`] prints.
//!
//! *Invariant:* every number depends on the seeds alone, not on threads, time or the order of the
//! work.

pub mod condition;
pub mod phase;
pub mod present;
pub mod sweep;
pub mod tally;
pub mod trial;
