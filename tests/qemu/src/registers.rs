//! Registers of the board. The only file that accesses memory by address.

/// The registers of one peripheral, by byte offset from its base.
#[derive(Clone, Copy)]
pub struct Block {
    base: usize,
}

/// UART0: the link to the host.
pub const UART0: Block = Block { base: 0x4000_4000 };
/// TIMER0: the clock.
pub const TIMER0: Block = Block { base: 0x4000_0000 };
/// TIMER1: the alarm.
pub const TIMER1: Block = Block { base: 0x4000_1000 };

impl Block {
    /// Reads the register at `offset`.
    pub fn read(self, offset: usize) -> u32 {
        // SAFETY: `Block`s exist only for the constants above, devices of 4 kB each, whose
        // registers all can be read.
        unsafe { ((self.base + (offset & 0xffc)) as *const u32).read_volatile() }
    }

    /// Writes the register at `offset`.
    pub fn write(self, offset: usize, value: u32) {
        // SAFETY: as for `read`; none of these devices accesses memory by itself.
        unsafe { ((self.base + (offset & 0xffc)) as *mut u32).write_volatile(value) }
    }
}
