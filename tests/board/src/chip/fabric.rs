//! Pins and memory, which both the processor and the DMA reach. Every change of a pin is recorded
//! with its moment.

use super::dma::Bus;
use super::exti::Exti;
use super::gpio::Port;
use crate::time::Beats;
use rsemu::core::space::RamStore;
use rsemu::core::value::{Endian, Width};
use std::sync::Arc;

/// Ports A to I.
pub const PORTS: usize = 9;

/// Address of SRAM.
pub const RAM_BASE: u32 = 0x2000_0000;

/// Length of SRAM1 and SRAM2, bytes.
pub const RAM_LEN: u32 = 128 * 1024;

const GPIO_BASE: u32 = 0x4002_0000;

/// Change of a port's pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinChange {
    /// Moment of the change.
    pub at: Beats,
    /// Number of the port: A is 0.
    pub port: usize,
    /// Levels before.
    pub before: u16,
    /// Levels after.
    pub after: u16,
}

/// Ports, external interrupts and memory.
#[derive(Debug)]
pub struct Fabric {
    /// The present moment.
    pub now: Beats,
    /// Ports A to I.
    pub ports: [Port; PORTS],
    /// External interrupts.
    pub exti: Exti,
    /// SRAM.
    pub ram: Arc<RamStore>,
    /// Changes of the pins.
    pub changes: Vec<PinChange>,
}

impl Fabric {
    /// Creates ports without any wire.
    pub fn new(ram: Arc<RamStore>) -> Self {
        Self {
            now: 0,
            ports: std::array::from_fn(Port::new),
            exti: Exti::default(),
            ram,
            changes: Vec::new(),
        }
    }

    /// Changes a port, records the changes of its pins, and passes them to the external interrupts.
    fn change<T>(&mut self, port: usize, act: impl FnOnce(&mut Port) -> T) -> T {
        let before = self.ports[port].levels();
        let result = act(&mut self.ports[port]);
        let after = self.ports[port].levels();
        if before != after {
            self.exti.edges(port, before, after);
            self.changes.push(PinChange {
                at: self.now,
                port,
                before,
                after,
            });
        }
        result
    }

    /// Writes a register of a port.
    pub fn write_port(&mut self, port: usize, offset: u32, value: u32) -> Option<()> {
        self.change(port, |port| port.write(offset, value))
    }

    /// Drives a pin from outside, or (`None`) releases it.
    pub fn drive(&mut self, port: usize, pin: u8, level: Option<bool>) {
        self.change(port, |port| port.wire(pin, level));
    }

    /// Resets one port.
    pub fn reset_port(&mut self, port: usize) {
        self.change(port, |pins| pins.reset(port));
    }

    /// Resets the chip. The wires outside stay.
    pub fn reset(&mut self) {
        self.exti = Exti::default();
        for port in 0..PORTS {
            self.reset_port(port);
        }
        self.exti = Exti::default();
    }
}

impl Bus for Fabric {
    fn load(&mut self, address: u32) -> Option<u32> {
        match address {
            RAM_BASE.. if address < RAM_BASE + RAM_LEN => {
                let at = u64::from(address - RAM_BASE);
                let word = self.ram.read_value(at, Width::U32, Endian::Little);
                word.ok().map(|word| word as u32)
            }
            _ => None,
        }
    }

    fn store(&mut self, address: u32, value: u32) -> Option<()> {
        match address {
            RAM_BASE.. if address < RAM_BASE + RAM_LEN => {
                let at = u64::from(address - RAM_BASE);
                let done = (self.ram).write_value(at, Width::U32, u64::from(value), Endian::Little);
                done.ok()
            }
            GPIO_BASE.. if address < GPIO_BASE + 0x400 * PORTS as u32 => {
                let port = (address - GPIO_BASE) / 0x400;
                self.write_port(port as usize, address & 0x3ff, value)
            }
            _ => None,
        }
    }
}
