//! Record of the program's previous run.
//!
//! On a panic, a hard fault or a supply that dips, the program stops motion, writes a few words
//! into memory that a reset does not clear, and waits for the watchdog. The next start reads them,
//! together with the chip's own record of the reset's cause, and the machine reports them to every
//! host. `addr2line -fie station-b ADDRESS` converts an address to a source line.
//!
//! # Brown-out
//! The chip's own brown-out detector is off unless its option bytes are set, and its flag never
//! comes alone. A start therefore counts as one after a brown-out in two cases: if the record says
//! that the supply was low, and if power came on with memory intact, because then it was gone for
//! less than the second or so that memory lasts. Switching the station off and on again that
//! quickly has the same effect.

use crate::vectors::{RETAINED, RETAINED_WORDS};
use crate::{engine, pins};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use embassy_stm32::pac;
use trinocular_core::frame::message::{End, LastRun, PLACES, ResetCause};
use trinocular_core::safety::Fault;

/// Words of memory in this module: seal, starts, cause, fault, places.
const _: () = assert!(RETAINED_WORDS == 4 + PLACES);

/// Mark of words written by this program. A random match occurs once in 2^32 power-ons.
const SEAL: u32 = 0x5b1d_c0de;

/// Cause of the program's end, as a number in the record. 0 is a reset from outside.
#[derive(Clone, Copy)]
#[repr(u32)]
pub enum Cause {
    /// Panic of the program.
    Panic = 1,
    /// Hard fault of the processor.
    HardFault = 2,
    /// Supply below 2.9 V.
    Supply = 3,
}

const PANIC: u32 = Cause::Panic as u32;
const HARD_FAULT: u32 = Cause::HardFault as u32;
const SUPPLY: u32 = Cause::Supply as u32;

fn word(index: usize) -> &'static AtomicU32 {
    static NOWHERE: AtomicU32 = AtomicU32::new(0);
    RETAINED.get(index).unwrap_or(&NOWHERE)
}

/// Reads the record and the cause of the reset, and starts a new record. Call once, at the start.
pub fn begin() -> (ResetCause, LastRun) {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    let valid = word(0).load(Relaxed) == SEAL;
    let old = |index: usize| if valid { word(index).load(Relaxed) } else { 0 };
    // Every reset sets the pin's flag, and power-on sets that of the brown-out, so test the
    // specific flags first. The watchdog ends the wait after a dip, so the record outranks its
    // flag.
    let powered = flags.porrstf() || flags.borrstf();
    let cause = if old(2) == SUPPLY || powered && valid {
        ResetCause::BrownOut
    } else if flags.wdgrstf() || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if flags.sftrstf() {
        ResetCause::Software
    } else if powered {
        ResetCause::PowerOn
    } else {
        ResetCause::Pin
    };
    let last_run = LastRun {
        starts: old(1).saturating_add(1),
        fault: Fault::ALL.get((old(3) as usize).wrapping_sub(1)).copied(),
        end: match old(2) {
            PANIC => End::Panic,
            HARD_FAULT => End::HardFault,
            _ => End::Outside,
        },
        places: core::array::from_fn(|index| old(4 + index)),
    };
    word(0).store(SEAL, Relaxed);
    word(1).store(last_run.starts, Relaxed);
    for index in 2..RETAINED_WORDS {
        word(index).store(0, Relaxed);
    }
    (cause, last_run)
}

/// Keeps the machine's fault for the next start: its number plus one, 0 for none.
pub fn keep_fault(fault: Option<Fault>) {
    word(3).store(
        fault.map_or(0, |fault| u32::from(fault.number()) + 1),
        Relaxed,
    );
}

/// Ends motion: masks interrupts, stops the step timer and switches the drivers off.
pub fn silence() {
    cortex_m::interrupt::disable();
    engine::stop();
    pins::set_drivers(false);
}

/// Ends motion, writes the record, and waits for the watchdog.
pub fn end(cause: Cause, places: impl Iterator<Item = u32>) -> ! {
    silence();
    word(2).store(cause as u32, Relaxed);
    for (index, place) in (4..RETAINED_WORDS).zip(places) {
        word(index).store(place, Relaxed);
    }
    loop {
        cortex_m::asm::nop();
    }
}

/// Converts a panic to a fault of the processor, by an undefined instruction. The fault handler
/// then knows the address without the tables of file names and lines in `info`, which take 12 KiB.
#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    #[cfg(feature = "defmt")]
    if let Some(place) = info.location() {
        defmt::error!("panic at {=str}:{=u32}", place.file(), place.line());
    }
    #[cfg(not(feature = "defmt"))]
    let _ = info;
    cortex_m::asm::udf()
}
