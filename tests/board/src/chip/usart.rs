//! Asynchronous USART with eight bits (RM0090 chapter 30), and the bytes on its wires.

use crate::time::Beats;
use std::collections::VecDeque;

const RXNE: u32 = 1 << 5;
const TC: u32 = 1 << 6;
const TXE: u32 = 1 << 7;
const IDLE: u32 = 1 << 4;
const ORE: u32 = 1 << 3;
const FE: u32 = 1 << 1;
const UE: u32 = 1 << 13;
const TE: u32 = 1 << 3;
const RE: u32 = 1 << 2;

/// Bits of a byte on the wire: start, eight, stop.
const BITS: Beats = 10;

/// Registers and wires.
#[derive(Clone, Debug)]
pub struct Usart {
    sr: u32,
    brr: u32,
    cr: [u32; 3],
    gtpr: u32,
    /// Period of the peripheral's clock.
    pub clock: Beats,
    received: u8,
    /// True if SR was read since the flag, so that reading DR clears it.
    seen: u32,
    /// Byte that waits behind the one on the wire.
    waiting: Option<u8>,
    /// Byte on the wire, with the moment of its end.
    sending: Option<(u8, Beats)>,
    /// Bytes on the wire to the chip, with the moments of their ends.
    arriving: VecDeque<(u8, Beats)>,
    /// Moment at which the line has been idle for one byte.
    idle_at: Option<Beats>,
    /// Bit period of the other end.
    pub far_bit: Beats,
    /// Bytes sent, with the moments of their ends.
    pub sent: Vec<(Beats, u8)>,
}

impl Usart {
    /// Creates the state after a reset; the other end sends `far_baud` bits per second.
    pub fn new(clock: Beats, far_baud: u64) -> Self {
        Self {
            sr: TXE | TC,
            brr: 0,
            cr: [0; 3],
            gtpr: 0,
            clock,
            received: 0,
            seen: 0,
            waiting: None,
            sending: None,
            arriving: VecDeque::new(),
            idle_at: None,
            far_bit: 336_000_000 / far_baud,
            sent: Vec::new(),
        }
    }

    /// Resets the peripheral: bytes from the other end are still on their way.
    pub fn reset(&mut self, clock: Beats) {
        *self = Self {
            far_bit: self.far_bit,
            arriving: std::mem::take(&mut self.arriving),
            sent: std::mem::take(&mut self.sent),
            ..Self::new(clock, 1)
        };
    }

    /// Returns the chip's own bit period.
    pub fn bit(&self) -> Beats {
        self.clock * Beats::from(self.brr)
    }

    /// Starts bytes from the other end at `now`, behind those already on their way.
    pub fn arrive(&mut self, now: Beats, bytes: &[u8]) {
        let mut at = self.arriving.back().map_or(now, |(_, at)| (*at).max(now));
        for byte in bytes {
            at += BITS * self.far_bit;
            self.arriving.push_back((*byte, at));
        }
    }

    /// Returns the end of the last byte to the chip.
    pub fn quiet_at(&self) -> Option<Beats> {
        self.arriving.back().map(|(_, at)| *at)
    }

    /// Returns true if the interrupt line is active.
    pub fn interrupts(&self) -> bool {
        let [cr1, _, cr3] = self.cr;
        let enabled = cr1 & (RXNE | TC | TXE | IDLE);
        let errors = self.sr & (ORE | FE) != 0 && cr3 & 1 != 0;
        let overrun = self.sr & ORE != 0 && cr1 & RXNE != 0;
        self.sr & enabled != 0 || errors || overrun
    }

    /// Returns the end of the next byte in either direction.
    pub fn next(&self) -> Option<Beats> {
        let arriving = self.arriving.front().map(|(_, at)| *at);
        let sending = self.sending.map(|(_, at)| at);
        [arriving, sending, self.idle_at]
            .into_iter()
            .flatten()
            .min()
    }

