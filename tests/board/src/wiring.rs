//! Wiring of the Olimex STM32-H405, as firmware/README.md describes it.

use crate::chip::fabric::{Fabric, PinChange};
use trinocular_core::steps::PortMap;

/// Port A.
pub const A: usize = 0;
/// Port B.
pub const B: usize = 1;
/// Port C.
pub const C: usize = 2;

/// Pin: port and number.
pub type Pin = (usize, u8);

/// STEP and DIR, all on port C.
pub const STEPPERS: PortMap = PortMap {
    step: [0, 2, 6],
    dir: [1, 3, 7],
    invert: [false; 3],
};

/// The pins of [`STEPPERS`].
pub const STEPPER_MASK: u16 = 0b1100_1111;

/// Camera pin, on port C.
pub const CAMERA_PIN: u8 = 8;

/// Limit switches, negative and positive end of each axis: closed to ground in the normal state.
pub const LIMITS: [[Pin; 2]; 3] = [[(A, 4), (A, 5)], [(A, 6), (A, 7)], [(B, 8), (B, 9)]];

/// Emergency stop: closed to ground in the normal state.
pub const EMERGENCY_STOP: Pin = (B, 13);

/// Second contact of the emergency stop: closed to the supply in the normal state. It gates the
/// step timer.
pub const GATE: Pin = (A, 0);

/// Fault line of the drivers: undriven in the normal state.
pub const DRIVER_FAULT: Pin = (B, 14);

/// Enable line of the drivers: low is on.
pub const NOT_ENABLE: Pin = (B, 15);

/// Status LED: low is on.
pub const LED: Pin = (C, 12);

/// Wires a board correctly, all contacts closed.
pub fn well(fabric: &mut Fabric) {
    for (port, pin) in LIMITS.into_iter().flatten().chain([EMERGENCY_STOP]) {
        fabric.drive(port, pin, Some(false));
    }
    let (port, pin) = GATE;
    fabric.drive(port, pin, Some(true));
    let (port, pin) = NOT_ENABLE;
    fabric.ports[port].pull_up(pin);
}

/// Opens a contact: the input's own resistor pulls it up.
pub fn open(fabric: &mut Fabric, (port, pin): Pin) {
    fabric.drive(port, pin, None);
}

/// Closes a contact.
pub fn close(fabric: &mut Fabric, (port, pin): Pin) {
    fabric.drive(port, pin, Some(false));
}

/// Returns the changes of the STEP and DIR pins: moments, and levels afterwards.
pub fn stepper_edges(changes: &[PinChange]) -> Vec<(u64, u16)> {
    changes
        .iter()
        .filter(|change| change.port == C && (change.before ^ change.after) & STEPPER_MASK != 0)
        .map(|change| (change.at, change.after & STEPPER_MASK))
        .collect()
}

/// Returns the steps of each axis, with DIR low counted backwards, and the total number of rising
/// edges.
pub fn steps(edges: &[(u64, u16)]) -> ([i64; 3], u64) {
    let (mut steps, mut count, mut before) = ([0; 3], 0, 0);
    for (_, after) in edges {
        let pins = STEPPERS.step.into_iter().zip(STEPPERS.dir);
        for ((step, dir), steps) in pins.zip(&mut steps) {
            if !before & after & 1 << step != 0 {
                count += 1;
                *steps += if after & 1 << dir != 0 { 1 } else { -1 };
            }
        }
        before = *after;
    }
    (steps, count)
}
