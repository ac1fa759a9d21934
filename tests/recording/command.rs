//! The commands that write and read recordings, as a user meets them.

use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;
use trinocular_tests::binary::{Outcome, signal, trinocular};
#[cfg(unix)]
use trinocular_tests::far_end::station;

fn run(folder: &Path, arguments: &[&str]) -> Outcome {
    Outcome::of(trinocular().args(arguments).current_dir(folder))
}

fn same(folder: &Path, file: &str) -> serde_json::Value {
    let mut lines = run(folder, &["replay", file, "--json"]).good_json();
    let summary = lines.pop().expect("one object");
    assert_eq!(summary["version"], 1);
    assert_eq!(summary["same"], true, "{summary}");
    summary
}

/// Returns the kinds of the records of an MCAP file: a byte and the length of each, after the
/// magic.
fn record_kinds(bytes: &[u8]) -> Vec<u8> {
    let (mut rest, mut kinds) = (&bytes[8..bytes.len() - 8], Vec::new());
    while let Some((kind, after)) = rest.split_first() {
        let (length, after) = after.split_first_chunk().expect("a length");
        kinds.push(*kind);
        rest = &after[usize::try_from(u64::from_le_bytes(*length)).unwrap()..];
    }
    kinds
}

/// The library of ROS 2 before mcap 1.3.1, and 1.4.0, reads no file in the order of time that has a
/// chunk without messages (foxglove/mcap issue 1400).
#[test]
fn every_chunk_has_messages() {
    const CHUNK: u8 = 6;
    const MESSAGE_INDEX: u8 = 7;
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let words = ["track", "--sim", "--seconds", "1", "--record", "run.mcap"];
    assert_eq!(run(folder, &words).code, Some(0));
    let kinds = record_kinds(&fs::read(folder.join("run.mcap")).unwrap());
    let chunks = kinds.windows(2).filter(|pair| pair[0] == CHUNK);
    assert!(chunks.clone().count() > 1, "{kinds:?}");
    assert!(chunks.map(|pair| pair[1]).all(|next| next == MESSAGE_INDEX));
}

#[test]
fn simulated_run_is_recorded_and_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let track = ["track", "--sim", "--seconds", "1", "--json"];
    let plain = run(folder, &track).good_json();
    let recorded = run(folder, &[&track[..], &["--record", "run.mcap"]].concat());
    assert_eq!(recorded.good_json(), plain, "a recording changes nothing");
    assert!(recorded.stderr.contains("recorded "), "{}", recorded.stderr);
    let summary = same(folder, "run.mcap");
    assert_eq!(summary["measurements"]["same"], plain.len() + 1);
    assert_eq!(summary["frames"]["same"], plain.len());
    assert_eq!(summary["station"], "twin");
    assert_eq!(summary["cut"], serde_json::Value::Null);
    assert!(summary["edges"]["same"].as_u64() > Some(100), "{summary}");
    // The same displacements from the images in the file.
    let estimated = run(folder, &["estimate", "run.mcap", "--json"]).good_json();
    assert_eq!(estimated.len(), plain.len());
    for (estimated, tracked) in estimated.iter().zip(&plain) {
        let mm = |value: &serde_json::Value| value["displacement_mm"][0].as_f64().unwrap();
        // The station computes in integers.
        assert!((mm(estimated) - mm(tracked)).abs() < 1e-4, "{estimated}");
    }
    let followed = run(folder, &["track", "--images", "run.mcap", "--json"]).good_json();
    assert_eq!(followed.len(), plain.len());
    let bench = run(
        folder,
        &["bench", "flow", "run.mcap", "--repeat", "1", "--json"],
    );
    assert_eq!(bench.good_json()[0]["captures"], plain.len() + 1);
    let export = ["export", "run.mcap", "--csv", "run.csv", "--images", "caps"];
    let export = [&export[..], &["--parquet", "run.parquet"]].concat();
    assert_eq!(run(folder, &export).code, Some(0));
    // Neither table is written if one of them may not be replaced.
    fs::remove_file(folder.join("run.csv")).unwrap();
    let again = [
        "export",
        "run.mcap",
        "--csv",
        "run.csv",
        "--parquet",
        "run.parquet",
    ];
    run(folder, &again).failed(1, &["run.parquet", "--force"]);
    assert!(!folder.join("run.csv").exists());
    let forced = run(folder, &[&again[..], &["--force"]].concat());
    assert_eq!(forced.code, Some(0), "{}", forced.stderr);
    let parquet = fs::read(folder.join("run.parquet")).unwrap();
    assert!(parquet.starts_with(b"PAR1") && parquet.ends_with(b"PAR1"));
    let table = fs::read_to_string(folder.join("run.csv")).unwrap();
    assert_eq!(table.lines().count(), plain.len() + 2);
    // The images as files give the same as those in the recording.
    fs::write(
        folder.join("rig.toml"),
        trinocular_rig::rig_file::RigFile::paper().to_toml(),
    )
    .unwrap();
    let files = run(folder, &["estimate", "caps", "--rig", "rig.toml", "--json"]);
    assert_eq!(files.good_json(), estimated);
}

