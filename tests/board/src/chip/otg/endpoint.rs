//! Endpoint of the USB controller, per direction.

use super::Answer;
use std::collections::VecDeque;

/// Transfer completed.
pub const XFRC: u32 = 1;
/// The endpoint was disabled.
const EPDISD: u32 = 1 << 1;
/// The setup stage is done.
pub const STUP: u32 = 1 << 3;
/// The host requested data, and the FIFO did not hold the packet.
const ITTXFE: u32 = 1 << 4;
/// The transmit FIFO is empty.
const TXFE: u32 = 1 << 7;

const USBAEP: u32 = 1 << 15;
const NAKSTS: u32 = 1 << 17;
const STALL: u32 = 1 << 21;
const CNAK: u32 = 1 << 26;
const SNAK: u32 = 1 << 27;
const SD0PID: u32 = 1 << 28;
const SD1PID: u32 = 1 << 29;
const EPDIS: u32 = 1 << 30;
const EPENA: u32 = 1 << 31;
/// Bits that keep the written value.
const PLAIN: u32 = USBAEP | 0x7ff | 3 << 18 | STALL | 0xf << 22;

/// Registers that both directions have in common.
#[derive(Clone, Debug, Default)]
struct Registers {
    ctl: u32,
    interrupt: u32,
    size: u32,
    toggle: bool,
}

impl Registers {
    fn is_active(&self, number: usize) -> bool {
        number == 0 || self.ctl & USBAEP != 0
    }

    fn begin_control(&mut self) {
        self.ctl = (self.ctl | NAKSTS) & !STALL;
        self.toggle = true;
    }

    fn deactivate(&mut self) {
        self.ctl &= !USBAEP;
    }

    /// Returns the largest packet; endpoint 0 has a code for it.
    fn packet_size(&self, number: usize) -> u32 {
        match number {
            0 => 64 >> (self.ctl & 3),
            _ => self.ctl & 0x7ff,
        }
    }

    /// Counts down a packet of the transfer. Returns the number of packets left.
    fn count_down(&mut self, bytes: u32) -> u32 {
        let packets = (self.size >> 19 & 0x3ff).saturating_sub(1);
        let rest = (self.size & 0x7ffff).saturating_sub(bytes);
        self.size = self.size & 0xe000_0000 | packets << 19 | rest;
        packets
    }

    fn read(&self, number: usize, register: u32) -> Option<u32> {
        Some(match register {
            // Endpoint 0 is always active, and shows no toggle.
            0x00 if number == 0 => self.ctl | USBAEP,
            0x00 => self.ctl | u32::from(self.toggle) << 16,
            0x08 => self.interrupt,
            0x10 => self.size,
            _ => return None,
        })
    }

    fn write(&mut self, register: u32, value: u32) -> Option<()> {
        match register {
            0x00 => self.write_control(value),
            0x08 => self.interrupt &= !value,
            0x10 => self.size = value,
            _ => return None,
        }
        Some(())
    }

    fn write_control(&mut self, value: u32) {
        self.ctl = self.ctl & !PLAIN | value & PLAIN;
        if value & SNAK != 0 {
            self.ctl |= NAKSTS;
        }
        if value & CNAK != 0 {
            self.ctl &= !NAKSTS;
        }
        if value & SD0PID != 0 {
            self.toggle = false;
        }
        if value & SD1PID != 0 {
            self.toggle = true;
        }
        if value & EPENA != 0 {
            self.ctl |= EPENA;
        }
        if value & EPDIS != 0 && self.ctl & EPENA != 0 {
            self.ctl &= !EPENA;
            self.interrupt |= EPDISD;
        }
    }
}

/// Endpoint to the host.
#[derive(Clone, Debug, Default)]
pub struct In {
    registers: Registers,
    fifo: VecDeque<u32>,
}

impl In {
    /// Returns true if the endpoint takes part in the bus.
    pub fn is_active(&self, number: usize) -> bool {
        self.registers.is_active(number)
    }

    /// Returns true if the driver ever enabled the endpoint.
    pub fn is_used(&self) -> bool {
        self.registers.ctl & USBAEP != 0
    }

    /// Returns the interrupt register.
    pub fn interrupts(&self) -> u32 {
        self.registers.interrupt | if self.fifo.is_empty() { TXFE } else { 0 }
    }

