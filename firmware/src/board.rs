//! The board: clock, pins and word rate. The only place that names a pin.
//!
//! Each board is a small file with the same items; one cargo feature chooses it. Whatever a driver
//! wants of STEP and DIR (pulse lengths, set-up, hold) is not here: it comes with the host's
//! configuration, and the station refuses a driver that the word rate is too fast for.
//!
//! # Inputs
//! Limit switches and the emergency stop are contacts that are closed when all is well, between pin
//! and ground, with the chip's pull-up: a cut wire reads as open. A switch that is not there is a
//! wire to ground.
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
use shared::steps::WordRate;

/// Port words per second: 500 kHz of steps on every axis.
pub const WORD_RATE: WordRate = WordRate::MHZ_1;

/// Speed of the UART link, baud.
pub const UART_BAUD: u32 = 921_600;

/// An output pin.
#[derive(Clone, Copy)]
pub struct Line {
    /// Its port.
    pub port: embassy_stm32::pac::gpio::Gpio,
    /// Its number within the port, 0 to 15.
    pub pin: u8,
    /// The level that means "on".
    pub active_high: bool,
}

/// An input that gates the step timer in hardware: TIM8_ETR, which is PA0 on these chips.
#[derive(Clone, Copy)]
pub struct Gate {
    /// The level at which the timer runs.
    pub active_high: bool,
}

/// Timer and streams of the step engine: whoever has this knows that nobody else has them.
#[expect(dead_code, reason = "the registers are used directly")]
pub struct Hardware {
    /// One overflow per word.
    pub timer: Peri<'static, TIM8>,
    /// DMA2 stream 1, which TIM8's update can request.
    pub player: Peri<'static, DMA2_CH1>,
    /// DMA2 stream 2, which TIM8's compare 1 can request.
    pub eraser: Peri<'static, DMA2_CH2>,
}

/// What a board's `assign` makes of the chip.
pub struct Parts {
    /// Switches of each axis, at the negative end and at the positive end. Open is high.
    pub limits: [[ExtiInput<'static, Async>; 2]; 3],
    /// Open is high, and stops.
    pub emergency_stop: ExtiInput<'static, Async>,
    /// Low is a fault.
    pub driver_fault: Option<ExtiInput<'static, Async>>,
    /// The second link.
    pub uart: BufferedUart<'static>,
    /// The first link: controller, D+, D-.
    pub usb: (
        Peri<'static, USB_OTG_FS>,
        Peri<'static, PA12>,
        Peri<'static, PA11>,
    ),
    /// Timer and DMA streams of the step engine.
    pub engine: Hardware,
    /// The independent watchdog.
    pub watchdog: Peri<'static, IWDG>,
    /// For session numbers.
    pub random: Peri<'static, RNG>,
}

/// 168 MHz from the board's crystal, 48 MHz for USB.
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
