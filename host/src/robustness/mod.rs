//! Whether what is measured can be trusted when the pictures are bad: many measurements of rendered
//! posters under each of a list of conditions, held against the truth and against their own sigma.
//!
//! * [`condition`] says, as data, what is photographed, what is wrong with it, and what must come
//!   out;
//! * [`trial`] photographs and measures once;
//! * [`tally`] counts what came out and judges it;
//! * [`sweep`] runs everything on a few threads;
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
