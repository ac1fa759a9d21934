//! DMA controller in direct mode (RM0090 chapter 10): each stream makes one transfer per request of
//! its peripheral.
//!
//! A transfer takes no time here. The model keeps what is visible from outside: a stream from
//! memory to a peripheral fetches the next item as soon as it is enabled, and again after each
//! transfer, one request ahead of its use.

/// Bus for 32-bit words; `None` is a bus error.
pub trait Bus {
    /// Reads a word.
    fn load(&mut self, address: u32) -> Option<u32>;
    /// Writes a word.
    fn store(&mut self, address: u32, value: u32) -> Option<()>;
}

const EN: u32 = 1;
const TEIE: u32 = 1 << 2;
const HTIE: u32 = 1 << 3;
const TCIE: u32 = 1 << 4;
const CIRC: u32 = 1 << 8;
const PINC: u32 = 1 << 9;
const MINC: u32 = 1 << 10;
/// Transfer error, half and whole transfer: as in the interrupt registers.
const TE: u32 = 1 << 3;
const HT: u32 = 1 << 4;
const TC: u32 = 1 << 5;

/// One stream.
#[derive(Clone, Debug, Default)]
pub struct Stream {
    /// Configuration; bit 0 enables the stream.
    pub cr: u32,
    /// Items left.
    pub ndtr: u32,
    par: u32,
    m0ar: u32,
    m1ar: u32,
    fcr: u32,
    /// Reload value of NDTR.
    whole: u32,
    fetched: Option<u32>,
    /// TE, HT, TC.
    flags: u32,
    /// True if the next transfer fails, by a fault from outside.
    pub fails: bool,
}

impl Stream {
    fn to_peripheral(&self) -> bool {
        self.cr >> 6 & 3 == 1
    }

    fn memory_at(&self) -> u32 {
        let done = self.whole.wrapping_sub(self.ndtr);
        let offset = if self.cr & MINC != 0 { 4 * done } else { 0 };
        self.m0ar.wrapping_add(offset)
    }

    fn peripheral_at(&self) -> u32 {
        let done = self.whole.wrapping_sub(self.ndtr);
        let offset = if self.cr & PINC != 0 { 4 * done } else { 0 };
        self.par.wrapping_add(offset)
    }

    fn enable(&mut self, bus: &mut impl Bus) {
        self.whole = self.ndtr;
        self.fetched = None;
        self.fetch(bus);
    }

    fn fetch(&mut self, bus: &mut impl Bus) {
        if self.to_peripheral() && self.cr & EN != 0 {
            self.fetched = bus.load(self.memory_at());
            if self.fetched.is_none() {
                self.fail();
            }
        }
    }

    fn fail(&mut self) {
        self.flags |= TE;
        self.cr &= !EN;
    }

    /// Handles a request of the stream's peripheral.
    fn transfer(&mut self, bus: &mut impl Bus) {
        if self.cr & EN == 0 || self.ndtr == 0 {
            return;
        }
        let moved = if std::mem::take(&mut self.fails) {
            None
        } else if self.to_peripheral() {
            let word = self.fetched.take();
            word.and_then(|word| bus.store(self.peripheral_at(), word))
        } else {
            let word = bus.load(self.peripheral_at());
            word.and_then(|word| bus.store(self.memory_at(), word))
        };
        if moved.is_none() {
            return self.fail();
        }
        self.ndtr -= 1;
        if self.ndtr == self.whole / 2 {
            self.flags |= HT;
        }
        if self.ndtr == 0 {
            self.flags |= TC;
            match self.cr & CIRC != 0 {
                true => self.ndtr = self.whole,
                false => self.cr &= !EN,
            }
        }
        self.fetch(bus);
    }

    fn interrupts(&self) -> bool {
        let pairs = [(TE, TEIE), (HT, HTIE), (TC, TCIE)];
        pairs
            .iter()
            .any(|(flag, enable)| self.flags & flag != 0 && self.cr & enable != 0)
    }
}

/// Controller of eight streams.
#[derive(Clone, Debug, Default)]
pub struct Dma {
    /// The streams.
    pub streams: [Stream; 8],
}

/// Position of a stream's flags in its interrupt register.
const PLACES: [u32; 4] = [0, 6, 16, 22];

impl Dma {
    /// Requests a transfer of `stream` over `channel`.
    pub fn request(&mut self, stream: usize, channel: u32, bus: &mut impl Bus) {
        let stream = &mut self.streams[stream];
        if stream.cr >> 25 & 7 == channel {
            stream.transfer(bus);
        }
    }

