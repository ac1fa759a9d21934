//! Chip around the processor: registers, events in the order of their time, interrupt lines.
//!
//! The models follow the reference manual RM0090 (STM32F405/407), as far as this firmware uses the
//! chip. Nothing is silently absent: [`Chip::complaints`] collects accesses to a register without a
//! model, to a peripheral without its clock, or of a kind that the manual forbids, and tests
//! require that list to be empty.

pub mod dma;
pub mod exti;
pub mod fabric;
pub mod flash;
pub mod gpio;
pub mod iwdg;
pub mod otg;
pub mod rcc;
pub mod rng;
pub mod timer;
pub mod usart;

use crate::time::{Beats, period};
use crate::usb_host::UsbHost;
use dma::Dma;
use fabric::Fabric;
use iwdg::Iwdg;
use otg::Otg;
use rcc::{Clocks, Gate, Rcc};
use rng::Rng;
use std::collections::BTreeSet;
use timer::Timer;
use usart::Usart;

/// Interrupt lines, one bit each.
pub type Lines = [u32; 3];

/// Interrupt numbers (RM0090, vector table).
mod irq {
    pub const EXTI: [u8; 16] = [6, 7, 8, 9, 10, 23, 23, 23, 23, 23, 40, 40, 40, 40, 40, 40];
    pub const DMA: [[u8; 8]; 2] = [
        [11, 12, 13, 14, 15, 16, 17, 47],
        [56, 57, 58, 59, 60, 68, 69, 70],
    ];
    pub const PVD: u8 = 1;
    pub const USART3: u8 = 39;
    pub const TIM8: [u8; 2] = [44, 46];
    pub const TIM5: u8 = 50;
    pub const OTG_FS: u8 = 67;
    pub const RNG: u8 = 80;
}

/// Clock gates: bus (AHB1, AHB2, AHB3, APB1, APB2) and bit.
mod gate {
    use super::Gate;
    pub const GPIO: usize = 0;
    pub const DMA: [Gate; 2] = [(0, 21), (0, 22)];
    pub const RNG: Gate = (1, 6);
    pub const OTG_FS: Gate = (1, 7);
    pub const TIM5: Gate = (3, 3);
    pub const USART3: Gate = (3, 18);
    pub const PWR: Gate = (3, 28);
    pub const TIM8: Gate = (4, 1);
    pub const SYSCFG: Gate = (4, 14);
}

/// Surroundings of the chip, which outlive a reset.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings {
    /// Frequency of the crystal, Hz.
    pub crystal_hz: u64,
    /// Frequency of the watchdog's oscillator, Hz: 17,000 to 47,000 (data sheet).
    pub lsi_hz: u64,
    /// Rate of the UART's other end, baud.
    pub uart_baud: u64,
    /// Seed of random numbers and of the memory's content at power-on.
    pub seed: u64,
    /// Value of DBGMCU_IDCODE.
    pub idcode: u32,
}

/// Peripherals, memory and pins.
#[derive(Debug)]
pub struct Chip {
    around: Surroundings,
    /// Reset and clock control.
    pub rcc: Rcc,
    /// Pins and memory.
    pub fabric: Fabric,
    /// DMA1 and DMA2.
    pub dma: [Dma; 2],
    /// Timer of the time driver.
    pub tim5: Timer,
    /// Timer of the step engine.
    pub tim8: Timer,
    /// UART of the second link.
    pub usart3: Usart,
    /// The watchdog.
    pub iwdg: Iwdg,
    rng: Rng,
    /// The USB controller.
    pub otg: Otg,
    /// Host at the other end of the USB cable.
    pub usb_host: UsbHost,
    /// Register FLASH_ACR.
    pub flash_acr: u32,
    pwr: [u32; 2],
    /// Supply voltage, mV.
    supply_mv: u32,
    dbgmcu: [u32; 3],
    clocks: Clocks,
    /// Next event of any peripheral but TIM8.
    slow: Option<Beats>,
    lines: Lines,
    /// Pending reset by a watchdog timeout, with its flags.
    pub reset: Option<u32>,
    /// Invalid accesses.
    pub complaints: BTreeSet<String>,
}

