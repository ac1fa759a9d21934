//! Recordings that a page starts and ends while the run goes on.

use super::peer::Peer;
use serde_json::{Value, json};
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use trinocular_tests::binary::{Outcome, trinocular};

/// `trinocular serve --control`, which ends with this value.
struct Served(Child);

impl Served {
    /// Starts the program; returns it with a page that may control the run.
    fn start(arguments: &[&str]) -> (Self, Peer) {
        let mut child = trinocular()
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
fn folder_that_is_missing_is_named_on_the_page() {
    let (_served, mut page) = Served::start(&["--recordings", "/nowhere/recordings"]);
    assert_eq!(page.ask(&json!({"record": {"on": true}})), None);
    let is_named = |state: &Value| state["notes"].to_string().contains("/nowhere/recordings");
    let state = page.state(is_named);
    assert!(state["recording"].is_null());
}
