#![doc = include_str!("../README.md")]
//! # Data flow
//!
//! ```text
//! bytes -> frame -> estimate -> track -> motion -> steps -> port words
//!          \------------- machine ------------/
//! ```
//!
//! *Invariant:* nothing here reads a clock, allocates, blocks, or keeps global state; there are no
//! callbacks, no `dyn`, no `async`. Time is an argument, and every action is a return value. The
//! same calls give the same bits on every machine.
//!
//! *Invariant:* from [`frame`] to [`steps`] everything is integer arithmetic, except the filters in
//! [`track`]: their deviations and velocities are `f32`, with `+ - * /` in a fixed order, which give
//! the same bits everywhere; their positions are integers, too. Other floating point is in [`rig`],
//! in the accumulating half of [`sums`] and in the `solve` functions of [`estimate`], none of which
//! the station runs.
//!
//! # Modules
//!
//! [`machine`] is the whole station. A shell (firmware, emulator, twin) calls `receive` with bytes,
//! `sense` with switches and `poll` with the time, and does what `poll` returns.
//!
//! [`rig`] holds the cameras as plain data, projects points into their images and converts pixels
//! to normalised coordinates.
//!
//! [`sums`] reduces the correspondences of one frame set to a few numbers, the flow sums. The host
//! accumulates them in floating point and sends them as integers.
//!
//! [`estimate`] computes the target's displacement from flow sums, with three estimators: midpoint
//! (the default, with sigma), and the paper's closed form and least squares. A fourth, for the host
//! alone, computes displacement and rotation from the points themselves. `sums` and `estimate` need
//! no other module but [`rig`] and [`fixed`]: see the example `displacement`.
//!
//! [`frame`] is the wire protocol: messages, their encoding, and a receiver for any chunking.
//!
//! [`track`] converts displacements to target positions, by the history of where the stage was, and
//! predicts where the target is now:
//!
//! ```
//! use trinocular_core::time::Instant;
//! use trinocular_core::track::filter::KinematicLimits;
//! use trinocular_core::track::pursuit::{Measurement, Pursuit, Settings};
//!
//! // A target at 2 steps/ms, measured every 20 ms with a variance of 0.1 steps².
//! let limits = [KinematicLimits { speed: 8.0, acceleration: 0.16, jerk: 0.004 }; 3];
//! let mut pursuit = Pursuit::default();
//! for k in 0..50u64 {
//!     let capture = Instant::from_micros(20_000 * k);
//!     let position = [(40 * k as i64) << 32, 0, 0];
//!     let measurement = Measurement { capture, position, variance: [0.1; 3] };
//!     pursuit.measure(capture, &measurement, &limits, &Settings::DEFAULT).unwrap();
//! }
//! // The station aims once per control tick. 10 ms after the last measurement, at 1960 steps, the
//! // target is near 1980 steps.
//! let last_us = 20_000 * 49u64;
//! let at = |ms| Instant::from_micros(last_us + ms * 1_000);
//! let aim = |ms| pursuit.aim(at(ms), &limits, &Settings::DEFAULT);
//! let [x, y, _] = (0..=10u64).filter_map(aim).last().unwrap();
//! assert!(((x.position >> 32) - 1980).abs() <= 1 && y.position == 0);
//! assert!((x.velocity - 2.0).abs() < 0.1);
//! ```
//!
//! [`motion`] plans segments of motion to target positions, within limits of speed, acceleration
//! and jerk; [`steps`] converts segments to the port words that make STEP and DIR edges. The two
//! need no other module but [`fixed`]: see the example `planner`.
//!
//! [`safety`] defines the states of the station, the trust in its position, and the numbered
//! faults.
//!
//! [`replay`] is the emulated station, and a run of it that can be repeated and compared between
//! machines.
//!
//! [`fixed`] and [`time`] hold the arithmetic and the instants that all modules use.
//!
//! # Glossary
//!
//! One word has one meaning in the whole project. A remark says why a less usual word was kept.
//!
//! | term | meaning |
//! |---|---|
//! | image | the picture that one camera takes at one instant |
//! | frame set | the images of all cameras at one instant |
//! | capture time | the instant at which a frame set was taken; `capture` on the wire, which is append-only |
//! | keyframe | the frame set from which displacement is measured; `reference` on the wire |
//! | flow frame, [`Frame`](frame::message::Frame) | the message with the flow sums of one frame set; the only thing that is called a frame alone, because the protocol's names cannot change |
//! | correspondence | one point that is matched in all active cameras and in the keyframe |
//! | view | the positions of one correspondence in one camera, at the keyframe and now ([`sums::View`]) |
//! | normalised coordinates | image coordinates divided by the focal length, without lens distortion and rotation |
//! | flow | displacement of a correspondence in an image |
//! | flow sums | sums over correspondences that the estimators need |
//! | displacement | the target's motion since the keyframe, in the camera frame, mm or nm |
//! | pose | displacement and rotation of a rigid target since the keyframe ([`estimate::pose`]) |
//! | pivot | the point of the target whose displacement is stated; matters if the target turns |
//! | sigma | stated standard deviation of a displacement, per axis |
//! | variance inflation factor | factor on the variance for correlated errors of neighbouring points; the field [`overlap`](sums::centred::CentredSums::overlap) is older |
//! | active cameras | cameras that take part in an estimate |
//! | inlier, consensus | a correspondence that agrees with the common displacement; the set of all that do |
//! | zncc | zero-mean normalised cross-correlation, the score of a match |
//! | epipolar search | search for a match along the epipolar line, within the search range of disparities |
//! | hand-eye matrix | linear map from camera axes to stage axes |
//! | eye-in-hand, eye-to-hand | cameras on the stage, or beside it; `Mounting::{OnStage, Fixed}` on the wire |
//! | station | the board that moves the stage, with its firmware; nothing else |
//! | client | the host's side of the protocol |
//! | emulated station | the station's code on a virtual clock ([`replay::Station`]) |
//! | plant | the simulated stage, which turns step edges into motion (control engineering) |
//! | twin | emulated station, plant and client in one program on virtual time (digital twin) |
//! | shell | the program around [`machine`] that owns clock, pins and links |
//! | control tick | the period of the station's control loop, 1 ms |
//! | segment, slot, word | a quarter of a tick; two words; one write to the port's set/reset register ([`steps`]) |
//! | fine unit | 2⁻³² of a step, the unit of all planned positions |
//! | velocity, speed | signed rate of a position, and its magnitude |
//! | travel | range of positions of an axis |
//! | backlash | play between motor and load on a reversal; a *flank* is one of the two surfaces that push |
//! | window | [`window_um`](frame::message::StageConfig::window_um): range of motion while the position is unknown |
//! | target track | the station's estimate of the target's state over time ([`track`]); its states are in [`Sight`](track::pursuit::Sight), a name of the protocol |
//! | innovation | measured minus predicted position in the filter of [`track`] |
//! | reject | a byte sequence that is no packet, or a point that is left out |
//! | refusal | the reason for which an estimator or the gate gives no displacement ([`estimate::Refusal`]) |
//! | denial | the reason for which the station does not execute a command ([`Denial`](frame::message::Denial)) |
//! | fault | a latched condition that stopped the stage ([`safety::Fault`]) |
//! | trust | whether the station knows its position: unknown, homed, degraded ([`safety::Trust`]) |
#![no_std]

#[cfg(test)]
extern crate std;

pub mod estimate;
pub mod fixed;
pub mod frame;
pub mod machine;
pub mod motion;
pub mod replay;
pub mod rig;
pub mod safety;
pub mod steps;
pub mod sums;
pub mod time;
pub mod track;
