//! Independent watchdog (RM0090 chapter 21), on its own oscillator.

use crate::time::Beats;

/// Periods of the oscillator for copying a register into its domain, at most.
const SYNC: Beats = 5;

/// Registers of the watchdog.
#[derive(Clone, Debug)]
pub struct Iwdg {
    /// Period of the low-speed oscillator.
    lsi: Beats,
    prescaler: u32,
    reload: u32,
    unlocked: bool,
    /// Moments at which the copies of PR and RLR are complete.
    busy: [Beats; 2],
    /// Moment of the start or of the last feeding; `None` before the start.
    fed: Option<Beats>,
}

impl Iwdg {
    /// Creates a watchdog that is not started, with an oscillator of `lsi_hz`.
    pub fn new(lsi_hz: u64) -> Self {
        Self {
            lsi: 336_000_000 / lsi_hz,
            prescaler: 0,
            reload: 0xfff,
            unlocked: false,
            busy: [0; 2],
            fed: None,
        }
    }

    /// Returns true if the watchdog runs; only a reset stops it.
    pub fn started(&self) -> bool {
        self.fed.is_some()
    }

    /// Returns the time from feeding to the reset.
    pub fn patience(&self) -> Beats {
        self.lsi * (4 << self.prescaler.min(6)) * (Beats::from(self.reload) + 1)
    }

    /// Returns the moment at which the watchdog resets the chip.
    pub fn next(&self) -> Option<Beats> {
        self.fed.map(|fed| fed + self.patience())
    }

    /// Reads a register, or returns `None` where there is none.
    pub fn read(&self, offset: u32, now: Beats) -> Option<u32> {
        Some(match offset {
            0x00 => 0,
            0x04 => self.prescaler,
            0x08 => self.reload,
            0x0c => u32::from(self.busy[0] > now) | u32::from(self.busy[1] > now) << 1,
            _ => return None,
        })
    }

    /// Writes a register. Returns `None` where there is none, for a locked register, and for one
    /// that is still being copied.
    pub fn write(&mut self, offset: u32, value: u32, now: Beats) -> Option<()> {
        match (offset, value) {
            (0x00, 0x5555) => self.unlocked = true,
            (0x00, 0xaaaa) => {
                self.unlocked = false;
                self.fed = self.fed.map(|_| now);
            }
            (0x00, 0xcccc) => {
                self.unlocked = false;
                self.fed = Some(now);
            }
            (0x04, _) if self.unlocked && self.busy[0] <= now => {
                self.prescaler = value & 7;
                self.busy[0] = now + SYNC * self.lsi;
            }
            (0x08, _) if self.unlocked && self.busy[1] <= now => {
                self.reload = value & 0xfff;
                self.busy[1] = now + SYNC * self.lsi;
            }
            _ => return None,
        }
        Some(())
    }
}
