//! Decoding of packets from bytes in any chunking.

use super::{CRC, MAX_PACKET};
use core::marker::PhantomData;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// Reason for which bytes were not a valid message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reject {
    /// More bytes than a packet may have came without a closing zero.
    TooLong,
    /// The COBS stuffing is invalid.
    Framing,
    /// The CRC-32 differs.
    Checksum,
    /// The packet is intact but is not a message of this protocol.
    Malformed,
}

/// Count of each [`Reject`]; the counts saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rejects {
    /// Count of [`Reject::TooLong`].
    pub too_long: u16,
    /// Count of [`Reject::Framing`].
    pub framing: u16,
    /// Count of [`Reject::Checksum`].
    pub checksum: u16,
    /// Count of [`Reject::Malformed`].
    pub malformed: u16,
}

impl Rejects {
    /// Counts one reject.
    pub fn count(&mut self, reject: Reject) {
        let counter = match reject {
            Reject::TooLong => &mut self.too_long,
            Reject::Framing => &mut self.framing,
            Reject::Checksum => &mut self.checksum,
            Reject::Malformed => &mut self.malformed,
        };
        *counter = counter.saturating_add(1);
    }

    /// Returns the sum of all counts.
    pub fn total(&self) -> u32 {
        [self.too_long, self.framing, self.checksum, self.malformed]
            .map(u32::from)
            .iter()
            .sum()
    }
}

/// Receiver of packets: collects bytes until a packet is complete, and undoes the COBS stuffing as
/// they arrive.
///
/// Each COBS block is a code and code - 1 bytes, and stands for these bytes and a zero. There is no
/// zero after a block with code 255 and at the end of the packet.
///
/// *Invariant:* the first `length` bytes of `buffer` are the packet so far, or `overrun` is set and
/// the receiver skips the rest of the packet.
///
/// ```
/// use trinocular_core::frame::encode::encode;
/// use trinocular_core::frame::message::{Command, Packet};
/// use trinocular_core::frame::receive::{Receiver, Reject};
///
/// let packet = Packet { sequence: 7, command: Command::Ping { host_us: 1_000 } };
/// let mut bytes = encode(&packet)?;
/// let mut receiver = Receiver::<Packet>::default();
///
/// // Byte by byte or in one piece: any chunking gives the same packets.
/// let received = bytes.iter().find_map(|byte| receiver.next(&mut &[*byte][..]));
/// assert_eq!(received, Some(Ok(packet)));
///
/// bytes[2] ^= 1;
/// let damaged = receiver.next(&mut &bytes[..]);
/// assert_eq!(damaged, Some(Err(Reject::Checksum)));
/// # Ok::<(), trinocular_core::frame::encode::TooLong>(())
/// ```
#[derive(Clone, Debug)]
pub struct Receiver<T> {
    /// Packet without its code and its closing zero.
    buffer: [u8; MAX_PACKET - 1],
    length: usize,
    /// Bytes of the present block that are still to come.
    block: u8,
    /// True if the block ends with a zero, unless the packet ends there.
    zero: bool,
    /// True after the first byte of the packet.
    begun: bool,
    overrun: bool,
    message: PhantomData<T>,
}

impl<T> Default for Receiver<T> {
    fn default() -> Self {
        Self {
            buffer: [0; MAX_PACKET - 1],
            length: 0,
            block: 0,
            zero: false,
            begun: false,
            overrun: false,
            message: PhantomData,
        }
    }
}

impl<T: DeserializeOwned> Receiver<T> {
    /// Takes bytes from the front of `input` up to the end of the next packet, and returns the
    /// message or the reason for a reject; `input` then holds the bytes behind the packet.
    ///
    /// Returns `None` when `input` is used up before a packet ends; call again with the bytes that
    /// follow.
    pub fn next(&mut self, input: &mut &[u8]) -> Option<Result<T, Reject>> {
        while let Some((&byte, rest)) = input.split_first() {
            *input = rest;
            if byte != 0 {
                self.push(byte);
                continue;
            }
            let length = core::mem::take(&mut self.length);
            let block = core::mem::take(&mut self.block);
            let overrun = core::mem::take(&mut self.overrun);
            self.zero = false;
            if core::mem::take(&mut self.begun) {
                return Some(match self.buffer.get(..length) {
                    Some(bytes) if !overrun && block == 0 => decode(bytes),
                    _ if overrun => Err(Reject::TooLong),
                    _ => Err(Reject::Framing),
                });
            }
        }
        None
    }

    /// Takes one byte of a packet, which is not zero.
    fn push(&mut self, byte: u8) {
        self.begun = true;
        if let Some(left) = self.block.checked_sub(1) {
            self.block = left;
            self.keep(byte);
        } else {
            if self.zero {
                self.keep(0);
            }
            self.block = byte.wrapping_sub(1);
            self.zero = byte != u8::MAX;
        }
    }

    fn keep(&mut self, byte: u8) {
        match self.buffer.get_mut(self.length) {
            Some(slot) => {
                *slot = byte;
                self.length += 1;
            }
            None => self.overrun = true,
        }
    }
}

/// Decodes the message in one packet.
fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Reject> {
    let body = bytes.len().checked_sub(4).ok_or(Reject::Checksum)?;
    let (body, sum) = bytes.split_at_checked(body).ok_or(Reject::Checksum)?;
    if sum != CRC.checksum(body).to_le_bytes() {
        return Err(Reject::Checksum);
    }
    match postcard::take_from_bytes(body) {
        Ok((message, [])) => Ok(message),
        _ => Err(Reject::Malformed),
    }
}
