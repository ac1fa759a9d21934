//! The wire: what host and station say to each other over any byte stream.
//!
//! # Format
//! A *packet* is a message encoded by postcard (its stable format, version 1), followed by its
//! CRC-32 (ISCSI, also known as CRC-32C, little-endian), the whole COBS-stuffed, with one zero byte
//! before it and one behind it. The first ends whatever noise stood on the line, so that noise
//! never costs the packet that follows; the last makes the packet complete at once. Empty packets
//! are allowed and mean nothing. A packet is at most [`MAX_PACKET`] bytes, a flow frame at most 64
//! (one full-speed USB packet), both with all framing.
//!
//! Every packet from the host is a [`message::Packet`]: a 16-bit sequence number and a
//! [`message::Command`]. The station accepts a packet only if its number lies ahead of the last
//! accepted one (serial number arithmetic, RFC 1982); a repeated number is a duplicate, one from
//! behind is stale. Either is counted and changes nothing. `Hello` may have any number and starts
//! the count anew, so a restarted host is understood.
//!
//! Everything from the station is a [`message::Report`].
//!
//! # Compatibility
//! Variants of the enums are append-only: postcard writes their index, so a renumbered variant
//! would decode as another action. The file `schema.txt` beside this module lists messages and
//! fields; its hash is in the station's hello, and the host refuses to move a station whose hash
//! differs. Tests hold the list and the committed bytes of every message to the code.

mod command;
pub mod encode;
pub mod message;
pub mod receive;

/// The longest packet, with all framing, bytes.
pub const MAX_PACKET: usize = 320;

/// The protocol's number: changes when packets of the old one can no longer be understood.
pub const PROTOCOL: u16 = 2;

/// The messages and fields of this version, in words.
pub const SCHEMA: &str = include_str!("schema.txt");

/// FNV-1a of [`SCHEMA`]: what both sides compare.
pub const SCHEMA_HASH: u32 = fnv1a(SCHEMA.as_bytes());

/// CRC-32/ISCSI, as iSCSI, ext4 and postcard's own examples use it.
pub(crate) static CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISCSI);

const fn fnv1a(text: &[u8]) -> u32 {
    let mut hash = 0x811c_9dc5u32;
    let mut at = 0;
    while at < text.len() {
        hash = (hash ^ text[at] as u32).wrapping_mul(0x0100_0193);
        at += 1;
    }
    hash
}

/// Two 32-bit integers at their full width.
pub mod fixint2 {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    /// Writes 2 x 4 bytes, little-endian.
    ///
    /// # Errors
    /// The serializer's own.
    pub fn serialize<S: Serializer>(value: &[i32; 2], to: S) -> Result<S::Ok, S::Error> {
        value.map(i32::to_le_bytes).serialize(to)
    }

    /// Reads what [`serialize`] wrote.
    ///
    /// # Errors
    /// The deserializer's own.
    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<[i32; 2], D::Error> {
        <[[u8; 4]; 2]>::deserialize(from).map(|words| words.map(i32::from_le_bytes))
    }
}
