//! Study of targets that turn, for developers: measures rendered scenes with and without a
//! rotation, alone, beside other objects and behind them, and compares the results with the truth
//! and with their own sigma.
//!
//! * [`scene`] holds the layouts and renders them;
//! * [`trial`] measures one rendering in both ways;
//! * [`sweep`] runs all layouts and counts;
//! * [`present`] prints.
//!
//! *Invariant:* every number depends on the seeds alone, not on threads or time.

pub mod present;
pub mod scene;
pub mod sweep;
pub mod trial;
