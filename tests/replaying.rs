//! A recorded life, replayed on this machine and on an emulated Cortex-M4, and compared with the
//! twin record by record.

use crate::emulator::Emulator;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;
use trinocular_client::twin::{PORT, RING_WORDS, Twin};
use trinocular_core::frame::message::{LastRun, Report, ResetCause};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::machine::Board;
use trinocular_core::replay::{Edge, Event, Log, Record, Replay, Station, Trace};
use trinocular_core::steps::{Segment, WordRate};
use trinocular_core::time::Instant;

/// Board of the twin, as in `qemu/src/board.rs`.
pub const BOARD: Board = Board {
    name: "qemu-mps2-an386",
    version: [0, 1, 0],
    word_rate: WordRate::MHZ_1,
    delay_us: RING_WORDS as u32,
    session: 1,
    reset_cause: ResetCause::PowerOn,
    last_run: LastRun::UNKNOWN,
    camera_pin: None,
};

/// Log and records of one life of the twin.
pub struct Recording {
    /// Inputs of the station with their instants.
    pub log: Vec<u8>,
    /// Outputs of the station.
    pub records: Vec<Record>,
    /// Steps at the pins, counted by the simulated drivers.
    pub steps: [i64; 3],
}

impl Recording {
    /// Returns the recording of a twin that keeps a log and has the board name of [`BOARD`].
    pub fn of(twin: &Twin) -> Self {
        let tape = twin.tape().expect("it was recorded");
        Self {
            log: tape.log(twin.now()),
            records: tape.records().to_vec(),
            steps: twin.steps(),
        }
    }

    /// Checks that a replay on this machine does as the twin did.
    pub fn check_here(&self) {
        let replayed = replay(&self.log, |_, _, _| {});
        if let Some((text, _)) = difference(&self.records, &replayed) {
            panic!("twin and replay differ at {text}");
        }
        // The simulated drivers, which share no code with the trace, counted the same steps.
        let digest = replayed.iter().rev().find_map(|record| match record {
            Record::Digest(_, digest) => Some(digest),
            Record::Sent(..) => None,
        });
        assert_eq!(
            digest.map(|digest| digest.steps.map(i64::from)),
            Some(self.steps)
        );
    }

    /// Checks that the emulated processor does as the twin did; returns the numbers of segments and
    /// packets that agree.
    pub fn check_emulated(&self) -> [usize; 2] {
        let folder = tempfile::tempdir().expect("a folder");
        let (log, trace) = (folder.path().join("log"), folder.path().join("trace"));
        std::fs::write(&log, &self.log).expect("the log is written");
        emulate(&log, &trace, None);
        let bytes = std::fs::read(&trace).expect("the image wrote its trace");
        let mut rest = &bytes[..];
        let emulated: Vec<Record> = std::iter::from_fn(|| Record::read(&mut rest)).collect();
        assert_eq!(rest.len(), 0, "the trace ends with a whole record");
        if let Some((text, instant)) = difference(&self.records, &emulated) {
            let mut closer = String::new();
            if let Some(instant) = instant {
                writeln!(closer, "here:\n{}", edges_here(&self.log, instant)).unwrap();
                let there = emulate(&log, &trace, Some(instant));
                writeln!(closer, "there:\n{there}").unwrap();
            }
            panic!("twin and emulated processor differ at {text}\n{closer}");
        }
        // On request the image prints all edges of a segment. Those of the segment with most steps
        // must agree, too.
        let busiest = |record: &Record| match record {
            Record::Digest(at, digest) => {
                Some((digest.edges.rises.map(u32::from).iter().sum::<u32>(), *at))
            }
            Record::Sent(..) => None,
        };
        let (rises, at) = (self.records.iter().filter_map(busiest).max()).expect("segments");
        assert!(rises > 0, "nothing ever moved");
        assert_eq!(emulate(&log, &trace, Some(at)), edges_here(&self.log, at));
        let segments = emulated.iter().filter(|r| matches!(r, Record::Digest(..)));
        let segments = segments.count();
        [segments, emulated.len() - segments]
    }
}

/// Replays a log on this machine; `segment` gets each segment with its edges.
pub fn replay(log: &[u8], mut segment: impl FnMut(Instant, &Segment, &[Edge])) -> Vec<Record> {
    let station = Station::new(BOARD, PORT, RING_WORDS as u32).expect("possible pins");
    let mut replay = Replay::new(station, Log::new(log)).expect("a whole log");
    let mut trace = Trace::new(PORT);
    let mut words = [0; 2 * WordRate::MHZ_1.slots_per_segment() as usize];
    let mut records = Vec::new();
    while let Some((at, event)) = replay.step(&mut words).expect("a whole log") {
        match event {
            Event::Sent(bytes) => records.push(Record::Sent(at, bytes)),
            Event::Segment(plan, filled) => {
                let mut edges = Vec::new();
                let digest = trace.digest(&plan, &words[..filled], |edge| edges.push(edge));
                segment(at, &plan, &edges);
                records.push(Record::Digest(at, digest));
            }
            Event::Refused(fault) => panic!("at {at:?}: {fault}"),
            Event::Idle(_) => {}
        }
    }
    records
}

/// Returns the report in a packet.
pub fn report(bytes: &[u8]) -> Option<Report> {
    let mut bytes = bytes;
    Receiver::default().next(&mut bytes)?.ok()
}

fn describe(record: Option<&Record>) -> String {
    match record {
        None => "nothing more".to_owned(),
        Some(Record::Sent(at, bytes)) => match report(bytes) {
            Some(report) => format!("{} us: {report:?}", at.micros()),
            None => format!("{} us: packet {bytes:02x?}", at.micros()),
        },
        Some(Record::Digest(at, digest)) => format!("{} us: {digest:?}", at.micros()),
    }
}

/// Returns the first record in which two machines differ, as text, and its instant if it is a
/// segment.
pub fn difference(a: &[Record], b: &[Record]) -> Option<(String, Option<Instant>)> {
    let at = (0..a.len().max(b.len())).find(|i| a.get(*i) != b.get(*i))?;
    let segments = a[..at.min(a.len())]
        .iter()
        .filter(|record| matches!(record, Record::Digest(..)))
        .count();
    let instant = [a, b].iter().find_map(|side| match side.get(at) {
        Some(Record::Digest(instant, _)) => Some(*instant),
        _ => None,
    });
    let text = format!(
        "record {at}, after {segments} segments:\n  {}\n  {}",
        describe(a.get(at)),
        describe(b.get(at))
    );
    Some((text, instant))
}

/// Replays a log in QEMU; with `closer`, the image prints details of the segment given out at that
/// instant.
fn emulate(log: &Path, trace: &Path, closer: Option<Instant>) -> String {
    let mut arguments = vec!["replay".into(), log.into(), trace.into()];
    arguments.extend(closer.map(|at| at.micros().to_string().into()));
    let ended = Emulator::run(&["-serial", "none"], &arguments, Duration::from_secs(300));
    assert!(ended.success, "the image failed: {}", ended.output);
    ended.output
}

/// Returns the same details of the segment on this machine.
fn edges_here(log: &[u8], chosen: Instant) -> String {
    let mut text = String::new();
    replay(log, |at, segment, edges| {
        if at == chosen {
            writeln!(text, "{segment:?}").unwrap();
            for edge in edges {
                writeln!(text, "{edge:?}").unwrap();
            }
        }
    });
    text
}
