//! The wire protocol between host and station, over any byte stream.
//!
//! # Format
//! A *packet* is a message encoded by postcard (its stable format, version 1), followed by its
//! CRC-32 (ISCSI, also known as CRC-32C, little-endian), the whole COBS-stuffed, with one zero byte
//! before it and one behind it. The first zero ends any noise on the line, so that noise never
//! costs the packet that follows; the last zero makes the packet complete at once. Empty packets
//! are allowed and mean nothing. A packet is at most [`MAX_PACKET`] bytes, a flow frame at most 64
//! (one full-speed USB packet), both with all framing.
//!
//! Every packet from the host is a [`message::Packet`]: a 16-bit sequence number and a
//! [`message::Command`]. The station accepts a packet only if its number lies ahead of the last
//! accepted one (serial number arithmetic, RFC 1982); a repeated number is a duplicate, a lower one
//! is stale. The station counts both and ignores them. `Hello` may have any number and restarts the
//! count, so that the station accepts a restarted host.
//!
//! Every packet from the station is a [`message::Report`].
//!
//! # Compatibility
//! Variants of the enums are append-only: postcard writes their index, so a renumbered variant
//! would decode as another action. The file `schema.txt` beside this module lists messages and
//! fields; its hash is in the station's hello, and the host refuses to move a station whose hash
//! differs. Tests hold the list and the committed bytes of every message to the code.

pub use crate::sums::fixint2;

mod command;
pub mod encode;
pub mod message;
pub mod receive;

/// Length of the longest packet, with all framing, bytes.
pub const MAX_PACKET: usize = 320;

/// Version of the protocol. It changes when packets of the previous version can no longer be
/// decoded.
pub const PROTOCOL: u16 = 2;

/// Messages and fields of this version, in words.
pub const SCHEMA: &str = include_str!("schema.txt");

/// FNV-1a hash of [`SCHEMA`], which both sides compare.
pub const SCHEMA_HASH: u32 = fnv1a(SCHEMA.as_bytes());

/// CRC-32/ISCSI, as in iSCSI, ext4 and postcard's own examples.
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