#[test]
fn scenario_is_recorded_and_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let scenarios = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios");
    let [step, switches] =
        ["step.toml", "switches.toml"].map(|name| scenarios.join(name).display().to_string());
    let record = ["--record", "run.mcap"];
    let recorded = run(folder, &[&["simulate", &step], &record[..]].concat());
    assert_eq!(recorded.code, Some(0), "{}", recorded.stderr);
    let summary = same(folder, "run.mcap");
    let frames = summary["frames"]["same"].as_u64();
    assert!(frames > Some(100), "{summary}");
    run(
        folder,
        &[&["simulate", &step, &switches], &record[..]].concat(),
    )
    .failed(2, &["--record", "one scenario"]);
}

#[cfg(unix)]
#[test]
fn station_on_a_line_replays_its_measurements() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let far_end = station();
    let line = [
        "--port",
        &far_end.path,
        "--heartbeat",
        "5000",
        "--path",
        "still",
    ];
    let record = ["track", "--sim", "--seconds", "1", "--record", "run.mcap"];
    let recorded = run(folder, &[&record[..], &line].concat());
    assert_eq!(recorded.code, Some(0), "{}", recorded.stderr);
    let summary = same(folder, "run.mcap");
    assert_eq!(summary["station"], "line");
    assert!(
        summary["measurements"]["same"].as_u64() > Some(5),
        "{summary}"
    );
    assert!(summary["frames"]["same"].as_u64() > Some(5), "{summary}");
    assert_eq!(summary["segments"]["same"], 0);
    let text = run(folder, &["replay", "run.mcap"]);
    assert!(
        text.stderr.contains("its segments are not recorded"),
        "{}",
        text.stderr
    );
}

#[test]
fn killed_run_leaves_a_readable_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (name, has_end, code) in [("KILL", false, None), ("INT", true, Some(130))] {
        let file = format!("{name}.mcap");
        let mut program = trinocular()
            .args(["track", "--sim", "--seconds", "600", "--record", &file])
            .current_dir(folder)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("it runs");
        let path = folder.join(&file);
        let is_long = || path.metadata().is_ok_and(|about| about.len() > 5 << 20);
        while !is_long() {
            assert!(program.try_wait().unwrap().is_none(), "it ended early");
            std::thread::sleep(Duration::from_millis(20));
        }
        signal(&program, name);
        let status = program.wait().unwrap();
        assert_eq!(status.code(), code, "{name}");
        let summary = same(folder, &file);
        assert_eq!(summary["cut"].is_null(), has_end, "{summary}");
        let measured = summary["measurements"]["same"].as_u64();
        assert!(measured >= Some(15), "{summary}");
        let estimated = run(folder, &["estimate", &file, "--json"]);
        // The cut may lie between the images of a frame set and its measurement.
        let sets = estimated.json().len() as u64 + 1;
        assert!(measured.unwrap().abs_diff(sets) <= 1, "{sets} {summary}");
    }
}

