//! Bytes to messages, in any chunking.

use super::{CRC, MAX_PACKET};
use core::marker::PhantomData;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// Why bytes were not a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reject {
    /// More bytes than a packet may have without a closing zero.
    TooLong,
    /// The COBS stuffing is broken.
    Framing,
    /// The CRC-32 differs.
    Checksum,
    /// A sound packet that is no message of this protocol.
    Malformed,
}

/// How often each [`Reject`] happened; the counts saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rejects {
    /// [`Reject::TooLong`].
    pub too_long: u16,
    /// [`Reject::Framing`].
    pub framing: u16,
    /// [`Reject::Checksum`].
    pub checksum: u16,
    /// [`Reject::Malformed`].
    pub malformed: u16,
}

impl Rejects {
    /// Counts one more.
    pub fn count(&mut self, reject: Reject) {
        let counter = match reject {
            Reject::TooLong => &mut self.too_long,
            Reject::Framing => &mut self.framing,
            Reject::Checksum => &mut self.checksum,
            Reject::Malformed => &mut self.malformed,
        };
        *counter = counter.saturating_add(1);
    }

    /// All of them.
    pub fn total(&self) -> u32 {
        [self.too_long, self.framing, self.checksum, self.malformed]
            .map(u32::from)
            .iter()
            .sum()
    }
}

/// Collects bytes until a packet is complete.
///
/// *Invariant:* `length` bytes of `buffer` are the packet so far, or `overrun` is set and the rest of it is being skipped.
#[derive(Clone, Debug)]
pub struct Receiver<T> {
    buffer: [u8; MAX_PACKET],
    length: usize,
    overrun: bool,
    message: PhantomData<T>,
}

impl<T> Default for Receiver<T> {
    fn default() -> Self {
        Self {
            buffer: [0; MAX_PACKET],
            length: 0,
            overrun: false,
            message: PhantomData,
        }
    }
}

impl<T: DeserializeOwned> Receiver<T> {
    /// Takes bytes from the front of `input` up to the end of the next packet.
    ///
    /// `None` when `input` is used up without one; call again with what comes next. Otherwise the packet's outcome, and
    /// `input` holds what follows it.
    pub fn next(&mut self, input: &mut &[u8]) -> Option<Result<T, Reject>> {
        while let Some((&byte, rest)) = input.split_first() {
            *input = rest;
            if byte != 0 {
                self.push(byte);
                continue;
            }
            let length = core::mem::take(&mut self.length);
            if core::mem::take(&mut self.overrun) {
                return Some(Err(Reject::TooLong));
            }
            if length > 0 {
                return Some(
                    self.buffer
                        .get_mut(..length)
                        .ok_or(Reject::TooLong)
                        .and_then(decode),
                );
            }
        }
        None
    }

    fn push(&mut self, byte: u8) {
        match self.buffer.get_mut(self.length) {
            Some(slot) => {
                *slot = byte;
                self.length += 1;
            }
            None => self.overrun = true,
        }
    }
}

/// One packet without its closing zero. The buffer is used up.
fn decode<T: DeserializeOwned>(packet: &mut [u8]) -> Result<T, Reject> {
    let length = cobs::decode_in_place(packet).map_err(|_| Reject::Framing)?;
    let bytes = packet.get(..length).ok_or(Reject::Framing)?;
    let body = length.checked_sub(4).ok_or(Reject::Checksum)?;
    let (body, sum) = bytes.split_at_checked(body).ok_or(Reject::Checksum)?;
    if sum != CRC.checksum(body).to_le_bytes() {
        return Err(Reject::Checksum);
    }
    match postcard::take_from_bytes(body) {
        Ok((message, [])) => Ok(message),
        _ => Err(Reject::Malformed),
    }
}
