//! The station's clock: microseconds since the start.

use embassy_time::Instant;

/// The present moment.
pub fn now() -> shared::time::Instant {
    shared::time::Instant::from_micros(Instant::now().as_micros())
}