    /// Moves bytes until `now`.
    pub fn advance(&mut self, now: Beats) {
        while let Some((byte, at)) = self.sending.filter(|(_, at)| *at <= now) {
            self.sent.push((at, byte));
            self.sending = None;
            match self.waiting.take() {
                Some(next) => self.begin(next, at),
                None => self.sr |= TC,
            }
        }
        while let Some((byte, at)) = self.arriving.front().copied().filter(|(_, at)| *at <= now) {
            self.arriving.pop_front();
            self.take(byte);
            let next = self.arriving.front();
            let silent = next.is_none_or(|(_, next)| next - BITS * self.far_bit > at);
            self.idle_at = silent.then_some(at + BITS * self.far_bit);
        }
        if self.idle_at.is_some_and(|at| at <= now) {
            self.idle_at = None;
            self.flag(IDLE);
        }
    }

    fn flag(&mut self, flag: u32) {
        self.sr |= flag;
        self.seen &= !flag;
    }

    fn take(&mut self, byte: u8) {
        if self.cr[0] & (UE | RE) != UE | RE {
            return;
        }
        // The receiver samples the tenth bit of the byte: off by half a bit, it reads another.
        let (bit, far) = (self.bit() as i64, self.far_bit as i64);
        if (bit - far).abs() * 19 > far {
            self.flag(FE);
        }
        if self.sr & RXNE != 0 {
            self.flag(ORE);
        } else {
            self.received = byte;
            self.sr |= RXNE;
        }
    }

    fn begin(&mut self, byte: u8, at: Beats) {
        self.sending = Some((byte, at + BITS * self.bit()));
        self.sr = self.sr & !TC | TXE;
    }

    /// Reads a register, or returns `None` where there is none.
    pub fn read(&mut self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x00 => {
                self.seen = self.sr;
                self.sr
            }
            0x04 => {
                self.sr &= !(self.seen & 0x1f | RXNE);
                u32::from(self.received)
            }
            0x08 => self.brr,
            0x0c..=0x14 => self.cr[(offset as usize - 0x0c) / 4],
            0x18 => self.gtpr,
            _ => return None,
        })
    }

    /// Writes a register, or returns `None` where there is none.
    pub fn write(&mut self, offset: u32, value: u32, now: Beats) -> Option<()> {
        match offset {
            // Written zeros clear TC and RXNE.
            0x00 => self.sr &= value | !(TC | RXNE),
            0x04 => {
                if self.cr[0] & (UE | TE) != UE | TE {
                    return None;
                }
                let byte = value as u8;
                match self.sending {
                    None => self.begin(byte, now),
                    Some(_) => {
                        self.waiting = Some(byte);
                        self.sr &= !(TXE | TC);
                    }
                }
            }
            0x08 => self.brr = value & 0xffff,
            0x0c..=0x14 => self.cr[(offset as usize - 0x0c) / 4] = value,
            0x18 => self.gtpr = value,
            _ => return None,
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::period;

    fn running() -> Usart {
        // 42 MHz and 921,600 baud.
        let mut usart = Usart::new(period(42_000_000), 921_600);
        usart.write(0x08, 46, 0);
        usart.write(0x0c, UE | TE | RE | RXNE | IDLE, 0);
        usart
    }

    #[test]
    fn unread_byte_is_an_overrun() {
        let mut usart = running();
        usart.arrive(0, b"ab");
        usart.advance(BITS * usart.far_bit);
        assert_eq!(usart.read(0), Some(TXE | TC | RXNE));
        usart.advance(2 * BITS * usart.far_bit);
        assert!(usart.interrupts());
        assert_eq!(usart.read(0), Some(TXE | TC | RXNE | ORE));
        assert_eq!(usart.read(4), Some(u32::from(b'a')));
        assert_eq!(usart.read(0), Some(TXE | TC));
        usart.advance(usart.next().expect("idle"));
        assert_eq!(usart.read(0), Some(TXE | TC | IDLE));
    }

    #[test]
    fn two_bytes_leave_without_a_gap() {
        let mut usart = running();
        usart.write(4, 1, 0);
        usart.write(4, 2, 100);
        assert_eq!(usart.read(0), Some(0));
        usart.advance(10 * BITS * usart.bit());
        let byte = BITS * usart.bit();
        assert_eq!(usart.sent, [(byte, 1), (2 * byte, 2)]);
        assert_eq!(usart.read(0), Some(TXE | TC));
    }

    #[test]
    fn wrong_rate_breaks_the_frame() {
        let mut usart = running();
        usart.write(0x08, 50, 0);
        usart.arrive(0, b"a");
        usart.advance(1_000_000);
        assert_ne!(usart.read(0).unwrap_or(0) & FE, 0);
    }
}
