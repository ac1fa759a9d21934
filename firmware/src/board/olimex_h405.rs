//! A plain STM32F405RG: Olimex STM32-H405, all pins on its two headers.

pub use super::plain_f405::{DRIVERS, STEP_PORT, assign};
use super::{Gate, Line};
use embassy_stm32::pac;
use shared::steps::PortMap;

/// As hello reports it.
pub const NAME: &str = "olimex-h405";

/// The crystal.
pub const CRYSTAL_HZ: u32 = 8_000_000;

/// STEP and DIR on port C. The host's configuration says which axes are inverted.
pub const STEP_PINS: PortMap = PortMap {
    step: [0, 2, 6],
    dir: [1, 3, 7],
    invert: [false; 3],
};

/// The emergency stop's second contact, between PA0 and 3.3 V: the board's own push button has PA0
/// pulled down. Open, or cut, is low.
pub const GATE: Option<Gate> = Some(Gate { active_high: true });

/// Status LED of the board, PC12, to the supply.
pub const LED: Line = Line {
    port: pac::GPIOC,
    pin: 12,
    active_high: false,
};
