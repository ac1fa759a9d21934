//! Recordings that a page starts and ends while the run goes on.

use super::peer::Peer;
use super::rig_with_default_stage;
use serde_json::{Value, json};
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use trinocular_tests::binary::{Outcome, trinocular};
use trinocular_tests::far_end::station;

/// `trinocular serve --control`, which ends with this value.
struct Served(Child);

impl Served {
    /// Starts the program; returns it with a page that may control the run.
    fn start(arguments: &[&str]) -> (Self, Peer) {
        Self::start_as(trinocular(), arguments)
    }

    /// Starts the program, which may write files of at most `bytes`.
    #[cfg(target_os = "linux")]
    fn start_limited(arguments: &[&str], bytes: u64) -> (Self, Peer) {
        let program = trinocular();
        let mut limited = std::process::Command::new("prlimit");
        limited
            .arg(format!("--fsize={bytes}"))
            .arg(program.get_program());
        Self::start_as(limited, arguments)
    }

    fn start_as(mut program: std::process::Command, arguments: &[&str]) -> (Self, Peer) {
        let mut child = program
            .args(["serve", "--listen", "127.0.0.1:0", "--control"])
            .args(arguments)
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let stderr = child.stderr.take().expect("a pipe");
        let served = Self(child);
        let mut lines = BufReader::new(stderr).lines().map_while(Result::ok);
        let link = lines.find_map(|line| Some(line.split_once("http://")?.1.to_owned()));
        let address = link.expect("the page's address");
        let address = address.trim_end_matches('/').parse().expect("an address");
        let link = lines.find_map(|line| Some(line.split_once("#control=")?.1.to_owned()));
        let token = link.expect("the control link");
        // The pipe stays open and is read, so that the program never waits for it.
        std::thread::spawn(move || lines.for_each(drop));
        let mut page = Peer::open(address);
        page.exchange(&token).expect("the link is new");
        (served, page)
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Returns the recordings in a folder.
fn recordings(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("the folder is there");
    entries
        .map(|entry| entry.expect("an entry").path())
        .collect()
}

/// Records until 10 more frame sets were measured.
fn record(page: &mut Peer) -> Value {
    assert_eq!(page.ask(&json!({"record": {"on": true}})), None);
    let begun = page.state(|state| state["recording"].is_string());
    let turns = |state: &Value| state["turns"].as_u64().unwrap_or(0);
    page.state(|state| turns(state) > turns(&begun) + 10);
    assert_eq!(page.ask(&json!({"mark": {"text": "lamp off"}})), None);
    page.state(|state| state["notes"].to_string().contains("lamp off"));
    assert_eq!(page.ask(&json!({"record": {"on": false}})), None);
    page.state(|state| state["recording"].is_null());
    begun
}

#[test]
fn recording_of_the_page_replays() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let place = folder.path().to_str().expect("a name in UTF-8");
    let (served, mut page) = Served::start(&["--recordings", place]);
    // It follows already: the recording begins with the images of the keyframe.
    page.state(|state| state["station"]["state"] == "following");
    let begun = record(&mut page);
    let files = recordings(folder.path());
    assert_eq!(files.len(), 1, "{files:?}");
    assert_eq!(begun["recording"], json!(files[0].to_str()));
    drop(served);
    let bytes = std::fs::read(&files[0]).expect("the recording is there");
    assert!(bytes.windows(8).any(|part| part == b"lamp off"));
    let replay = Outcome::of(trinocular().arg("replay").arg(&files[0]).arg("--json"));
    let summary = &replay.good_json()[0];
    assert_eq!(summary["same"], true, "{summary}");
    assert!(
        summary["measurements"]["same"].as_u64() >= Some(10),
        "{summary}"
    );
    assert_eq!(summary["not_measured"], 0, "{summary}");
}

#[test]
fn second_recording_is_a_new_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let place = folder.path().to_str().expect("a name in UTF-8");
    let (_served, mut page) = Served::start(&["--recordings", place]);
    page.state(|state| state["station"]["state"] == "following");
    let first = record(&mut page);
    // Names differ by the second.
    std::thread::sleep(std::time::Duration::from_millis(1_100));
    let second = record(&mut page);
    assert_ne!(first["recording"], second["recording"]);
    assert_eq!(recordings(folder.path()).len(), 2);
}

