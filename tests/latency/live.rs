//! Real time. A busy computer holds up the simulated station: the command may then refuse, but never
//! give a wrong delay.

use super::{LIMIT_MS, desk, number, run, written_ms};
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Stdio};
use std::time::Duration;
use tempfile::TempDir;
use trinocular_client::stage::default_stage;
use trinocular_rig::rig_file::RigFile;
use trinocular_tests::binary::{Outcome, signal, suspend, trinocular};

/// A heartbeat timeout that a busy test machine does not exceed.
const HEARTBEAT: &str = "--heartbeat 5000";

/// Runs until one is not disturbed.
const TRIES: usize = 20;

/// True delays of the twin's cameras, ms.
const TRUTH_MS: [f64; 3] = [-6.0, 0.0, 21.0];

/// A running `trinocular twin` with cameras.
struct Twin {
    program: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    port: String,
}

impl Drop for Twin {
    fn drop(&mut self) {
        // It has ended already, if the test did that.
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

impl Twin {
    fn start(desk: &TempDir, link: &str, words: &str) -> Self {
        let port = desk.path().join(link).display().to_string();
        let mut program = trinocular();
        program
            .args(["twin", "--with-target", "--fps", "60", "--link", &port])
            .args(words.split_whitespace())
            .current_dir(desk.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut program = program.spawn().expect("trinocular runs");
        let mut output = BufReader::new(program.stdout.take().expect("it is piped"));
        let mut line = String::new();
        output.read_line(&mut line).expect("it says where it is");
        let twin = Self {
            input: program.stdin.take().expect("it is piped"),
            output,
            program,
            port,
        };
        let zero = format!("zero --rig rig.toml {HEARTBEAT} --port {}", twin.port);
        let zero = run(desk.path(), &zero);
        assert_eq!(zero.code, Some(0), "{}", zero.stderr);
        twin
    }

    /// Returns the words that measure its cameras.
    fn latency(&self) -> String {
        let Self { port, .. } = self;
        format!("latency --rig rig.toml --port {port} --cameras twin:{port} {HEARTBEAT}")
    }

    /// Returns true if the stage is away from zero.
    fn is_away(&mut self) -> bool {
        writeln!(self.input, "where").expect("it reads");
        let mut line = String::new();
        self.output.read_line(&mut line).expect("it speaks UTF-8");
        !line.starts_with("stage at 0.0000 0.0000 0.0000")
    }
}

/// Runs the words until the station's clock has not jumped meanwhile, as it does on a busy computer.
fn undisturbed(desk: &TempDir, words: &str) -> Outcome {
    let mut runs = (0..TRIES).map(|_| run(desk.path(), words));
    let undisturbed = runs.find(|done| !done.stderr.contains("clock jumped"));
    undisturbed.expect("a run without a jump of the clock")
}

/// Checks a run that a busy computer may have disturbed: true delays, or a refusal. Returns true for
/// delays.
#[track_caller]
fn is_right_or_refused(done: &Outcome) -> bool {
    if done.code != Some(0) {
        assert!(matches!(done.code, Some(1 | 3)), "{done:?}");
        assert_eq!(done.stdout, "");
        assert!(done.stderr.contains("error: "), "{}", done.stderr);
        return false;
    }
    let found = &done.json()[0];
    let cameras = found["cameras"].as_array().expect("cameras");
    assert_eq!(cameras.len(), TRUTH_MS.len());
    for (camera, truth_ms) in cameras.iter().zip(TRUTH_MS) {
        let off_ms = number(camera, "delay_ms") - truth_ms;
        let sigma_ms = number(camera, "sigma_ms");
        println!("{truth_ms} ms: off by {off_ms:.3} ± {sigma_ms:.3} ms");
        assert!(off_ms.abs() < LIMIT_MS + 4.0 * sigma_ms, "{found}");
    }
    true
}

#[test]
fn delays_of_live_cameras_are_written() {
    let desk = desk();
    let delays = TRUTH_MS.map(|ms| ms.to_string()).join(",");
    let options = format!("--path still --rig rig.toml --camera-delay={delays}");
    let twin = Twin::start(&desk, "station", &options);
    let words = format!("{} --fps 60 --json --out new.toml", twin.latency());
    let new = desk.path().join("new.toml");
    let mut refusals = Vec::new();
    let found = (0..TRIES).find_map(|_| {
        let done = run(desk.path(), &words);
        if is_right_or_refused(&done) {
            return Some(done);
        }
        assert!(!new.exists(), "a refusal writes no file");
        refusals.push(done.stderr);
        None
    });
    let found = found.unwrap_or_else(|| panic!("{TRIES} refusals: {refusals:#?}"));
    let found = &found.json()[0];
    let written = written_ms(&new);
    assert_eq!(written.len(), 3);
    for (index, delay_ms) in written.into_iter().enumerate() {
        let measured_ms = number(&found["cameras"][index], "delay_ms");
        let delay_ms = delay_ms.expect("a delay");
        assert!(
            (delay_ms - measured_ms).abs() < 0.0051,
            "{delay_ms} and {measured_ms}"
        );
    }
    let text = std::fs::read_to_string(&new).expect("it is there");
    assert!(text.starts_with("# our bench\n"), "{text}");
}

/// The station's clock stands still while the twin is suspended.
#[test]
fn suspended_twin_gives_no_wrong_delay() {
    let desk = desk();
    let delays = TRUTH_MS.map(|ms| ms.to_string()).join(",");
    let options = format!("--path still --rig rig.toml --camera-delay={delays}");
    let mut twin = Twin::start(&desk, "station", &options);
    let mut latency = trinocular();
    latency
        .args(format!("{} --fps 60 --json", twin.latency()).split_whitespace())
        .current_dir(desk.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut latency = latency.spawn().expect("it runs");
    while !twin.is_away() {
        let ended = latency.try_wait().expect("it is ours");
        assert!(ended.is_none(), "it ended before the stage moved");
        std::thread::sleep(Duration::from_millis(20));
    }
    for _ in 0..2 {
        suspend(&twin.program);
        std::thread::sleep(Duration::from_millis(700));
        signal(&twin.program, "CONT");
        std::thread::sleep(Duration::from_millis(900));
    }
    let done = latency.wait_with_output().expect("it ends");
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    let done = Outcome {
        code: done.status.code(),
        stdout: text(done.stdout),
        stderr: text(done.stderr),
    };
    println!("{}", done.stderr);
    is_right_or_refused(&done);
}

#[test]
fn moving_target_is_refused() {
    let desk = desk();
    let twin = Twin::start(&desk, "station", "--path circle --rig rig.toml");
    let done = undisturbed(&desk, &twin.latency());
    assert_eq!(done.code, Some(1), "{}", done.stderr);
    assert_eq!(done.stdout, "");
    assert!(done.stderr.contains("target at rest"), "{}", done.stderr);
}

/// The cameras are those of another bench, whose stage does not move.
#[test]
fn cameras_of_another_stage_are_refused() {
    let desk = desk();
    let twin = Twin::start(&desk, "station", "--path still --rig rig.toml");
    let other = Twin::start(&desk, "other", "--path still --rig rig.toml");
    let words = twin.latency();
    let words = words.replace(
        &format!("twin:{}", twin.port),
        &format!("twin:{}", other.port),
    );
    let done = undisturbed(&desk, &words);
    assert_eq!(done.code, Some(1), "{}", done.stderr);
    assert!(
        done.stderr.contains("is it the camera on the stage"),
        "{}",
        done.stderr
    );
}

/// The twin's cameras stand in another order than the rig file says.
#[test]
fn exchanged_cameras_are_refused() {
    let desk = desk();
    let mut rig = RigFile::paper();
    rig.stage = Some(default_stage());
    rig.names = ["a", "b", "c"].map(String::from).to_vec();
    std::fs::write(desk.path().join("rig.toml"), rig.to_toml()).expect("it is ours");
    let (first, last) = (rig.rig.cameras[0], rig.rig.cameras[2]);
    (rig.rig.cameras[0], rig.rig.cameras[2]) = (last, first);
    std::fs::write(desk.path().join("swapped.toml"), rig.to_toml()).expect("it is ours");
    let mut twin = Twin::start(&desk, "station", "--path still --rig swapped.toml");
    let done = run(desk.path(), &twin.latency());
    assert_eq!(done.code, Some(1), "{}", done.stderr);
    assert!(
        done.stderr.contains("`a` and `c` exchanged"),
        "{}",
        done.stderr
    );
    assert!(!twin.is_away(), "the stage has not moved");
}
