//! Output pins.

use crate::board::{CAMERA_PIN, DRIVERS, GATE, LED, Line, STEP_PINS, STEP_PORT};
use embassy_stm32::pac;
use embassy_stm32::pac::gpio::vals::{Moder, Ospeedr, Pupdr};

/// Idle word: lowers every STEP pin and does nothing else. The pins get it while there is no
/// motion.
pub const IDLE_WORD: u32 =
    (1 << STEP_PINS.step[0] | 1 << STEP_PINS.step[1] | 1 << STEP_PINS.step[2]) << 16;

/// Pin of TIM8_ETR, on port A.
const GATE_PIN: usize = 0;

/// Alternate function of the gate's pin (data sheet, "Alternate function mapping").
const TIM8_FUNCTION: u8 = 3;

/// Configures STEP, DIR, the camera pin, the drivers' enable lines and the LED as outputs: STEP and
/// camera low, drivers off, LED off. Connects the gate's pin to the step timer.
pub fn prepare() {
    for line in DRIVERS.iter().chain([&LED]) {
        set(*line, false);
        // The slowest edges: an enable line needs no faster ones, and PC13 to PC15 allow none.
        output(*line, Ospeedr::LOW_SPEED);
    }
    STEP_PORT.bsrr().write(|w| w.0 = IDLE_WORD);
    let stepper = STEP_PINS.step.into_iter().chain(STEP_PINS.dir);
    for pin in stepper.chain(CAMERA_PIN) {
        let line = Line {
            port: STEP_PORT,
            pin,
            active_high: true,
        };
        // 50 MHz class at most: edges of some ns suffice for STEP and radiate less.
        output(line, Ospeedr::MEDIUM_SPEED);
    }
    if let Some(gate) = GATE {
        let pull = if gate.active_high {
            Pupdr::PULL_DOWN
        } else {
            Pupdr::PULL_UP
        };
        pac::GPIOA.pupdr().modify(|w| w.set_pupdr(GATE_PIN, pull));
        pac::GPIOA
            .afr(0)
            .modify(|w| w.set_afr(GATE_PIN, TIM8_FUNCTION));
        pac::GPIOA
            .moder()
            .modify(|w| w.set_moder(GATE_PIN, Moder::ALTERNATE));
    }
}

/// Returns true if the board has a gate and it stops the step timer.
pub fn gate_is_open() -> bool {
    GATE.is_some_and(|gate| {
        let high = pac::GPIOA.idr().read().idr(GATE_PIN) == pac::gpio::vals::Idr::HIGH;
        high != gate.active_high
    })
}

fn output(line: Line, speed: Ospeedr) {
    let pin = usize::from(line.pin & 15);
    line.port.ospeedr().modify(|w| w.set_ospeedr(pin, speed));
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
