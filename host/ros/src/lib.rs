#![doc = include_str!("../README.md")]
//!
//! # Modules
//!
//! * [`message_type`] names the types of ROS 2 and their hashes;
//! * [`graph`] makes key expressions, liveliness tokens and identifiers;
//! * [`attachment`] encodes what goes with every message;
//! * [`command`] reads the commands of nodes;
//! * [`name`] converts names of cameras to names of ROS 2;
//! * `publisher`, with the feature `zenoh`, sends the frame sets of a run and takes commands.
//!
//! The formats are those of `rmw_zenoh_cpp` 0.2.4 and later (its `docs/design.md`), which ROS 2
//! Jazzy, Kilted and Rolling have.

// Output goes through `notice!` or a writer whose errors are handled: these macros panic instead.
#![cfg_attr(not(test), deny(clippy::print_stderr, clippy::print_stdout))]

pub mod attachment;
pub mod command;
pub mod graph;
pub mod message_type;
pub mod name;
#[cfg(feature = "zenoh")]
pub mod publisher;
