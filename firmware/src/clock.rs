//! Clock of the station: microseconds since the start.

use embassy_time::Instant;

/// Returns the present instant.
pub fn now() -> trinocular_core::time::Instant {
    trinocular_core::time::Instant::from_micros(Instant::now().as_micros())
}