impl Chip {
    /// Creates the chip at power-on.
    pub fn new(around: Surroundings, fabric: Fabric) -> Self {
        let flags = rcc::flag::POWER_ON | rcc::flag::BROWN_OUT | rcc::flag::PIN;
        let rcc = Rcc::new(around.crystal_hz, flags);
        let clocks = rcc.clocks(0);
        Self {
            around,
            rcc,
            fabric,
            dma: Default::default(),
            tim5: Timer::new(true, period(clocks.timer1)),
            tim8: Timer::new(false, period(clocks.timer2)),
            usart3: Usart::new(period(clocks.pclk1), around.uart_baud),
            iwdg: Iwdg::new(around.lsi_hz),
            rng: Rng::new(around.seed),
            otg: Otg::default(),
            usb_host: UsbHost::default(),
            flash_acr: 0,
            pwr: [0x4000, 0],
            supply_mv: 3_300,
            dbgmcu: [0; 3],
            clocks,
            slow: None,
            lines: [0; 3],
            reset: None,
            complaints: BTreeSet::new(),
        }
    }

    /// Resets everything but the debug block, the reset flags, the wires outside and memory.
    pub fn reset(&mut self, flags: u32) {
        self.rcc = Rcc::new(
            self.around.crystal_hz,
            self.rcc.flags() | flags | rcc::flag::PIN,
        );
        self.clocks = self.rcc.clocks(self.fabric.now);
        self.dma = Default::default();
        self.fabric.reset();
        self.tim5 = Timer::new(true, period(self.clocks.timer1));
        self.tim8 = Timer::new(false, period(self.clocks.timer2));
        self.usart3.reset(period(self.clocks.pclk1));
        self.iwdg = Iwdg::new(self.around.lsi_hz);
        self.rng.reset();
        self.otg = Otg::default();
        self.flash_acr = 0;
        self.pwr = [0x4000, 0];
        self.reset = None;
        self.refresh();
    }

    /// Returns the clock tree.
    pub fn clocks(&self) -> Clocks {
        self.clocks
    }

    /// Returns the duration of a processor cycle.
    pub fn cycle(&self) -> Beats {
        period(self.clocks.hclk)
    }

    /// Returns the active interrupt lines.
    pub fn lines(&self) -> Lines {
        self.lines
    }

    /// Returns the next event after the present moment.
    pub fn next(&self) -> Option<Beats> {
        [self.tim8.next(), self.slow].into_iter().flatten().min()
    }

    /// Handles events until `end`, or until one that changes the interrupt lines or resets the
    /// chip. Returns the moment reached.
    pub fn advance(&mut self, end: Beats) -> Beats {
        loop {
            let fast = self.tim8.next();
            let Some(at) = fast
                .into_iter()
                .chain(self.slow)
                .min()
                .filter(|at| *at <= end)
            else {
                self.fabric.now = end;
                return end;
            };
            self.fabric.now = at;
            if fast == Some(at) {
                let requests = self.tim8.advance(at);
                self.request(requests);
            }
            let before = self.lines;
            if self.slow == Some(at) {
                self.happen(at);
            } else if self.tim8.interrupts() != [false; 2] {
                self.refresh();
            }
            if self.lines != before || self.reset.is_some() {
                return at;
            }
        }
    }

    /// Passes TIM8's requests to DMA2 (RM0090, table "DMA2 request mapping"), all on channel 7.
    fn request(&mut self, requests: timer::Requests) {
        const STREAMS: [usize; 5] = [1, 2, 3, 4, 7];
        for (bit, stream) in STREAMS.into_iter().enumerate() {
            if requests & 1 << bit != 0 && self.rcc.runs(gate::DMA[1]) {
                self.dma[1].request(stream, 7, &mut self.fabric);
                if self.dma[1].streams[stream].cr & 0x16 != 0 {
                    self.refresh();
                }
            }
        }
    }

