//! BIGTREETECH SKR 2 with an STM32F407VG: a board for plug-in stepper drivers.
//!
//! Three of its five driver sockets have STEP and DIR on one port, and these carry the axes: X in
//! the socket marked Y, Y in the one marked E0, Z in the one marked E1. (Its sockets X and Z, and
//! the boards SKR Pro and Octopus, spread STEP and DIR of three axes over several ports, which one
//! stream of port words cannot serve.) PC13 switches the motor power through a transistor.
//!
//! This image replaces the maker's boot loader, which would expect a program 32 KiB higher.

use super::{Gate, Hardware, Line, Parts, UART_BAUD};
use crate::vectors::{Irqs, uart_buffers};
use embassy_stm32::exti::ExtiInput;
use embassy_stm32::gpio::Pull;
use embassy_stm32::usart::{BufferedUart, Config, ConfigError};
use embassy_stm32::{Peripherals, pac};
use trinocular_core::steps::PortMap;

/// Name of the board in hello.
pub const NAME: &str = "skr-2";

/// Frequency of the crystal, Hz.
pub const CRYSTAL_HZ: u32 = 8_000_000;

/// Port of all STEP and DIR pins.
pub const STEP_PORT: pac::gpio::Gpio = pac::GPIOD;

/// Sockets Y, E0, E1. The host's configuration states which axes are inverted.
pub const STEP_PINS: PortMap = PortMap {
    step: [5, 15, 11],
    dir: [4, 14, 10],
    invert: [false; 3],
};

/// Enable lines, switched on together when the station is configured: motor power first, then the
/// nEN line of each socket.
pub const DRIVERS: &[Line] = &[
    Line {
        port: pac::GPIOC,
        pin: 13,
        active_high: true,
    },
    Line {
        port: pac::GPIOD,
        pin: 6,
        active_high: false,
    },
    Line {
        port: pac::GPIOC,
        pin: 7,
        active_high: false,
    },
    Line {
        port: pac::GPIOD,
        pin: 13,
        active_high: false,
    },
];

/// Camera pin, PD1: the enable pin of the empty socket marked Z.
pub const CAMERA_PIN: Option<u8> = Some(1);

/// Second contact of the emergency stop, between PA0 (header E1DET) and ground, like all others of
/// this board. The high level means open.
pub const GATE: Option<Gate> = Some(Gate { active_high: false });

/// Status LED. The board has none on a pin; connect one to PE13, header EXP1.
pub const LED: Line = Line {
    port: pac::GPIOE,
    pin: 13,
    active_high: true,
};

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
        // The headers of negative ends are marked X-STOP, Y-STOP, Z-STOP; of positive ends E0DET,
        // PROBE (signal), PWRDET.
        limits: [
            [
                ExtiInput::new(p.PC1, p.EXTI1, Pull::Up, Irqs),
                ExtiInput::new(p.PC2, p.EXTI2, Pull::Up, Irqs),
            ],
            [
                ExtiInput::new(p.PC3, p.EXTI3, Pull::Up, Irqs),
                ExtiInput::new(p.PE4, p.EXTI4, Pull::Up, Irqs),
            ],
            [
                ExtiInput::new(p.PC0, p.EXTI0, Pull::Up, Irqs),
                ExtiInput::new(p.PC15, p.EXTI15, Pull::Up, Irqs),
            ],
        ],
        // PROBE header, servo pin.
        emergency_stop: ExtiInput::new(p.PE5, p.EXTI5, Pull::Up, Irqs),
        driver_fault: None,
        uart: BufferedUart::new(p.USART3, p.PD9, p.PD8, tx_buffer, rx_buffer, Irqs, config)?,
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
