//! Ends of runs with a station in motion: by signals, closed and full outputs, and other hosts.
//!
//! Every command that moves a stage ends alike: before the program ends, the stage is at rest,
//! stopped by command and without a fault.

use trinocular_client::serial::Serial;
use trinocular_client::stage::default_stage;
#[path = "ending/load.rs"]
mod load;
#[path = "ending/owner.rs"]
mod owner;
#[path = "ending/signals.rs"]
mod signals;
#[path = "ending/station.rs"]
mod station_says;

use std::fs::{File, OpenOptions};
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use trinocular_core::frame::message::{Command as StationCommand, Packet, Report};
use trinocular_core::safety::State;
use trinocular_rig::rig_file::RigFile;
use trinocular_tests::binary::{Outcome, signal, trinocular};
use trinocular_tests::emulator::{Emulator, pins};
use trinocular_tests::far_end::{FarEnd, bridge, station, station_behind};

/// Time limit of every wait. It is long enough for any machine; a test that reaches it has failed.
const PATIENCE: Duration = Duration::from_secs(60);

/// Lets one test run at a time, because each processes images.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs with long motion: a jog of ten seconds, and other commands. The heartbeat timeout is long
/// because the test machine may be busy.
const RUNS: [&str; 4] = [
    "jog x=50 --rig wide.toml --heartbeat 5000",
    "home x --rig home.toml --heartbeat 5000",
    "track --sim --path line --seconds 60 --heartbeat 5000",
    "--heartbeat 5000 --report report.html",
];

struct Desk {
    folder: TempDir,
}

impl Desk {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, change: fn(&mut trinocular_rig::rig_file::Stage)| {
            let mut rig = RigFile::paper();
            let mut stage = default_stage();
            change(&mut stage);
            rig.stage = Some(stage);
            std::fs::write(folder.path().join(name), rig.to_toml()).expect("it is ours");
        };
        write("wide.toml", |stage| stage.care.unknown_window_mm = 60.0);
        write("home.toml", |stage| {
            stage.max_speed_mm_s = [5.0; 3];
            stage.care.home = [None; 3];
            stage.care.home[0] = Some(trinocular_rig::rig_file::HomeSwitch {
                side: trinocular_core::frame::message::Side::Negative,
                position_mm: -61.0,
            });
        });
        Self { folder }
    }

    fn command(&self, end: &FarEnd, words: &str) -> Command {
        let mut command = trinocular();
        command
            .args(words.split_whitespace())
            .args(["--port", &end.path])
            .current_dir(self.folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        command
    }

    fn start(&self, end: &FarEnd, words: &str) -> Child {
        self.command(end, words).spawn().expect("trinocular runs")
    }
}

