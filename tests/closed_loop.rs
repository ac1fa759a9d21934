//! The paper's closed loop with station B on a serial line in real time: images on this side,
//! everything from frame to step pins on the other.

use serde_json::Value;
use std::io::{BufRead as _, BufReader};
use std::process::Stdio;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use trinocular::paper::tracking::{self, BOUND_MM, MOVES, Run, Settings};
use trinocular::servo::station_link::StationPlace;
use trinocular_client::stage::default_stage;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_tests::binary::trinocular;
use trinocular_tests::emulator::{Emulator, pins};
use trinocular_tests::far_end::{FarEnd, mute, station};

/// Heartbeat timeout, ms. It is long because the test machine may be busy, and the heartbeat is no
/// part of these tests.
const HEARTBEAT_MS: u16 = 5_000;

/// Lets one closed loop run at a time, because each needs a processor of its own.
static ALONE: Mutex<()> = Mutex::new(());

/// Runs Table 6 with the station on this port.
fn table_6(path: &str) -> Run {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let place = StationPlace::Port {
        path,
        heartbeat_ms: HEARTBEAT_MS,
    };
    let run = tracking::run(&Settings::default(), &default_stage(), place, |_| {})
        .unwrap_or_else(|error| panic!("{error}"));
    println!(
        "{}: largest error {:.4?} mm, {} of {} frame sets used, clock known to {:?} us",
        run.station,
        run.worst_mm(),
        run.used(),
        run.steps.len(),
        run.sync_bound_us
    );
    assert_eq!(run.stops.len(), MOVES);
    let worst = run.worst_mm();
    assert!(
        (0..3).all(|i| worst[i] <= BOUND_MM[i]),
        "{worst:?} mm: {:#?}",
        run.stops
    );
    run
}

#[test]
fn table_6_over_a_line() {
    let end = station();
    let run = table_6(&end.path);
    assert_eq!(run.pulses[1].commanded, end.steps());
}

#[test]
#[ignore = "needs QEMU and a thumbv7em compiler; tests/run includes it"]
fn table_6_with_the_emulated_board() {
    let folder = tempfile::tempdir().expect("a folder");
    let trace = folder.path().join("trace");
    let (emulator, path) = Emulator::live(&trace);
    let run = table_6(&path);
    assert!(
        run.station.starts_with("qemu-mps2-an386 on "),
        "{}",
        run.station
    );
    // The trace is written every 100 ms; two seconds are many of those on any machine.
    std::thread::sleep(Duration::from_secs(2));
    drop(emulator);
    let (steps, _) = pins(&trace);
    assert_eq!(run.pulses[1].commanded, steps);
}

/// Runs the program; returns exit code, standard output and standard error.
fn run(arguments: &[&str]) -> (Option<i32>, String, String) {
    let done = trinocular()
        .args(arguments)
        .output()
        .expect("trinocular runs");
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    (done.status.code(), text(done.stdout), text(done.stderr))
}

fn track(end: &FarEnd) -> (Option<i32>, String, String) {
    run(&[
        "track",
        "--sim",
        "--port",
        &end.path,
        "--heartbeat",
        "5000",
        "--path",
        "steps",
        "--seconds",
        "3",
        "--json",
    ])
}

#[test]
fn track_follows_with_station_on_port() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let end = station();
    let (code, out, err) = track(&end);
    assert_eq!(code, Some(0), "{err}");
    assert!(err.contains("far end on "), "{err}");
    let lines: Vec<Value> = out
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    let used = lines
        .iter()
        .filter(|line| line["displacement_mm"].is_array())
        .count();
    assert!(used >= 5 && 2 * used > lines.len(), "{out}");
    // It stood still after the last move it saw, or was on its way there. In any case it moved, and
    // never beyond the target.
    let steps = end.steps();
    assert!(
        steps.iter().all(|steps| (60..=660).contains(steps)),
        "{steps:?}"
    );
}

