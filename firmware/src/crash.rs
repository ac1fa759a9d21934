//! What the last life of the program left behind.
//!
//! A panic, a hard fault or a supply that dips stops motion, writes a few words into memory that a
//! reset does not clear, and waits for the watchdog. The next start reads them, together with the
//! chip's own record of what reset it, and the machine tells every host. What an address means,
//! `addr2line -fie station-b ADDRESS` says.
//!
//! # Brown-out
//! The chip's own detector of brown-outs is off unless its option bytes are set, and its flag
//! never comes alone. So a start counts as one after a brown-out when the record says that the
//! supply was low, and when power came on with memory intact: then it was gone for less than the
//! second or so that memory lasts. Whoever switches the station off and on again that quickly is
//! told the same.

use crate::vectors::{RETAINED, RETAINED_WORDS};
use crate::{engine, pins};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use embassy_stm32::pac;
use shared::frame::message::{End, LastRun, PLACES, ResetCause};
use shared::safety::Fault;

/// Words of memory that this module has: seal, starts, cause, fault, places.
const _: () = assert!(RETAINED_WORDS == 4 + PLACES);

/// Marks the words as written by this program. Chance makes it once in 2^32 power-ons.
const SEAL: u32 = 0x5b1d_c0de;

/// How the program ended, as a number in the record. 0 is a reset from outside.
#[derive(Clone, Copy)]
#[repr(u32)]
pub enum Cause {
    /// The program gave up.
    Panic = 1,
    /// The processor did.
    HardFault = 2,
    /// The supply fell below 2.9 V.
    Supply = 3,
}

const PANIC: u32 = Cause::Panic as u32;
const HARD_FAULT: u32 = Cause::HardFault as u32;
const SUPPLY: u32 = Cause::Supply as u32;

fn word(index: usize) -> &'static AtomicU32 {
    static NOWHERE: AtomicU32 = AtomicU32::new(0);
    RETAINED.get(index).unwrap_or(&NOWHERE)
}

/// Reads what reset the chip and the record, and opens a new one. Once, at the start.
pub fn begin() -> (ResetCause, LastRun) {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    let valid = word(0).load(Relaxed) == SEAL;
    let old = |index: usize| if valid { word(index).load(Relaxed) } else { 0 };
    // The pin's flag is set by every reset, power-on sets the brown-out's: so from the particular
    // to the general. The watchdog ends the wait after a dip, so its flag says less than the
    // record.
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

/// Keeps the machine's fault for the next start: its number plus one, 0 is none.
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

/// Ends motion, leaves the message, and waits for the watchdog.
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

/// A panic becomes a fault of the processor: the undefined instruction. Its handler then knows
/// where it came from without the tables of file names and lines that `info` would bring along (12
/// KiB).
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