#[test]
fn second_run_to_the_same_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let track = ["track", "--sim", "--seconds", "600", "--record", "run.mcap"];
    let mut program = trinocular()
        .args(track)
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("it runs");
    let path = folder.join("run.mcap");
    while !path.metadata().is_ok_and(|about| about.len() > 1 << 20) {
        assert!(program.try_wait().unwrap().is_none(), "it ended early");
        std::thread::sleep(Duration::from_millis(20));
    }
    run(folder, &track).failed(1, &["run.mcap", "another run writes this file"]);
    // A crash leaves no lock behind.
    signal(&program, "KILL");
    program.wait().unwrap();
    let short = ["track", "--sim", "--seconds", "0.2", "--record", "run.mcap"];
    let next = run(folder, &short);
    assert_eq!(next.code, Some(0), "{}", next.stderr);
}

/// The limit stands for a full disk; the run goes on, and its exit code says what happened.
#[cfg(unix)]
#[test]
fn full_disk_ends_the_file_not_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let program = trinocular().get_program().to_owned();
    let line = "ulimit -f 4096; exec \"$0\" track --sim --seconds 1 --json --record run.mcap";
    let mut shell = std::process::Command::new("bash");
    let outcome = Outcome::of(shell.args(["-c", line]).arg(program).current_dir(folder));
    outcome.failed_after_notes(1, &["run.mcap", "cannot write"]);
    assert_eq!(outcome.json().len(), 59, "the run went on");
    assert!(
        outcome.stderr.contains("the run goes on"),
        "{}",
        outcome.stderr
    );
    let length = folder.join("run.mcap").metadata().unwrap().len();
    assert!((2 << 20..=4 << 20).contains(&length), "{length} bytes");
    let summary = same(folder, "run.mcap");
    // The file was closed, after its last whole chunk; every reader says that the end is missing.
    let said = "was not ended by its run";
    assert!(summary["cut"].to_string().contains(said), "{summary}");
    for reader in [
        &["replay", "run.mcap"][..],
        &["export", "run.mcap", "--csv", "run.csv"],
        &["export", "run.mcap", "--images", "caps"],
        &["estimate", "run.mcap"],
        &["track", "--images", "run.mcap"],
        &["bench", "flow", "run.mcap", "--repeat", "1"],
        &["report", "run.mcap"],
    ] {
        let outcome = run(folder, reader);
        assert!(
            outcome.stderr.contains(said),
            "{reader:?} {}",
            outcome.stderr
        );
    }
    let report = run(folder, &["report", "run.mcap", "--json"]).good_json();
    assert!(report[0]["cut"].to_string().contains(said), "{}", report[0]);
    assert!(
        summary["measurements"]["same"].as_u64() >= Some(8),
        "{summary}"
    );
}

