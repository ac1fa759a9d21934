//! Encoding of messages to packets.

use super::{CRC, MAX_PACKET};
use postcard::ser_flavors::{Cobs, Slice, crc::CrcModifier};
use serde::Serialize;

/// Packet, ready to send.
pub type Bytes = heapless::Vec<u8, MAX_PACKET>;

/// Encodes `message` as one packet: a zero, then postcard and CRC-32 in COBS, and a zero.
///
/// # Errors
/// [`TooLong`] if it would exceed [`MAX_PACKET`]. No message of this protocol does (test
/// `every_message_fits`).
///
/// # Example
/// ```
/// use trinocular_core::frame::encode::encode;
/// use trinocular_core::frame::message::{Command, Packet};
///
/// let packet = Packet { sequence: 7, command: Command::Hello };
/// let bytes = encode(&packet)?;
/// assert_eq!((bytes.first(), bytes.last()), (Some(&0), Some(&0)));
/// assert!(!bytes[1..bytes.len() - 1].contains(&0));
/// # Ok::<(), trinocular_core::frame::encode::TooLong>(())
/// ```
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

/// Error of a message that does not fit one packet.
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
