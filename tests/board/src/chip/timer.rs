//! Up-counting timers (RM0090 chapters 17 and 18): prescaler and repetition counter with their
//! shadows, four compares, interrupt and DMA requests, one-pulse mode, gated mode by the external
//! trigger with its filter.
//!
//! Nothing ticks: the counter is computed on access, and [`Timer::next`] returns the moment of the
//! next visible event.

use crate::time::Beats;

const CEN: u32 = 1;
const UDIS: u32 = 1 << 1;
const URS: u32 = 1 << 2;
const OPM: u32 = 1 << 3;
/// Index of SMCR among the registers.
const SMCR: usize = 2;
/// Flags of update and of compares 1 to 4: the same bits in SR, and as interrupt enables in DIER.
const FLAGS: u32 = 0x1f;

/// One timer.
#[derive(Clone, Debug)]
pub struct Timer {
    /// Control register 1.
    pub cr1: u32,
    /// Enables of interrupts and DMA requests.
    pub dier: u32,
    sr: u32,
    psc: u32,
    arr: u32,
    rcr: u32,
    ccr: [u32; 4],
    /// Registers without effect here.
    other: [u32; 24],
    /// Prescaler and repetitions in use, loaded at an update.
    psc_used: u32,
    repetitions: u32,
    count: u32,
    /// Moment at which `count` was reached.
    since: Beats,
    /// Period of the timer's clock; 0 is off.
    clock: Beats,
    /// Moment of the last start.
    pub started: Option<Beats>,
    /// Level of the external trigger behind the filter.
    trigger: bool,
    /// Next level behind the filter, with its moment.
    filtered: Option<(Beats, bool)>,
}

/// DMA requests of a timer: update, compares 1 to 4.
pub type Requests = u32;

impl Timer {
    /// Creates the state after a reset. A `wide` timer counts to 32 bits.
    pub fn new(wide: bool, clock: Beats) -> Self {
        Self {
            cr1: 0,
            dier: 0,
            sr: 0,
            psc: 0,
            arr: if wide { u32::MAX } else { 0xffff },
            rcr: 0,
            ccr: [0; 4],
            other: [0; 24],
            psc_used: 0,
            repetitions: 0,
            count: 0,
            since: 0,
            clock,
            started: None,
            trigger: false,
            filtered: None,
        }
    }

    /// Sets the clock from `now` on.
    pub fn set_clock(&mut self, clock: Beats, now: Beats) {
        self.advance(now);
        self.clock = clock;
        self.since = now;
    }

    /// Returns the interrupt lines: update, compare.
    pub fn interrupts(&self) -> [bool; 2] {
        let active = self.sr & self.dier;
        [active & 1 != 0, active & (FLAGS & !1) != 0]
    }

    fn tick(&self) -> Beats {
        self.clock * (Beats::from(self.psc_used) + 1)
    }

    fn runs(&self) -> bool {
        self.cr1 & CEN != 0 && self.clock != 0 && self.arr != 0 && !self.is_gated_off()
    }

    /// Returns true if the gated mode (SMS 5) stops the counter: the external trigger (TS 7) is
    /// low, or high where ETP inverts it.
    fn is_gated_off(&self) -> bool {
        let smcr = self.other[SMCR];
        smcr & 7 == 5 && smcr >> 4 & 7 == 7 && self.trigger == (smcr >> 15 & 1 != 0)
    }

    /// Returns the time for which the external trigger must keep a level: ETF's samples at its
    /// division of the dead-time clock, CKD (RM0090 17.4.3 and 17.4.1).
    fn filter_time(&self) -> Beats {
        const FILTERS: [(Beats, Beats); 16] = [
            (0, 0),
            (1, 2),
            (1, 4),
            (1, 8),
            (2, 6),
            (2, 8),
            (4, 6),
            (4, 8),
            (8, 6),
            (8, 8),
            (16, 5),
            (16, 6),
            (16, 8),
            (32, 5),
            (32, 6),
            (32, 8),
        ];
        let etf = self.other[SMCR] >> 8 & 0xf;
        let (division, samples) = FILTERS[etf as usize];
        // The first three sample at the timer's own clock.
        let dead_time = if etf < 4 { 0 } else { self.cr1 >> 8 & 3 };
        (self.clock << dead_time) * division * samples
    }