    fn happen(&mut self, now: Beats) {
        self.tim5.advance(now);
        self.usart3.advance(now);
        if self.usb_host.next(&self.otg).is_some_and(|at| at <= now) {
            self.usb_host.act(now, &mut self.otg);
        }
        if self.iwdg.next().is_some_and(|at| at <= now) {
            self.reset = Some(rcc::flag::WATCHDOG);
        }
        self.refresh();
    }

    /// Updates lines and the next slow event.
    pub fn refresh(&mut self) {
        let now = self.fabric.now;
        self.tim8.set_trigger(self.external_trigger(), now);
        let candidates = [
            self.tim5.next(),
            self.usart3.next(),
            self.iwdg.next(),
            self.rng.next(now),
            self.usb_host.next(&self.otg).map(|at| at.max(now)),
        ];
        self.slow = candidates.into_iter().flatten().min();
        let mut lines = [0; 3];
        let mut raise =
            |irq: u8, up: bool| lines[usize::from(irq) / 32] |= u32::from(up) << (irq % 32);
        let pending = self.fabric.exti.pending();
        raise(irq::PVD, pending & exti::DETECTOR != 0);
        for (line, irq) in irq::EXTI.into_iter().enumerate() {
            raise(irq, pending & 1 << line != 0);
        }
        for (dma, irqs) in self.dma.iter().zip(irq::DMA) {
            for (up, irq) in dma.interrupts().into_iter().zip(irqs) {
                raise(irq, up);
            }
        }
        raise(irq::USART3, self.usart3.interrupts());
        for (up, irq) in self.tim8.interrupts().into_iter().zip(irq::TIM8) {
            raise(irq, up);
        }
        raise(irq::TIM5, self.tim5.interrupts().contains(&true));
        raise(irq::OTG_FS, self.otg.interrupts());
        raise(irq::RNG, self.rng.interrupts(now));
        self.lines = lines;
    }

    /// Returns the level of TIM8_ETR, PA0 as alternate function 3 (data sheet).
    fn external_trigger(&self) -> bool {
        let port = &self.fabric.ports[0];
        port.mode(0) == 2 && port.afr[0] & 0xf == 3 && port.levels() & 1 != 0
    }

    /// Returns the voltage detector's output: true if it is on and the supply lies below its
    /// threshold (RM0090 5.4.1, data sheet).
    fn supply_is_low(&self) -> bool {
        const THRESHOLDS_MV: [u32; 8] = [2_000, 2_100, 2_300, 2_500, 2_600, 2_700, 2_800, 2_900];
        let threshold = THRESHOLDS_MV[(self.pwr[0] >> 5 & 7) as usize];
        self.pwr[0] & 1 << 4 != 0 && self.supply_mv < threshold
    }

    /// Changes the detector's state, and passes the edge of its output on.
    fn detect<T>(&mut self, act: impl FnOnce(&mut Self) -> T) -> T {
        let before = self.supply_is_low();
        let result = act(self);
        let after = self.supply_is_low();
        if before != after {
            self.fabric.exti.detector_edge(after);
        }
        result
    }

    /// Sets the supply voltage, mV. The chip's reset at about 1.7 V is
    /// [`Board::lose_power`](crate::board::Board::lose_power).
    pub fn set_supply(&mut self, mv: u32) {
        self.detect(|chip| chip.supply_mv = mv);
        self.refresh();
    }

    /// Starts bytes from the UART's other end.
    pub fn uart_arrives(&mut self, bytes: &[u8]) {
        self.usart3.arrive(self.fabric.now, bytes);
        self.refresh();
    }

