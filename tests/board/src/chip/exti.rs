//! External interrupts (RM0090 chapter 12): edges of pins, lines 0 to 15, and of the supply's
//! detector, line 16, become pending bits.

/// Line of the supply's detector.
pub const DETECTOR: u32 = 1 << 16;

/// Registers, with SYSCFG's choice of ports.
#[derive(Clone, Debug, Default)]
pub struct Exti {
    imr: u32,
    emr: u32,
    rtsr: u32,
    ftsr: u32,
    pr: u32,
    /// SYSCFG_EXTICR1 to 4: the port of each line.
    pub ports: [u32; 4],
}

impl Exti {
    /// Returns the port that feeds a line.
    pub fn port(&self, line: u32) -> usize {
        (self.ports[line as usize / 4] >> (4 * (line % 4)) & 0xf) as usize
    }

    /// Handles a change of a port's levels.
    pub fn edges(&mut self, port: usize, before: u16, after: u16) {
        for line in 0..16 {
            if self.port(line) != port {
                continue;
            }
            let bit = 1 << line;
            let selected = match (u32::from(before) & bit != 0, u32::from(after) & bit != 0) {
                (false, true) => self.rtsr,
                (true, false) => self.ftsr,
                _ => 0,
            };
            self.pr |= selected & bit;
        }
    }

    /// Handles a change of the supply detector's output.
    pub fn detector_edge(&mut self, rises: bool) {
        let selected = if rises { self.rtsr } else { self.ftsr };
        self.pr |= selected & DETECTOR;
    }

    /// Returns the lines that interrupt.
    pub fn pending(&self) -> u32 {
        self.pr & self.imr & (DETECTOR | 0xffff)
    }

    /// Reads a register, or returns `None` where there is none.
    pub fn read(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x00 => self.imr,
            0x04 => self.emr,
            0x08 => self.rtsr,
            0x0c => self.ftsr,
            0x10 => 0,
            0x14 => self.pr,
            _ => return None,
        })
    }

    /// Writes a register, or returns `None` where there is none.
    pub fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        match offset {
            0x00 => self.imr = value,
            0x04 => self.emr = value,
            0x08 => self.rtsr = value,
            0x0c => self.ftsr = value,
            0x10 => self.pr |= value & self.imr,
            0x14 => self.pr &= !value,
            _ => return None,
        }
        Some(())
    }
}
