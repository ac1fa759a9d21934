//! Everything between the serial port and the step pins.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod estimate;
pub mod fixed;
pub mod frame;
pub mod motion;
pub mod rig;
pub mod steps;
pub mod sums;
