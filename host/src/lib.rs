//! Images to flow sums, the twin, and the command line of Trinocular.
//!
//! The feature `camera`, off by default, adds live V4L2 cameras on Linux
//! ([`trinocular_vision::images::cameras`]).

// Output goes through `notice!` or a writer whose errors are handled: these macros panic instead.
#![cfg_attr(not(test), deny(clippy::print_stderr, clippy::print_stdout))]

pub mod accuracy_study;
pub mod budget;
pub mod paper;
pub mod report;
pub mod scenario;
pub mod servo;
