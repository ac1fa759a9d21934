//! embassy-time on two of the board's CMSDK timers, which count down at 25 MHz.
//!
//! TIMER0 runs forever and wraps every 172 s: its interrupt counts the wraps. TIMER1 is set to the
//! next alarm and stopped when it fires. Nothing ticks while nothing is due, so an idle emulator
//! can jump from alarm to alarm.

use crate::interrupts::{self, Line};
use crate::registers::{TIMER0, TIMER1};
use core::cell::{Cell, RefCell};
use core::task::Waker;
use critical_section::{CriticalSection, Mutex};
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

/// Timer counts per microsecond.
const COUNTS_PER_US: u64 = 25;

// Register offsets of a CMSDK timer.
const CONTROL: usize = 0x0;
const VALUE: usize = 0x4;
const RELOAD: usize = 0x8;
const INTERRUPT: usize = 0xc;

/// Control: count, and interrupt at zero.
const RUN: u32 = 0b1001;

struct Clock {
    wraps: Mutex<Cell<u32>>,
    waiting: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock {
    wraps: Mutex::new(Cell::new(0)),
    waiting: Mutex::new(RefCell::new(Queue::new())),
});

impl Clock {
    fn micros(&self, section: CriticalSection) -> u64 {
        let mut wraps = self.wraps.borrow(section).get();
        let mut left = TIMER0.read(VALUE);
        if TIMER0.read(INTERRUPT) & 1 != 0 {
            // The timer wrapped and the interrupt still waits: the value must be one from after the
            // wrap.
            wraps += 1;
            left = TIMER0.read(VALUE);
        }
        ((u64::from(wraps) << 32) | u64::from(u32::MAX - left)) / COUNTS_PER_US
    }

    /// Wakes the tasks that are due and sets the alarm for the next one.
    fn set_alarm(&self, section: CriticalSection) {
        let mut waiting = self.waiting.borrow(section).borrow_mut();
        TIMER1.write(CONTROL, 0);
        loop {
            let now = self.micros(section);
            let next = waiting.next_expiration(now);
            if next == u64::MAX {
                return;
            }
            if next > now {
                // Farther alarms are set again when this one fires.
                let counts = ((next - now) * COUNTS_PER_US).min(u64::from(u32::MAX)) as u32;
                TIMER1.write(RELOAD, counts);
                TIMER1.write(VALUE, counts);
                TIMER1.write(CONTROL, RUN);
                return;
            }
        }
    }
}

impl Driver for Clock {
    fn now(&self) -> u64 {
        critical_section::with(|section| self.micros(section))
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|section| {
            let sooner = self
                .waiting
                .borrow(section)
                .borrow_mut()
                .schedule_wake(at, waker);
            if sooner {
                self.set_alarm(section);
            }
        });
    }
}

/// Starts the clock.
pub fn start() {
    TIMER0.write(RELOAD, u32::MAX);
    TIMER0.write(VALUE, u32::MAX);
    TIMER0.write(CONTROL, RUN);
    interrupts::enable(Line::Timer0);
    interrupts::enable(Line::Timer1);
}

/// Handles TIMER0 at zero.
pub unsafe extern "C" fn on_wrap() {
    critical_section::with(|section| {
        TIMER0.write(INTERRUPT, 1);
        let wraps = CLOCK.wraps.borrow(section);
        wraps.set(wraps.get().wrapping_add(1));
    });
}

/// Handles TIMER1 at zero.
pub unsafe extern "C" fn on_alarm() {
    critical_section::with(|section| {
        TIMER1.write(INTERRUPT, 1);
        CLOCK.set_alarm(section);
    });
}
