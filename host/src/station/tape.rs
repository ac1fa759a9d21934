//! What went into a station and what came out, from its first instant: enough to repeat its life
//! elsewhere and compare.

use shared::frame::encode::Bytes;
use shared::replay::{Entry, Record, Trace, Writer};
use shared::safety::Inputs;
use shared::steps::{PortMap, Segment};
use shared::time::Instant;

/// A log of inputs, and the records of what followed.
#[derive(Clone, Debug)]
pub struct Tape {
    log: Vec<u8>,
    records: Vec<Record>,
    trace: Trace,
}

impl Tape {
    pub(super) fn new(map: PortMap) -> Self {
        Self {
            log: Vec::new(),
            records: Vec::new(),
            trace: Trace::new(map),
        }
    }

    fn entry(&mut self, at: Instant, entry: Entry<'_>) {
        Writer(|part: &[u8]| self.log.extend_from_slice(part)).entry(at, entry);
    }

    pub(super) fn received(&mut self, at: Instant, bytes: &[u8]) {
        self.entry(at, Entry::Bytes(bytes));
    }

    pub(super) fn switched(&mut self, at: Instant, inputs: Inputs) {
        self.entry(at, Entry::Switches(inputs));
    }

    pub(super) fn sent(&mut self, at: Instant, bytes: &Bytes) {
        self.records.push(Record::Sent(at, bytes.clone()));
    }

    pub(super) fn segment(&mut self, at: Instant, segment: &Segment, words: &[u32]) {
        let digest = self.trace.digest(segment, words, |_| {});
        self.records.push(Record::Digest(at, digest));
    }

    /// The log so far, as [`shared::replay::Log`] reads it, with time passing up to `end`.
    pub fn log(&self, end: Instant) -> Vec<u8> {
        let mut log = self.log.clone();
        Writer(|part: &[u8]| log.extend_from_slice(part)).entry(end, Entry::Wait);
        log
    }

    /// What the station did so far.
    pub fn records(&self) -> &[Record] {
        &self.records
    }
}
