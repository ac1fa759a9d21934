//! Simulated cameras that the simulated station triggers, for every command that uses them.

use super::{HEARTBEAT, Twin, bench, state};
use serde_json::Value;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};
use trinocular_client::observer::StationObserver;
use trinocular_client::serial::Serial;
use trinocular_client::stage::default_stage;
use trinocular_rig::rig_file::{RigFile, Trigger};
use trinocular_tests::binary::{interrupt, signal, suspend, trinocular};

/// Writes the rig file of the bench, with triggers ten times per second and this exposure.
fn write_triggered(twin: &Twin, exposure_us: u32) {
    let mut rig = RigFile::paper();
    // Slow enough for ten images per second on the way, each at another place between two steps.
    let mut stage = default_stage();
    stage.max_speed_mm_s = [4.83; 3];
    rig.stage = Some(stage);
    rig.trigger = Some(Trigger {
        rate_hz: 10,
        pulse_us: 2_000,
        active_low: false,
        exposure_us,
        between_steps: false,
    });
    let path = twin.folder.path().join("triggered.toml");
    std::fs::write(path, rig.to_toml()).expect("it is ours");
}

/// Starts to track with cameras that the station triggers ten times per second.
fn track_triggered(twin: &Twin) -> Child {
    write_triggered(twin, 0);
    let words = format!(
        "track --cameras twin --rig triggered.toml --json --seconds 12 --port {} {}",
        twin.port,
        HEARTBEAT.join(" ")
    );
    let mut track = trinocular();
    let track = track
        .args(words.split_whitespace())
        .current_dir(twin.folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    track.spawn().expect("it runs")
}

/// Calls `at_row` with the number of each row until `track` ends well; returns what it printed.
/// Every time must be a trigger's: to the microsecond, which no comparison of clocks would give.
fn times_of_triggers(mut track: Child, mut at_row: impl FnMut(usize)) -> String {
    let rows = BufReader::new(track.stdout.take().expect("it is piped")).lines();
    let mut times_s = Vec::new();
    for (n, row) in rows.enumerate() {
        let row: Value = serde_json::from_str(&row.expect("UTF-8")).expect("JSON");
        times_s.push(row["time_s"].as_f64().expect("a number"));
        at_row(n);
    }
    let text = std::io::read_to_string(track.stderr.take().expect("it is piped")).expect("UTF-8");
    assert_eq!(track.wait().expect("it ends").code(), Some(0), "{text}");
    assert!(times_s.len() > 20, "{text}");
    for time_s in times_s {
        let periods = time_s * 10.0;
        assert!((periods - periods.round()).abs() < 2e-5, "{time_s}");
    }
    text
}

/// The station triggers the simulated cameras: every capture time is a trigger's, and an image that
/// is lost and one that comes twice are named.
#[test]
fn missed_and_doubled_images_are_named() {
    let mut twin = bench("line");
    let track = track_triggered(&twin);
    let text = times_of_triggers(track, |n| match n {
        5 => twin.order("miss"),
        15 => twin.order("double"),
        _ => {}
    });
    for part in [
        "camera 0: no image of trigger ",
        "camera 0: a second image of trigger ",
        " triggers missed, 1 images doubled",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let refused = twin.run(&format!(
        "track --cameras twin --rig triggered.toml --delay 4 {}",
        HEARTBEAT.join(" ")
    ));
    refused.failed(2, &["--delay", "[trigger]"]);
}

/// The time of the simulated station and its target stands still now and then, for up to some
/// periods, as on a busy computer. Images once had the time of a later trigger from then on, which
/// ended in a fault of unstable following.
#[test]
fn station_that_stands_still_is_followed() {
    let twin = bench("line");
    let track = track_triggered(&twin);
    times_of_triggers(track, |n| {
        if n % 6 == 3 {
            suspend(&twin.program);
            std::thread::sleep(Duration::from_millis([80, 130, 180, 270][n / 6 % 4]));
            signal(&twin.program, "CONT");
        }
    });
}

/// A page of triggered cameras, whose program ends with it.
struct Page {
    program: Child,
    address: String,
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

impl Page {
    fn open(twin: &Twin) -> Self {
        write_triggered(twin, 0);
        let words = format!(
            "serve --cameras twin --rig triggered.toml --listen 127.0.0.1:0 --port {}",
            twin.port
        );
        let mut program = trinocular()
            .args(words.split_whitespace())
            .current_dir(twin.folder.path())
            .stderr(Stdio::piped())
            .spawn()
            .expect("it runs");
        let lines = BufReader::new(program.stderr.take().expect("it is piped")).lines();
        let mut lines = lines.map_while(Result::ok);
        let mut said = Vec::new();
        let address = lines
            .by_ref()
            .inspect(|line| said.push(line.clone()))
            .find_map(|line| Some(line.split_once("http://")?.1.to_owned()));
        let address = address.unwrap_or_else(|| panic!("no page: {said:#?}"));
        // An unread pipe would block the program.
        std::thread::spawn(move || lines.for_each(drop));
        Self {
            program,
            address: address.trim_end_matches('/').to_owned(),
        }
    }

    fn turns(&self) -> u64 {
        state(&self.address)["turns"].as_u64().unwrap_or(0)
    }

    /// Waits until the state of the page is as wanted.
    #[track_caller]
    fn reach(&self, what: &str, wanted: impl Fn(&Value) -> bool) {
        let end = Instant::now() + Duration::from_secs(60);
        loop {
            let state = state(&self.address);
            if wanted(&state) {
                return;
            }
            assert!(Instant::now() < end, "{what}: {state}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits for a note with this text.
    #[track_caller]
    fn reach_note(&self, text: &str) {
        self.reach(text, |state| {
            let notes = state["notes"].as_array().into_iter().flatten();
            let mut texts = notes.filter_map(|note| note["text"].as_str());
            texts.any(|note| note.contains(text))
        });
    }

    /// Waits for this number of further frame sets.
    #[track_caller]
    fn reach_turns(&self, more: u64) {
        let before = self.turns();
        self.reach("images", |state| {
            state["turns"].as_u64() >= Some(before + more)
        });
    }
}

/// Count of what a station sends.
#[derive(Default)]
struct Counter {
    triggered: AtomicU64,
}

impl StationObserver for Counter {
    fn sent(&self, _: u64, _: &[u8]) {}

    fn received(&self, _: u64, bytes: &[u8]) {
        use trinocular_core::frame::message::Report;
        let (mut receiver, mut bytes) =
            (trinocular_core::frame::receive::Receiver::default(), bytes);
        while let Some(report) = receiver.next(&mut bytes) {
            if matches!(report, Ok(Report::Triggered(_))) {
                self.triggered.fetch_add(1, Relaxed);
            }
        }
    }
}

/// Returns true if the station triggers the cameras while it sends ten status reports.
fn is_triggering(twin: &Twin) -> bool {
    let counter = Arc::new(Counter::default());
    let observer = Arc::clone(&counter) as Arc<dyn StationObserver>;
    let serial = Serial::connect_observed(&twin.port, Some(observer)).expect("it answers");
    let mut seen = std::collections::BTreeSet::new();
    let end = Instant::now() + Duration::from_secs(60);
    while seen.len() < 10 {
        assert!(Instant::now() < end, "the station reports its status");
        seen.extend(serial.status().map(|status| status.time.micros()));
        std::thread::sleep(Duration::from_millis(5));
    }
    counter.triggered.load(Relaxed) > 0
}

/// A page that only shows has the images of the triggers, names and counts what is wrong with them,
/// starts triggers that ended with a restart of the station again, and ends them.
#[test]
fn page_shows_triggered_images() {
    let mut twin = bench("still");
    let mut page = Page::open(&twin);
    page.reach_note("it triggers the cameras 10 times per second");
    page.reach_turns(5);
    twin.order("miss");
    page.reach_note("camera 0: no image of trigger ");
    twin.order("double");
    page.reach_note("camera 0: a second image of trigger ");
    for reason in ["missed triggers", "second of a trigger"] {
        page.reach(reason, |state| {
            state["drops"][0][reason].as_u64() >= Some(1)
        });
    }
    page.reach_turns(5);
    twin.order("restart");
    page.reach_note("they were started again");
    page.reach_turns(5);
    interrupt(&page.program);
    assert_eq!(page.program.wait().expect("it ends").code(), Some(0));
    assert!(!is_triggering(&twin), "the page is gone");
}

/// A line that is lost for longer than the wait for images, and back, ends no page: the station
/// triggers on, and the images go on.
#[test]
fn page_survives_a_lost_line() {
    let mut twin = bench("still");
    let page = Page::open(&twin);
    page.reach_turns(5);
    twin.order("unplug");
    std::thread::sleep(Duration::from_millis(4_000));
    twin.order("plug");
    page.reach_note("the line was lost");
    page.reach_turns(10);
    drop(page);
    assert!(
        is_triggering(&twin),
        "a page that was killed ends no triggers"
    );
}

/// The middle of the exposure is found on however busy a computer, because the trigger's instant and
/// the stage's path are on the station's clock.
#[test]
fn triggers_time_the_exposure() {
    let twin = bench("still");
    let heartbeat = HEARTBEAT.join(" ");
    write_triggered(&twin, 4_000);
    twin.good(&format!("zero --rig triggered.toml {heartbeat}"));
    let words = format!("calibrate-stage --cameras twin --rig triggered.toml --json {heartbeat}");
    let done = twin.run(&words);
    let found = &done.good_json()[0];
    let middle_ms = found["trigger"]["middle_ms"].as_f64().expect("a number");
    let sigma_ms = found["delay"]["sigma_ms"].as_f64().expect("a number");
    assert!(middle_ms.abs() < 0.3 + 4.0 * sigma_ms, "{found}");
    assert_eq!(found["trigger"]["file_ms"].as_f64(), Some(2.0));
    // The simulated cameras expose at the trigger.
    let warned = "half of `exposure_us` in [trigger] is 2.00 ms: write exposure_us = ";
    assert!(done.stderr.contains(warned), "{}", done.stderr);
    assert!(!is_triggering(&twin), "the command has ended");
}

/// A program that only watches cannot trigger through the one that has the port.
#[test]
fn page_beside_another_is_refused() {
    let twin = bench("still");
    let _page = Page::open(&twin);
    let words = "serve --cameras twin --rig triggered.toml --listen 127.0.0.1:0";
    twin.run(words).failed(2, &["has the port", "--control"]);
}

#[test]
fn delays_of_triggered_cameras_are_refused() {
    let twin = bench("still");
    write_triggered(&twin, 0);
    let latency = twin.run("latency --cameras twin --rig triggered.toml");
    latency.failed(1, &["triggered.toml", "[trigger]", "no delay to measure"]);
    let serve =
        twin.run("serve --cameras twin --rig triggered.toml --delay 4 --listen 127.0.0.1:0");
    serve.failed(2, &["--delay", "[trigger]"]);
}
