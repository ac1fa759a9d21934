//! Observers of a station: recorders and whatever else must see every byte on the line.

use trinocular_core::safety::Inputs;
use trinocular_core::steps::Segment;
use trinocular_core::time::Instant;

/// Observer of one station.
///
/// It is called wherever bytes pass, also on the heartbeat's thread: it copies what it needs and
/// returns at once. Times are the host's clock of that connection, µs; with a twin, its virtual
/// time.
pub trait StationObserver: Send + Sync {
    /// Takes in bytes that were written to the station.
    fn sent(&self, at_us: u64, bytes: &[u8]);

    /// Takes in bytes that came from the station.
    fn received(&self, at_us: u64, bytes: &[u8]);

    /// Takes in a segment of a twin and the port words made of it.
    fn segment(&self, _at: Instant, _segment: &Segment, _words: &[u32]) {}

    /// Takes in a change of the switches that a twin senses.
    fn switches(&self, _at: Instant, _inputs: &Inputs) {}

    /// Takes in the loss of the line, with its reason.
    fn line_lost(&self, _at_us: u64, _reason: &str) {}
}
