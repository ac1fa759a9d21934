//! The station again, from its recorded inputs.

use super::difference::{Comparison, Difference, first_field};
use crate::topic::Topic;
use std::collections::VecDeque;
use trinocular_client::twin::{self, PORT};
use trinocular_core::frame::message::Report;
use trinocular_core::frame::receive::Receiver;
use trinocular_core::replay::{EmulatedStation, Entry, Event, Record, Trace};
use trinocular_core::steps::WordRate;
use trinocular_core::time::Instant;

/// Outputs of one side that wait for the other's. A recording writes them within a moment.
const MOST_WAITING: usize = 1 << 20;

/// Longest time between two inputs, µs: a day. More would run for hours.
const LONGEST_GAP_US: u64 = 86_400_000_000;

/// Outputs of one kind, of both sides, and their comparison.
#[derive(Default)]
struct Stream {
    recorded: VecDeque<Vec<u8>>,
    replayed: VecDeque<Vec<u8>>,
    is_different: bool,
}

/// An emulated station that gets recorded inputs.
pub(super) struct StationReplay {
    station: EmulatedStation,
    trace: Trace,
    words: Vec<u32>,
    output: Stream,
    edges: Stream,
    /// True if the log ends with the end of its run.
    has_ended: bool,
    /// Instant of the last recorded output.
    last: Instant,
    packets: Comparison,
    segments: Comparison,
    edge_count: Comparison,
}

impl StationReplay {
    pub fn new(board: &str) -> Result<Self, String> {
        let length = board.len();
        if length > 16 {
            return Err(format!(
                "the board's name has {length} bytes, 16 are the most"
            ));
        }
        // Names of boards are constants elsewhere. A replay makes one, and then the program ends.
        let board = twin::board(board.to_owned().leak());
        Ok(Self {
            station: twin::emulated(board),
            trace: Trace::new(PORT),
            words: vec![0; 2 * WordRate::MHZ_1.slots_per_segment() as usize],
            output: Stream::default(),
            edges: Stream::default(),
            has_ended: false,
            last: Instant::default(),
            packets: Comparison::default(),
            segments: Comparison::default(),
            edge_count: Comparison::default(),
        })
    }

    /// Lets time pass to the instant of an input, and gives it to the station.
    pub fn input(&mut self, at: Instant, input: Entry<'_>) -> Result<(), String> {
        if at > self.station.now() {
            self.pass(at)?;
        }
        match input {
            Entry::Bytes(bytes) => self.station.receive(bytes),
            Entry::Switches(inputs) => self.station.set_switches(inputs),
            Entry::Wait => self.has_ended = true,
        }
        Ok(())
    }

    fn pass(&mut self, end: Instant) -> Result<(), String> {
        if end.since(self.station.now()) > LONGEST_GAP_US {
            let us = end.micros();
            return Err(format!(
                "an input at {us} us is a day after the one before it"
            ));
        }
        loop {
            let event = self.station.run(end, &mut self.words);
            let now = self.station.now();
            match event {
                Event::Idle(_) => return Ok(()),
                Event::Refused(fault) => return Err(format!("the station refused: {fault}")),
                Event::Sent(bytes) => self.replayed(&Record::Sent(now, bytes)),
                Event::Segment(segment, filled) => {
                    let mut edges = now.micros().to_le_bytes().to_vec();
                    let words = &self.words[..filled];
                    let digest = self.trace.digest(&segment, words, |edge| {
                        edges.extend(edge.word.to_le_bytes());
                        edges.extend(edge.pins.to_le_bytes());
                    });
                    self.replayed(&Record::Digest(now, digest));
                    if edges.len() > 8 {
                        self.edges.replayed.push_back(edges);
                        self.compare_edges();
                    }
                }
            }
            if self.output.replayed.len() > MOST_WAITING {
                return Err("the recording has inputs without outputs".to_owned());
            }
        }
    }

    fn replayed(&mut self, record: &Record) {
        let mut bytes = Vec::new();
        record.write(|part| bytes.extend_from_slice(part));
        self.output.replayed.push_back(bytes);
        self.compare_output();
    }

    /// Takes in a recorded output.
    pub fn output(&mut self, topic: Topic, bytes: &[u8]) -> Result<(), String> {
        let is_edges = topic == Topic::Edges;
        let stream = match is_edges {
            true => &mut self.edges,
            false => &mut self.output,
        };
        if stream.recorded.len() > MOST_WAITING {
            return Err("the recording has outputs without inputs".to_owned());
        }
        stream.recorded.push_back(bytes.to_vec());
        match is_edges {
            true => self.compare_edges(),
            false => {
                let record = Record::read(&mut &bytes[..]);
                let record = record.ok_or("an output is no record of a trace")?;
                self.last = self.last.max(instant(&record));
                self.compare_output();
            }
        }
        Ok(())
    }

