//! The watchdog and the status LED.

use crate::board::LED;
use crate::pins;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering::Relaxed};
use embassy_stm32::Peri;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Ticker};
use shared::safety::State;

/// Nominal patience. Its oscillator runs at 17 to 47 kHz instead of 32 (data sheet), so it is 34 to
/// 94 ms in truth.
const PATIENCE_US: u32 = 50_000;

/// How often the tasks are looked at.
const LOOK_MS: u64 = 10;

/// Who must be alive.
#[derive(Clone, Copy)]
pub enum Task {
    /// Turned a segment into words.
    Step,
    /// Asked the machine what to do.
    Control,
    /// Looked for bytes on USB; a host is not needed.
    Usb,
    /// Looked for bytes on the UART.
    Uart,
    /// Served the USB controller; a plug is not needed.
    Device,
    /// Looked at the emergency stop.
    EmergencyStop,
    /// Looked at the drivers' fault line.
    DriverFault,
    /// Looked at a limit switch, 0 to 5.
    Limit(u8),
}

impl Task {
    /// The task's bit in a set of tasks.
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

/// Every bit that a task may have.
const BITS: usize = 14;

static ALIVE: AtomicU32 = AtomicU32::new(0);

/// Asks each task, by its bit, for a sign of life.
static ASKED: [Signal<CriticalSectionRawMutex, ()>; BITS] = [const { Signal::new() }; BITS];
static STATE: AtomicU8 = AtomicU8::new(0);

/// Waits for the watchdog's next look at this task, for tasks that may have nothing else to wait
/// for. What they say then, [`alive`], is seen at the look after it.
pub async fn look(task: Task) {
    match ASKED.get(task.bit().trailing_zeros() as usize) {
        Some(asked) => asked.wait().await,
        None => core::future::pending().await,
    }
}

/// Says that a task is alive: each at least every 10 ms, give or take a look.
pub fn alive(task: Task) {
    ALIVE.fetch_or(task.bit(), Relaxed);
}

/// The state that the LED shows.
pub fn show(state: State) {
    STATE.store(state as u8, Relaxed);
}

/// Starts the watchdog. Nothing but a reset stops it.
pub fn unleash(watchdog: Peri<'static, IWDG>) -> IndependentWatchdog<'static, IWDG> {
    let mut watchdog = IndependentWatchdog::new(watchdog, PATIENCE_US);
    watchdog.unleash();
    watchdog
}

/// States in which it moves because a host wants it to.
const COMMANDED: [u8; 3] = [
    State::Moving as u8,
    State::Following as u8,
    State::Homing as u8,
];

/// Feeds the watchdog while everyone of the set `tasks` is alive; blinks.
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
        // A task that comes round every 10 ms may miss one look; two such looks still leave time
        // for a third.
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
