//! Attachment of every message: sequence number, time and publisher.
//!
//! ```text
//! int64 sequence number | int64 time, ns since 1970 | 16 (length) | 16 bytes of the publisher
//! ```
//!
//! Little-endian. Only `rmw_zenoh_cpp` 0.2.0 to 0.2.3 (the first of Jazzy) put a name before each.

/// Bytes of an attachment.
pub const BYTES: usize = 8 + 8 + 1 + 16;

/// Encodes an attachment. The first message of a publisher has the sequence number 1.
///
/// ```
/// use trinocular_ros::attachment::encode;
///
/// let bytes = encode(1, 1_000_000_000, [7; 16]);
/// assert_eq!(bytes[..9], [1, 0, 0, 0, 0, 0, 0, 0, 0x00]);
/// assert_eq!(bytes[16..], [[16].as_slice(), &[7; 16]].concat());
/// ```
pub fn encode(sequence: i64, time_ns: i64, gid: [u8; 16]) -> [u8; BYTES] {
    let mut bytes = [16; BYTES];
    bytes[..8].copy_from_slice(&sequence.to_le_bytes());
    bytes[8..16].copy_from_slice(&time_ns.to_le_bytes());
    bytes[17..].copy_from_slice(&gid);
    bytes
}
