//! What is soldered to the pins of the Olimex STM32-H405, as firmware/README.md wants it.

use crate::chip::fabric::{Fabric, PinChange};
use shared::steps::PortMap;

/// Ports by number.
pub const A: usize = 0;
/// Port B.
pub const B: usize = 1;
/// Port C.
pub const C: usize = 2;

/// A pin: port and number.
pub type Pin = (usize, u8);

/// STEP and DIR, all on port C.
pub const STEPPERS: PortMap = PortMap {
    step: [0, 2, 6],
    dir: [1, 3, 7],
    invert: [false; 3],
};

/// The pins of [`STEPPERS`].
pub const STEPPER_MASK: u16 = 0b1100_1111;

/// Limit switches, negative and positive end of each axis: closed to ground when well.
pub const LIMITS: [[Pin; 2]; 3] = [[(A, 4), (A, 5)], [(A, 6), (A, 7)], [(B, 8), (B, 9)]];

/// The emergency stop: closed to ground when well.
pub const EMERGENCY_STOP: Pin = (B, 13);

/// The emergency stop's second contact: closed to the supply when well. It gates the step timer.
pub const GATE: Pin = (A, 0);

/// The drivers' fault line: nobody drives it when all is well.
pub const DRIVER_FAULT: Pin = (B, 14);

/// The drivers' enable line: low is on.
pub const NOT_ENABLE: Pin = (B, 15);

/// The status LED: low is on.
pub const LED: Pin = (C, 12);

/// A board as it should be wired, all contacts closed.
pub fn well(fabric: &mut Fabric) {
    for (port, pin) in LIMITS.into_iter().flatten().chain([EMERGENCY_STOP]) {
        fabric.drive(port, pin, Some(false));
    }
    let (port, pin) = GATE;
    fabric.drive(port, pin, Some(true));
    let (port, pin) = NOT_ENABLE;
    fabric.ports[port].pull_up(pin);
}

/// An open contact: the input's own resistor pulls it up.
pub fn open(fabric: &mut Fabric, (port, pin): Pin) {
    fabric.drive(port, pin, None);
}

/// A closed one.
pub fn close(fabric: &mut Fabric, (port, pin): Pin) {
    fabric.drive(port, pin, Some(false));
}

/// Changes of the STEP and DIR pins: when, and their levels afterwards.
pub fn stepper_edges(changes: &[PinChange]) -> Vec<(u64, u16)> {
    changes
        .iter()
        .filter(|change| change.port == C && (change.before ^ change.after) & STEPPER_MASK != 0)
        .map(|change| (change.at, change.after & STEPPER_MASK))
        .collect()
}

/// Rising edges of the STEP pins, axis by axis, with DIR low counted backwards, and how many there
/// were.
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
