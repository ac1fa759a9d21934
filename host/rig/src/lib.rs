//! Rig files of Trinocular, and what reads and writes files without surprises.

// Output goes through `notice!` or a writer whose errors are handled: these macros panic instead.
#![cfg_attr(not(test), deny(clippy::print_stderr, clippy::print_stdout))]

pub mod error;
pub mod input;
pub mod interruption;
pub mod notice;
pub mod output;
pub mod printable;
pub mod random;
pub mod rig_file;
