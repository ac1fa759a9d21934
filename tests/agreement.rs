//! The twin, a replay of its log here, and a replay on an emulated Cortex-M4 do the same, bit for bit: packets to the host, segments, port words.

#[path = "agreement/life.rs"]
mod life;

use host::station::tape::Tape;
use host::station::twin::{PORT, RING_WORDS};
use life::{Life, ROUNDS};
use shared::frame::encode::encode;
use shared::frame::message::{Command, Frame, LastRun, Packet, Report, ResetCause, Status, Sums};
use shared::frame::receive::Receiver;
use shared::machine::Board;
use shared::replay::{Edge, Entry, Event, Log, Record, Replay, Station, Trace, Writer};
use shared::safety::State;
use shared::steps::{Segment, WordRate};
use shared::time::Instant;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;
use std::sync::OnceLock;
use std::time::Duration;
use trinocular_tests::emulator::Emulator;

/// As in `qemu/src/board.rs`.
const BOARD: Board = Board {
    name: "qemu-mps2-an386",
    version: [0, 1, 0],
    word_rate: WordRate::MHZ_1,
    delay_us: RING_WORDS as u32,
    session: 1,
    reset_cause: ResetCause::PowerOn,
    last_run: LastRun::UNKNOWN,
};

/// The log of one life and what the twin did in it.
struct Recording {
    log: Vec<u8>,
    records: Vec<Record>,
    frames: usize,
    steps: [i64; 3],
}

fn recording() -> &'static Recording {
    static RECORDING: OnceLock<Recording> = OnceLock::new();
    RECORDING.get_or_init(|| {
        let life = Life::new(BOARD.name);
        let tape: &Tape = life.twin.tape().expect("it was recorded");
        Recording {
            log: tape.log(life.twin.now()),
            records: tape.records().to_vec(),
            frames: life.frames,
            steps: life.twin.steps(),
        }
    })
}

