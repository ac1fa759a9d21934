//! Recordings: a run is recorded, replayed bit for bit on this machine and on an emulated
//! Cortex-M4, and every change is noticed; a run that ends at any moment leaves a file that is
//! read.

#[path = "recording/command.rs"]
mod command;
#[path = "recording/report.rs"]
mod report;
#[path = "recording/run.rs"]
mod run;

use run::{Alteration, Run};
use std::path::Path;
use trinocular_recording::read::Source;
use trinocular_recording::replay::{self, Replayed};
use trinocular_tests::replaying::{BOARD, Recording};

fn replayed(path: &Path) -> Replayed {
    let source = Source::open(path).expect("a recording");
    let settings = run::settings(Some(BOARD.name));
    replay::replay(&source, &settings, |_| {}).expect("it is replayed")
}

#[test]
fn eventful_run_replays_without_difference() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let frames = 240;
    let run = Run::record(&path, frames, None);
    assert!(run.refused >= 10, "{} refused", run.refused);
    assert!(run.unused >= 10, "{} not used", run.unused);
    assert!(run.faults >= 3, "{} faults", run.faults);
    let replayed = replayed(&path);
    assert_eq!(replayed.first_difference(), None);
    assert_eq!(replayed.measurements.same, frames as u64 + 1);
    assert!(replayed.frames.same >= 200, "{replayed:?}");
    assert!(replayed.edges.same > 1_000, "{replayed:?}");
    assert!(replayed.packets.same > frames as u64);
    assert_eq!(replayed.not_measured, 0);
}

/// Returns the number of frames of the long runs: 10,000 in `tests/run --all`.
fn frames_or(few: usize) -> usize {
    let frames = std::env::var("RECORDED_FRAMES").ok();
    frames.map_or(few, |count| count.parse().expect("a number"))
}

#[test]
#[ignore = "takes a minute; tests/run --all includes it"]
fn long_run_replays_without_difference() {
    let frames = frames_or(600);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let run = Run::record(&path, frames, None);
    let replayed = replayed(&path);
    println!(
        "{frames} frames: {} refused, {} not used, {} faults, {} configurations; {:?}",
        run.refused,
        run.unused,
        run.faults,
        run.configurations,
        replayed
            .comparisons()
            .map(|(name, c)| (name, c.same, c.different))
    );
    assert_eq!(replayed.first_difference(), None);
    assert_eq!(replayed.measurements.same, frames as u64 + 1);
}

#[test]
fn every_alteration_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    for (alteration, kind, message, field) in [
        (Alteration::Pixel, "measurements", "frame set", ""),
        (Alteration::Packet, "packets", "packet", ""),
        (Alteration::Word, "segments", "segment", "words"),
        (
            Alteration::Sums,
            "frames",
            "frame to the station",
            "mean_nm",
        ),
    ] {
        let path = folder.path().join(format!("{alteration:?}.mcap"));
        Run::record(&path, 40, Some(alteration));
        let replayed = replayed(&path);
        let all = replayed.comparisons();
        let (_, found) = all.iter().find(|(name, _)| *name == kind).unwrap();
        let first = found.first.as_ref();
        let first = first.unwrap_or_else(|| panic!("{alteration:?}: {replayed:?}"));
        assert!(first.message.contains(message), "{alteration:?}: {first:?}");
        assert!(first.field.contains(field), "{alteration:?}: {first:?}");
        assert_ne!(first.recorded, first.replayed, "{alteration:?}");
    }
}

#[test]
#[ignore = "needs QEMU and a thumbv7em compiler; tests/run includes it"]
fn recording_replays_on_emulated_processor() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let run = Run::record(&path, frames_or(240), None);
    let source = Source::open(&path).expect("a recording");
    let (log, records) = replay::log(&source).expect("a whole recording");
    let recording = Recording {
        log,
        records,
        steps: run.steps,
    };
    recording.check_here();
    let [segments, packets] = recording.check_emulated();
    println!("{segments} segments and {packets} packets of an MCAP file agree");
}
