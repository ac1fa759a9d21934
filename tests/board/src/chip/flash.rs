//! Timing of the flash memory: wait states, and the accelerator that hides most of them (RM0090
//! 3.5.2).
//!
//! The manual's model: a read of the memory gives a line of 128 bits, and takes FLASH_ACR's wait
//! states plus one cycle. Lines of code stay in an instruction cache of 64, lines of constants in a
//! data cache of 8; a full cache drops the least recently used line. With the prefetch on, the next
//! line is read ahead into a buffer of one line while a line is executed: straight code then waits
//! only if it uses up a line faster than the memory delivers the next. Constants have priority over
//! code.
//!
//! Not in the manual, and assumed the slower way: a read ahead finishes before another read begins.

/// Base-2 logarithm of a line's bytes.
const LINE_BITS: u32 = 4;

/// Bits of FLASH_ACR: prefetch, instruction cache, data cache.
const PRFTEN: u32 = 1 << 8;
const ICEN: u32 = 1 << 9;
const DCEN: u32 = 1 << 10;

/// Cache of recently used lines.
#[derive(Debug)]
struct Cache {
    /// Numbers of lines, the most recently used one at the end.
    lines: Vec<u32>,
    size: usize,
}

impl Cache {
    fn new(size: usize) -> Self {
        Self {
            lines: Vec::with_capacity(size),
            size,
        }
    }

    fn holds(&self, line: u32) -> bool {
        self.lines.contains(&line)
    }

    /// Returns true if the line is in the cache; it then counts as used.
    fn uses(&mut self, line: u32) -> bool {
        let found = self.lines.iter().rposition(|held| *held == line);
        if let Some(at) = found {
            self.lines.remove(at);
            self.lines.push(line);
        }
        found.is_some()
    }

    fn keeps(&mut self, line: u32) {
        if self.lines.len() == self.size {
            self.lines.remove(0);
        }
        self.lines.push(line);
    }
}

/// Flash accelerator.
#[derive(Debug)]
pub struct Accelerator {
    /// Register FLASH_ACR.
    pub acr: u32,
    code: Cache,
    constants: Cache,
    /// Line that is being executed.
    current: Option<u32>,
    /// Line that was, or is being, read ahead.
    ahead: Option<u32>,
    /// End of the memory's present read, in processor cycles.
    busy_until: u64,
    /// Present cycle, waits included.
    now: u64,
    waits: u64,
}

impl Default for Accelerator {
    fn default() -> Self {
        Self {
            acr: 0,
            code: Cache::new(64),
            constants: Cache::new(8),
            current: None,
            ahead: None,
            busy_until: 0,
            now: 0,
            waits: 0,
        }
    }
}

impl Accelerator {
    fn wait_states(&self) -> u64 {
        u64::from(self.acr & 7)
    }

    fn wait(&mut self, cycles: u64) {
        self.waits += cycles;
        self.now += cycles;
    }

    /// Waits for the memory and reads a line.
    fn read(&mut self) {
        self.wait(self.busy_until.saturating_sub(self.now));
        self.wait(self.wait_states());
        self.busy_until = self.now;
    }

    /// Fetches an instruction.
    pub fn fetch(&mut self, address: u32) {
        let line = address >> LINE_BITS;
        if self.current == Some(line) {
            return;
        }
        self.current = Some(line);
        let cached = self.acr & ICEN != 0;
        if !(cached && self.code.uses(line)) {
            if self.ahead == Some(line) {
                self.wait(self.busy_until.saturating_sub(self.now));
            } else {
                self.read();
            }
            if cached {
                self.code.keeps(line);
            }
        }
        let next = line + 1;
        if self.acr & PRFTEN != 0 && self.ahead != Some(next) && !self.code.holds(next) {
            self.ahead = Some(next);
            self.busy_until = self.busy_until.max(self.now) + 1 + self.wait_states();
        }
    }

    /// Reads a constant.
    pub fn load(&mut self, address: u32) {
        let line = address >> LINE_BITS;
        let cached = self.acr & DCEN != 0;
        if cached && self.constants.uses(line) {
            return;
        }
        self.read();
        if cached {
            self.constants.keeps(line);
        }
    }

    /// Accounts for the processor's own cycles of an instruction. Returns the number of wait
    /// cycles.
    pub fn used(&mut self, cycles: u64) -> u64 {
        self.now += cycles;
        std::mem::take(&mut self.waits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_168_mhz(enables: u32) -> Accelerator {
        Accelerator {
            acr: 5 | enables,
            ..Accelerator::default()
        }
    }

    /// Returns the waits per line while instructions of one cycle and two bytes follow each other.
    fn straight(accelerator: &mut Accelerator, lines: u32) -> Vec<u64> {
        let line = |at: u32| (0..8).map(move |k| 0x0800_0000 + 16 * at + 2 * k);
        (0..lines)
            .map(|at| {
                line(at)
                    .map(|address| {
                        accelerator.fetch(address);
                        accelerator.used(1)
                    })
                    .sum()
            })
            .collect()
    }

    #[test]
    fn lines_wait_without_prefetch() {
        assert_eq!(straight(&mut at_168_mhz(0), 3), [5, 5, 5]);
    }

    #[test]
    fn prefetch_hides_waits() {
        // Eight cycles a line, of which the next line's read takes six.
        assert_eq!(straight(&mut at_168_mhz(PRFTEN), 4), [5, 0, 0, 0]);
    }

    #[test]
    fn cached_loop_waits_once() {
        let mut accelerator = at_168_mhz(ICEN);
        assert_eq!(straight(&mut accelerator, 64).iter().sum::<u64>(), 5 * 64);
        assert_eq!(straight(&mut accelerator, 64).iter().sum::<u64>(), 0);
        // One line more than the cache holds: each line is gone when it is used again.
        straight(&mut accelerator, 65);
        assert_eq!(straight(&mut accelerator, 65).iter().sum::<u64>(), 5 * 65);
    }

    #[test]
    fn constants_have_eight_lines() {
        let mut accelerator = at_168_mhz(DCEN);
        let mut waits = |lines: u32| {
            (0..lines).for_each(|line| accelerator.load(0x0800_0000 + 16 * line));
            accelerator.used(1)
        };
        assert_eq!([waits(8), waits(8), waits(9), waits(9)], [40, 0, 5, 45]);
    }
}
