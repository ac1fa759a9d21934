//! Images to flow sums, the twin, and the command line of Trinocular.
//!
//! The feature `camera`, off by default, adds live V4L2 cameras on Linux ([`images::cameras`]).

// Output goes through `notice!` or a writer whose errors are handled: these macros panic instead.
#![cfg_attr(not(test), deny(clippy::print_stderr, clippy::print_stdout))]

pub mod accuracy_study;
pub mod alignment;
pub mod budget;
pub mod calibration;
pub mod client;
pub mod error;
pub mod field_of_view;
pub mod flow;
pub mod hand_eye;
pub mod images;
pub mod input;
pub mod interruption;
pub mod matching;
pub mod measure;
pub mod notice;
pub mod output;
pub mod paper;
pub mod plant;
pub mod points;
pub mod printable;
pub mod random;
pub mod report;
pub mod rig_file;
pub mod scenario;
pub mod servo;
pub mod stage_timings;
pub mod sums;
pub mod thread_pool;
