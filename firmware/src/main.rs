//! The station on an STM32F405 or F407: clocks, links, pins, watchdog, and the loop that moves
//! bytes and words.
//!
//! The crate `trinocular-core` makes all decisions of the station; see its
//! [`Machine`](trinocular_core::machine::Machine). This program gives the machine its clock and its
//! connections:
//!
//! | module | purpose | runs |
//! |---|---|---|
//! | [`engine`] | segments to port words, which reach the pins without the processor | executor of interrupt UART5 |
//! | [`control`] | the machine: bytes and switches in, bytes and segments out | executor of interrupt UART4 |
//! | [`link`], [`usb`] | bytes of USB and UART, one code for both | thread |
//! | [`switches`] | limit switches, emergency stop, driver fault | as `control`; the emergency stop as `engine` |
//! | [`watch`] | the watchdog, fed while every task is alive; the LED | thread |
//! | [`crash`] | record of a panic, a fault or a dip of the supply for the next start | |
//! | [`fault`] | handlers of hard faults and of a low supply | |
//! | [`board`] | the only module that names a pin | |
//! | [`clock`] | the station's time | |
//! | [`vectors`] | interrupts and the memory that survives a reset; with [`fault`] the only unsafe code | |
//!
//! *Invariant:* no task waits for a link while it holds a resource that motion needs. Motion never
//! waits for the host.
//!
//! Features: one board (`olimex-h405`, `feather-f405`, `skr-2`); `defmt` for a log over a debug
//! probe.
#![no_std]
#![no_main]

// First, because the modules below use its macro.
#[macro_use]
mod log;

mod board;
mod clock;
mod control;
mod crash;
mod engine;
mod fault;
mod link;
mod pins;
mod switches;
mod usb;
mod vectors;
mod watch;

use embassy_executor::{SpawnError, SpawnToken, Spawner};
use embassy_stm32::pac;
use embassy_stm32::rng::Rng;
use vectors::{Irqs, Level};
use watch::Task;

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    // First, so that the record is open when the rest of the start fails.
    let (reset_cause, last_run) = crash::begin();
    let chip = embassy_stm32::init(board::clocks());
    // Flash needs five wait states at 168 MHz. Caches and prefetch, off after reset and left off by
    // the HAL, hide nearly all of them. The chip's first revision, A, must run without prefetch
    // (errata sheet ES0182). It reports the device number of another chip, the STM32F2, which is an
    // erratum, too.
    const REVISION_A: u16 = 0x411;
    let prefetch = pac::DBGMCU.idcode().read().dev_id() != REVISION_A;
    pac::FLASH.acr().modify(|w| {
        w.set_icen(true);
        w.set_dcen(true);
        w.set_prften(prefetch);
    });
    // Under a debugger, time, steps and watchdog stop together with the processor.
    pac::DBGMCU.apb1fzr().modify(|freeze| {
        freeze.set_tim5(true);
        freeze.set_iwdg(true);
    });
    pac::DBGMCU.apb2fzr().modify(|freeze| freeze.set_tim8(true));
    pins::prepare();

    let Ok(parts) = board::assign(chip) else {
        // A UART that cannot make its baud rate is a mistake in board.rs.
        panic!("UART")
    };
    // From here on a hang resets the chip.
    let watchdog = watch::start(parts.watchdog);
    let session = Rng::new(parts.random, Irqs).next_u32();
    note!("{} starts, session {}", board::NAME, session);

    fault::watch_supply();

    let mut tasks = [Task::Step, Task::Control, Task::Usb, Task::Uart]
        .into_iter()
        .chain([Task::Device, Task::EmergencyStop])
        .fold(0, |tasks, task| tasks | task.bit());
    let step = vectors::executor(Level::Step);
    let tick = vectors::executor(Level::Control);
    step.spawn(spawned(engine::run(parts.engine)));
    step.spawn(spawned(switches::emergency_stop(parts.emergency_stop)));
    tick.spawn(spawned(control::run(session, reset_cause, last_run)));
    for (number, switch) in (0..).zip(parts.limits.into_iter().flatten()) {
        tasks |= Task::Limit(number).bit();
        tick.spawn(spawned(switches::limit(number, switch)));
    }
    if let Some(fault) = parts.driver_fault {
        tasks |= Task::DriverFault.bit();
        tick.spawn(spawned(switches::driver_fault(fault)));
    }

    let (controller, dp, dm) = parts.usb;
    usb::start(spawner, controller, dp, dm);
    spawner.spawn(spawned(link::uart(parts.uart)));
    watch::run(watchdog, tasks).await
}

/// Returns the token of a task that has a slot. A station without one of its tasks must not run, so
/// a missing slot is a panic at the start.
fn spawned<T>(task: Result<SpawnToken<T>, SpawnError>) -> SpawnToken<T> {
    match task {
        Ok(token) => token,
        Err(_) => panic!("a task without a place"),
    }
}
