//! A plain STM32F405RG: Adafruit Feather STM32F405 Express. In brackets the names on its silk screen.

use super::{Line, Parts, UART_BAUD};
use crate::engine::Hardware;
use crate::vectors::{Irqs, uart_buffers};
use embassy_stm32::exti::ExtiInput;
use embassy_stm32::gpio::Pull;
use embassy_stm32::usart::{BufferedUart, Config, ConfigError};
use embassy_stm32::{Peripherals, pac};
use shared::steps::PortMap;

/// As hello reports it.
pub const NAME: &str = "feather-f405";

/// The crystal.
pub const CRYSTAL_HZ: u32 = 12_000_000;

/// The port of all STEP and DIR pins.
pub const STEP_PORT: pac::gpio::Gpio = pac::GPIOC;

/// STEP on PC2 [12], PC4 [A4], PC6 [6]; DIR on PC3 [11], PC5 [A5], PC7 [5]. The host's configuration says which axes are inverted.
pub const STEP_PINS: PortMap = PortMap {
    step: [2, 4, 6],
    dir: [3, 5, 7],
    invert: [false; 3],
};

/// Switched on together when the station is configured: the drivers' enable line (nEN), PB15 [MO].
pub const DRIVERS: &[Line] = &[Line {
    port: pac::GPIOB,
    pin: 15,
    active_high: false,
}];

/// The red LED of the board, PC1 [13].
pub const LED: Line = Line {
    port: pac::GPIOC,
    pin: 1,
    active_high: true,
};

/// Gives every pin its work.
///
/// # Errors
/// If the UART cannot run at [`UART_BAUD`].
pub fn assign(p: Peripherals) -> Result<Parts, ConfigError> {
    let mut config = Config::default();
    config.baudrate = UART_BAUD;
    let (tx_buffer, rx_buffer) = uart_buffers();
    Ok(Parts {
        limits: [
            [
                ExtiInput::new(p.PA4, p.EXTI4, Pull::Up, Irqs),
                ExtiInput::new(p.PA5, p.EXTI5, Pull::Up, Irqs),
            ],
            [
                ExtiInput::new(p.PA6, p.EXTI6, Pull::Up, Irqs),
                ExtiInput::new(p.PA7, p.EXTI7, Pull::Up, Irqs),
            ],
            [
                ExtiInput::new(p.PB8, p.EXTI8, Pull::Up, Irqs),
                ExtiInput::new(p.PB9, p.EXTI9, Pull::Up, Irqs),
            ],
        ],
        emergency_stop: ExtiInput::new(p.PB13, p.EXTI13, Pull::Up, Irqs),
        driver_fault: Some(ExtiInput::new(p.PB14, p.EXTI14, Pull::Up, Irqs)),
        uart: BufferedUart::new(p.USART3, p.PB11, p.PB10, tx_buffer, rx_buffer, Irqs, config)?,
        usb: (p.USB_OTG_FS, p.PA12, p.PA11),
        engine: Hardware {
            timer: p.TIM8,
            player: p.DMA2_CH1,
            eraser: p.DMA2_CH2,
        },
        watchdog: p.IWDG,
        random: p.RNG,
    })
}
