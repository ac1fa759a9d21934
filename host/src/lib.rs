//! Images to flow sums, the twin, and the command line of Trinocular.
//!
//! The feature `camera`, off by default, adds live V4L2 cameras on Linux ([`images::cameras`]).

// Output goes through `notice!` or a writer whose errors are handled: these macros panic instead.
#![cfg_attr(not(test), deny(clippy::print_stderr, clippy::print_stdout))]

pub mod alignment;
pub mod calibration;
pub mod error;
pub mod experiment;
pub mod flow;
pub mod images;
pub mod input;
pub mod interruption;
pub mod matching;
pub mod mounting;
pub mod notice;
pub mod output;
pub mod plant;
pub mod points;
pub mod printable;
pub mod random;
pub mod report;
pub mod rig_file;
pub mod robustness;
pub mod simulation;
pub mod stage_timings;
pub mod station;
pub mod sums;
pub mod thread_pool;
pub mod validation;
pub mod verification;
