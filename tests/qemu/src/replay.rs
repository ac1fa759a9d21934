//! Runs a station through a recorded log on virtual time.

use crate::board::{BOARD, PORT, RING_WORDS, SEGMENT_WORDS};
use crate::port_log::PortLog;
use crate::{Failure, Path};
use semihosting::fs::File;
use semihosting::io::Read;
use semihosting::println;
use static_cell::ConstStaticCell;
use trinocular_core::replay::{Event, Log, Replay, Station};

/// Length of the longest log, bytes: about 20,000 frames.
const LOG_BYTES: usize = 2 << 20;

static LOG: ConstStaticCell<[u8; LOG_BYTES]> = ConstStaticCell::new([0; LOG_BYTES]);

/// Replays the log in `log_path`; the trace goes to `trace_path`. With `closer`, prints the
/// segments of that instant in full.
pub fn run(log_path: &Path, trace_path: &Path, closer: Option<u64>) -> Result<(), Failure> {
    let buffer = LOG.take();
    let mut file = File::open(log_path.as_c_str()?).map_err(|_| Failure("cannot open the log"))?;
    let mut length = 0;
    while let Some(room) = buffer.get_mut(length..).filter(|room| !room.is_empty()) {
        match file
            .read(room)
            .map_err(|_| Failure("cannot read the log"))?
        {
            0 => break,
            read => length += read,
        }
    }
    let bytes = buffer.get(..length).unwrap_or_default();
    if length == LOG_BYTES {
        return Err(Failure("the log is too long"));
    }
    let broken = |_| Failure("the log is broken");
    let station = Station::new(BOARD, PORT, RING_WORDS).map_err(|_| Failure("impossible pins"))?;
    let mut replay = Replay::new(station, Log::new(bytes)).map_err(broken)?;
    let mut port_log = PortLog::create(trace_path)?;
    let mut words = [0; SEGMENT_WORDS];
    while let Some((at, event)) = replay.step(&mut words).map_err(broken)? {
        let chosen = closer == Some(at.micros());
        if let (true, Event::Segment(segment, _)) = (chosen, &event) {
            println!("{segment:?}");
        }
        if let Event::Refused(_) = event {
            return Err(Failure("the generator refused a segment"));
        }
        port_log.note(at, &event, &words, |edge| {
            if chosen {
                println!("{edge:?}");
            }
        });
    }
    port_log.finish()
}
