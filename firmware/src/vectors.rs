//! Interrupts, executors and the memory that survives a reset.
//!
//! This file and [`fault`](crate::fault) hold all unsafe code: everything that hardware, linker or
//! vector table need without the compiler's checks is here, in few lines.
//!
//! # Priorities
//! A smaller number is more urgent. No interrupt waits long: a critical section masks all of them
//! for a few dozen instructions.
//!
//! | priority | interrupt | longest work |
//! |---|---|---|
//! | 0 | PVD (supply) | the last one: it ends in a reset |
//! | 0 | TIM5 (time), EXTI (switches) | wakes a task |
//! | 2 | USART3 | a byte; it must not wait for 250 words |
//! | 3 | UART5, the executor of [`engine`](crate::engine) | the 250 words of a segment |
//! | 4 | OTG_FS | a packet of 64 bytes |
//! | 5 | UART4, the executor of [`control`](crate::control) | a control tick |
//! | - | thread: links, watchdog, LED | |
//!
//! (UART4 and UART5 themselves are not used: their vectors are free.)
#![allow(unsafe_code)]

use core::sync::atomic::AtomicU32;
use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_stm32::interrupt::{self, InterruptExt, Priority};
use embassy_stm32::{bind_interrupts, exti, peripherals, rng, usart, usb};
use static_cell::ConstStaticCell;

bind_interrupts!(
    /// Interrupt handlers of the HAL's drivers.
    pub struct Irqs {
        OTG_FS => usb::InterruptHandler<peripherals::USB_OTG_FS>;
        USART3 => usart::BufferedInterruptHandler<peripherals::USART3>;
        RNG => rng::InterruptHandler<peripherals::RNG>;
        EXTI0 => exti::InterruptHandler<interrupt::typelevel::EXTI0>;
        EXTI1 => exti::InterruptHandler<interrupt::typelevel::EXTI1>;
        EXTI2 => exti::InterruptHandler<interrupt::typelevel::EXTI2>;
        EXTI3 => exti::InterruptHandler<interrupt::typelevel::EXTI3>;
        EXTI4 => exti::InterruptHandler<interrupt::typelevel::EXTI4>;
        EXTI9_5 => exti::InterruptHandler<interrupt::typelevel::EXTI9_5>;
        EXTI15_10 => exti::InterruptHandler<interrupt::typelevel::EXTI15_10>;
    }
);

static STEP: InterruptExecutor = InterruptExecutor::new();
static CONTROL: InterruptExecutor = InterruptExecutor::new();

/// Priority level of a task.
#[derive(Clone, Copy)]
pub enum Level {
    /// Level of the step engine.
    Step,
    /// Level of the machine.
    Control,
}

/// Starts an executor and sets the other interrupts' priorities around it. Call once per level.
pub fn executor(level: Level) -> SendSpawner {
    interrupt::USART3.set_priority(Priority::P2);
    interrupt::OTG_FS.set_priority(Priority::P4);
    match level {
        Level::Step => {
            interrupt::UART5.set_priority(Priority::P3);
            STEP.start(interrupt::UART5)
        }
        Level::Control => {
            interrupt::UART4.set_priority(Priority::P5);
            CONTROL.start(interrupt::UART4)
        }
    }
}

#[embassy_stm32::interrupt]
fn UART5() {
    // SAFETY: STEP was started with this interrupt, and no other code calls `on_interrupt`.
    unsafe { STEP.on_interrupt() }
}

#[embassy_stm32::interrupt]
fn UART4() {
    // SAFETY: CONTROL was started with this interrupt, and no other code calls `on_interrupt`.
    unsafe { CONTROL.on_interrupt() }
}

/// Number of words in [`RETAINED`].
pub const RETAINED_WORDS: usize = 10;

/// Words that a reset does not clear; [`crash`](crate::crash) defines their meaning. After power-on
/// their values are arbitrary.
// SAFETY: the section exists in cortex-m-rt's linker script and is neither loaded nor cleared.
// Every bit pattern is a valid AtomicU32, and all accesses go through atomics, which the compiler
// may not fold into the initial value.
#[unsafe(link_section = ".uninit.retained")]
pub static RETAINED: [AtomicU32; RETAINED_WORDS] = [const { AtomicU32::new(0) }; RETAINED_WORDS];

/// Returns the memory of the UART's driver: a few packets per direction. The second call panics.
pub fn uart_buffers() -> (&'static mut [u8], &'static mut [u8]) {
    static TX: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);
    static RX: ConstStaticCell<[u8; 256]> = ConstStaticCell::new([0; 256]);
    (TX.take(), RX.take())
}
