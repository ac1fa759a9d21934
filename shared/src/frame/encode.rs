//! Messages to bytes.

use super::{CRC, MAX_PACKET};
use postcard::ser_flavors::{Cobs, Slice, crc::CrcModifier};
use serde::Serialize;

/// A packet ready to be sent.
pub type Bytes = heapless::Vec<u8, MAX_PACKET>;

/// Encodes `message` as one packet: a zero, then postcard and CRC-32 in COBS, and a zero.
///
/// # Errors
/// [`TooLong`] if it would exceed [`MAX_PACKET`]. No message of this protocol does (test
/// `every_message_fits`).
pub fn encode<T: Serialize>(message: &T) -> Result<Bytes, TooLong> {
    let mut bytes = Bytes::new();
    bytes.resize(MAX_PACKET, 0).map_err(|_| TooLong)?;
    let behind_zero = bytes.get_mut(1..).ok_or(TooLong)?;
    let stuffed = Cobs::try_new(Slice::new(behind_zero)).map_err(|_| TooLong)?;
    let flavor = CrcModifier::new(stuffed, CRC.digest());
    let packet = postcard::serialize_with_flavor(message, flavor).map_err(|_| TooLong)?;
    let length = 1 + packet.len();
    bytes.truncate(length);
    Ok(bytes)
}

/// The message does not fit one packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooLong;

impl core::fmt::Display for TooLong {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "the message is longer than {MAX_PACKET} bytes on the wire"
        )
    }
}

impl core::error::Error for TooLong {}
