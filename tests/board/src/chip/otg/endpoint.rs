//! One endpoint of the USB controller, each way.

use super::Answer;
use std::collections::VecDeque;

/// Transfer completed.
pub const XFRC: u32 = 1;
/// The endpoint was disabled.
const EPDISD: u32 = 1 << 1;
/// The setup stage is done.
pub const STUP: u32 = 1 << 3;
/// The host asked, and the FIFO did not hold the packet.
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
/// Bits that keep what is written.
const PLAIN: u32 = USBAEP | 0x7ff | 3 << 18 | STALL | 0xf << 22;

/// The packet size of an endpoint; endpoint 0 has a code for it.
fn packet_size(ctl: u32, number: usize) -> u32 {
    match number {
        0 => 64 >> (ctl & 3),
        _ => ctl & 0x7ff,
    }
}

/// What writing a control register does, the same both ways. Returns true if the endpoint was disabled.
fn write_control(ctl: &mut u32, toggle: &mut bool, value: u32) -> bool {
    *ctl = *ctl & !PLAIN | value & PLAIN;
    if value & SNAK != 0 {
        *ctl |= NAKSTS;
    }
    if value & CNAK != 0 {
        *ctl &= !NAKSTS;
    }
    if value & SD0PID != 0 {
        *toggle = false;
    }
    if value & SD1PID != 0 {
        *toggle = true;
    }
    if value & EPENA != 0 {
        *ctl |= EPENA;
    }
    let disabled = value & EPDIS != 0 && *ctl & EPENA != 0;
    if disabled {
        *ctl &= !EPENA;
    }
    disabled
}

/// Size and packets of a transfer, less one packet.
fn count_down(size: &mut u32, bytes: u32) -> u32 {
    let packets = (*size >> 19 & 0x3ff).saturating_sub(1);
    let rest = (*size & 0x7ffff).saturating_sub(bytes);
    *size = *size & 0xe000_0000 | packets << 19 | rest;
    packets
}

/// To the host.
#[derive(Clone, Debug, Default)]
pub struct In {
    ctl: u32,
    interrupt: u32,
    size: u32,
    toggle: bool,
    fifo: VecDeque<u32>,
}

impl In {
    /// Whether it takes part in the bus.
    pub fn is_active(&self, number: usize) -> bool {
        number == 0 || self.ctl & USBAEP != 0
    }

    /// Whether the driver ever enabled it.
    pub fn is_used(&self) -> bool {
        self.ctl & USBAEP != 0
    }

    /// Its interrupt register.
    pub fn interrupts(&self) -> u32 {
        self.interrupt | if self.fifo.is_empty() { TXFE } else { 0 }
    }

    /// A SETUP packet came.
    pub fn begin_control(&mut self) {
        self.ctl = (self.ctl | NAKSTS) & !STALL;
        self.toggle = true;
    }

    /// The bus was reset.
    pub fn deactivate(&mut self) {
        self.ctl &= !USBAEP;
    }

    /// Empties the FIFO.
    pub fn flush(&mut self) {
        self.fifo.clear();
    }

    /// A word into the FIFO. False when it is full.
    pub fn load(&mut self, word: u32, depth: u32) -> bool {
        let fits = (self.fifo.len() as u32) < depth;
        if fits {
            self.fifo.push_back(word);
        }
        fits
    }

    /// The host asks.
    pub fn give(&mut self, number: usize) -> Answer {
        if self.ctl & STALL != 0 {
            return Answer::Stall;
        }
        let length = (self.size & 0x7ffff).min(packet_size(self.ctl, number));
        let words = length.div_ceil(4) as usize;
        if self.ctl & EPENA == 0 || self.ctl & NAKSTS != 0 || self.fifo.len() < words {
            if self.fifo.is_empty() {
                self.interrupt |= ITTXFE;
            }
            return Answer::Nak;
        }
        let mut bytes: Vec<u8> = (self.fifo.drain(..words))
            .flat_map(u32::to_le_bytes)
            .collect();
        bytes.truncate(length as usize);
        let toggle = self.toggle;
        self.toggle = !toggle;
        if count_down(&mut self.size, length) == 0 {
            self.ctl &= !EPENA;
            self.interrupt |= XFRC;
        }
        Answer::Data(toggle, bytes)
    }

    /// A register of endpoint `number`, whose FIFO has so many words.
    pub fn read(&self, number: usize, register: u32, depth: u32) -> Option<u32> {
        Some(match register {
            0x00 => control(self.ctl, self.toggle, number),
            0x08 => self.interrupts(),
            0x10 => self.size,
            0x18 => depth.saturating_sub(self.fifo.len() as u32),
            _ => return None,
        })
    }

    /// Writes a register.
    pub fn write(&mut self, register: u32, value: u32) -> Option<()> {
        match register {
            0x00 => {
                if write_control(&mut self.ctl, &mut self.toggle, value) {
                    self.interrupt |= EPDISD;
                }
            }
            0x08 => self.interrupt &= !value,
            0x10 => self.size = value,
            _ => return None,
        }
        Some(())
    }
}

fn control(ctl: u32, toggle: bool, number: usize) -> u32 {
    // Endpoint 0 is always active.
    ctl | if number == 0 {
        USBAEP
    } else {
        u32::from(toggle) << 16
    }
}

/// From the host.
#[derive(Clone, Debug, Default)]
pub struct Out {
    ctl: u32,
    /// Its interrupt register.
    pub interrupt: u32,
    size: u32,
    /// The toggle it expects.
    pub toggle: bool,
}

impl Out {
    /// Whether it takes part in the bus.
    pub fn is_active(&self, number: usize) -> bool {
        number == 0 || self.ctl & USBAEP != 0
    }

    /// Whether it stalls.
    pub fn stalls(&self) -> bool {
        self.ctl & STALL != 0
    }

    /// Whether it refuses packets for now.
    pub fn naks(&self) -> bool {
        self.ctl & NAKSTS != 0
    }

    /// A SETUP packet came.
    pub fn begin_control(&mut self) {
        self.ctl = (self.ctl | NAKSTS) & !STALL;
        self.toggle = true;
        let setups = (self.size >> 29 & 3).saturating_sub(1);
        self.size = self.size & 0x1fff_ffff | setups << 29;
    }

    /// The bus was reset.
    pub fn deactivate(&mut self) {
        self.ctl &= !USBAEP;
    }

    /// A packet is taken. True when that ends the transfer; the endpoint then refuses more.
    pub fn take(&mut self, number: usize, bytes: u32) -> bool {
        self.toggle = !self.toggle;
        let left = count_down(&mut self.size, bytes);
        let done = left == 0 || bytes < packet_size(self.ctl, number);
        if done {
            self.ctl |= NAKSTS;
        }
        done
    }

    /// The end of a transfer or of a setup stage was read from the FIFO.
    pub fn finish(&mut self, interrupt: u32) {
        self.interrupt |= interrupt;
        self.ctl &= !EPENA;
    }

    /// A register of endpoint `number`.
    pub fn read(&self, number: usize, register: u32) -> Option<u32> {
        Some(match register {
            0x00 => control(self.ctl, self.toggle, number),
            0x08 => self.interrupt,
            0x10 => self.size,
            _ => return None,
        })
    }

    /// Writes a register.
    pub fn write(&mut self, register: u32, value: u32) -> Option<()> {
        match register {
            0x00 => {
                if write_control(&mut self.ctl, &mut self.toggle, value) {
                    self.interrupt |= EPDISD;
                }
            }
            0x08 => self.interrupt &= !value,
            0x10 => self.size = value,
            _ => return None,
        }
        Some(())
    }
}
