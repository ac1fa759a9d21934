//! Vision of Trinocular: images to flow sums, calibration, alignment and hand-eye calibration.
//!
//! The feature `camera`, off by default, adds live V4L2 cameras on Linux ([`images::cameras`]).

// Output goes through `notice!` or a writer whose errors are handled: these macros panic instead.
#![cfg_attr(not(test), deny(clippy::print_stderr, clippy::print_stdout))]

pub mod alignment;
pub mod calibration;
pub mod field_of_view;
pub mod flow;
pub mod hand_eye;
pub mod images;
pub mod matching;
pub mod measure;
pub mod points;
pub mod stage_timings;
pub mod sums;
pub mod thread_pool;
