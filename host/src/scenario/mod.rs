//! Scenarios: timelines of target motion, frames and faults as data, run on virtual time, with
//! their expected results.
//!
//! ```text
//! file -> scenario -> run (cameras, host, twin) -> trace -> figures -> missed expectations, page
//! ```
//!
//! * [`mod@file`] is the content of a file, [`motion`] the motion of the target;
//! * [`run`] is the loop, with [`cameras`] that render images or project points;
//! * [`trace`] is the true position at every millisecond, [`figures`] computes figures from it;
//! * [`expect`] holds the expected result, [`judge`] lists the missed expectations;
//! * [`present`] shows the results, [`csv`] writes the trace as a table.
//!
//! *Invariant:* no result depends on the speed of this machine. A scenario gives the same step
//! edges in every run, and so does its tape when replayed on another machine.

pub mod cameras;
pub mod csv;
pub mod expect;
pub mod figures;
pub mod file;
pub mod judge;
pub mod motion;
pub mod present;
mod read;
pub mod run;
pub mod trace;
