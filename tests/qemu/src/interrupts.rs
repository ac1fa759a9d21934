//! Vector table behind the core's own exceptions.

use crate::{time, uart};
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;

/// Interrupt line of the AN386 image.
#[derive(Clone, Copy)]
#[repr(u16)]
pub enum Line {
    /// UART0 has a byte.
    Uart0Receive = 0,
    /// UART0 took a byte.
    Uart0Transmit = 1,
    /// TIMER0 reached zero.
    Timer0 = 8,
    /// TIMER1 reached zero.
    Timer1 = 9,
}

// SAFETY: the numbers are the board's, and each has its handler in the table below.
unsafe impl InterruptNumber for Line {
    fn number(self) -> u16 {
        self as u16
    }
}

/// Enables the line.
pub fn enable(line: Line) {
    // SAFETY: no critical section of this image relies on a masked line; they all disable
    // interrupts as a whole.
    unsafe { NVIC::unmask(line) };
}

unsafe extern "C" fn unexpected() {
    panic!("an interrupt that is not enabled");
}

/// One function for each of the board's 32 lines.
#[used]
#[unsafe(no_mangle)]
#[unsafe(link_section = ".vector_table.interrupts")]
pub static __INTERRUPTS: [unsafe extern "C" fn(); 32] = {
    let mut table = [unexpected as unsafe extern "C" fn(); 32];
    table[Line::Uart0Receive as usize] = uart::on_receive;
    table[Line::Uart0Transmit as usize] = uart::on_transmit;
    table[Line::Timer0 as usize] = time::on_wrap;
    table[Line::Timer1 as usize] = time::on_alarm;
    table
};
