//! Adafruit Feather STM32F405 Express: a plain STM32F405RG. Names on its silk screen are in
//! brackets.

pub use super::plain_f405::{DRIVERS, STEP_PORT, assign};
use super::{Gate, Line};
use embassy_stm32::pac;
use trinocular_core::steps::PortMap;

/// Name of the board in hello.
pub const NAME: &str = "feather-f405";

/// Frequency of the crystal, Hz.
pub const CRYSTAL_HZ: u32 = 12_000_000;

/// STEP on PC2 [12], PC4 [A4], PC6 [6]; DIR on PC3 [11], PC5 [A5], PC7 [5]. The host's
/// configuration states which axes are inverted.
pub const STEP_PINS: PortMap = PortMap {
    step: [2, 4, 6],
    dir: [3, 5, 7],
    invert: [false; 3],
};

/// No camera pin, because STEP, DIR and the LED take all pins of the step port on the headers.
pub const CAMERA_PIN: Option<u8> = None;

/// No gate, because PA0 is not on the board's headers.
pub const GATE: Option<Gate> = None;

/// Red LED of the board, PC1 [13].
pub const LED: Line = Line {
    port: pac::GPIOC,
    pin: 1,
    active_high: true,
};