    /// Handles a SETUP packet.
    pub fn begin_control(&mut self) {
        self.registers.begin_control();
    }

    /// Handles a reset of the bus.
    pub fn deactivate(&mut self) {
        self.registers.deactivate();
    }

    /// Empties the FIFO.
    pub fn flush(&mut self) {
        self.fifo.clear();
    }

    /// Writes a word to the FIFO. Returns false if it is full.
    pub fn load(&mut self, word: u32, depth: u32) -> bool {
        let fits = (self.fifo.len() as u32) < depth;
        if fits {
            self.fifo.push_back(word);
        }
        fits
    }

    /// Answers the host's request for data.
    pub fn give(&mut self, number: usize) -> Answer {
        let registers = &mut self.registers;
        if registers.ctl & STALL != 0 {
            return Answer::Stall;
        }
        let length = (registers.size & 0x7ffff).min(registers.packet_size(number));
        let words = length.div_ceil(4) as usize;
        if registers.ctl & EPENA == 0 || registers.ctl & NAKSTS != 0 || self.fifo.len() < words {
            if self.fifo.is_empty() {
                registers.interrupt |= ITTXFE;
            }
            return Answer::Nak;
        }
        let mut bytes: Vec<u8> = (self.fifo.drain(..words))
            .flat_map(u32::to_le_bytes)
            .collect();
        bytes.truncate(length as usize);
        let toggle = registers.toggle;
        registers.toggle = !toggle;
        if registers.count_down(length) == 0 {
            registers.ctl &= !EPENA;
            registers.interrupt |= XFRC;
        }
        Answer::Data(toggle, bytes)
    }

    /// Reads a register of endpoint `number`, whose FIFO holds `depth` words.
    pub fn read(&self, number: usize, register: u32, depth: u32) -> Option<u32> {
        match register {
            0x08 => Some(self.interrupts()),
            0x18 => Some(depth.saturating_sub(self.fifo.len() as u32)),
            _ => self.registers.read(number, register),
        }
    }

    /// Writes a register.
    pub fn write(&mut self, register: u32, value: u32) -> Option<()> {
        self.registers.write(register, value)
    }
}

/// Endpoint from the host.
#[derive(Clone, Debug, Default)]
pub struct Out {
    registers: Registers,
}

impl Out {
    /// Returns true if the endpoint takes part in the bus.
    pub fn is_active(&self, number: usize) -> bool {
        self.registers.is_active(number)
    }

    /// Returns true if the endpoint stalls.
    pub fn stalls(&self) -> bool {
        self.registers.ctl & STALL != 0
    }

    /// Returns true if the endpoint refuses packets for now.
    pub fn naks(&self) -> bool {
        self.registers.ctl & NAKSTS != 0
    }

    /// Returns the interrupt register.
    pub fn interrupts(&self) -> u32 {
        self.registers.interrupt
    }

    /// Returns the expected toggle.
    pub fn toggle(&self) -> bool {
        self.registers.toggle
    }

    /// Handles a SETUP packet.
    pub fn begin_control(&mut self) {
        self.registers.begin_control();
        let size = self.registers.size;
        let setups = (size >> 29 & 3).saturating_sub(1);
        self.registers.size = size & 0x1fff_ffff | setups << 29;
    }

    /// Handles a reset of the bus.
    pub fn deactivate(&mut self) {
        self.registers.deactivate();
    }

    /// Takes a packet. Returns true if it ends the transfer; the endpoint then refuses more.
    pub fn take(&mut self, number: usize, bytes: u32) -> bool {
        let registers = &mut self.registers;
        registers.toggle = !registers.toggle;
        let left = registers.count_down(bytes);
        let done = left == 0 || bytes < registers.packet_size(number);
        if done {
            registers.ctl |= NAKSTS;
        }
        done
    }

    /// Ends a transfer or a setup stage when its entry was read from the FIFO.
    pub fn finish(&mut self, interrupt: u32) {
        self.registers.interrupt |= interrupt;
        self.registers.ctl &= !EPENA;
    }

    /// Reads a register of endpoint `number`.
    pub fn read(&self, number: usize, register: u32) -> Option<u32> {
        self.registers.read(number, register)
    }

    /// Writes a register.
    pub fn write(&mut self, register: u32, value: u32) -> Option<()> {
        self.registers.write(register, value)
    }
}
