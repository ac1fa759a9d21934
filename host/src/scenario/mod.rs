//! Scenarios: timelines of target motion, frames and faults as data, run on virtual time, with what
//! must come of them.
//!
//! ```text
//! file -> scenario -> run (cameras, host, twin) -> trace -> figures -> missed expectations, page
//! ```
//!
//! * [`mod@file`] says what a file may hold, [`motion`] how the target moves;
//! * [`run`] is the loop, with [`cameras`] that render pictures or project points;
//! * [`trace`] is the truth at every millisecond, [`figures`] what it amounts to;
//! * [`expect`] is what must come of it, [`judge`] says what was missed;
//! * [`present`] shows it.
//!
//! *Invariant:* nothing depends on how fast this machine is: a scenario gives the same step edges
//! in every run, and its tape, replayed on another machine, too.

pub mod cameras;
pub mod expect;
pub mod figures;
pub mod file;
pub mod judge;
pub mod motion;
pub mod present;
mod read;
pub mod run;
pub mod trace;