    /// Returns the interrupt lines of the streams.
    pub fn interrupts(&self) -> [bool; 8] {
        std::array::from_fn(|i| self.streams[i].interrupts())
    }

    /// Reads a register, or returns `None` where there is none.
    pub fn read(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x00 | 0x04 => {
                let half = &self.streams[offset as usize..][..4];
                (half.iter().zip(PLACES)).fold(0, |word, (s, place)| word | s.flags << place)
            }
            0x08 | 0x0c => 0,
            0x10..=0xcc => {
                let stream = &self.streams[(offset as usize - 0x10) / 0x18];
                match (offset - 0x10) % 0x18 {
                    0x00 => stream.cr,
                    0x04 => stream.ndtr,
                    0x08 => stream.par,
                    0x0c => stream.m0ar,
                    0x10 => stream.m1ar,
                    _ => stream.fcr,
                }
            }
            _ => return None,
        })
    }

    /// Writes a register. Returns `None` where there is none, and for writes that the manual
    /// forbids: addresses and counts of a running stream.
    pub fn write(&mut self, offset: u32, value: u32, bus: &mut impl Bus) -> Option<()> {
        match offset {
            0x08 | 0x0c => {
                let half = &mut self.streams[offset as usize - 8..][..4];
                for (stream, place) in half.iter_mut().zip(PLACES) {
                    stream.flags &= !(value >> place & 0x3d);
                }
            }
            0x10..=0xcc => {
                let stream = &mut self.streams[(offset as usize - 0x10) / 0x18];
                let running = stream.cr & EN != 0;
                match (offset - 0x10) % 0x18 {
                    0x00 => {
                        stream.cr = value;
                        if !running && value & EN != 0 {
                            stream.enable(bus);
                        }
                    }
                    _ if running => return None,
                    0x04 => stream.ndtr = value & 0xffff,
                    0x08 => stream.par = value,
                    0x0c => stream.m0ar = value,
                    0x10 => stream.m1ar = value,
                    _ => stream.fcr = value,
                }
            }
            _ => return None,
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Words(Vec<u32>);

    impl Bus for Words {
        fn load(&mut self, address: u32) -> Option<u32> {
            self.0.get(address as usize / 4).copied()
        }
        fn store(&mut self, address: u32, value: u32) -> Option<()> {
            *self.0.get_mut(address as usize / 4)? = value;
            Some(())
        }
    }

    /// A circular player and the eraser behind it, on a ring of three words at 0; the port is word
    /// 4, the idle word is word 5.
    #[test]
    fn played_words_are_erased() {
        let mut bus = Words(vec![1, 2, 3, 0, 0, 77]);
        let mut dma = Dma::default();
        for (stream, par, direction) in [(1, 16, 1 << 6), (2, 20, 0)] {
            let base = 0x10 + 0x18 * stream;
            for (offset, value) in [(4, 3), (8, par), (12, 0)] {
                dma.write(base + offset, value, &mut bus);
            }
            dma.write(base, 7 << 25 | direction | CIRC | MINC | EN, &mut bus);
        }
        let mut played = Vec::new();
        for round in 0..5 {
            dma.request(1, 7, &mut bus);
            played.push(bus.0[4]);
            dma.request(2, 7, &mut bus);
            if round == 0 {
                // Too late for word 1, which was fetched; in time for word 2.
                (bus.0[1], bus.0[2]) = (8, 9);
            }
        }
        assert_eq!(played, [1, 2, 9, 77, 77]);
        assert_eq!(dma.streams[1].ndtr, 1);
        dma.request(1, 6, &mut bus);
        assert_eq!(dma.streams[1].ndtr, 1, "not its channel");
        assert_eq!(dma.write(0x10 + 0x18 + 4, 9, &mut bus), None, "it runs");
    }

    #[test]
    fn failed_transfer_stops_the_stream() {
        let mut bus = Words(vec![1, 2]);
        let mut dma = Dma::default();
        dma.write(0x14, 2, &mut bus);
        dma.write(0x18, 400, &mut bus);
        dma.write(0x10, 1 << 6 | CIRC | MINC | TEIE | EN, &mut bus);
        dma.request(0, 0, &mut bus);
        assert_eq!((dma.streams[0].cr & EN, dma.read(0)), (0, Some(TE)));
        assert!(dma.interrupts()[0]);
    }
}
