//! What the last life of the program left behind.
//!
//! A panic or a hard fault stops motion, writes a few words into memory that a reset does not clear, and waits for the watchdog. The next start
//! reads them, together with the chip's own record of what reset it, and the machine tells every host. What an address means,
//! `addr2line -fie station-b ADDRESS` says.

use crate::vectors::RETAINED;
use crate::{engine, pins};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use embassy_stm32::pac;
use shared::frame::message::{End, LastRun, PLACES, ResetCause};
use shared::safety::Fault;

/// Words of memory that this module wants: seal, starts, end, fault, places.
pub const WORDS: usize = 4 + PLACES;

/// Marks the words as written by this program. Chance makes it once in 2^32 power-ons.
const SEAL: u32 = 0x5b1d_c0de;

/// [`End::Panic`] in the record; 0 is [`End::Outside`].
const PANIC: u32 = End::Panic as u32;
/// [`End::HardFault`] in the record.
const HARD_FAULT: u32 = End::HardFault as u32;

fn word(index: usize) -> &'static AtomicU32 {
    static NOWHERE: AtomicU32 = AtomicU32::new(0);
    RETAINED.get(index).unwrap_or(&NOWHERE)
}

/// Reads what reset the chip and the record, and opens a new one. Once, at the start.
pub fn begin() -> (ResetCause, LastRun) {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    // The pin's flag is set by every reset, power-on sets the brown-out's: so from the particular to the general.
    let cause = if flags.wdgrstf() || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if flags.sftrstf() {
        ResetCause::Software
    } else if flags.porrstf() {
        ResetCause::PowerOn
    } else if flags.borrstf() {
        ResetCause::BrownOut
    } else {
        ResetCause::Pin
    };
    let valid = word(0).load(Relaxed) == SEAL;
    let old = |index: usize| if valid { word(index).load(Relaxed) } else { 0 };
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
    for index in 2..WORDS {
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

/// Stops the step timer and the drivers, leaves the message, and waits for the watchdog.
pub fn end(how: End, places: impl Iterator<Item = u32>) -> ! {
    cortex_m::interrupt::disable();
    engine::stop();
    pins::set_drivers(false);
    word(2).store(how as u32, Relaxed);
    for (index, place) in (4..WORDS).zip(places) {
        word(index).store(place, Relaxed);
    }
    loop {
        cortex_m::asm::nop();
    }
}

/// A panic becomes a fault of the processor: the undefined instruction. Its handler then knows where it came from without the tables of file names
/// and lines that `info` would bring along (12 KiB).
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
