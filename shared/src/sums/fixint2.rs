//! Serialization of two 32-bit integers at their full width: 2 x 4 bytes, little-endian.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Writes 2 x 4 bytes, little-endian.
///
/// # Errors
/// Errors of the serializer.
pub fn serialize<S: Serializer>(value: &[i32; 2], to: S) -> Result<S::Ok, S::Error> {
    value.map(i32::to_le_bytes).serialize(to)
}

/// Reads the bytes that [`serialize`] wrote.
///
/// # Errors
/// Errors of the deserializer.
pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<[i32; 2], D::Error> {
    <[[u8; 4]; 2]>::deserialize(from).map(|words| words.map(i32::from_le_bytes))
}
