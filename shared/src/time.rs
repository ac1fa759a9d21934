//! Instants of the station's clock. Nothing in this crate reads a clock: time is always an
//! argument.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Instant of the station's clock: microseconds since the station started.
///
/// On the wire an instant takes 48 bits, little-endian, which is enough for 8.9 years of uptime.
/// Later instants saturate there.
///
/// ```
/// use trinocular_core::time::Instant;
///
/// let start = Instant::from_micros(1_000);
/// let later = start.plus_micros(250);
/// assert_eq!((later.since(start), start.since(later)), (250, 0));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Instant(u64);

impl Instant {
    /// Last instant that the wire can carry.
    pub const MAX: Self = Self((1 << 48) - 1);

    /// Creates an instant from microseconds since the start.
    pub const fn from_micros(micros: u64) -> Self {
        Self(micros)
    }

    /// Returns the microseconds since the start.
    pub const fn micros(self) -> u64 {
        self.0
    }

    /// Returns the instant `micros` later, saturating.
    #[must_use]
    pub const fn plus_micros(self, micros: u64) -> Self {
        Self(self.0.saturating_add(micros))
    }

    /// Returns the microseconds since `earlier`, or 0 if `earlier` is later.
    pub const fn since(self, earlier: Self) -> u64 {
        self.0.saturating_sub(earlier.0)
    }
}

impl Serialize for Instant {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let [a, b, c, d, e, f, ..] = self.0.min(Self::MAX.0).to_le_bytes();
        [a, b, c, d, e, f].serialize(to)
    }
}

impl<'de> Deserialize<'de> for Instant {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let [a, b, c, d, e, f] = <[u8; 6]>::deserialize(from)?;
        Ok(Self(u64::from_le_bytes([a, b, c, d, e, f, 0, 0])))
    }
}
