use super::probe::{Edges, Probe};
use crate::frame::CRC;
use crate::frame::encode::Bytes;
use crate::steps::{AXES, PortMap, Segment};
use crate::time::Instant;

/// One action of a station.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant)] // no alloc
pub enum Record {
    /// A packet for the host.
    Sent(Instant, Bytes),
    /// Checksums of a segment and its words.
    Digest(Instant, Digest),
}

/// Checksums and edge counts of a segment and its words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digest {
    /// CRC-32/ISCSI of the segment's numbers.
    pub plan: u32,
    /// CRC-32/ISCSI of its port words, little-endian.
    pub words: u32,
    /// Edges that the words make.
    pub edges: Edges,
    /// Steps since the start, DIR high as forwards.
    pub steps: [i32; AXES],
}

/// Change of the pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Number of the word in its segment.
    pub word: u16,
    /// Levels of the pins after the word.
    pub pins: u16,
}

/// Converter of a station's actions to records.
#[derive(Clone, Debug)]
pub struct Trace {
    probe: Probe,
}

/// Bytes of a [`Digest`] in a trace.
const DIGEST_BYTES: usize = 4 + 4 + 6 + 6 + 12;

impl Trace {
    /// Creates a trace of a port whose pins are all low.
    pub fn new(map: PortMap) -> Self {
        Self {
            probe: Probe::new(map),
        }
    }

    /// Computes the digest of a segment and its words, and calls `edge` for each pin change.
    pub fn digest(
        &mut self,
        segment: &Segment,
        words: &[u32],
        mut edge: impl FnMut(Edge),
    ) -> Digest {
        let edges = self.probe.feed(words, |word, _, after| {
            edge(Edge {
                // Segments have at most 4,000 words, ports 16 pins.
                word: word as u16,
                pins: after as u16,
            });
        });
        let mut sum = CRC.digest();
        for word in words {
            sum.update(&word.to_le_bytes());
        }
        Digest {
            plan: plan_sum(segment),
            words: sum.finalize(),
            edges,
            steps: self.probe.steps(),
        }
    }
}

fn plan_sum(segment: &Segment) -> u32 {
    let mut sum = CRC.digest();
    sum.update(&segment.slots().to_le_bytes());
    for axis in segment.axes() {
        sum.update(&axis.first.to_le_bytes());
        sum.update(&axis.change.to_le_bytes());
        sum.update(&[u8::from(axis.backward)]);
    }
    sum.finalize()
}

impl Record {
    /// Writes the record: kind (0 packet, 1 digest), instant (8 bytes, µs), then a packet's length
    /// (2 bytes) and bytes, or a digest's fields in their order; little-endian.
    pub fn write(&self, mut put: impl FnMut(&[u8])) {
        match self {
            Self::Sent(at, bytes) => {
                put(&[0]);
                put(&at.micros().to_le_bytes());
                put(&(bytes.len() as u16).to_le_bytes());
                put(bytes);
            }
            Self::Digest(at, digest) => {
                put(&[1]);
                put(&at.micros().to_le_bytes());
                put(&digest.plan.to_le_bytes());
                put(&digest.words.to_le_bytes());
                let counts = digest.edges.rises.into_iter().chain(digest.edges.turns);
                counts.for_each(|count| put(&count.to_le_bytes()));
                digest
                    .steps
                    .iter()
                    .for_each(|steps| put(&steps.to_le_bytes()));
            }
        }
    }

    /// Reads the record at the front of `bytes` and advances them; returns `None` if there is no
    /// whole record.
    pub fn read(bytes: &mut &[u8]) -> Option<Self> {
        let (kind, rest) = bytes.split_first()?;
        let (at, rest) = rest.split_first_chunk::<8>()?;
        let at = Instant::from_micros(u64::from_le_bytes(*at));
        let (record, rest) = match kind {
            0 => {
                let (length, rest) = rest.split_first_chunk::<2>()?;
                let (packet, rest) =
                    rest.split_at_checked(usize::from(u16::from_le_bytes(*length)))?;
                (Self::Sent(at, Bytes::from_slice(packet).ok()?), rest)
            }
            1 => {
                let (digest, rest) = rest.split_first_chunk::<DIGEST_BYTES>()?;
                (Self::Digest(at, Digest::read(digest)?), rest)
            }
            _ => return None,
        };
        *bytes = rest;
        Some(record)
    }
}

impl Digest {
    fn read(bytes: &[u8; DIGEST_BYTES]) -> Option<Self> {
        let (sums, rest) = bytes.split_first_chunk::<8>()?;
        let (counts, steps) = rest.split_first_chunk::<12>()?;
        let word = |bytes: &[u8], i: usize| {
            let word = bytes.as_chunks::<4>().0.get(i).copied();
            u32::from_le_bytes(word.unwrap_or_default())
        };
        let count = |i: usize| {
            let count = counts.as_chunks::<2>().0.get(i).copied();
            u16::from_le_bytes(count.unwrap_or_default())
        };
        Some(Self {
            plan: word(sums, 0),
            words: word(sums, 1),
            edges: Edges {
                rises: core::array::from_fn(count),
                turns: core::array::from_fn(|i| count(AXES + i)),
            },
            steps: core::array::from_fn(|i| word(steps, i).cast_signed()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn records_survive_a_round_trip() {
        let digest = Digest {
            plan: 0xdead_beef,
            words: 7,
            edges: Edges {
                rises: [1, 2, 300],
                turns: [0, 1, 2],
            },
            steps: [-5, 6, i32::MIN],
        };
        let records = [
            Record::Sent(Instant::from_micros(9), Bytes::from_slice(&[4, 5]).unwrap()),
            Record::Digest(Instant::from_micros(1 << 40), digest),
        ];
        let mut bytes = Vec::new();
        for record in &records {
            record.write(|part| bytes.extend_from_slice(part));
        }
        let mut rest = &bytes[..];
        for record in &records {
            assert_eq!(Record::read(&mut rest).as_ref(), Some(record));
        }
        assert_eq!(Record::read(&mut rest), None);
        for end in 0..bytes.len() - 1 {
            let mut short = &bytes[..end];
            while Record::read(&mut short).is_some() {}
        }
    }

    #[test]
    fn one_word_changes_the_digest() {
        let map = PortMap {
            step: [0, 1, 2],
            dir: [3, 4, 5],
            invert: [false; 3],
        };
        let segment = Segment::pause(2);
        let mut seen = Vec::new();
        let one = Trace::new(map).digest(&segment, &[0, 1, 1 << 16, 0], |edge| seen.push(edge));
        let other = Trace::new(map).digest(&segment, &[0, 0, 1, 1 << 16], |_| {});
        assert_eq!(one.edges, other.edges);
        assert_eq!(one.plan, other.plan);
        assert_ne!(one.words, other.words);
        assert_eq!(seen, [Edge { word: 1, pins: 1 }, Edge { word: 2, pins: 0 }]);
    }
}
