//! `trinocular simulate` as a user meets it.

use super::folder;
use serde_json::Value;
use std::fs;
use trinocular_tests::binary::{Outcome, trinocular};

fn simulate(arguments: &[&str]) -> Outcome {
    let mut command = trinocular();
    command.arg("simulate").args(arguments);
    Outcome::of(command.current_dir(folder()))
}

/// A folder with one scenario file.
struct Desk(tempfile::TempDir);

impl Desk {
    fn with(text: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        fs::write(folder.path().join("it.toml"), text).expect("written");
        Self(folder)
    }

    fn path(&self, name: &str) -> String {
        let path = self.0.path().join(name);
        path.to_str().expect("a plain path").to_owned()
    }
}

/// Returns the text of a scenario with one thing changed.
fn changed(name: &str, from: &str, to: &str) -> String {
    let text = fs::read_to_string(folder().join(name)).expect("a scenario");
    assert!(text.contains(from), "{name} has no {from:?}");
    text.replacen(from, to, 1)
}

#[test]
fn json_has_every_figure() {
    let outcome = simulate(&["step.toml", "switches.toml", "--points", "--json"]);
    let [step, switches] = outcome.good_json().try_into().expect("two lines");
    let keys = "scenario rms_mm max_mm settle_ms latency_ms steps lost faults states sights \
                rms_3d_mm lag_mm overshoot jitter_mm reversals_per_s speed_mm_s \
                acceleration_mm_s2 frames silences refused_commands missed";
    for key in keys.split_whitespace() {
        assert!(step.get(key).is_some(), "`{key}` is missing: {step}");
    }
    assert_eq!(step["scenario"], "step");
    assert_eq!(step["lost"], 0);
    assert!(step["settle_ms"].as_f64().expect("it settles") < 250.0);
    assert!(step["latency_ms"]["p50"].as_f64() <= step["latency_ms"]["p99"].as_f64());
    assert_eq!(step["missed"], Value::Array(Vec::new()));
    assert_eq!(switches["settle_ms"], Value::Null);
    assert_eq!(
        switches["faults"],
        serde_json::json!(["limit", "emergency_stop"])
    );
    assert_eq!(outcome.stderr, "");
}

#[test]
fn missed_expectation_exits_1() {
    let desk = Desk::with(&changed(
        "step.toml",
        "settle_ms = 250.0",
        "settle_ms = 5.0",
    ));
    let outcome = simulate(&[&desk.path("it.toml"), "--points"]);
    outcome.failed_after_notes(1, &["it.toml: missed: settle_ms is ", "above 5.0000"]);
    assert!(outcome.stdout.contains("1 missed"), "{}", outcome.stdout);
    // Without prediction no bound is judged.
    let outcome = simulate(&[&desk.path("it.toml"), "--points", "--no-prediction"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
}

#[test]
fn report_is_page_with_plots() {
    let desk = Desk::with("");
    let page = desk.path("page.html");
    let outcome = simulate(&["heartbeat.toml", "--report", &page]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let html = fs::read_to_string(page).expect("the page");
    for part in [
        "Error X, stage - target",
        "Velocity of the stage",
        "silence at 0.7 s",
        "as expected",
    ] {
        assert!(html.contains(part), "{part}");
    }
    assert!(html.matches("<svg").count() >= 5);
}

/// Bad files end with 1 before any run, with a message that names file, line and field.
#[test]
fn bad_files_are_refused_by_name() {
    for (from, to, parts) in [
        (
            "seed = 1",
            "sed = 1",
            &["it.toml:3:", "`sed`", "unknown field"][..],
        ),
        (
            "peak_mm_s = 20.0\n",
            "",
            &["it.toml:", "`target[0].peak_mm_s`", "missing"],
        ),
        (
            "what = \"occlusion\"",
            "what = \"sunset\"",
            &["`event[0].what`", "unknown event `sunset`", "occlusion"],
        ),
        (
            "at_s = 3.0",
            "at_s = 30.0",
            &["`event[0].at_s`", "30 is out of range"],
        ),
        (
            "seconds = 0.5",
            "seconds = -0.5",
            &["`event[0].seconds`", "greater than 0"],
        ),
        (
            "noise_grey = 2.0",
            "noise_grey = nan",
            &["`cameras.noise_grey`", "finite"],
        ),
        (
            "kind = \"rendered\"",
            "kind = \"points\"",
            &["`cameras.noise_grey`", "unknown field", "noise_px"],
        ),
        (
            "rms_mm = [0.10,",
            "rms_mm = [0.10, 0.10,",
            &["`expect.rms_mm`", "expected 3 elements, found 4"],
        ),
        (
            "[expect]",
            "[expect]\nfaults = [\"tired\"]",
            &[
                "`expect.faults[0]`",
                "unknown word `tired`; known here: heartbeat",
            ],
        ),
        (
            "from_s = 4.0",
            "from_s = 6.0",
            &["`measure`", "from_s must be before"],
        ),
        ("seed = 1", "seed = ", &["it.toml:3:", "not valid TOML"]),
    ] {
        let desk = Desk::with(&changed("occlusion.toml", from, to));
        simulate(&["step.toml", &desk.path("it.toml"), "--points"]).failed(1, parts);
    }
    simulate(&["nowhere.toml"]).failed(1, &["nowhere.toml", "cannot read"]);
}
