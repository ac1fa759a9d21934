//! Commands that drive a station by hand, as a user meets them: a station on a pseudo-terminal, the
//! built program, its messages and exit codes.

#[path = "by_hand/homing.rs"]
mod homing;
#[path = "by_hand/jog.rs"]
mod jog;

use serde_json::{Value, json};
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use trinocular_client::stage::default_stage;
use trinocular_core::frame::message::{End, LastRun, ResetCause, Side};
use trinocular_core::safety::{Fault, State};
use trinocular_rig::rig_file::{HomeSwitch, RigFile};
use trinocular_tests::binary::trinocular;
use trinocular_tests::emulator::{Emulator, pins};
use trinocular_tests::far_end::{FarEnd, mute, station, station_after};

/// Time limit of every wait. It is long enough for any machine; a test that reaches it has failed.
const PATIENCE: Duration = Duration::from_secs(60);

/// Exit code and output of a finished run.
struct Done {
    code: Option<i32>,
    out: String,
    err: String,
}

impl Done {
    #[track_caller]
    fn ended(self, code: i32, parts: &[&str]) -> Self {
        assert_eq!(self.code, Some(code), "{}\n{}", self.out, self.err);
        let text = if code == 0 { &self.out } else { &self.err };
        for part in parts {
            assert!(text.contains(part), "`{part}` is not in: {text}");
        }
        self
    }

    #[track_caller]
    fn json(&self) -> Value {
        serde_json::from_str(&self.out).expect("one JSON object")
    }
}

/// A folder with a rig file, and the path to a station.
struct Desk {
    folder: TempDir,
    port: String,
}

impl Desk {
    fn new(port: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let mut rig = RigFile::paper();
        std::fs::write(folder.path().join("cameras.toml"), rig.to_toml()).expect("it is ours");
        rig.stage = Some(default_stage());
        std::fs::write(folder.path().join("rig.toml"), rig.to_toml()).expect("it is ours");
        let mut stage = default_stage();
        stage.care.unknown_window_mm = 60.0;
        rig.stage = Some(stage);
        std::fs::write(folder.path().join("wide.toml"), rig.to_toml()).expect("it is ours");
        let mut stage = default_stage();
        stage.care.home = [Side::Negative, Side::Positive, Side::Negative].map(|side| {
            let position_mm = match side {
                Side::Negative => -61.0,
                Side::Positive => 61.0,
            };
            Some(HomeSwitch { side, position_mm })
        });
        stage.care.home_speed_mm_s = [50.0, 2.0];
        rig.stage = Some(stage);
        std::fs::write(folder.path().join("home.toml"), rig.to_toml()).expect("it is ours");
        Self {
            folder,
            port: port.to_owned(),
        }
    }

    fn command(&self, words: &str) -> Command {
        let mut command = trinocular();
        command
            .args(words.split_whitespace())
            .args(["--port", &self.port])
            .current_dir(self.folder.path());
        command
    }

    fn run(&self, words: &str) -> Done {
        let done = self.command(words).output().expect("trinocular runs");
        let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
        Done {
            code: done.status.code(),
            out: text(done.stdout),
            err: text(done.stderr),
        }
    }

    fn start(&self, words: &str) -> Child {
        let mut command = self.command(words);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command.spawn().expect("trinocular runs")
    }

    fn status(&self) -> Value {
        self.run("status --json").json()
    }
}

/// Options of every run. The heartbeat timeout is long because the test machine may be too busy for
/// a heartbeat every 20 ms.
const CONFIGURE: &str = "--rig rig.toml --heartbeat 5000";