/// Replays a log on this machine; `segment` gets each segment with its edges.
fn replay(log: &[u8], mut segment: impl FnMut(Instant, &Segment, &[Edge])) -> Vec<Record> {
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

fn report(bytes: &[u8]) -> Option<Report> {
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

/// The first record in which two machines differ, described; and its instant if it is a segment.
fn difference(a: &[Record], b: &[Record]) -> Option<(String, Option<Instant>)> {
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

#[test]
fn the_recorded_life_is_eventful() {
    let recording = recording();
    let mut states = BTreeSet::new();
    let mut faults = BTreeSet::new();
    let mut last: Option<Status> = None;
    let (mut hellos, mut homed) = (0, 0);
    let mut outcomes = BTreeMap::<String, u32>::new();
    for record in &recording.records {
        let Record::Sent(_, bytes) = record else {
            continue;
        };
        match report(bytes).expect("the station sends sound packets") {
            Report::Status(status) => {
                let was = last.as_ref().map(|last: &Status| last.state);
                homed += usize::from(was == Some(State::Homing) && status.state == State::Idle);
                states.insert(format!("{:?}", status.state));
                faults.extend(status.fault.map(|fault| format!("{fault:?}")));
                last = Some(status);
            }
            Report::Hello(_) => hellos += 1,
            Report::Answer { outcome, .. } => {
                *outcomes.entry(format!("{outcome:?}")).or_default() += 1;
            }
            Report::Pong { .. } | Report::LastRun(_) => {}
        }
    }
    let last = last.expect("there was a status");
    println!(
        "{} frames written, {} used, {} refused, {:?}\nstates {states:?}\nfaults {faults:?}\noutcomes {outcomes:#?}",
        recording.frames, last.frames_used, last.frames_refused, last.drops
    );
    assert!(recording.frames >= 2_000);
    assert!(last.frames_used >= 1_000);
    assert!(last.frames_refused >= 300);
    assert_eq!(states.len(), 8, "all states");
    assert_eq!(
        homed, ROUNDS,
        "every search that was let end found its switches"
    );
    for fault in [
        "Heartbeat",
        "EmergencyStop",
        "Limit",
        "Driver",
        "SwitchNotFound",
    ] {
        assert!(faults.contains(fault), "{fault} is not in {faults:?}");
    }
    assert!(hellos >= 2);
    let drops = last.drops;
    for count in [
        drops.duplicate,
        drops.stale,
        drops.overflow,
        drops.rejects.checksum,
        drops.rejects.too_long,
    ] {
        assert!(count > 0, "{drops:?}");
    }
    assert_ne!(last.state, State::Faulted);
}

#[test]
fn a_replay_does_what_the_twin_did() {
    let recording = recording();
    let replayed = replay(&recording.log, |_, _, _| {});
    if let Some((text, _)) = difference(&recording.records, &replayed) {
        panic!("twin and replay differ at {text}");
    }
    // The simulated drivers, which share no code with the trace, counted the same steps.
    let digest = replayed.iter().rev().find_map(|record| match record {
        Record::Digest(_, digest) => Some(digest),
        Record::Sent(..) => None,
    });
    assert_eq!(
        digest.map(|digest| digest.steps.map(i64::from)),
        Some(recording.steps)
    );
}

/// The sequence number of a frame for the midpoint that the station used, half way through its life.
fn frame_used(records: &[Record]) -> u16 {
    let used: Vec<u16> = records
        .iter()
        .filter_map(|record| match record {
            Record::Sent(_, bytes) => report(bytes),
            Record::Digest(..) => None,
        })
        .filter_map(|report| match report {
            Report::Status(status) => status.estimate,
            _ => None,
        })
        .filter(|estimate| estimate.sigma_nm.is_some())
        .map(|estimate| estimate.sequence)
        .collect();
    used[used.len() / 2]
}

#[test]
fn a_nanometre_in_one_frame_is_noticed() {
    let recording = recording();
    let mut log = Log::new(&recording.log);
    let mut changed = Vec::new();
    let mut writer = Writer(|part: &[u8]| changed.extend_from_slice(part));
    let chosen = frame_used(&recording.records);
    let mut found = false;
    while let Some((at, entry)) = log.entry().expect("a whole log") {
        let packet = match entry {
            Entry::Bytes(bytes) => Receiver::<Packet>::default().next(&mut &bytes[..]),
            _ => None,
        };
        if let Some(Ok(mut packet)) = packet
            && packet.sequence == chosen
            && let Command::Frame(Frame {
                sums: Sums::Midpoint(sums),
                ..
            }) = &mut packet.command
        {
            found = true;
            sums.mean_nm[0] += 1;
            let bytes = encode(&packet).expect("it was a packet");
            writer.entry(at, Entry::Bytes(&bytes));
            continue;
        }
        writer.entry(at, entry);
    }
    assert!(found, "frame {chosen} is in the log");
    let replayed = replay(&changed, |_, _, _| {});
    let (text, _) = difference(&recording.records, &replayed).expect("a difference");
    assert!(text.contains("EstimateReport"), "{text}");
}

#[test]
#[ignore = "needs QEMU and a thumbv7em compiler; tests/run includes it"]
fn the_emulated_processor_does_what_the_twin_did() {
    let recording = recording();
    let folder = tempfile::tempdir().expect("a folder");
    let (log, trace) = (folder.path().join("log"), folder.path().join("trace"));
    std::fs::write(&log, &recording.log).expect("the log is written");
    emulate(&log, &trace, None);
    let bytes = std::fs::read(&trace).expect("the image wrote its trace");
    let mut rest = &bytes[..];
    let emulated: Vec<Record> = std::iter::from_fn(|| Record::read(&mut rest)).collect();
    assert_eq!(rest.len(), 0, "the trace ends with a whole record");
    if let Some((text, instant)) = difference(&recording.records, &emulated) {
        let mut closer = String::new();
        if let Some(instant) = instant {
            writeln!(closer, "here:\n{}", edges_here(&recording.log, instant)).unwrap();
            let there = emulate(&log, &trace, Some(instant));
            writeln!(closer, "there:\n{there}").unwrap();
        }
        panic!("twin and emulated processor differ at {text}\n{closer}");
    }
    // On request the image tells all edges of a segment: those of one that steps on all axes are the same, too.
    let busy = |record: &&Record| matches!(record, Record::Digest(_, d) if d.edges.rises.iter().all(|n| *n > 0));
    let Some(Record::Digest(at, _)) = recording.records.iter().find(busy) else {
        panic!("no segment steps on all axes");
    };
    assert_eq!(
        emulate(&log, &trace, Some(*at)),
        edges_here(&recording.log, *at)
    );
    let segments = emulated.iter().filter(|r| matches!(r, Record::Digest(..)));
    println!(
        "{} frames: {} segments and {} packets agree",
        recording.frames,
        segments.clone().count(),
        emulated.len() - segments.count()
    );
}

/// Replays in QEMU; with `closer`, what the image prints about the segment given out at that instant.
fn emulate(log: &Path, trace: &Path, closer: Option<Instant>) -> String {
    let mut arguments = vec!["replay".into(), log.into(), trace.into()];
    arguments.extend(closer.map(|at| at.micros().to_string().into()));
    let ended = Emulator::run(&["-serial", "none"], &arguments, Duration::from_secs(300));
    assert!(ended.success, "the image failed: {}", ended.output);
    ended.output
}

/// The same about the segment here.
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
