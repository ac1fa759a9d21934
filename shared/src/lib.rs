//! Everything between the serial port and the step pins.
//!
//! ```text
//! bytes -> frame -> estimate -> track -> motion -> steps -> port words
//!          \------------- machine ------------/
//! ```
//!
//! | module | what it does |
//! |---|---|
//! | [`rig`] | the cameras as plain data, projection and its inverse |
//! | [`sums`] | what one frame of images says, as a few integers: the thing the host sends |
//! | [`frame`] | the wire: messages, encoding, a receiver for any chunking |
//! | [`estimate`] | sums to the target's displacement: closed form, least squares, midpoint |
//! | [`track`] | displacement to target position, through the history of where the stage was; where the target is by now, and what to believe |
//! | [`motion`] | target position to velocity- and acceleration-limited segments |
//! | [`steps`] | segments to the words that make STEP and DIR edges |
//! | [`safety`] | states, trust in the position, numbered faults |
//! | [`machine`] | ties them together: `receive`, `sense`, `poll` |
//! | [`replay`] | a run that can be repeated, and compared between machines |
//! | [`fixed`], [`time`] | the arithmetic and the instants that all of them use |
//!
//! *Invariant:* nothing here reads a clock, allocates, blocks, or keeps global state; there are no
//! callbacks, no `dyn`, no `async`. Time is an argument, and what must be done is returned as a
//! value. The same calls give the same bits on every machine.
//!
//! *Invariant:* from [`frame`] to [`steps`] everything is integer arithmetic, but for the filter in
//! [`track`]: its deviations and rates are `f32`, with `+ - * /` in a fixed order, which give the
//! same bits everywhere; positions stay integers there, too. Other floating point stays in [`rig`],
//! in the accumulating half of [`sums`] and in the `solve` functions of [`estimate`], none of which
//! the station runs.
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
