//! The station on an STM32F405 or F407: clocks, links, pins, watchdog, and the loop that moves bytes and words.
//!
//! All that the station *decides* is in the crate `shared`; see its [`Machine`](shared::machine::Machine). This program gives the machine
//! its clock and its wires:
//!
//! | module | what it does | runs |
//! |---|---|---|
//! | [`engine`] | segments to port words, and these to the pins without the processor | executor of interrupt UART5 |
//! | [`control`] | the machine: bytes and switches in, bytes and segments out | executor of interrupt UART4 |
//! | [`link`], [`usb`] | bytes of USB and UART, one code for both | thread |
//! | [`switches`] | limit switches, emergency stop, driver fault | as `control`; the emergency stop as `engine` |
//! | [`watch`] | the watchdog, fed while step, control and both links are alive; the LED | thread |
//! | [`crash`] | what a panic or a fault leaves behind for the next start | |
//! | [`board`] | the only place that names a pin | |
//! | [`vectors`] | interrupts and the memory that survives a reset; the only unsafe code | |
//!
//! *Invariant:* no task waits for a link while it holds something that motion needs. Motion never waits for the host.
//!
//! Features: one board (`olimex-h405`, `feather-f405`, `skr-2`); `defmt` for a log over a debug probe.
#![no_std]
#![no_main]

// First: its macro is used below.
#[macro_use]
mod log;

mod board;
mod control;
mod crash;
mod engine;
mod link;
mod pins;
mod switches;
mod usb;
mod vectors;
mod watch;

use embassy_executor::Spawner;
use embassy_stm32::pac;
use embassy_stm32::rng::Rng;
use vectors::{Irqs, Level};

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let chip = embassy_stm32::init(board::clocks());
    // Flash needs five wait states at 168 MHz. Caches and prefetch, off after reset and left off by the HAL, hide nearly all of them. The chip's
    // first revision, A, must do without prefetch (errata sheet ES0182).
    const REVISION_A: u16 = 0x1000;
    let prefetch = pac::DBGMCU.idcode().read().rev_id() != REVISION_A;
    pac::FLASH.acr().modify(|w| {
        w.set_icen(true);
        w.set_dcen(true);
        w.set_prften(prefetch);
    });
    // Under a debugger time, steps and watchdog stand still together with the processor.
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
    let watchdog = watch::unleash(parts.watchdog);
    let session = Rng::new(parts.random, Irqs).next_u32();
    note!("{} starts, session {}", board::NAME, session);

    let step = vectors::executor(Level::Step);
    let control = vectors::executor(Level::Control);
    for spawned in [
        engine::run(parts.engine).map(|task| step.spawn(task)),
        switches::emergency_stop(parts.emergency_stop).map(|task| step.spawn(task)),
        control::run(session).map(|task| control.spawn(task)),
    ] {
        // Each task has its place and is spawned once.
        let _ = spawned;
    }
    let limits = parts.limits.into_iter().flatten();
    for (number, switch) in (0..).zip(limits) {
        let _ = switches::limit(number, switch).map(|task| control.spawn(task));
    }
    if let Some(fault) = parts.driver_fault {
        let _ = switches::driver_fault(fault).map(|task| control.spawn(task));
    }

    let (controller, dp, dm) = parts.usb;
    usb::start(spawner, controller, dp, dm);
    let _ = link::uart(parts.uart).map(|task| spawner.spawn(task));
    watch::run(watchdog).await
}