    fn compare_output(&mut self) {
        while let Some((a, b)) = self.output.pair() {
            if self.output.is_different {
                continue;
            }
            let (recorded, replayed) = (read(&a), read(&b));
            let is_packet = matches!(
                recorded.as_ref().or(replayed.as_ref()),
                Some(Record::Sent(..))
            );
            let comparison = match is_packet {
                true => &mut self.packets,
                false => &mut self.segments,
            };
            let number = comparison.same;
            let difference = (a != b).then(|| difference(number, recorded, replayed));
            self.output.is_different = difference.is_some();
            comparison.count(difference);
        }
    }

    fn compare_edges(&mut self) {
        while let Some((a, b)) = self.edges.pair() {
            if self.edges.is_different {
                continue;
            }
            if a == b {
                self.edge_count.same += (a.len() as u64 - 8) / 4;
                continue;
            }
            self.edges.is_different = true;
            let at_us = read_us(&a).min(read_us(&b));
            let edges = |bytes: &[u8]| bytes.get(8..).unwrap_or_default().to_vec();
            let (recorded, replayed) = (edges(&a), edges(&b));
            let edge = |bytes: &[u8], index: usize| match bytes.as_chunks::<4>().0.get(index) {
                Some([a, b, c, d]) => {
                    let (word, pins) = (u16::from_le_bytes([*a, *b]), u16::from_le_bytes([*c, *d]));
                    format!("word {word}, pins {pins:06b}")
                }
                None => "no edge".to_owned(),
            };
            let count = recorded.len().max(replayed.len()) / 4;
            let differ = |i: &usize| edge(&recorded, *i) != edge(&replayed, *i);
            let index = (0..=count).find(differ).unwrap_or(0);
            self.edge_count.count(Some(Difference {
                at_us,
                message: "edges of a segment".to_owned(),
                field: format!("edge {index}"),
                recorded: edge(&recorded, index),
                replayed: edge(&replayed, index),
            }));
        }
    }

    /// Lets time pass to the end; returns packets, segments and edges.
    pub fn finish(mut self) -> Result<[Comparison; 3], String> {
        if !self.has_ended && self.last > self.station.now() {
            self.pass(self.last)?;
        }
        // A recording that was cut off may lack outputs at its end, but not have more of them.
        let lacks = |stream: &Stream, has_ended: bool| {
            !stream.is_different
                && (!stream.recorded.is_empty() || has_ended && !stream.replayed.is_empty())
        };
        if lacks(&self.output, self.has_ended) {
            let recorded = self.output.recorded.front().and_then(|bytes| read(bytes));
            let replayed = self.output.replayed.front().and_then(|bytes| read(bytes));
            let number = self.packets.same;
            self.packets
                .count(Some(difference(number, recorded, replayed)));
        }
        if lacks(&self.edges, self.has_ended) {
            let front = [&self.edges.recorded, &self.edges.replayed].map(VecDeque::front);
            let [recorded, replayed] = front.map(|front| match front {
                Some(bytes) => format!("edges at {} us", read_us(bytes)),
                None => "nothing more".to_owned(),
            });
            self.edge_count.count(Some(Difference {
                at_us: front
                    .into_iter()
                    .flatten()
                    .map(|b| read_us(b))
                    .min()
                    .unwrap_or(0),
                message: "edges of a segment".to_owned(),
                field: "number of segments".to_owned(),
                recorded,
                replayed,
            }));
        }
        Ok([self.packets, self.segments, self.edge_count])
    }
}

impl Stream {
    /// Takes the oldest of both sides.
    fn pair(&mut self) -> Option<(Vec<u8>, Vec<u8>)> {
        if self.recorded.is_empty() || self.replayed.is_empty() {
            return None;
        }
        self.recorded.pop_front().zip(self.replayed.pop_front())
    }
}

fn read_us(bytes: &[u8]) -> u64 {
    bytes
        .first_chunk::<8>()
        .map_or(0, |us| u64::from_le_bytes(*us))
}

fn read(bytes: &[u8]) -> Option<Record> {
    Record::read(&mut &bytes[..])
}

fn instant(record: &Record) -> Instant {
    match record {
        Record::Sent(at, _) | Record::Digest(at, _) => *at,
    }
}

/// Returns the report in a packet.
fn report(record: &Record) -> Option<Report> {
    let Record::Sent(_, bytes) = record else {
        return None;
    };
    Receiver::default().next(&mut &bytes[..])?.ok()
}

/// Names the first difference of two records that are not the same.
fn difference(number: u64, recorded: Option<Record>, replayed: Option<Record>) -> Difference {
    let sides = [&recorded, &replayed];
    let instants = sides.into_iter().flatten().map(instant);
    let at_us = instants.map(Instant::micros).min().unwrap_or(0);
    let message = |kind: &str| format!("{kind} {number}");
    let reports = [&recorded, &replayed].map(|side| side.as_ref().and_then(report));
    let (message, found) = match (&reports, &recorded, &replayed) {
        ([Some(a), Some(b)], ..) if a != b => (message("packet"), first_field(a, b)),
        (_, Some(Record::Sent(..)), _) => (message("packet"), first_field(&recorded, &replayed)),
        _ => (message("segment"), first_field(&recorded, &replayed)),
    };
    let (field, recorded, replayed) = found.unwrap_or_default();
    Difference {
        at_us,
        message,
        field,
        recorded,
        replayed,
    }
}
