//! Counter of instructions: under `-icount shift=3` one instruction takes 8 ns, and SysTick counts
//! at 25 MHz, once in 5 instructions.

use core::ops::AddAssign;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;

/// Instructions per tick of SysTick.
const INSTRUCTIONS_PER_TICK: u64 = 5;

/// The largest count of SysTick.
const LARGEST: u32 = 0xff_ffff;

/// SysTick as a counter of instructions.
pub struct Counter {
    /// Timer, which runs as long as this value lives.
    _timer: SYST,
    /// Cost of counting itself, ticks.
    own: u32,
}

/// Sum over many runs of one operation.
#[derive(Clone, Copy, Default)]
pub struct Sum {
    ticks: u64,
    runs: u64,
}

impl Sum {
    /// Returns the instructions of one run of `units`, per unit, rounded up.
    pub fn per(self, units: u64) -> u64 {
        (self.ticks * INSTRUCTIONS_PER_TICK).div_ceil((self.runs * units).max(1))
    }

    /// Returns tenths of instructions per unit, rounded up.
    pub fn tenths_per(self, units: u64) -> u64 {
        (self.ticks * INSTRUCTIONS_PER_TICK * 10).div_ceil((self.runs * units).max(1))
    }
}

impl AddAssign for Sum {
    fn add_assign(&mut self, more: Self) {
        self.ticks += more.ticks;
        self.runs += more.runs;
    }
}

impl Counter {
    /// Starts counting.
    pub fn new(mut timer: SYST) -> Self {
        timer.set_clock_source(SystClkSource::Core);
        timer.set_reload(LARGEST);
        timer.clear_current();
        timer.enable_counter();
        let mut counter = Self {
            _timer: timer,
            own: 0,
        };
        let mut empty = Sum::default();
        for _ in 0..100 {
            counter.add(&mut empty, || ());
        }
        counter.own = (empty.ticks / empty.runs) as u32;
        counter
    }

    /// Runs `work` and adds its instructions to `sum`. At most 16 M ticks.
    #[inline(never)]
    pub fn add<R>(&mut self, sum: &mut Sum, work: impl FnOnce() -> R) -> R {
        // The timer counts down. Interrupts are not enabled in this mode of the image.
        let before = SYST::get_current();
        let result = core::hint::black_box(work());
        let after = SYST::get_current();
        let ticks = before.wrapping_sub(after) & LARGEST;
        sum.ticks += u64::from(ticks.saturating_sub(self.own));
        sum.runs += 1;
        result
    }

    /// Runs a hundred calls in one go, their loop included.
    pub fn calls<R>(&mut self, mut call: impl FnMut() -> R) -> Sum {
        let mut sum = Sum::default();
        self.add(&mut sum, || {
            for _ in 0..100 {
                core::hint::black_box(call());
            }
        });
        sum.runs = 100;
        sum
    }
}
