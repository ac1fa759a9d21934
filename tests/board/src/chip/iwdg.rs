//! The independent watchdog (RM0090 chapter 21), on its own oscillator.

use crate::time::Beats;

/// Copying a register into the oscillator's domain takes up to five of its periods.
const SYNC: Beats = 5;

/// The registers.
#[derive(Clone, Debug)]
pub struct Iwdg {
    /// A period of the low-speed oscillator.
    lsi: Beats,
    prescaler: u32,
    reload: u32,
    unlocked: bool,
    /// When PR and RLR are copied.
    busy: [Beats; 2],
    /// When it started or was last fed; `None` before the start.
    fed: Option<Beats>,
}

impl Iwdg {
    /// Not started, on an oscillator of so many hertz.
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

    /// Whether it runs: nothing but a reset stops it.
    pub fn started(&self) -> bool {
        self.fed.is_some()
    }

    /// From feeding to the reset.
    pub fn patience(&self) -> Beats {
        self.lsi * (4 << self.prescaler.min(6)) * (Beats::from(self.reload) + 1)
    }

    /// When it resets the chip.
    pub fn next(&self) -> Option<Beats> {
        self.fed.map(|fed| fed + self.patience())
    }

    /// A register; `None` where there is none.
    pub fn read(&self, offset: u32, now: Beats) -> Option<u32> {
        Some(match offset {
            0x00 => 0,
            0x04 => self.prescaler,
            0x08 => self.reload,
            0x0c => u32::from(self.busy[0] > now) | u32::from(self.busy[1] > now) << 1,
            _ => return None,
        })
    }

    /// Writes a register; `None` where there is none, for a register that is locked, and for one
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