    fn gated(&mut self, gate: Gate, address: u32) -> bool {
        let runs = self.rcc.runs(gate);
        if !runs {
            self.complain(format!("{address:#010x} has no clock"));
        }
        runs
    }

    fn complain(&mut self, text: String) {
        self.complaints.insert(text);
    }

    /// Executes a word read of the processor.
    pub fn read(&mut self, address: u32) -> u32 {
        let now = self.fabric.now;
        let (block, offset) = (address & !0x3ff, address & 0x3ff);
        let value = match block {
            0x4000_0c00 if self.gated(gate::TIM5, address) => {
                self.tim5.advance(now);
                self.tim5.read(offset)
            }
            0x4001_0400 if self.gated(gate::TIM8, address) => self.tim8.read(offset),
            0x4000_3000 => self.iwdg.read(offset, now),
            0x4000_4800 if self.gated(gate::USART3, address) => self.usart3.read(offset),
            0x4000_7000 if self.gated(gate::PWR, address) => match offset {
                // The regulator is ready.
                4 => Some(self.pwr[1] | 1 << 14 | u32::from(self.supply_is_low()) << 2),
                _ => self.pwr.get(offset as usize / 4).copied(),
            },
            0x4001_3800 if self.gated(gate::SYSCFG, address) => match offset {
                0x08..=0x14 => Some(self.fabric.exti.ports[(offset as usize - 8) / 4]),
                _ => None,
            },
            0x4001_3c00 => self.fabric.exti.read(offset),
            0x4002_0000..0x4002_2400 => {
                let port = (block - 0x4002_0000) / 0x400;
                match self.gated((gate::GPIO, port), address) {
                    true => self.fabric.ports[port as usize].read(offset),
                    false => Some(0),
                }
            }
            0x4002_3800 => self.rcc.read(offset, now),
            0x4002_3c00 if offset == 0 => Some(self.flash_acr),
            0x4002_6000 | 0x4002_6400 => {
                let which = (block - 0x4002_6000) as usize / 0x400;
                match self.gated(gate::DMA[which], address) {
                    true => self.dma[which].read(offset),
                    false => Some(0),
                }
            }
            0x5000_0000..0x5004_0000 => match self.gated(gate::OTG_FS, address) {
                true => self.otg.read(address - 0x5000_0000),
                false => Some(0),
            },
            0x5006_0800 if self.gated(gate::RNG, address) => self.rng.read(offset, now),
            0xe004_2000 if offset == 0 => Some(self.around.idcode),
            0xe004_2000 => self.dbgmcu.get(offset as usize / 4 - 1).copied(),
            0x4000_0c00 | 0x4001_0400 | 0x4000_4800 | 0x4000_7000 | 0x4001_3800 | 0x5006_0800 => {
                Some(0)
            }
            _ => None,
        };
        if let Some(misuse) = self.otg.misuse.take() {
            self.complain(misuse.to_owned());
        }
        self.refresh();
        value.unwrap_or_else(|| {
            self.complain(format!("read of {address:#010x}: no model"));
            0
        })
    }

