//! GPIO ports (RM0090 chapter 8), with the wires at their pins outside the chip.

/// Registers of one port.
#[derive(Clone, Debug)]
pub struct Port {
    /// Two bits a pin: 0 input, 1 output, 2 alternate function, 3 analogue.
    pub moder: u32,
    /// 1 is open drain.
    pub otyper: u32,
    /// Two bits a pin.
    pub ospeedr: u32,
    /// Two bits a pin: 0 none, 1 up, 2 down.
    pub pupdr: u32,
    /// Output data register.
    pub odr: u32,
    /// Four bits a pin.
    pub afr: [u32; 2],
    /// Pins that are driven from outside, and their levels.
    outside: (u16, u16),
    /// Pins with a resistor to the supply outside.
    pulled_up: u16,
    /// Pins that the output register drives, and the levels of the others: computed on a change,
    /// because words come every microsecond.
    driven: u16,
    others: u16,
}

/// Registers of a port after reset; A and B carry the debug pins.
const RESET: [(u32, u32, u32); 3] = [
    (0xa800_0000, 0x0c00_0000, 0x6400_0000),
    (0x0000_0280, 0x0000_00c0, 0x0000_0100),
    (0, 0, 0),
];

impl Port {
    /// Creates port `number` (A is 0) after reset, without wires.
    pub fn new(number: usize) -> Self {
        let (moder, ospeedr, pupdr) = RESET[number.min(2)];
        let mut port = Self {
            moder,
            otyper: 0,
            ospeedr,
            pupdr,
            odr: 0,
            afr: [0; 2],
            outside: (0, 0),
            pulled_up: 0,
            driven: 0,
            others: 0,
        };
        port.settle();
        port
    }

    /// Resets the port; the wires outside stay.
    pub fn reset(&mut self, number: usize) {
        *self = Self {
            outside: self.outside,
            pulled_up: self.pulled_up,
            ..Self::new(number)
        };
        self.settle();
    }

    /// Drives a pin from outside, or (`None`) releases it.
    pub fn wire(&mut self, pin: u8, level: Option<bool>) {
        let bit = 1 << pin;
        let (wired, levels) = &mut self.outside;
        match level {
            None => *wired &= !bit,
            Some(high) => {
                *wired |= bit;
                *levels = *levels & !bit | if high { bit } else { 0 };
            }
        }
        self.settle();
    }

    /// Connects a pin to the supply through a resistor.
    pub fn pull_up(&mut self, pin: u8) {
        self.pulled_up |= 1 << pin;
        self.settle();
    }

    /// Returns the function of a pin, as in MODER.
    pub fn mode(&self, pin: u32) -> u32 {
        self.moder >> (2 * pin) & 3
    }

    fn settle(&mut self) {
        let pins = |wanted: &dyn Fn(u32) -> bool| {
            (0..16)
                .filter(|pin| wanted(*pin))
                .fold(0, |mask, pin| mask | 1 << pin)
        };
        self.driven = pins(&|pin| self.mode(pin) == 1);
        let internal: u16 = pins(&|pin| self.pupdr >> (2 * pin) & 3 == 1);
        let (wired, level) = self.outside;
        self.others = !self.driven & (level & wired | (self.pulled_up | internal) & !wired);
    }

    /// Returns the levels of all pins, as an instrument outside sees them. A pin without a driver
    /// or a pull is low.
    pub fn levels(&self) -> u16 {
        self.driven & self.odr as u16 | self.others
    }

    /// Reads a register, or returns `None` where there is none.
    pub fn read(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x00 => self.moder,
            0x04 => self.otyper,
            0x08 => self.ospeedr,
            0x0c => self.pupdr,
            0x10 => u32::from(self.levels()),
            0x14 => self.odr,
            0x18 => 0,
            0x20 => self.afr[0],
            0x24 => self.afr[1],
            _ => return None,
        })
    }

    /// Writes a register, or returns `None` where there is none.
    pub fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        match offset {
            0x00 => {
                self.moder = value;
                self.settle();
            }
            0x04 => self.otyper = value & 0xffff,
            0x08 => self.ospeedr = value,
            0x0c => {
                self.pupdr = value;
                self.settle();
            }
            0x14 => self.odr = value & 0xffff,
            // Set wins over reset.
            0x18 => self.odr = self.odr & !(value >> 16) | value & 0xffff,
            0x20 => self.afr[0] = value,
            0x24 => self.afr[1] = value,
            _ => return None,
        }
        Some(())
    }
}
