//! Reset and clock control (RM0090 chapter 7): oscillators with their start-up times, the PLL, the
//! clock tree, enables and resets.

use crate::time::{Beats, US};

/// Start-up time of a crystal (data sheet, typical).
const HSE_START: Beats = 2_000 * US;

/// Lock time of the PLL (data sheet, minimum).
const PLL_LOCK: Beats = 75 * US;

/// Start-up time of the low-speed oscillator (data sheet, typical).
const LSI_START: Beats = 15 * US;

const HSION: u32 = 1;
const HSEON: u32 = 1 << 16;
const PLLON: u32 = 1 << 24;

/// Reset flags of CSR.
pub mod flag {
    /// Brown-out or power-on.
    pub const BROWN_OUT: u32 = 1 << 25;
    /// Reset pin, which any reset drives.
    pub const PIN: u32 = 1 << 26;
    /// Power-on.
    pub const POWER_ON: u32 = 1 << 27;
    /// Software reset.
    pub const SOFTWARE: u32 = 1 << 28;
    /// Independent watchdog.
    pub const WATCHDOG: u32 = 1 << 29;
}

/// Clock frequencies, Hz; 0 is off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clocks {
    /// Processor, memories, DMA, GPIO.
    pub hclk: u64,
    /// Slow peripherals.
    pub pclk1: u64,
    /// Fast peripherals.
    pub pclk2: u64,
    /// Timers on APB1.
    pub timer1: u64,
    /// Timers on APB2.
    pub timer2: u64,
    /// USB and random numbers.
    pub usb: u64,
}

/// The registers.
#[derive(Clone, Debug)]
pub struct Rcc {
    cr: u32,
    /// PLL factors.
    pub pllcfgr: u32,
    /// Switches and prescalers.
    pub cfgr: u32,
    csr: u32,
    bdcr: u32,
    /// Registers of AHB1, AHB2, AHB3, APB1, APB2: reset, enable, enable in sleep.
    reset: [u32; 5],
    enable: [u32; 5],
    sleep: [u32; 5],
    crystal_hz: u64,
    /// Moments at which HSE, PLL and LSI are ready, if they are switched on.
    ready: [Beats; 3],
}

/// Bus and bit of a peripheral.
pub type Gate = (usize, u32);

impl Rcc {
    /// Creates the state after a reset with these flags.
    pub fn new(crystal_hz: u64, flags: u32) -> Self {
        Self {
            cr: 0x83,
            pllcfgr: 0x2400_3010,
            cfgr: 0,
            csr: flags,
            bdcr: 0,
            reset: [0; 5],
            enable: [0x0010_0000, 0, 0, 0, 0],
            sleep: [0x7e67_91ff, 0xf1, 1, 0x36fe_c9ff, 0x0007_5f33],
            crystal_hz,
            ready: [Beats::MAX; 3],
        }
    }

    /// Returns the flags of the reset's cause.
    pub fn flags(&self) -> u32 {
        self.csr & 0xfe00_0000
    }

    /// Returns true if a peripheral has its clock and is not held in reset.
    pub fn runs(&self, (bus, bit): Gate) -> bool {
        self.enable[bus] & !self.reset[bus] & 1 << bit != 0
    }

    /// Returns true if a peripheral is held in reset.
    pub fn holds(&self, (bus, bit): Gate) -> bool {
        self.reset[bus] & 1 << bit != 0
    }

    fn is_ready(&self, which: usize, now: Beats) -> bool {
        self.ready[which] <= now
    }

    fn vco(&self) -> u64 {
        let source = if self.pllcfgr & 1 << 22 != 0 {
            self.crystal_hz
        } else {
            16_000_000
        };
        let (m, n) = (self.pllcfgr & 0x3f, self.pllcfgr >> 6 & 0x1ff);
        source / u64::from(m.max(1)) * u64::from(n)
    }