/// The target moves 12 mm and farther. A stage with 2 mm of travel each way moves exactly that far,
/// as a twin and on a port.
#[test]
fn stage_of_rig_file_moves() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().expect("a folder");
    let mut rig = RigFile::paper();
    rig.stage = Some(Stage {
        travel_mm: [[-2.0, 2.0]; 3],
        ..default_stage()
    });
    let path = folder.path().join("rig.toml");
    rig.write(&path).expect("it is ours");
    let track = |more: &[&str]| {
        let rig = path.to_str().expect("UTF-8");
        let words = [
            "track",
            "--sim",
            "--rig",
            rig,
            "--path",
            "steps",
            "--seconds",
            "3",
            "--json",
        ];
        let (code, out, err) = run(&[&words[..], more].concat());
        assert_eq!(code, Some(0), "{err}");
        let last = out.lines().next_back().expect("a line");
        let last: Value = serde_json::from_str(last).expect("JSON");
        let x = |key: &str| last[key][0].as_f64().expect("a number");
        [x("target_mm"), x("camera_mm")]
    };
    let [target, camera] = track(&[]);
    assert!(
        target > 7.9 && (1.9..=2.0).contains(&camera),
        "{target} {camera}"
    );
    let end = station();
    let [target, camera] = track(&["--port", &end.path, "--heartbeat", "5000"]);
    assert!(
        target > 3.9 && (1.9..=2.0).contains(&camera),
        "{target} {camera}"
    );
    assert!(
        end.steps().iter().all(|steps| *steps <= 160),
        "{:?}",
        end.steps()
    );
}

/// Runs `track` for eight seconds with the line unplugged for `away` from the second image on. The
/// program inherits the pseudo-terminal from this process, so its line falls silent instead of
/// breaking as in `serial.rs`.
fn track_with_a_break(end: &FarEnd, heartbeat: &str, away: Duration) -> (Option<i32>, String) {
    let mut running = trinocular()
        .args([
            "track",
            "--sim",
            "--port",
            &end.path,
            "--heartbeat",
            heartbeat,
        ])
        .args(["--path", "line", "--seconds", "8", "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("trinocular runs");
    let mut lines = BufReader::new(running.stdout.take().expect("piped")).lines();
    for _ in 0..2 {
        lines.next().expect("a picture").expect("UTF-8");
    }
    end.unplug();
    std::thread::sleep(away);
    end.plug();
    // An unread pipe would block the writer.
    for line in lines {
        line.expect("UTF-8");
    }
    let done = running.wait_with_output().expect("it ends");
    let text = String::from_utf8(done.stderr).expect("UTF-8");
    (done.status.code(), text)
}

#[test]
fn unnoticed_break_is_survived() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let end = station();
    let (code, err) = track_with_a_break(&end, "10000", Duration::from_millis(100));
    assert_eq!(code, Some(0), "{err}");
    assert!(err.contains("following error"), "{err}");
}

#[test]
fn break_that_stops_station_ends_run() {
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let end = station();
    let (code, err) = track_with_a_break(&end, "1000", Duration::from_secs(3));
    assert_eq!(code, Some(3), "{err}");
    assert!(
        err.contains(&end.path) && err.contains("the line was lost for"),
        "{err}"
    );
    let stood = end.steps();
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(end.steps(), stood);
}

#[test]
fn silent_or_missing_port_is_named() {
    let nobody = mute();
    let (code, out, err) = track(&nobody);
    assert_eq!(code, Some(3), "{err}");
    assert!(out.is_empty() && err.contains(&nobody.path), "{err}");
    for command in [&["track", "--sim"][..], &["hello"], &[]] {
        let (code, _, err) = run(&[command, &["--port", "/dev/no-such-port"]].concat());
        assert_eq!(code, Some(1), "{err}");
        assert!(err.contains("/dev/no-such-port"), "{err}");
    }
    let (code, _, err) = run(&["track", "--images", "x", "--rig", "y", "--port", "z"]);
    assert_eq!(code, Some(2), "{err}");
}

#[test]
fn auto_without_station_lists_ports() {
    let (_, ports, _) = run(&["ports", "--json"]);
    // With a real board connected this test is skipped, because it must not write to it.
    if !ports.contains("\"is_station\":true") {
        let (code, _, err) = run(&["hello", "--port", "auto"]);
        assert_eq!(code, Some(1), "{err}");
        assert!(err.contains("no USB port of a station"), "{err}");
    }
}