fn moving(end: &FarEnd) {
    let patience = Instant::now() + PATIENCE;
    while end.steps()[0] < 80 {
        assert!(Instant::now() < patience, "{:?}", end.steps());
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn day_with_a_station() {
    let end = station();
    let desk = Desk::new(&end.path);
    desk.run("status")
        .ended(0, &["far end on", "unconfigured", "next", "--rig"]);
    desk.run("jog x=1").ended(3, &["--rig RIG.toml", &end.path]);
    desk.run("zero").ended(3, &["--rig RIG.toml", &end.path]);
    assert_eq!(end.steps(), [0; 3]);

    let first = desk.run(&format!("jog x=1 Y=-0.5 {CONFIGURE}"));
    let first = first.ended(0, &["1.0000 -0.5000 0.0000 mm (80 -40 0 steps)", "unknown"]);
    assert!(first.err.contains("slowly"), "{}", first.err);
    assert_eq!(end.steps(), [80, -40, 0]);
    desk.run("status")
        .ended(0, &["80 -40 0 steps, unknown", "`zero`"]);

    desk.run("zero").ended(0, &["it was at 80 -40 0 steps"]);
    let status = desk.status();
    assert_eq!(status["state"], "idle");
    assert_eq!(status["trust"], "homed");
    assert_eq!(status["position_steps"], json!([0, 0, 0]));
    assert_eq!(status["next"], Value::Null);

    // The station keeps its configuration, but without the rig file only steps are known here.
    let jog = desk.run("jog z=2 --json").ended(0, &[]).json();
    assert_eq!(jog["moved_steps"], json!([0, 0, 160]));
    assert_eq!(jog["position_mm"], Value::Null);
    assert_eq!(end.steps(), [80, -40, 160]);
}

#[test]
fn stopped_station_names_next_step() {
    let end = station();
    let desk = Desk::new(&end.path);
    desk.run(&format!("zero {CONFIGURE}")).ended(0, &[]);
    desk.run("stop")
        .ended(0, &["stopped at 0 0 0 steps, position known"]);
    desk.run("jog x=1").ended(3, &["`trinocular reset`"]);
    desk.run("reset").ended(0, &["idle"]);
    desk.run("jog x=1").ended(0, &["80 0 0 steps, known"]);
    assert_eq!(end.steps(), [80, 0, 0]);
}

#[test]
fn invalid_arguments_fail_before_port_opens() {
    let desk = Desk::new("/dev/no-such-port");
    for (words, part) in [
        ("jog", "AXIS=MM"),
        ("jog w=1", "unknown axis `w`"),
        ("jog x", "x=1.5"),
        ("jog x=far", "`far` is not a number"),
        ("jog x=NaN", "-1000 to 1000"),
        ("jog x=1001", "-1000 to 1000"),
        ("jog x=101cm", "-1000 to 1000"),
        ("jog x=1,5", "with a decimal point"),
        ("jog x=80steps", "`steps` is no unit"),
        ("jog x=0.0001", "shorter than 0.001 mm"),
        ("jog x=1 X=2", "axis x is named twice"),
        ("jog x=1 --heartbeat 200", "--rig"),
        ("home w", "possible values: x, y, z"),
        ("diagnose --list", "cannot be used with"),
    ] {
        desk.run(words).ended(2, &[part]);
    }
    desk.run("jog x=1 --rig cameras.toml")
        .ended(1, &["cameras.toml", "[stage]"]);
    desk.run("zero --rig none.toml").ended(1, &["none.toml"]);
    for words in [
        "status", "jog x=1", "home", "zero", "stop", "reset", "diagnose",
    ] {
        let parts = ["/dev/no-such-port", "`trinocular ports` lists"];
        desk.run(words).ended(1, &parts);
    }
    let nobody = mute();
    Desk::new(&nobody.path).run("status").ended(
        3,
        &[
            "did not answer hello",
            &nobody.path,
            "flashed",
            "921600 baud",
        ],
    );
}

#[test]
fn last_crash_is_reported_with_command() {
    let end = station_after(
        ResetCause::Watchdog,
        LastRun {
            starts: 3,
            fault: Some(Fault::Limit),
            end: End::Panic,
            places: [0x0800_1234, 0x0800_5679, 0, 0, 0, 0],
        },
    );
    let desk = Desk::new(&end.path);
    let told = [
        "last start    watchdog",
        "starts        3 since power on",
        "its program panicked; fault 2 (limit) was latched",
        "addr2line -fie my.elf 0x8001234 0x8005676",
    ];
    desk.run("hello --elf my.elf").ended(0, &told);
    assert_eq!(
        desk.run("hello --json").json()["last_run"],
        json!({"starts": 3, "fault": 2, "end": "panic", "addresses": [0x0800_1234, 0x0800_5676]})
    );
    // Nothing moves until the fault is acknowledged, not even for a run that clears other faults.
    let status = desk.run("status").ended(3, &["fault 9"]);
    assert!(status.out.contains("panicked"), "{}", status.out);
    assert!(status.out.contains("`trinocular hello`"), "{}", status.out);
    for words in [
        format!("jog x=1 {CONFIGURE}"),
        format!("home {CONFIGURE} x"),
    ] {
        desk.run(&words).ended(3, &["a fault is latched"]);
    }
    desk.run("track --sim --seconds 1").ended(3, &["fault 9"]);
    assert_eq!(desk.status()["fault"]["name"], "restart");
    desk.run("reset").ended(0, &["cleared fault 9"]);
    desk.run(&format!("jog x=1 {CONFIGURE}")).ended(0, &["80"]);
    assert_eq!(end.steps(), [80, 0, 0]);
}

#[test]
fn diagnose_lists_states_and_faults() {
    let done = trinocular().arg("diagnose").output().expect("it runs");
    assert!(done.status.success());
    let text = String::from_utf8(done.stdout).expect("UTF-8");
    let list = trinocular().args(["diagnose", "--list"]).output();
    assert_eq!(list.expect("it runs").stdout, text.as_bytes());
    let document = include_str!("../FAULTS.md");
    let fenced = format!("```text\n{text}```\n");
    assert!(
        document.ends_with(&fenced),
        "FAULTS.md is not what `trinocular diagnose --list` prints:\n{text}"
    );
    for state in State::ALL {
        let name = format!("{state:?}").to_lowercase();
        assert!(
            text.contains(&format!("  {} {name} ", state.number())),
            "{text}"
        );
    }
    let positions = text.matches("position: ").count();
    assert_eq!(positions, Fault::ALL.len());
    for fault in Fault::ALL {
        assert!(text.contains(&format!("\n  {} ", fault.number())), "{text}");
    }
}

#[test]
#[ignore = "needs QEMU and a thumbv7em compiler; tests/run includes it"]
fn emulated_board_is_driven_by_hand() {
    let folder = tempfile::tempdir().expect("a folder");
    let trace = folder.path().join("trace");
    let (emulator, path) = Emulator::live(&trace);
    let desk = Desk::new(&path);
    desk.run(&format!("zero {CONFIGURE}")).ended(0, &[]);
    desk.run("jog x=2 y=-1")
        .ended(0, &["160 -80 0 steps, known"]);
    desk.run("jog z=0.5").ended(0, &["160 -80 40 steps, known"]);
    desk.run("stop").ended(0, &["stopped"]);
    desk.run("reset").ended(0, &["idle"]);
    // The trace is written every 100 ms; two seconds are many of those on any machine.
    std::thread::sleep(Duration::from_secs(2));
    drop(emulator);
    assert_eq!(pins(&trace).0, [160, -80, 40]);
}

#[test]
fn run_that_zeroes_says_so() {
    let end = station();
    let desk = Desk::new(&end.path);
    desk.run(&format!("zero {CONFIGURE}")).ended(0, &[]);
    desk.run(&format!("jog x=2 y=-1 {CONFIGURE}")).ended(0, &[]);
    let track = "track --sim --path still --seconds 0.1 --heartbeat 5000 --rig rig.toml";
    let done = desk.run(track);
    let said = "the present position is zero now; it was 2.0000 -1.0000 0.0000 mm (known)";
    assert!(done.err.contains(said), "{}", done.err);
    assert_eq!(done.code, Some(0), "{}", done.err);
}

#[test]
fn failed_stop_names_other_means() {
    let desk = Desk::new("/dev/no-such-port");
    let done = desk
        .run("stop")
        .ended(1, &["/dev/no-such-port", "plugged in"]);
    let other = "if the stage moves, press the emergency stop";
    assert!(done.err.contains(other), "{}", done.err);
}

#[test]
fn unplugged_port_is_named_at_once() {
    let end = station();
    let desk = Desk::new(&end.path);
    let mut jog = desk.start("jog x=50 --rig wide.toml --heartbeat 5000");
    let mut lines = BufReader::new(jog.stderr.take().expect("piped")).lines();
    let patience = Instant::now() + PATIENCE;
    while end.steps()[0] < 40 {
        assert!(Instant::now() < patience, "it does not move");
        std::thread::sleep(Duration::from_millis(5));
    }
    end.unplug();
    let mut said = Vec::new();
    for line in lines.by_ref().map_while(Result::ok) {
        said.push(line);
        if said
            .last()
            .is_some_and(|line| line.contains("trying for 10 s"))
        {
            break;
        }
    }
    // The program still waits for the port when it says so.
    let last = said.last().map_or("", String::as_str);
    assert!(last.contains("the port is gone"), "{said:?}");
    assert!(jog.try_wait().expect("it is ours").is_none());
    end.plug();
    let rest: Vec<String> = lines.map_while(Result::ok).collect();
    assert_eq!(jog.wait().expect("it ends").code(), Some(3), "{rest:?}");
    assert!(rest.join(" ").contains("the line was lost for"), "{rest:?}");
    let mut table = String::new();
    let out = jog.stdout.as_mut().expect("piped");
    out.read_to_string(&mut table).expect("text");
    let stood = end.standing();
    let place = format!("({} 0 0 steps)", stood[0]);
    assert!(table.contains(&place), "{place} is not in: {table}");
    assert!(stood[0] < 4_000, "{stood:?}");
}
