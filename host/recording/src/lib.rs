#![doc = include_str!("../README.md")]
//!
//! # Modules
//!
//! * [`recorder`] takes in what passes through a run and writes it on a thread of its own;
//! * [`message`], [`schema`], [`topic`] and [`cdr`] are the contents of the file;
//! * [`read`] reads recordings and the MCAP files and ROS 2 bags of others;
//! * [`regions`] keeps the regions of interest;
//! * [`replay`] runs the measurements and the station again, and compares;
//! * [`export`] makes the table of measurements.

// Output goes through `notice!` or a writer whose errors are handled: these macros panic instead.
#![cfg_attr(not(test), deny(clippy::print_stderr, clippy::print_stdout))]

pub mod cdr;
pub mod export;
pub mod message;
mod png;
pub mod queue;
pub mod read;
pub mod recorder;
pub mod regions;
pub mod replay;
pub mod schema;
mod sink;
mod thread;
pub mod topic;