fn moving(end: &FarEnd) {
    let patience = Instant::now() + PATIENCE;
    while end.steps().iter().all(|steps| steps.abs() < 40) {
        assert!(Instant::now() < patience, "{:?}", end.steps());
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits for a program to end by itself; returns exit code and standard error.
fn ended(mut program: Child) -> (Option<i32>, String) {
    let patience = Instant::now() + PATIENCE;
    while program.try_wait().expect("it is ours").is_none() {
        if Instant::now() > patience {
            program.kill().expect("it runs");
            panic!("it does not end");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let stderr = program.stderr.take();
    let text = stderr.map_or(String::new(), |pipe| {
        std::io::read_to_string(pipe).expect("UTF-8")
    });
    (program.wait().expect("it ended").code(), text)
}

/// Checks that the stage is at rest because of a stop and for no other reason.
#[track_caller]
fn stands_stopped(end: &FarEnd) {
    let stood = end.steps();
    let serial = Serial::connect(&end.path).expect("it answers");
    let status = serial.fresh_status(false).expect("it tells");
    assert_eq!((status.state, status.fault), (State::Stopped, None));
    assert_eq!(end.steps(), stood);
}

#[test]
fn signal_in_motion_stops_stage() {
    let _alone = alone();
    let desk = Desk::new();
    for (words, name) in RUNS.into_iter().zip(["INT", "TERM", "HUP", "INT"]) {
        let end = station();
        let run = desk.start(&end, words);
        moving(&end);
        signal(&run, name);
        let (code, err) = ended(run);
        assert_eq!(code, Some(3), "{words}: {err}");
        assert!(err.contains("interrupted"), "{words}: {err}");
        stands_stopped(&end);
    }
    let end = station();
    for name in ["INT", "TERM", "HUP"] {
        // On a busy computer the stage may stand when the signal comes, and stop for no other run.
        let stopped = (0..10).any(|_| stopped_in_motion(&desk, &end, name));
        assert!(stopped, "{name} never came in motion");
    }
}

/// Starts `track`, and ends it by a signal once it moves; returns false if the stage stood then.
fn stopped_in_motion(desk: &Desk, end: &FarEnd, name: &str) -> bool {
    let run = desk.start(end, RUNS[2]);
    std::thread::sleep(Duration::from_millis(300));
    let before = end.steps();
    let has_moved = || {
        let axes = end.steps().into_iter().zip(before);
        axes.into_iter().any(|(now, then)| (now - then).abs() >= 40)
    };
    let patience = Instant::now() + PATIENCE;
    while !has_moved() {
        assert!(Instant::now() < patience, "{:?}", end.steps());
        std::thread::sleep(Duration::from_millis(5));
    }
    signal(&run, name);
    let (code, err) = ended(run);
    let is_stopped = code == Some(3);
    if is_stopped {
        stands_stopped(end);
    } else {
        let by_signal = [130, 143, 129].map(Some).contains(&code);
        assert!(by_signal, "{name}: {code:?} {err}");
    }
    is_stopped
}

#[test]
fn stop_lost_after_signal_is_repeated() {
    let _alone = alone();
    let desk = Desk::new();
    for words in [RUNS[0], RUNS[2]] {
        let (mut is_moving, mut lost) = (false, 0);
        let lose = move |packet: &Packet| {
            is_moving |= matches!(
                packet.command,
                StationCommand::Jog { .. } | StationCommand::Frame(_)
            );
            let is_stop = is_moving && matches!(packet.command, StationCommand::Stop);
            lost += usize::from(is_stop);
            is_stop && lost <= 3
        };
        let end = station_behind(lose, Some);
        let run = desk.start(&end, words);
        moving(&end);
        signal(&run, "INT");
        let (code, err) = ended(run);
        assert_eq!(code, Some(3), "{words}: {err}");
        stands_stopped(&end);
    }
}

#[test]
#[ignore = "needs QEMU and a thumbv7em compiler; tests/run includes it"]
fn stop_lost_to_emulated_board_is_repeated() {
    let _alone = alone();
    let desk = Desk::new();
    let folder = tempfile::tempdir().expect("a folder");
    let trace = folder.path().join("trace");
    let (emulator, path) = Emulator::live(&trace);
    let is_moving = Arc::new(AtomicBool::new(false));
    let (moves, mut lost) = (Arc::clone(&is_moving), 0);
    let end = bridge(&path, move |packet| {
        let is_jog = matches!(packet.command, StationCommand::Jog { .. });
        moves.fetch_or(is_jog, Ordering::Relaxed);
        let is_stop = matches!(packet.command, StationCommand::Stop);
        lost += usize::from(is_stop);
        is_stop && lost <= 2
    });
    let run = desk.start(&end, RUNS[0]);
    let patience = Instant::now() + PATIENCE;
    while !is_moving.load(Ordering::Relaxed) {
        assert!(Instant::now() < patience, "no jog comes");
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(Duration::from_millis(500));
    signal(&run, "INT");
    let (code, err) = ended(run);
    assert_eq!(code, Some(3), "{err}");
    let serial = Serial::connect(&end.path).expect("it answers");
    let status = serial.fresh_status(false).expect("it tells");
    assert_eq!((status.state, status.fault), (State::Stopped, None));
    // Its trace is written every 100 ms; two seconds are many of those on any machine.
    std::thread::sleep(Duration::from_secs(2));
    drop(emulator);
    let (steps, _) = pins(&trace);
    assert_eq!(steps, status.position_steps.map(i64::from));
    assert!((1..4_000).contains(&steps[0]), "{steps:?}");
}

#[test]
fn second_signal_ends_at_once() {
    let _alone = alone();
    let desk = Desk::new();
    let mut is_moving = false;
    let lose = move |packet: &Packet| {
        is_moving |= matches!(packet.command, StationCommand::Jog { .. });
        is_moving && matches!(packet.command, StationCommand::Stop)
    };
    let end = station_behind(lose, Some);
    let run = desk.start(&end, RUNS[0]);
    moving(&end);
    signal(&run, "INT");
    std::thread::sleep(Duration::from_millis(300));
    signal(&run, "INT");
    let (code, err) = ended(run);
    assert_eq!(code, Some(3), "{err}");
    assert!(
        !err.contains("stops"),
        "it waited for its patience to end: {err}"
    );
}

#[test]
fn unanswered_stop_is_reported() {
    let _alone = alone();
    let desk = Desk::new();
    let mut is_moving = false;
    let lose = move |packet: &Packet| {
        is_moving |= matches!(packet.command, StationCommand::Frame(_));
        is_moving && matches!(packet.command, StationCommand::Stop)
    };
    let end = station_behind(lose, Some);
    let run = desk.start(&end, "track --sim --path line --seconds 60");
    moving(&end);
    signal(&run, "TERM");
    let (code, err) = ended(run);
    assert_eq!(code, Some(3), "{err}");
    assert!(err.contains("answered none of"), "{err}");
    end.standing();
}

/// The reader of standard output closes it, or the disk is full, after the first image.
#[test]
fn closed_output_stops_stage() {
    let _alone = alone();
    let desk = Desk::new();
    let words = "track --sim --path line --seconds 60 --heartbeat 5000 --json";

    let end = station();
    let mut run = desk
        .command(&end, words)
        .stdout(Stdio::piped())
        .spawn()
        .expect("it runs");
    let mut lines = BufReader::new(run.stdout.take().expect("piped")).lines();
    while end.steps().iter().all(|steps| steps.abs() < 40) {
        lines.next().expect("a picture").expect("UTF-8");
    }
    drop(lines);
    let (code, err) = ended(run);
    assert_eq!(code, Some(3), "{err}");
    assert!(err.contains("standard output was closed"), "{err}");
    stands_stopped(&end);

    let end = station();
    let full = OpenOptions::new()
        .write(true)
        .open("/dev/full")
        .expect("Linux has it");
    let run = desk
        .command(&end, words)
        .stdout(full)
        .spawn()
        .expect("it runs");
    let (code, err) = ended(run);
    assert_eq!(code, Some(1), "{err}");
    assert!(err.contains("standard output"), "{err}");
    assert_ne!(
        Serial::connect(&end.path)
            .expect("it answers")
            .fresh_status(false)
            .expect("it tells")
            .state,
        State::Faulted
    );
}

#[test]
fn full_standard_error_ends_no_run() {
    let _alone = alone();
    let desk = Desk::new();
    for (words, expected) in [
        ("jog x=1 --rig wide.toml --heartbeat 5000", 0),
        ("track --sim --path steps --seconds 2 --heartbeat 5000", 0),
        ("status --json", 0),
        ("jog x=500 --rig wide.toml --heartbeat 5000", 3),
        ("jog x", 2),
        ("zero --rig none.toml", 1),
    ] {
        let end = station();
        let full: File = OpenOptions::new()
            .write(true)
            .open("/dev/full")
            .expect("Linux has it");
        let run = desk
            .command(&end, words)
            .stderr(full)
            .spawn()
            .expect("it runs");
        let (code, _) = ended(run);
        assert_eq!(code, Some(expected), "{words}");
    }
}

#[test]
fn second_host_learns_port_owner() {
    let _alone = alone();
    let desk = Desk::new();
    let end = station();
    let first = desk.start(&end, RUNS[0]);
    moving(&end);
    let status = Outcome::of(desk.command(&end, "status").stdout(Stdio::piped()));
    assert_eq!(status.code, Some(0), "{}", status.stderr);
    let (code, err) = ended(desk.start(&end, "zero"));
    assert_eq!(code, Some(3), "{err}");
    let pid = format!("process {}", first.id());
    for part in [&end.path, &pid, "jog x=50", "Ctrl-C"] {
        assert!(err.contains(part), "`{part}` is not in: {err}");
    }
    for part in ["moving", &pid, "jog x=50"] {
        let text = &status.stdout;
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
    signal(&first, "INT");
    assert_eq!(ended(first).0, Some(3));
    stands_stopped(&end);
}

#[test]
fn board_control_characters_are_hidden() {
    let end = station_behind(
        |_| false,
        |mut report| {
            if let Report::Hello(hello) = &mut report {
                hello.board = "\u{1b}[2Jboard\u{7}".try_into().expect("short");
            }
            Some(report)
        },
    );
    for words in [
        &["hello"][..],
        &["status"],
        &["diagnose"],
        &["hello", "--json"],
    ] {
        let done = trinocular()
            .args(words)
            .args(["--port", &end.path])
            .output()
            .expect("runs");
        let text = String::from_utf8([done.stdout, done.stderr].concat()).expect("UTF-8");
        assert!(text.contains("?[2Jboard?"), "{text}");
        assert!(
            !text.chars().any(|c| c.is_control() && c != '\n'),
            "{text:?}"
        );
    }
}

#[test]
fn stop_command_ends_other_run() {
    let _alone = alone();
    let desk = Desk::new();
    let end = station();
    let first = desk.start(&end, RUNS[2]);
    moving(&end);
    let (code, err) = ended(desk.start(&end, "stop"));
    assert_eq!(code, Some(0), "{err}");
    assert!(err.contains(&format!("(process {})", first.id())), "{err}");
    assert_eq!(ended(first).0, Some(3));
    stands_stopped(&end);
}

#[test]
fn signal_stops_stage_calibration() {
    let _alone = alone();
    let desk = Desk::new();
    let end = station();
    let zero = desk.start(&end, "zero --rig home.toml --heartbeat 5000");
    assert_eq!(ended(zero).0, Some(0));
    let words = "calibrate-stage --rig home.toml --images . --heartbeat 5000 --reach 40";
    let run = desk.start(&end, words);
    moving(&end);
    signal(&run, "TERM");
    let (code, err) = ended(run);
    assert_eq!(code, Some(3), "{err}");
    assert!(err.contains("interrupted"), "{err}");
    stands_stopped(&end);
}

#[test]
fn motors_are_switched_by_hand() {
    let _alone = alone();
    let desk = Desk::new();
    let end = station();
    let say = |words: &str, expected: i32| {
        let done = desk.command(&end, words).stdout(Stdio::piped()).output();
        let done = done.expect("trinocular runs");
        let text = String::from_utf8([done.stdout, done.stderr].concat()).expect("UTF-8");
        assert_eq!(done.status.code(), Some(expected), "{text}");
        text
    };
    assert!(say("motors off", 3).contains("--rig"));
    say("zero --rig wide.toml --heartbeat 5000", 0);
    assert!(say("status", 0).contains("motors        on"));
    assert!(say("motors off", 0).contains("the motors are off"));
    let status = say("status", 0);
    assert!(
        status.contains("motors        off") && status.contains("`motors on`"),
        "{status}"
    );
    assert!(say("status --json", 0).contains("\"motors\":false"));
    assert!(say("jog x=1", 3).contains("trinocular motors on"));
    assert!(say("motors on", 0).contains("the motors are on"));
    say("zero", 0);
    say("jog x=1", 0);
    assert_eq!(end.steps(), [80, 0, 0]);
}
