//! Faults of the processor and of its supply, which lead to [`crash::end`].
//!
//! | fault | detected by |
//! |---|---|
//! | panic | the panic handler executes an undefined instruction, which is a hard fault |
//! | stack overflow | the stack leaves core-coupled memory at its lower end, where there is nothing: a bus fault, and so a hard fault |
//! | other hard faults | the processor |
//! | supply below 2.9 V | the chip's voltage detector, which interrupts; the processor is specified for 168 MHz above 2.7 V |
#![allow(unsafe_code)]

use crate::crash::{self, Cause};
use core::arch::naked_asm;
use cortex_m_rt::ExceptionFrame;
use embassy_stm32::interrupt::{self, InterruptExt, Priority};
use embassy_stm32::pac;

/// Address range of flash.
const CODE: core::ops::Range<u32> = 0x0800_0000..0x0810_0000;

/// Size of the exception frame, bytes: eight registers, which the processor pushes before a fault's
/// handler.
const FRAME: u32 = 32;

unsafe extern "C" {
    /// Highest address of the stack, where it begins. Only the addresses of these three symbols
    /// have a meaning.
    static _stack_start: u32;
    /// Lowest address that the stack may reach.
    static _stack_end: u32;
    /// End of RAM by cortex-m-rt's linker script, where the handler has its own stack.
    static _ram_end: u32;
}

/// Switches to a stack of its own before anything else, because a stack overflow may be the cause.
///
/// # Safety
/// For the vector table only.
// SAFETY: two loads, a move and a branch; no stack is used before there is one. RAM's last KiB is
// unused: static data grow from the other end.
#[unsafe(naked)]
#[unsafe(export_name = "HardFault")]
unsafe extern "C" fn hard_fault() -> ! {
    naked_asm!(
        "mov r0, sp",
        "ldr r1, ={top}",
        "mov sp, r1",
        "b {next}",
        top = sym _ram_end,
        next = sym end_with_frame,
    )
}

/// Handles a hard fault, or a panic that became one. Return addresses are odd (Thumb).
extern "C" fn end_with_frame(stack: u32) -> ! {
    crash::silence();
    let bottom = &raw const _stack_end as u32;
    let top = &raw const _stack_start as u32;
    // A frame outside the stack was not written, so it holds no information.
    let above = stack.wrapping_add(FRAME);
    let whole = stack >= bottom && above <= top && stack.is_multiple_of(4);
    let above = if whole { above } else { bottom };
    // SAFETY: aligned words of the stack, from its exception frame or its lowest address on.
    let words = (above / 4..top / 4)
        .map(|word| word << 2)
        .map(|address| unsafe { (address as *const u32).read() });
    let callers = words.filter(|word| word % 2 == 1 && CODE.contains(word));
    if !whole {
        crash::end(Cause::HardFault, callers);
    }
    // SAFETY: the processor wrote an exception's frame there, by the check above.
    let frame = unsafe { &*(stack as *const ExceptionFrame) };
    let at = frame.pc();
    /// `udf #0`
    const UNDEFINED: u16 = 0xde00;
    // SAFETY: an even address within flash, which can always be read.
    let panicked = CODE.contains(&at)
        && at.is_multiple_of(2)
        && unsafe { (at as *const u16).read() } == UNDEFINED;
    let cause = if panicked {
        Cause::Panic
    } else {
        Cause::HardFault
    };
    crash::end(cause, [at, frame.lr()].into_iter().chain(callers))
}

/// Line of the external interrupts that is wired to the voltage detector.
const DETECTOR: usize = 16;

/// Starts to watch the supply. The watchdog must run already, because it ends the wait for a supply
/// that recovers.
pub fn watch_supply() {
    // Threshold 7 is nominally 2.9 V (RM0090 5.4.1).
    pac::PWR.cr1().modify(|w| {
        w.set_pls(7);
        w.set_pvde(true);
    });
    critical_section::with(|_| {
        // The detector's output rises when the supply falls.
        pac::EXTI.rtsr(0).modify(|w| w.set_line(DETECTOR, true));
        pac::EXTI.imr(0).modify(|w| w.set_line(DETECTOR, true));
    });
    interrupt::PVD.set_priority(Priority::P0);
    // SAFETY: no critical section relies on this interrupt being off; its handler never returns.
    unsafe { interrupt::PVD.enable() };
    // A supply that is low from the start makes no edge.
    if pac::PWR.csr1().read().pvdo() {
        interrupt::PVD.pend();
    }
}

#[embassy_stm32::interrupt]
fn PVD() {
    crash::end(Cause::Supply, core::iter::empty())
}
