//! The twin, a replay of its log on this machine, and a replay on an emulated Cortex-M4 agree bit
//! for bit in packets to the host, segments and port words.

#[path = "agreement/life.rs"]
mod life;

use life::{Life, ROUNDS};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::OnceLock;
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{Command, Frame, Packet, Report, Status, Sums};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::replay::{Entry, Log, Record, Writer};
use trinocular_core::safety::State;
use trinocular_tests::replaying::{BOARD, Recording, difference, replay, report};

/// Returns the recording and the number of frames written in it.
fn recording() -> &'static (Recording, usize) {
    static RECORDING: OnceLock<(Recording, usize)> = OnceLock::new();
    RECORDING.get_or_init(|| {
        let life = Life::new(BOARD.name);
        (Recording::of(&life.twin), life.frames)
    })
}

#[test]
fn recorded_life_is_eventful() {
    let (recording, frames) = recording();
    let mut states = BTreeSet::new();
    let mut faults = BTreeSet::new();
    let mut sights = BTreeSet::new();
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
                sights.insert(format!("{:?}", status.sight));
                states.insert(format!("{:?}", status.state));
                faults.extend(status.fault.map(|fault| format!("{fault:?}")));
                last = Some(status);
            }
            Report::Hello(_) => hellos += 1,
            Report::Answer { outcome, .. } => {
                *outcomes.entry(format!("{outcome:?}")).or_default() += 1;
            }
            Report::Pong { .. } | Report::LastRun(_) | Report::Triggered(_) => {}
        }
    }
    let last = last.expect("there was a status");
    println!(
        "{} frames written, {} used, {} refused, {:?}\nstates {states:?}\n\
         faults {faults:?}\nsights {sights:?}\noutcomes {outcomes:#?}",
        frames, last.frames_used, last.frames_refused, last.drops
    );
    assert!(*frames >= 2_000);
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
    assert_eq!(sights.len(), 4, "all sights: {sights:?}");
    assert!(outcomes.contains_key("Denied(Outlier)"), "{outcomes:?}");
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
fn replay_matches_twin() {
    recording().0.check_here();
}

/// Returns the sequence number of a frame for the midpoint estimator that the station used half way
/// through its life.
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
fn nanometre_in_one_frame_is_noticed() {
    let (recording, _) = recording();
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
fn emulated_processor_matches_twin() {
    let (recording, frames) = recording();
    let [segments, packets] = recording.check_emulated();
    println!("{frames} frames: {segments} segments and {packets} packets agree");
}
