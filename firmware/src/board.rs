//! Board: clock, pins and word rate. The only module that names a pin.
//!
//! Each board is a small file with the same items; one cargo feature selects it. The driver's
//! timing of STEP and DIR (pulse lengths, set-up, hold) is not here: it comes with the host's
//! configuration, and the station refuses a driver that is too slow for the word rate.
//!
//! # Inputs
//! Limit switches and the emergency stop are contacts between pin and ground that are closed in the
//! normal state, with the chip's pull-up: a cut wire reads as open. A missing switch is replaced by
//! a wire to ground.
//!
//! The emergency stop's second contact, on boards with a [`Gate`], stops the step timer itself.

#[cfg(feature = "olimex-h405")]
mod olimex_h405;
#[cfg(feature = "olimex-h405")]
pub use olimex_h405::*;

#[cfg(feature = "feather-f405")]
mod feather_f405;
#[cfg(feature = "feather-f405")]
pub use feather_f405::*;

#[cfg(any(feature = "olimex-h405", feature = "feather-f405"))]
mod plain_f405;

#[cfg(feature = "skr-2")]
mod skr_2;
#[cfg(feature = "skr-2")]
pub use skr_2::*;

use embassy_stm32::exti::ExtiInput;
use embassy_stm32::mode::Async;
use embassy_stm32::peripherals::{DMA2_CH1, DMA2_CH2, IWDG, PA11, PA12, RNG, TIM8, USB_OTG_FS};
use embassy_stm32::usart::BufferedUart;
use embassy_stm32::{Config, Peri};
use trinocular_core::steps::WordRate;

/// Port words per second: at most 500,000 steps/s on every axis.
pub const WORD_RATE: WordRate = WordRate::MHZ_1;

/// Rate of the UART link, baud.
pub const UART_BAUD: u32 = 921_600;

/// Output pin.
#[derive(Clone, Copy)]
pub struct Line {
    /// GPIO port of the pin.
    pub port: embassy_stm32::pac::gpio::Gpio,
    /// Number of the pin within its port, 0 to 15.
    pub pin: u8,
    /// True if the high level means "on".
    pub active_high: bool,
}

/// Input that gates the step timer in hardware: TIM8_ETR, which is PA0 on these chips.
#[derive(Clone, Copy)]
pub struct Gate {
    /// True if the timer runs at the high level.
    pub active_high: bool,
}

/// Timer and streams of the step engine. Its owner has exclusive use of them.
#[expect(dead_code, reason = "the registers are used directly")]
pub struct Hardware {
    /// Step timer, with one overflow per word.
    pub timer: Peri<'static, TIM8>,
    /// Player: DMA2 stream 1, which TIM8's update can request.
    pub player: Peri<'static, DMA2_CH1>,
    /// Eraser: DMA2 stream 2, which TIM8's compare 1 can request.
    pub eraser: Peri<'static, DMA2_CH2>,
}

/// Peripherals of the chip, as a board's `assign` sets them up.
pub struct Parts {
    /// Limit switches of each axis, negative end first. The high level means open.
    pub limits: [[ExtiInput<'static, Async>; 2]; 3],
    /// Emergency stop. The high level means open, and stops.
    pub emergency_stop: ExtiInput<'static, Async>,
    /// Fault line of the drivers. The low level means a fault.
    pub driver_fault: Option<ExtiInput<'static, Async>>,
    /// UART, the second link.
    pub uart: BufferedUart<'static>,
    /// USB, the first link: controller, D+, D-.
    pub usb: (
        Peri<'static, USB_OTG_FS>,
        Peri<'static, PA12>,
        Peri<'static, PA11>,
    ),
    /// Timer and DMA streams of the step engine.
    pub engine: Hardware,
    /// The independent watchdog.
    pub watchdog: Peri<'static, IWDG>,
    /// Random number generator, for session numbers.
    pub random: Peri<'static, RNG>,
}

/// Returns the clock configuration: 168 MHz from the board's crystal, 48 MHz for USB.
pub fn clocks() -> Config {
    use embassy_stm32::rcc::{
        AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv,
        PllSource, Sysclk, mux,
    };
    use embassy_stm32::time::Hertz;
    // The PLL's input is 2 MHz for either crystal.
    const PREDIV: PllPreDiv = match CRYSTAL_HZ {
        8_000_000 => PllPreDiv::DIV4,
        12_000_000 => PllPreDiv::DIV6,
        _ => panic!("a crystal of 8 or 12 MHz"),
    };
    let mut config = Config::default();
    config.rcc.hsi = false;
    config.rcc.hse = Some(Hse {
        freq: Hertz(CRYSTAL_HZ),
        mode: HseMode::Oscillator,
    });
    config.rcc.pll_src = PllSource::HSE;
    config.rcc.pll = Some(Pll {
        prediv: PREDIV,
        mul: PllMul::MUL168,
        divp: Some(PllPDiv::DIV2),
        divq: Some(PllQDiv::DIV7),
        divr: None,
    });
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV1;
    config.rcc.apb1_pre = APBPrescaler::DIV4;
    // TIM8 then runs at twice APB2's 84 MHz, `engine::TIMER_HZ`.
    config.rcc.apb2_pre = APBPrescaler::DIV2;
    config.rcc.mux.clk48sel = mux::Clk48sel::PLL1_Q;
    config
}
