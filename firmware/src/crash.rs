//! What the last life of the program left behind.
//!
//! A panic or a hard fault stops motion, writes a few words into memory that a reset does not clear, and waits for the watchdog. The next start
//! reads them, together with the chip's own record of what reset it. What an address means, `addr2line -fie station-b ADDRESS` says.

use crate::vectors::RETAINED;
use crate::{engine, pins};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use embassy_stm32::pac;
use shared::frame::message::ResetCause;

/// Addresses that are kept of a crash: the instruction, the return address, and what on the stack looks like one.
pub const PLACES: usize = 6;

/// Words of memory that this module wants: seal, starts, kind, fault, places.
pub const WORDS: usize = 4 + PLACES;

/// Marks the words as written by this program. Chance makes it once in 2^32 power-ons.
const SEAL: u32 = 0x5b1d_c0de;

/// How the program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// Not by itself: power, pin, or a watchdog that nobody fed.
    None = 0,
    /// It panicked.
    Panic = 1,
    /// The processor faulted.
    HardFault = 2,
}

/// What is known about the time before this start.
#[derive(Clone, Copy, Debug)]
pub struct History {
    /// What reset the chip.
    pub cause: ResetCause,
    /// Starts since power-on, this one included.
    pub starts: u32,
    /// How the program ended.
    pub kind: Kind,
    /// Where: the instruction first, then whoever called, as far as the stack shows it.
    pub places: [u32; PLACES],
    /// Number of the last fault of the machine, plus one; 0 is none.
    pub fault: u32,
}

fn word(index: usize) -> &'static AtomicU32 {
    static NOWHERE: AtomicU32 = AtomicU32::new(0);
    RETAINED.get(index).unwrap_or(&NOWHERE)
}

/// Reads the record and opens a new one. Once, at the start.
pub fn begin() -> History {
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
    let history = History {
        cause,
        starts: old(1).saturating_add(1),
        kind: match old(2) {
            1 => Kind::Panic,
            2 => Kind::HardFault,
            _ => Kind::None,
        },
        places: core::array::from_fn(|index| old(4 + index)),
        fault: old(3),
    };
    word(0).store(SEAL, Relaxed);
    word(1).store(history.starts, Relaxed);
    for index in 2..WORDS {
        word(index).store(0, Relaxed);
    }
    history
}

/// Keeps the machine's fault for the next start.
pub fn keep_fault(number: Option<u8>) {
    word(3).store(number.map_or(0, |number| u32::from(number) + 1), Relaxed);
}

/// Stops the step timer and the drivers, leaves the message, and waits for the watchdog.
pub fn end(kind: Kind, places: impl Iterator<Item = u32>) -> ! {
    cortex_m::interrupt::disable();
    engine::stop();
    pins::set_drivers(false);
    word(2).store(kind as u32, Relaxed);
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
