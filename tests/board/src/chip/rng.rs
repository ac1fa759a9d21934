//! Random number generator (RM0090 chapter 24): a word per 40 periods of the 48 MHz clock, here
//! from a seed.

use crate::time::{Beats, period};
use trinocular_rig::random::Random;

const RNGEN: u32 = 1 << 2;
const IE: u32 = 1 << 3;

/// The registers.
#[derive(Debug)]
pub struct Rng {
    cr: u32,
    ready: Beats,
    source: Random,
}

impl Rng {
    /// Creates the state after a reset.
    pub fn new(seed: u64) -> Self {
        Self {
            cr: 0,
            ready: Beats::MAX,
            source: Random::seeded(seed),
        }
    }

    /// Resets the registers; the noise source continues.
    pub fn reset(&mut self) {
        (self.cr, self.ready) = (0, Beats::MAX);
    }

    /// Returns true if the interrupt line is active.
    pub fn interrupts(&self, now: Beats) -> bool {
        self.cr & IE != 0 && self.ready <= now
    }

    /// Returns the moment of the next word, if the program waits for it.
    pub fn next(&self, now: Beats) -> Option<Beats> {
        (self.cr & IE != 0 && self.ready > now && self.ready != Beats::MAX).then_some(self.ready)
    }

    /// Reads a register, or returns `None` where there is none.
    pub fn read(&mut self, offset: u32, now: Beats) -> Option<u32> {
        Some(match offset {
            0x00 => self.cr,
            0x04 => u32::from(self.ready <= now),
            0x08 if self.ready <= now => {
                self.ready = now + 40 * period(48_000_000);
                self.source.next_u64() as u32
            }
            0x08 => 0,
            _ => return None,
        })
    }

    /// Writes a register, or returns `None` where there is none.
    pub fn write(&mut self, offset: u32, value: u32, now: Beats) -> Option<()> {
        match offset {
            0x00 => {
                self.ready = match (self.cr & RNGEN != 0, value & RNGEN != 0) {
                    (_, false) => Beats::MAX,
                    (false, true) => now + 40 * period(48_000_000),
                    (true, true) => self.ready,
                };
                self.cr = value;
            }
            0x04 => {}
            _ => return None,
        }
        Some(())
    }
}
