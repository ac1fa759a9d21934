//! Output pins.

use crate::board::{DRIVERS, LED, Line, STEP_PINS, STEP_PORT};
use embassy_stm32::pac::gpio::vals::{Moder, Ospeedr};

/// The word that lowers every STEP pin and does nothing else: what the pins get when there is no motion.
pub const IDLE_WORD: u32 =
    (1 << STEP_PINS.step[0] | 1 << STEP_PINS.step[1] | 1 << STEP_PINS.step[2]) << 16;

/// Makes outputs of STEP, DIR, the drivers' enable lines and the LED: STEP low, drivers off, LED off.
pub fn prepare() {
    for line in DRIVERS.iter().chain([&LED]) {
        set(*line, false);
        output(*line);
    }
    STEP_PORT.bsrr().write(|w| w.0 = IDLE_WORD);
    for pin in STEP_PINS.step.into_iter().chain(STEP_PINS.dir) {
        output(Line {
            port: STEP_PORT,
            pin,
            active_high: true,
        });
    }
}

fn output(line: Line) {
    let pin = usize::from(line.pin & 15);
    // 50 MHz class at most: edges of some ns suffice for STEP and radiate less.
    line.port
        .ospeedr()
        .modify(|w| w.set_ospeedr(pin, Ospeedr::MEDIUM_SPEED));
    line.port
        .moder()
        .modify(|w| w.set_moder(pin, Moder::OUTPUT));
}

/// Switches an output on or off.
pub fn set(line: Line, on: bool) {
    let high = on == line.active_high;
    let bit = 1 << (line.pin & 15);
    line.port
        .bsrr()
        .write(|w| w.0 = if high { bit } else { bit << 16 });
}

/// Switches the drivers' enable lines.
pub fn set_drivers(on: bool) {
    for line in DRIVERS {
        set(*line, on);
    }
}
