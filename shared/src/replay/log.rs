use crate::safety::Inputs;
use crate::time::Instant;

/// Input of a station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Entry<'a> {
    /// Bytes from the host.
    Bytes(&'a [u8]),
    /// Change of the switches.
    Switches(Inputs),
    /// No input: time passes up to this instant.
    Wait,
}

/// Log of inputs in the order of their time, as bytes.
///
/// One entry is its instant (8 bytes, µs, little-endian), its kind (1 byte: 0 bytes, 1 switches, 2
/// wait), the payload's length (2 bytes) and the payload. Switches are one byte: bits 0 to 5 the
/// limits (axis by axis, negative end first), bit 6 the emergency stop, bit 7 the driver's fault.
///
/// An entry takes effect at the control tick after its instant, as any input of a station does.
#[derive(Clone, Copy, Debug)]
pub struct Log<'a>(&'a [u8]);

/// Reason for which a log cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogFault {
    /// The log ends within an entry.
    Short,
    /// No kind of entry has this number.
    Kind(u8),
    /// The length of the payload does not fit the kind.
    Length,
}

impl core::fmt::Display for LogFault {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Short => f.write_str("the log ends within an entry"),
            Self::Kind(kind) => write!(f, "the log has no entries of kind {kind}"),
            Self::Length => f.write_str("an entry of the log has an impossible length"),
        }
    }
}

impl core::error::Error for LogFault {}

impl<'a> Log<'a> {
    /// Creates a reader of the log in `bytes`.
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    /// Reads the next entry, or returns `None` at the end.
    ///
    /// # Errors
    /// [`LogFault`] if the bytes are no entry.
    pub fn entry(&mut self) -> Result<Option<(Instant, Entry<'a>)>, LogFault> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let (at, rest) = self.0.split_first_chunk::<8>().ok_or(LogFault::Short)?;
        let (kind, rest) = rest.split_first().ok_or(LogFault::Short)?;
        let (length, rest) = rest.split_first_chunk::<2>().ok_or(LogFault::Short)?;
        let length = usize::from(u16::from_le_bytes(*length));
        let (payload, rest) = rest.split_at_checked(length).ok_or(LogFault::Short)?;
        self.0 = rest;
        let entry = match (kind, payload) {
            (0, bytes) => Entry::Bytes(bytes),
            (1, [switches]) => Entry::Switches(inputs(*switches)),
            (2, []) => Entry::Wait,
            (1 | 2, _) => return Err(LogFault::Length),
            (kind, _) => return Err(LogFault::Kind(*kind)),
        };
        Ok(Some((Instant::from_micros(u64::from_le_bytes(*at)), entry)))
    }
}

/// Writer of a log.
pub struct Writer<W>(pub W);

impl<W: FnMut(&[u8])> Writer<W> {
    /// Appends an entry. More than 65,535 bytes are split over entries of the same instant.
    pub fn entry(&mut self, at: Instant, entry: Entry<'_>) {
        match entry {
            Entry::Bytes(bytes) => bytes
                .chunks(usize::from(u16::MAX))
                .for_each(|chunk| self.put(at, 0, chunk)),
            Entry::Switches(inputs) => self.put(at, 1, &[switches(inputs)]),
            Entry::Wait => self.put(at, 2, &[]),
        }
    }

    fn put(&mut self, at: Instant, kind: u8, payload: &[u8]) {
        let Self(write) = self;
        write(&at.micros().to_le_bytes());
        write(&[kind]);
        // `entry` passes at most 65,535 bytes.
        write(&(payload.len() as u16).to_le_bytes());
        write(payload);
    }
}

fn switches(inputs: Inputs) -> u8 {
    let limits = inputs.limits.as_flattened().iter();
    let all = limits.chain([&inputs.emergency_stop, &inputs.driver_fault]);
    all.enumerate()
        .fold(0, |bits, (i, on)| bits | u8::from(*on) << i)
}

fn inputs(bits: u8) -> Inputs {
    let on = |bit: usize| bits >> bit & 1 == 1;
    Inputs {
        limits: core::array::from_fn(|axis| [on(2 * axis), on(2 * axis + 1)]),
        emergency_stop: on(6),
        driver_fault: on(7),
        words_emitted: 0,
        trigger_losses: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[test]
    fn entries_survive_a_round_trip() {
        let entries = [
            (3, Entry::Bytes(&[1, 0, 2])),
            (3, Entry::Bytes(&[])),
            (70_000, Entry::Switches(inputs(0b1001_0010))),
            (u64::MAX, Entry::Wait),
        ];
        let mut bytes = Vec::new();
        let mut writer = Writer(|part: &[u8]| bytes.extend_from_slice(part));
        for (at, entry) in entries {
            writer.entry(Instant::from_micros(at), entry);
        }
        let mut log = Log::new(&bytes);
        // An entry without bytes has no effect, and is not written.
        for (at, entry) in entries.into_iter().filter(|e| e.1 != Entry::Bytes(&[])) {
            assert_eq!(log.entry(), Ok(Some((Instant::from_micros(at), entry))));
        }
        assert_eq!(log.entry(), Ok(None));
    }

    proptest! {
        #[test]
        fn every_switch_has_its_bit(bits: u8) {
            prop_assert_eq!(switches(inputs(bits)), bits);
        }

        #[test]
        fn no_bytes_panic(bytes: Vec<u8>) {
            let mut log = Log::new(&bytes);
            while let Ok(Some(_)) = log.entry() {}
        }
    }
}