    /// Sets the level of the external trigger's pin.
    pub fn set_trigger(&mut self, level: bool, now: Beats) {
        if level == self.trigger {
            self.filtered = None;
        } else if self.filtered.is_none() {
            self.filtered = Some((now + self.filter_time(), level));
        }
    }

    /// Returns the ticks until the counter is at `value` again, at least one.
    fn ticks_to(&self, value: u32) -> Option<u64> {
        let length = u64::from(self.arr) + 1;
        (value <= self.arr).then(|| {
            let ahead = (u64::from(value) + length - u64::from(self.count) % length) % length;
            if ahead == 0 { length } else { ahead }
        })
    }

    /// Returns the ticks to the counter's next value that raises a flag.
    fn nearest(&self, enables: u32) -> Option<u64> {
        let update = (enables & 1 != 0).then(|| self.ticks_to(0)).flatten();
        let compares = (self.ccr.iter().zip(1..))
            .filter(|(_, channel)| enables & 1 << channel != 0)
            .filter_map(|(ccr, _)| self.ticks_to(*ccr));
        update.into_iter().chain(compares).min()
    }

    /// Returns the moment of the next interrupt or DMA request, or of the next level behind the
    /// filter.
    pub fn next(&self) -> Option<Beats> {
        let filtered = self.filtered.map(|(at, _)| at);
        self.next_event().into_iter().chain(filtered).min()
    }

    fn next_event(&self) -> Option<Beats> {
        let enables = self.dier & FLAGS | self.dier >> 8 & FLAGS | (self.cr1 & OPM) >> 3;
        if !self.runs() || enables == 0 {
            return None;
        }
        Some(self.since + self.nearest(enables)? * self.tick())
    }

    /// Counts up to `now`. Returns the DMA requests of the last event passed; call it at least at
    /// each [`Timer::next`].
    pub fn advance(&mut self, now: Beats) -> Requests {
        let mut requests = 0;
        while let Some((at, level)) = self.filtered.filter(|(at, _)| *at <= now) {
            requests |= self.count_to(at);
            self.filtered = None;
            self.trigger = level;
            self.since = at;
        }
        requests | self.count_to(now)
    }

    fn count_to(&mut self, now: Beats) -> Requests {
        let mut requests = 0;
        while self.runs() {
            let Some(ticks) = self.nearest(FLAGS) else {
                break;
            };
            let at = self.since + ticks * self.tick();
            if at > now {
                let passed = now.saturating_sub(self.since) / self.tick();
                self.count += passed as u32;
                self.since += passed * self.tick();
                break;
            }
            let count = (u64::from(self.count) + ticks) % (u64::from(self.arr) + 1);
            self.count = count as u32;
            self.since = at;
            requests = self.raise();
        }
        requests
    }

    /// Raises the flags of the counter's present value, and returns the DMA requests.
    fn raise(&mut self) -> Requests {
        let mut flags = (self.ccr.iter().zip(1..))
            .filter(|(ccr, _)| **ccr == self.count)
            .fold(0, |flags, (_, channel)| flags | 1 << channel);
        if self.count == 0 {
            if self.repetitions > 0 {
                self.repetitions -= 1;
            } else if self.cr1 & UDIS == 0 {
                flags |= 1;
                self.load_shadows();
            }
            if flags & 1 != 0 && self.cr1 & OPM != 0 {
                self.cr1 &= !CEN;
            }
        }
        self.sr |= flags;
        self.dier >> 8 & flags
    }

    fn load_shadows(&mut self) {
        self.psc_used = self.psc;
        self.repetitions = self.rcr & 0xff;
    }

