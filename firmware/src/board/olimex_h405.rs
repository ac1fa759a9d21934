//! Olimex STM32-H405: a plain STM32F405RG with all pins on two headers.

pub use super::plain_f405::{DRIVERS, STEP_PORT, assign};
use super::{Gate, Line};
use embassy_stm32::pac;
use trinocular_core::steps::PortMap;

/// Name of the board in hello.
pub const NAME: &str = "olimex-h405";

/// Frequency of the crystal, Hz.
pub const CRYSTAL_HZ: u32 = 8_000_000;

/// STEP and DIR on port C. The host's configuration states which axes are inverted.
pub const STEP_PINS: PortMap = PortMap {
    step: [0, 2, 6],
    dir: [1, 3, 7],
    invert: [false; 3],
};

/// Camera pin, PC8 of the step port.
pub const CAMERA_PIN: Option<u8> = Some(8);

/// Second contact of the emergency stop, between PA0 and 3.3 V, because the board's own push button
/// has a pull-down at PA0. An open contact or a cut wire reads low.
pub const GATE: Option<Gate> = Some(Gate { active_high: true });

/// Status LED of the board, PC12, to the supply.
pub const LED: Line = Line {
    port: pac::GPIOC,
    pin: 12,
    active_high: false,
};