#[test]
fn folder_that_is_missing_is_named_at_once() {
    let arguments = ["serve", "--control", "--recordings", "/nowhere/recordings"];
    let outcome = Outcome::of(trinocular().args(arguments));
    outcome.failed(1, &["/nowhere/recordings", "is no folder"]);
}

#[test]
fn removed_recording_is_no_success() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let place = folder.path().join("runs");
    std::fs::create_dir(&place).expect("a new folder");
    let words = ["--recordings", place.to_str().expect("a name in UTF-8")];
    let (mut served, mut page) = Served::start(&[&words[..], &["--seconds", "8"]].concat());
    assert_eq!(page.ask(&json!({"record": {"on": true}})), None);
    page.state(|state| state["recording"].is_string());
    std::fs::remove_dir_all(&place).expect("ours");
    assert_eq!(page.ask(&json!({"record": {"on": false}})), None);
    page.state(|state| {
        state["notes"]
            .to_string()
            .contains("was removed or renamed")
    });
    drop(page);
    assert_eq!(served.0.wait().expect("it ends").code(), Some(1));
}

#[test]
#[cfg(target_os = "linux")]
fn failed_write_ends_recording_on_page() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let place = folder.path().to_str().expect("a name in UTF-8");
    let words = ["--recordings", place, "--seconds", "12"];
    let (mut served, mut page) = Served::start_limited(&words, 8_000_000);
    page.state(|state| state["station"]["state"] == "following");
    assert_eq!(page.ask(&json!({"record": {"on": true}})), None);
    page.state(|state| state["recording"].is_string());
    let warned = |state: &Value| state["notes"].to_string().contains("cannot write");
    page.state(|state| state["recording"].is_null() && warned(state));
    drop(page);
    assert_eq!(served.0.wait().expect("it ends").code(), Some(1));
}

/// Commands of the page and of other programs stand in the recording.
#[test]
fn deeds_stand_in_the_recording() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let place = folder.path().to_str().expect("a name in UTF-8");
    let end = station();
    let other = tempfile::tempdir().expect("a temporary folder");
    let rig = rig_with_default_stage(other.path());
    let rig = rig.to_str().expect("a name in UTF-8");
    let arguments = ["--port", &end.path, "--recordings", place, "--rig", rig];
    let (served, mut page) = Served::start(&arguments);
    page.state(|state| state["station"]["state"] == "idle");
    assert_eq!(page.ask(&json!({"record": {"on": true}})), None);
    page.state(|state| state["recording"].is_string());
    assert_eq!(page.ask(&json!({"zero": {}})), None);
    for order in [&["motors", "off"][..], &["motors", "on"], &["stop"]] {
        let done = Outcome::of(trinocular().args(order).args(["--port", &end.path]));
        assert_eq!(done.code, Some(0), "{}", done.stderr);
    }
    page.state(|state| state["notes"].to_string().contains("stopped by"));
    assert_eq!(page.ask(&json!({"reset": {}})), None);
    assert_eq!(page.ask(&json!({"record": {"on": false}})), None);
    page.state(|state| state["recording"].is_null());
    drop(served);
    let files = recordings(folder.path());
    let bytes = std::fs::read(&files[0]).expect("the recording is there");
    let text = String::from_utf8_lossy(&bytes);
    for part in [
        "zero: the position became 0 0 0 mm, by the live page",
        "motors off, by `",
        "motors on, by `",
        " motors on --port ",
        "stopped by `",
        "reset, by the live page",
    ] {
        assert!(text.contains(part), "`{part}` is not in the recording");
    }
}
