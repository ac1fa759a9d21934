//! Record of the station's actions, in a file on the emulator's side.

use crate::{Failure, Path, board};
use semihosting::fs::File;
use semihosting::io::Write;
use trinocular_core::replay::{Edge, Event, Record, Trace};
use trinocular_core::time::Instant;

/// A trace that grows in memory and goes to the file in large pieces.
pub struct PortLog {
    trace: Trace,
    file: File,
    buffer: [u8; 8192],
    used: usize,
    failed: bool,
}

impl PortLog {
    /// Creates the file.
    pub fn create(path: &Path) -> Result<Self, Failure> {
        let file = File::create(path.as_c_str()?).map_err(|_| Failure("cannot write the trace"))?;
        Ok(Self {
            trace: Trace::new(board::PORT),
            file,
            buffer: [0; 8192],
            used: 0,
            failed: false,
        })
    }

    /// Records an action of the station, and calls `edge` for each pin change.
    pub fn note(&mut self, at: Instant, event: &Event, words: &[u32], edge: impl FnMut(Edge)) {
        let record = match event {
            Event::Sent(bytes) => Record::Sent(at, bytes.clone()),
            Event::Segment(segment, filled) => {
                let words = words.get(..*filled).unwrap_or_default();
                Record::Digest(at, self.trace.digest(segment, words, edge))
            }
            Event::Refused(_) | Event::Idle(_) => return,
        };
        record.write(|part| self.put(part));
    }

    fn put(&mut self, part: &[u8]) {
        if self.buffer.len() - self.used < part.len() {
            self.flush();
        }
        if let Some(room) = self.buffer.get_mut(self.used..self.used + part.len()) {
            room.copy_from_slice(part);
            self.used += part.len();
        }
    }

    /// Writes the rest of the trace.
    pub fn flush(&mut self) {
        let full = self.buffer.get(..self.used).unwrap_or_default();
        self.failed |= self.file.write_all(full).is_err();
        self.used = 0;
    }

    /// Writes the rest of the trace, and fails unless all of it reached the file.
    pub fn finish(mut self) -> Result<(), Failure> {
        self.flush();
        match self.failed {
            true => Err(Failure("the trace could not be written")),
            false => Ok(()),
        }
    }
}
