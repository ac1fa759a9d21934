//! The program Trinocular as a library: the closed loop of cameras and stage, simulated runs,
//! predictions and reports.
//!
//! Images and calibration are in [`trinocular_vision`], the client of the station and the
//! twin in [`trinocular_client`], rig files in [`trinocular_rig`], and the station's
//! logic in [`trinocular_core`]. The command line is the program alone, not a part of this
//! library.
//!
//! ```
//! use trinocular::servo::simulated::{ServoTiming, SimulatedServo};
//! use trinocular::servo::station_link::StationPlace;
//! use trinocular::servo::world::SimulatedWorld;
//! use trinocular_client::stage::{default_stage, setpoint};
//! use trinocular_core::rig::Rig;
//! use trinocular_vision::images::{SceneSettings, Texture};
//! use trinocular_vision::sums::Estimator;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Three cameras on the stage of one twin watch a poster on the stage of another.
//! let (rig, texture, scene) = (Rig::paper(), Texture::natural(1), SceneSettings::default());
//! let place = StationPlace::Twin;
//! let mut world = SimulatedWorld::new(&rig, &default_stage(), place, &texture, scene, 1)?;
//! let timing = ServoTiming::default();
//! let mut servo = SimulatedServo::start(&mut world, &rig, timing, Estimator::Midpoint)?;
//! world.a.send(setpoint([4.0, 0.0, 0.0]));
//! for _ in 0..30 {
//!     servo.step(&mut world)?;
//! }
//! let [target_mm, camera_mm] = world.positions_mm();
//! assert!((target_mm[0] - camera_mm[0]).abs() < 0.1);
//! # Ok(())
//! # }
//! ```
//!
//! # Modules
//!
//! | module | holds |
//! |---|---|
//! | [`servo`] | the closed loop, with live, recorded and simulated images |
//! | [`scenario`] | timelines of motion and faults from files, with expected results |
//! | [`budget`] | predicted accuracy and limits of a rig |
//! | [`paper`] | the tables of the paper |
//! | [`report`] | pages with tables and figures |
//! | [`run_report`] | the page of a run or of a recording |
//! | [`pose_study`] | error of rotation and displacement over the Cramér-Rao bound |
//! | [`accuracy_study`] | a study for developers: error and refusals under many conditions |
//!
//! Units are in the names: `_mm`, `_px`, `_us`, `_s`. The feature `camera`, off by default, adds
//! live V4L2 cameras on Linux ([`trinocular_vision::images::cameras`]).

// Output goes through `notice!` or a writer whose errors are handled: these macros panic instead.
#![cfg_attr(not(test), deny(clippy::print_stderr, clippy::print_stdout))]

pub mod accuracy_study;
pub mod budget;
pub mod calendar;
pub mod paper;
pub mod pose_study;
pub mod report;
pub mod run_report;
pub mod scenario;
pub mod servo;
pub mod turning_study;
