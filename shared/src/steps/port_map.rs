//! Pins of the step port, and the refusal of pins that cannot be.

use core::fmt;

use super::AXES;

/// Pins of the port (0-15) that carry the signals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortMap {
    /// STEP pin of each axis; a rising edge makes a step.
    pub step: [u8; AXES],
    /// DIR pin of each axis; high is forwards.
    pub dir: [u8; AXES],
    /// Axes whose DIR is low forwards.
    pub invert: [bool; AXES],
}

/// Reason to refuse a [`PortMap`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortFault {
    /// The port has no such pin: its pins are 0 to 15.
    NoSuchPin(u8),
    /// Two signals share this pin.
    PinTwice(u8),
}

impl fmt::Display for PortFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSuchPin(pin) => write!(f, "pin {pin} is not one of 0..15"),
            Self::PinTwice(pin) => write!(f, "pin {pin} carries two signals"),
        }
    }
}

impl core::error::Error for PortFault {}