/// Results of a whole run do not depend on its recording.
#[cfg(unix)]
#[test]
fn full_disk_loses_no_result() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let text = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/step.toml"));
    fs::write(folder.join("it.toml"), text.unwrap()).unwrap();
    let under_limit = |blocks: u32, arguments: &str| {
        let line = format!("ulimit -f {blocks}; exec \"$0\" {arguments} --record run.mcap --force");
        let mut shell = std::process::Command::new("bash");
        let program = trinocular().get_program().to_owned();
        let outcome = Outcome::of(shell.args(["-c", &line]).arg(program).current_dir(folder));
        outcome.failed_after_notes(1, &["run.mcap", "cannot write"]);
        assert!(
            outcome.stderr.contains("the run goes on"),
            "{}",
            outcome.stderr
        );
        outcome
    };
    let simulate = "simulate it.toml --report it.html --csv it.csv";
    let table = under_limit(4096, simulate);
    assert!(table.stdout.contains("it: "), "{}", table.stdout);
    assert!(folder.join("it.html").exists(), "the page");
    let rows = fs::read_to_string(folder.join("it.csv")).unwrap();
    assert!(
        rows.lines().count() > 1_000,
        "{} rows",
        rows.lines().count()
    );
    let json = under_limit(4096, "simulate it.toml --json");
    assert_eq!(json.json()[0]["scenario"], "it");
    let experiment = "--report all.html --figure all.svg --json";
    let experiment = under_limit(4096, experiment);
    assert_eq!(
        experiment.json()[0]["stops"].as_array().map(Vec::len),
        Some(5)
    );
    assert!(
        folder.join("all.html").exists(),
        "the page of the experiment"
    );
    assert!(folder.join("all.svg").exists(), "its figure");
}

#[test]
fn other_files_are_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("a.mcap"), "id,camera\n").unwrap();
    run(folder, &["replay", "a.mcap"]).failed(1, &["a.mcap", "no MCAP file"]);
    run(folder, &["estimate", "a.mcap"]).failed(1, &["a.mcap", "no MCAP file"]);
    run(folder, &["replay", "none.mcap"]).failed(1, &["none.mcap", "cannot read"]);
    assert_eq!(run(folder, &["export", "a.mcap"]).code, Some(2));
    let record = ["track", "--sim", "--seconds", "0.2", "--record", "a.mcap"];
    run(folder, &record).failed(1, &["a.mcap", "is no recording of this program", "--force"]);
    let forced = run(folder, &[&record[..], &["--force"]].concat());
    assert_eq!(forced.code, Some(0), "{}", forced.stderr);
    same(folder, "a.mcap");
    let alone = run(folder, &["track", "--sim", "--record-images", "none"]);
    assert_eq!(alone.code, Some(2), "{}", alone.stderr);
}

#[test]
fn recording_without_images_replays_the_station() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let record = [
        "--seconds",
        "0.5",
        "--record",
        "run.mcap",
        "--record-images",
    ];
    let track = |form: &'static str| {
        let arguments = [&["track", "--sim"], &record[..], &[form]].concat();
        assert_eq!(run(folder, &arguments).code, Some(0));
        same(folder, "run.mcap")
    };
    let none = track("none");
    assert_eq!(none["measurements"]["same"], 0);
    assert!(none["not_measured"].as_u64() > Some(10));
    assert!(none["segments"]["same"].as_u64() > Some(1_000));
    for reader in [
        &["estimate", "run.mcap"][..],
        &["export", "run.mcap", "--images", "caps"],
        &["track", "--images", "run.mcap"],
        &["bench", "flow", "run.mcap"],
    ] {
        let outcome = run(folder, reader);
        outcome.failed_after_notes(1, &["run.mcap: was recorded without images"]);
        assert!(!outcome.stderr.contains("--topic"), "{}", outcome.stderr);
    }
    let png = track("png");
    assert_eq!(png["not_measured"], 0);
    assert_eq!(png["segments"], none["segments"]);
}