    /// Executes a word write of the processor.
    pub fn write(&mut self, address: u32, value: u32) {
        let now = self.fabric.now;
        let (block, offset) = (address & !0x3ff, address & 0x3ff);
        let done = match block {
            0x4000_0c00 if self.gated(gate::TIM5, address) => {
                self.tim5.advance(now);
                self.tim5.write(offset, value, now).map(|_| ())
            }
            0x4001_0400 if self.gated(gate::TIM8, address) => {
                let requests = self.tim8.write(offset, value, now);
                self.request(requests.unwrap_or(0));
                requests.map(|_| ())
            }
            0x4000_3000 => self.iwdg.write(offset, value, now),
            0x4000_4800 if self.gated(gate::USART3, address) => {
                self.usart3.write(offset, value, now)
            }
            0x4000_7000 if self.gated(gate::PWR, address) => self.detect(|chip| {
                let word = chip.pwr.get_mut(offset as usize / 4)?;
                *word = value;
                Some(())
            }),
            0x4001_3800 if self.gated(gate::SYSCFG, address) => match offset {
                0x08..=0x14 => {
                    self.fabric.exti.ports[(offset as usize - 8) / 4] = value & 0xffff;
                    Some(())
                }
                _ => None,
            },
            0x4001_3c00 => self.fabric.exti.write(offset, value),
            0x4002_0000..0x4002_2400 => {
                let port = (block - 0x4002_0000) / 0x400;
                match self.gated((gate::GPIO, port), address) {
                    true => self.fabric.write_port(port as usize, offset, value),
                    false => Some(()),
                }
            }
            0x4002_3800 => {
                let done = self.rcc.write(offset, value, now);
                self.take_clocks(now);
                self.hold_in_reset();
                done
            }
            0x4002_3c00 if offset == 0 => {
                self.flash_acr = value & 0x1f07;
                Some(())
            }
            0x4002_6000 | 0x4002_6400 => {
                let which = (block - 0x4002_6000) as usize / 0x400;
                match self.gated(gate::DMA[which], address) {
                    true => self.dma[which].write(offset, value, &mut self.fabric),
                    false => Some(()),
                }
            }
            0x5000_0000..0x5004_0000 => match self.gated(gate::OTG_FS, address) {
                true => self.otg.write(address - 0x5000_0000, value),
                false => Some(()),
            },
            0x5006_0800 if self.gated(gate::RNG, address) => self.rng.write(offset, value, now),
            0xe004_2000 if offset > 0 => {
                let word = self.dbgmcu.get_mut(offset as usize / 4 - 1);
                word.map(|word| *word = value)
            }
            0x4000_0c00 | 0x4001_0400 | 0x4000_4800 | 0x4000_7000 | 0x4001_3800 | 0x5006_0800 => {
                Some(())
            }
            _ => None,
        };
        if let Some(misuse) = self.otg.misuse.take() {
            self.complain(misuse.to_owned());
        }
        if done.is_none() {
            self.complain(format!(
                "write of {value:#x} to {address:#010x}: no such thing"
            ));
        }
        self.refresh();
    }

    /// Handles a write to the clock tree.
    fn take_clocks(&mut self, now: Beats) {
        let clocks = self.rcc.clocks(now);
        if clocks == self.clocks {
            return;
        }
        if clocks.hclk == 0 {
            return self.complain("the processor's clock is off".to_owned());
        }
        self.clocks = clocks;
        self.tim5.set_clock(period(clocks.timer1), now);
        self.tim8.set_clock(period(clocks.timer2), now);
        self.usart3.clock = period(clocks.pclk1);
    }

    /// Handles a write to the reset registers.
    fn hold_in_reset(&mut self) {
        let clocks = self.clocks;
        for port in 0..fabric::PORTS {
            if self.rcc.holds((gate::GPIO, port as u32)) {
                self.fabric.reset_port(port);
            }
        }
        for (gate, dma) in gate::DMA.into_iter().zip(&mut self.dma) {
            if self.rcc.holds(gate) {
                *dma = Dma::default();
            }
        }
        if self.rcc.holds(gate::TIM5) {
            self.tim5 = Timer::new(true, period(clocks.timer1));
        }
        if self.rcc.holds(gate::TIM8) {
            self.tim8 = Timer::new(false, period(clocks.timer2));
        }
        if self.rcc.holds(gate::USART3) {
            self.usart3.reset(period(clocks.pclk1));
        }
        if self.rcc.holds(gate::OTG_FS) {
            self.otg = Otg::default();
        }
        if self.rcc.holds(gate::RNG) {
            self.rng.reset();
        }
        if self.rcc.holds(gate::SYSCFG) {
            self.fabric.exti.ports = [0; 4];
        }
    }
}
