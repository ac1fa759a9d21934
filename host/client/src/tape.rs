//! Recording of a station's inputs and outputs from its first instant, complete enough to replay
//! and compare the run elsewhere.

use trinocular_core::frame::encode::Bytes;
use trinocular_core::replay::{Entry, Record, Trace, Writer};
use trinocular_core::safety::Inputs;
use trinocular_core::steps::{PortMap, Segment};
use trinocular_core::time::Instant;

/// Log of a station's inputs, and records of its outputs.
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

    /// Returns the log so far in the format of [`trinocular_core::replay::Log`], with time passing
    /// up to `end`.
    pub fn log(&self, end: Instant) -> Vec<u8> {
        let mut log = self.log.clone();
        Writer(|part: &[u8]| log.extend_from_slice(part)).entry(end, Entry::Wait);
        log
    }

    /// Returns the station's outputs so far.
    pub fn records(&self) -> &[Record] {
        &self.records
    }
}
