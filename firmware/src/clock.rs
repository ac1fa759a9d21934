//! Clock of the station: microseconds since the start.

use embassy_time::Instant;

/// Returns the present instant.
pub fn now() -> shared::time::Instant {
    shared::time::Instant::from_micros(Instant::now().as_micros())
}
