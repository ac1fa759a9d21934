//! Watchdog and status LED.

use crate::board::LED;
use crate::pins;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering::Relaxed};
use embassy_stm32::Peri;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Ticker};
use trinocular_core::safety::State;

/// Nominal timeout of the watchdog, µs. Its oscillator runs at 17 to 47 kHz instead of 32 (data
/// sheet), so the real timeout is 34 to 94 ms.
const TIMEOUT_US: u32 = 50_000;

/// Interval between two checks of the tasks, ms.
const LOOK_MS: u64 = 10;

/// Task that must be alive, with the work that shows it.
#[derive(Clone, Copy)]
pub enum Task {
    /// Turned a segment into words.
    Step,
    /// Polled the machine.
    Control,
    /// Polled USB for bytes; needs no host.
    Usb,
    /// Polled the UART for bytes.
    Uart,
    /// Served the USB controller; needs no cable.
    Device,
    /// Sampled the emergency stop.
    EmergencyStop,
    /// Sampled the drivers' fault line.
    DriverFault,
    /// Sampled a limit switch, 0 to 5.
    Limit(u8),
}

impl Task {
    /// Returns the task's bit in a set of tasks.
    pub const fn bit(self) -> u32 {
        1 << match self {
            Self::Step => 0,
            Self::Control => 1,
            Self::Usb => 2,
            Self::Uart => 3,
            Self::Device => 4,
            Self::EmergencyStop => 5,
            Self::DriverFault => 6,
            Self::Limit(number) => 8 + (number & 7) as u32,
        }
    }
}

/// Number of bits that a task may have.
const BITS: usize = 14;

static ALIVE: AtomicU32 = AtomicU32::new(0);

/// Requests for a sign of life from each task, by its bit.
static ASKED: [Signal<CriticalSectionRawMutex, ()>; BITS] = [const { Signal::new() }; BITS];
static STATE: AtomicU8 = AtomicU8::new(0);

/// Waits for the watchdog's next check of this task, for tasks that may have no other event to wait
/// for. A call of [`alive`] then counts at the check after it.
pub async fn look(task: Task) {
    match ASKED.get(task.bit().trailing_zeros() as usize) {
        Some(asked) => asked.wait().await,
        None => core::future::pending().await,
    }
}

/// Reports that a task is alive. Each task must call it every 10 ms, plus or minus one check.
pub fn alive(task: Task) {
    ALIVE.fetch_or(task.bit(), Relaxed);
}

/// Sets the state that the LED shows.
pub fn show(state: State) {
    STATE.store(state as u8, Relaxed);
}

/// Starts the watchdog. Only a reset stops it.
pub fn start(watchdog: Peri<'static, IWDG>) -> IndependentWatchdog<'static, IWDG> {
    let mut watchdog = IndependentWatchdog::new(watchdog, TIMEOUT_US);
    watchdog.unleash();
    watchdog
}

/// States in which the stage moves at a host's command.
const COMMANDED: [u8; 3] = [
    State::Moving as u8,
    State::Following as u8,
    State::Homing as u8,
];

/// Feeds the watchdog while every task of the set `tasks` is alive, and blinks.
///
/// | LED | state |
/// |---|---|
/// | one short flash every second | not configured |
/// | on | at rest |
/// | 2 Hz | moving, following or homing |
/// | two short flashes every second | stopping, or stopped by command |
/// | 8 Hz | faulted |
pub async fn run(mut watchdog: IndependentWatchdog<'static, IWDG>, tasks: u32) -> ! {
    let mut ticker = Ticker::every(Duration::from_millis(LOOK_MS));
    let mut seen = 0;
    let mut looks: u32 = 0;
    loop {
        ticker.next().await;
        // A task that runs every 10 ms may miss one check; two such checks still leave time for a
        // third.
        seen |= ALIVE.swap(0, Relaxed);
        if seen & tasks == tasks {
            seen = 0;
            watchdog.pet();
        }
        for asked in &ASKED {
            asked.signal(());
        }
        looks = looks.wrapping_add(1);
        let on = match STATE.load(Relaxed) {
            state if state == State::Unconfigured as u8 => looks % 100 < 5,
            state if state == State::Idle as u8 => true,
            state if COMMANDED.contains(&state) => looks % 50 < 25,
            state if state == State::Faulted as u8 => looks % 12 < 6,
            _ => matches!(looks % 100, 0..5 | 15..20),
        };
        pins::set(LED, on);
    }
}
