#![doc = include_str!("../README.md")]
//!
//! # Modules
//!
//! ```text
//! images -> matching -> flow -> sums        measurement
//! images -> calibration -> alignment -> hand_eye        set-up, once per rig
//! ```
//!
//! | module | holds |
//! |---|---|
//! | [`images`] | frame sets from folders, live cameras ([`images::cameras`]) and a renderer |
//! | [`matching`] | pyramid, corners, zncc, Lucas-Kanade, epipolar search, stereo matching |
//! | [`flow`] | keyframe, search for the displacement, tracking, inliers, refusals |
//! | [`sums`], [`measure`](mod@measure) | flow sums of correspondences, or straight from images |
//! | [`points`] | matched points from a CSV file |
//! | [`estimation`] | displacement and rotation of points or images, by the rules of `estimate` |
//! | [`calibration`] | cameras and rig from photographs of a chessboard; files of OpenCV and ROS |
//! | [`alignment`] | principal points and rolls of a rig from images of any scene |
//! | [`hand_eye`] | the matrix from camera axes to stage axes |
//! | [`field_of_view`] | the space that the cameras see |
//! | [`thread_pool`], [`stage_timings`] | threads that share the work, and times of its stages |

// Output goes through `notice!` or a writer whose errors are handled: these macros panic instead.
#![cfg_attr(not(test), deny(clippy::print_stderr, clippy::print_stdout))]

pub mod alignment;
pub mod calibration;
pub mod estimation;
pub mod field_of_view;
pub mod flow;
pub mod hand_eye;
pub mod images;
pub mod matching;
pub mod measure;
mod median;
pub mod points;
mod rigid;
pub mod spot;
pub mod stage_timings;
pub mod sums;
pub mod targets;
pub mod thread_pool;