    /// Reads a register after counting up to `now`, or returns `None` where there is none.
    pub fn read(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x00 => self.cr1,
            0x0c => self.dier,
            0x10 => self.sr,
            0x14 => 0,
            0x24 => self.count,
            0x28 => self.psc,
            0x2c => self.arr,
            0x30 => self.rcr,
            0x34..=0x40 => self.ccr[(offset as usize - 0x34) / 4],
            0x04 | 0x08 | 0x18..=0x20 | 0x44..=0x50 => self.other[offset as usize / 4],
            _ => return None,
        })
    }

    /// Writes a register after counting up to `now`, and returns its DMA requests, or `None` where
    /// there is none.
    pub fn write(&mut self, offset: u32, value: u32, now: Beats) -> Option<Requests> {
        match offset {
            0x00 => {
                if self.cr1 & CEN == 0 && value & CEN != 0 {
                    self.since = now;
                    self.started = Some(now);
                }
                self.cr1 = value;
            }
            0x0c => self.dier = value,
            // Written zeros clear.
            0x10 => self.sr &= value,
            0x14 => {
                if value & 1 != 0 && self.cr1 & UDIS == 0 {
                    self.count = 0;
                    self.since = now;
                    self.load_shadows();
                    if self.cr1 & URS == 0 {
                        self.sr |= 1;
                        return Some(self.dier >> 8 & 1);
                    }
                }
            }
            0x24 => (self.count, self.since) = (value, now),
            0x28 => self.psc = value & 0xffff,
            0x2c => self.arr = value,
            0x30 => self.rcr = value,
            0x34..=0x40 => self.ccr[(offset as usize - 0x34) / 4] = value,
            0x04 | 0x08 | 0x18..=0x20 | 0x44..=0x50 => self.other[offset as usize / 4] = value,
            _ => return None,
        }
        Some(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 MHz words as in the step engine: update and compare 1 in turn, half a word apart.
    #[test]
    fn update_and_compare_alternate() {
        let mut timer = Timer::new(false, 2);
        for (offset, value) in [(0x2c, 167), (0x34, 84), (0x14, 1), (0x24, 126)] {
            timer.write(offset, value, 0);
        }
        timer.write(0x10, 0, 0);
        timer.write(0x0c, 0x300, 0);
        timer.write(0x00, CEN, 1_000);
        let mut events = Vec::new();
        for _ in 0..4 {
            let at = timer.next().expect("it runs");
            events.push((at, timer.advance(at)));
        }
        assert_eq!(events, [(1_084, 1), (1_252, 2), (1_420, 1), (1_588, 2)]);
        assert_eq!(timer.read(0x10), Some(0x1f), "compares 2 to 4 are at zero");
    }

    #[test]
    fn one_pulse_mode_ends_the_count() {
        let mut timer = Timer::new(false, 1);
        for (offset, value) in [(0x2c, 9), (0x30, 2), (0x14, 1), (0x10, 0), (0x0c, 1)] {
            timer.write(offset, value, 0);
        }
        timer.write(0x00, CEN | OPM, 0);
        timer.advance(29);
        assert_eq!((timer.sr & 1, timer.cr1 & CEN), (0, CEN));
        timer.advance(30);
        assert_eq!((timer.sr & 1, timer.cr1 & CEN), (1, 0));
        timer.advance(500);
        assert_eq!(timer.read(0x24), Some(0));
    }

    #[test]
    fn filtered_gate_stops_the_count() {
        let mut timer = Timer::new(false, 2);
        // ETF 15 at a quarter of the clock: 1,024 clocks. Gated by ETRF.
        for (offset, value) in [
            (0x2c, 167),
            (0x00, 2 << 8 | CEN),
            (0x08, 0xf << 8 | 7 << 4 | 5),
        ] {
            timer.write(offset, value, 0);
        }
        timer.advance(1_000);
        assert_eq!(
            timer.read(0x24),
            Some(0),
            "it stands while the trigger is low"
        );
        timer.set_trigger(true, 1_000);
        assert_eq!(timer.next(), Some(3_048));
        timer.advance(3_068);
        assert_eq!(timer.read(0x24), Some(10));
        // Shorter than the filter, so without effect.
        timer.set_trigger(false, 3_068);
        timer.set_trigger(true, 4_000);
        timer.advance(4_068);
        assert_eq!(timer.read(0x24), Some((10 + 500) % 168));
        timer.set_trigger(false, 4_068);
        timer.advance(20_000);
        assert_eq!(timer.read(0x24), Some((10 + 500 + 1_024) % 168));
    }

    #[test]
    fn prescaler_changes_at_an_update() {
        let mut timer = Timer::new(true, 4);
        timer.write(0x28, 83, 0);
        timer.write(0x00, CEN, 0);
        timer.advance(40);
        assert_eq!(timer.read(0x24), Some(10));
        timer.write(0x14, 1, 40);
        timer.advance(40 + 3 * 336);
        assert_eq!(timer.read(0x24), Some(3));
    }
}
