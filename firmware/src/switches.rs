//! Limit switches, emergency stop and the drivers' fault line.
//!
//! An edge on the pin's EXTI line wakes a task, which samples again after 20 µs so that a spark
//! does not stop the stage, and then holds the switch as open for at least two control ticks. So
//! the machine, which samples once per tick, misses nothing that lasted 20 µs. Without an edge the
//! task samples the pin whenever the watchdog checks the task, every 10 ms: a lost edge costs no
//! more than that.
//!
//! The emergency stop does not wait for the machine: its task runs beside the step engine and
//! empties the ring. Its second contact, where the board has a [gate](crate::board::Gate), stops
//! the step timer without any program; the machine sees that contact, too. Drivers stay energised,
//! because a stage without current may fall; to cut the current, use a further contact in the motor
//! supply.

use crate::watch::{self, Task};
use crate::{engine, pins};
use core::sync::atomic::{AtomicU8, Ordering::Relaxed};
use embassy_futures::select::{Either, select};
use embassy_stm32::exti::ExtiInput;
use embassy_stm32::gpio::Level;
use embassy_stm32::mode::Async;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Timer;
use trinocular_core::safety::Inputs;

/// Least duration of a level, µs.
const SPARK_US: u64 = 20;

/// Least time for which an open switch is shown, µs: two control ticks.
const HOLD_US: u64 = 2_000;

const EMERGENCY_STOP: u8 = 1 << 6;
const DRIVER_FAULT: u8 = 1 << 7;

/// Bits 0 to 5: limit switches, two per axis, negative end first.
static OPEN: AtomicU8 = AtomicU8::new(0);

static CHANGED: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Waits until a switch opens.
pub async fn changed() {
    CHANGED.wait().await;
}

/// Returns the inputs for the machine.
pub fn inputs(words_emitted: u64, trigger_losses: u32) -> Inputs {
    let open = OPEN.load(Relaxed);
    let limit = |number: u8| open & 1 << number != 0;
    Inputs {
        limits: [
            [limit(0), limit(1)],
            [limit(2), limit(3)],
            [limit(4), limit(5)],
        ],
        emergency_stop: open & EMERGENCY_STOP != 0 || pins::gate_is_open(),
        driver_fault: open & DRIVER_FAULT != 0,
        words_emitted,
        trigger_losses,
    }
}

/// Watches a contact to ground. `number` counts the limit switches from 0 to 5.
#[embassy_executor::task(pool_size = 6)]
pub async fn limit(number: u8, switch: ExtiInput<'static, Async>) {
    let task = Task::Limit(number);
    watch(switch, task, 1 << (number & 7), Level::High, || {}).await
}

/// Watches the emergency stop, beside the step engine.
#[embassy_executor::task]
pub async fn emergency_stop(switch: ExtiInput<'static, Async>) {
    let task = Task::EmergencyStop;
    watch(switch, task, EMERGENCY_STOP, Level::High, engine::suppress).await
}

/// Watches a line that is low when a driver has a fault.
#[embassy_executor::task]
pub async fn driver_fault(line: ExtiInput<'static, Async>) {
    watch(line, Task::DriverFault, DRIVER_FAULT, Level::Low, || {}).await
}

/// Shows `bit` while the pin has the level that means open or fault, and calls `act` as soon as it
/// has.
async fn watch(mut pin: ExtiInput<'static, Async>, task: Task, bit: u8, trouble: Level, act: fn()) {
    loop {
        wait(&mut pin, task, trouble).await;
        Timer::after_micros(SPARK_US).await;
        if pin.get_level() != trouble {
            continue;
        }
        act();
        OPEN.fetch_or(bit, Relaxed);
        CHANGED.signal(());
        // Contacts bounce: closed means closed for a while.
        loop {
            Timer::after_micros(HOLD_US).await;
            if pin.get_level() != trouble {
                break;
            }
            wait(&mut pin, task, opposite(trouble)).await;
        }
        OPEN.fetch_and(!bit, Relaxed);
    }
}

/// Waits for a level. Each round begins with a sample of the pin itself.
async fn wait(pin: &mut ExtiInput<'static, Async>, task: Task, level: Level) {
    loop {
        watch::alive(task);
        let there = match level {
            Level::High => select(pin.wait_for_high(), watch::look(task)).await,
            Level::Low => select(pin.wait_for_low(), watch::look(task)).await,
        };
        if let Either::First(()) = there {
            return;
        }
    }
}

const fn opposite(level: Level) -> Level {
    match level {
        Level::High => Level::Low,
        Level::Low => Level::High,
    }
}
