//! Common parts of the plain STM32F405RG boards, whose headers carry the same pins.

use super::{Hardware, Line, Parts, UART_BAUD};
use crate::vectors::{Irqs, uart_buffers};
use embassy_stm32::exti::ExtiInput;
use embassy_stm32::gpio::Pull;
use embassy_stm32::usart::{BufferedUart, Config, ConfigError};
use embassy_stm32::{Peripherals, pac};

/// Port of all STEP and DIR pins.
pub const STEP_PORT: pac::gpio::Gpio = pac::GPIOC;

/// Enable lines, switched on together when the station is configured: the drivers' nEN, PB15 (the
/// Feather's MO).
pub const DRIVERS: &[Line] = &[Line {
    port: pac::GPIOB,
    pin: 15,
    active_high: false,
}];

/// Assigns a function to every pin.
///
/// # Errors
/// [`ConfigError`] if the UART cannot run at [`UART_BAUD`].
pub fn assign(p: Peripherals) -> Result<Parts, ConfigError> {
    let mut config = Config::default();
    config.baudrate = UART_BAUD;
    // An unconnected receiver picks up interference from the motors' cables.
    config.rx_pull = Pull::Up;
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