/// The stage's position has one meaning in rows, recordings and tables: at the capture.
#[test]
fn recorded_stage_is_that_of_the_rows() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/data");
    let (captures, rig) = (format!("{data}/captures"), format!("{data}/rig.toml"));
    let track = ["track", "--images", &captures, "--rig", &rig, "--json"];
    let rows = run(folder, &[&track[..], &["--record", "run.mcap"]].concat()).good_json();
    let export = ["export", "run.mcap", "--csv", "run.csv"];
    assert_eq!(run(folder, &export).code, Some(0));
    let table = fs::read_to_string(folder.join("run.csv")).unwrap();
    let mut lines = table
        .lines()
        .map(|line| line.split(',').collect::<Vec<_>>());
    let names = lines.next().expect("a header");
    let place = names.iter().position(|name| *name == "stage_x_mm");
    let place = place.expect("a column");
    // The first row is the keyframe.
    let recorded: Vec<[f64; 3]> = lines
        .skip(1)
        .map(|cells| [0, 1, 2].map(|axis| cells[place + axis].parse().expect("a number")))
        .collect();
    let told: Vec<[f64; 3]> = rows
        .iter()
        .map(|row| [0, 1, 2].map(|axis| row["stage_mm"][axis].as_f64().expect("a number")))
        .collect();
    assert_eq!(recorded.len(), told.len());
    assert!(told.iter().any(|mm| mm[0] > 0.1), "{told:?}");
    for (recorded, told) in recorded.iter().zip(&told) {
        let is_same = recorded.iter().zip(told).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(is_same, "{recorded:?} {told:?}");
    }
    same(folder, "run.mcap");
}

/// Recordings from before the position at the capture say nothing about it in their metadata.
#[test]
fn older_recording_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let record = ["track", "--sim", "--seconds", "1", "--record", "run.mcap"];
    assert_eq!(run(folder, &record).code, Some(0));
    let mut bytes = fs::read(folder.join("run.mcap")).unwrap();
    let text = b"at the capture";
    let at = bytes.windows(text.len()).position(|part| part == text);
    let at = at.expect("the metadata say it");
    bytes[at..at + text.len()].copy_from_slice(b"after whatever");
    fs::write(folder.join("old.mcap"), bytes).unwrap();
    same(folder, "old.mcap");
    let report = ["report", "old.mcap", "--out", "old.html", "--json"];
    let object = &run(folder, &report).good_json()[0];
    assert!(object["cut"].is_null(), "{object}");
}

/// Ideal points leave neither images nor displacements, and nothing claims that they do.
#[test]
fn recording_of_points_claims_no_measurement() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let step = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/step.toml");
    let simulate = ["simulate", step, "--points", "--record", "run.mcap"];
    assert_eq!(run(folder, &simulate).code, Some(0));
    let estimated = run(folder, &["estimate", "run.mcap"]);
    estimated.failed_after_notes(1, &["was recorded without images", "simulate --points"]);
    let report = run(folder, &["report", "run.mcap"]);
    let said = "without a displacement in the recording: ";
    assert!(report.stdout.contains(said), "{}", report.stdout);
    assert!(!report.stdout.contains(" measured: "), "{}", report.stdout);
    let json = run(folder, &["report", "run.mcap", "--json"]).good_json();
    assert_eq!(json[0]["measured"], 0);
}

/// A file that ends before its first frame set: what it holds, and what is missing.
#[test]
fn cut_before_first_frame_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let record = ["track", "--sim", "--seconds", "1", "--record", "run.mcap"];
    assert_eq!(run(folder, &record).code, Some(0));
    let bytes = fs::read(folder.join("run.mcap")).unwrap();
    // The first chunk is not whole here.
    fs::write(folder.join("cut.mcap"), &bytes[..bytes.len().min(20_000)]).unwrap();
    let export = ["export", "cut.mcap", "--csv", "cut.csv"];
    let outcome = run(folder, &export);
    outcome.failed(
        1,
        &["cut.mcap: holds no measurement and no other message: it is cut off at"],
    );
    assert!(!outcome.stderr.contains("only recordings of this program"));
    assert!(!folder.join("cut.csv").exists());
    // Nothing tells whose recording it was.
    fs::write(folder.join("cut.mcap"), &bytes[..8]).unwrap();
    for command in ["replay", "report"] {
        let outcome = run(folder, &[command, "cut.mcap"]);
        outcome.failed_after_notes(1, &["cut.mcap: holds nothing", "is cut off at byte 8"]);
        assert!(
            !outcome.stderr.contains("of this program"),
            "{}",
            outcome.stderr
        );
    }
}