    /// Returns the clock tree that the registers describe.
    pub fn clocks(&self, now: Beats) -> Clocks {
        let vco = match self.is_ready(1, now) {
            true => self.vco(),
            false => 0,
        };
        let sys = match self.cfgr & 3 {
            0 => 16_000_000,
            1 => self.crystal_hz,
            _ => vco / (u64::from(self.pllcfgr >> 16 & 3) * 2 + 2),
        };
        let hclk = match self.cfgr >> 4 & 0xf {
            n @ 8..=11 => sys >> (n - 7),
            n @ 12..=15 => sys >> (n - 6),
            _ => sys,
        };
        let apb = |shift: u32| match self.cfgr >> shift & 7 {
            n @ 4..=7 => (hclk >> (n - 3), (hclk >> (n - 3)) * 2),
            _ => (hclk, hclk),
        };
        let ((pclk1, timer1), (pclk2, timer2)) = (apb(10), apb(13));
        Clocks {
            hclk,
            pclk1,
            pclk2,
            timer1,
            timer2,
            usb: vco / u64::from((self.pllcfgr >> 24 & 0xf).max(2)),
        }
    }

    /// Reads a register, or returns `None` where there is none.
    pub fn read(&self, offset: u32, now: Beats) -> Option<u32> {
        Some(match offset {
            0x00 => {
                let ready = |which, bit: u32| u32::from(self.is_ready(which, now)) << bit;
                let hsi = (self.cr & HSION) << 1;
                self.cr & !0x0202_0002 | hsi | ready(0, 17) | ready(1, 25)
            }
            0x04 => self.pllcfgr,
            // The switch follows at once.
            0x08 => self.cfgr & !0xc | (self.cfgr & 3) << 2,
            0x0c => 0,
            0x10..=0x18 => self.reset[(offset as usize - 0x10) / 4],
            0x20 | 0x24 => self.reset[3 + (offset as usize - 0x20) / 4],
            0x30..=0x38 => self.enable[(offset as usize - 0x30) / 4],
            0x40 | 0x44 => self.enable[3 + (offset as usize - 0x40) / 4],
            0x50..=0x58 => self.sleep[(offset as usize - 0x50) / 4],
            0x60 | 0x64 => self.sleep[3 + (offset as usize - 0x60) / 4],
            0x70 => self.bdcr,
            0x74 => self.csr & !2 | u32::from(self.is_ready(2, now)) << 1,
            _ => return None,
        })
    }

    /// Writes a register, or returns `None` where there is none.
    pub fn write(&mut self, offset: u32, value: u32, now: Beats) -> Option<()> {
        match offset {
            0x00 => {
                for (which, bit, time) in [(0, HSEON, HSE_START), (1, PLLON, PLL_LOCK)] {
                    match (self.cr & bit != 0, value & bit != 0) {
                        (false, true) => self.ready[which] = now + time,
                        (true, false) => self.ready[which] = Beats::MAX,
                        _ => {}
                    }
                }
                self.cr = value & !0x0202_0002;
            }
            0x04 => self.pllcfgr = value,
            0x08 => self.cfgr = value & !0xc,
            0x0c => {}
            0x10..=0x18 => self.reset[(offset as usize - 0x10) / 4] = value,
            0x20 | 0x24 => self.reset[3 + (offset as usize - 0x20) / 4] = value,
            0x30..=0x38 => self.enable[(offset as usize - 0x30) / 4] = value,
            0x40 | 0x44 => self.enable[3 + (offset as usize - 0x40) / 4] = value,
            0x50..=0x58 => self.sleep[(offset as usize - 0x50) / 4] = value,
            0x60 | 0x64 => self.sleep[3 + (offset as usize - 0x60) / 4] = value,
            0x70 => self.bdcr = value,
            0x74 => {
                match (self.csr & 1 != 0, value & 1 != 0) {
                    (false, true) => self.ready[2] = now + LSI_START,
                    (true, false) => self.ready[2] = Beats::MAX,
                    _ => {}
                }
                if value & 1 << 24 != 0 {
                    self.csr &= 1;
                }
                self.csr = self.csr & !1 | value & 1;
            }
            _ => return None,
        }
        Some(())
    }
}
