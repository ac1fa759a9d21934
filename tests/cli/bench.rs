//! `bench flow`: its output. No test judges the durations themselves, which depend on the machine.

use std::path::Path;

use serde_json::Value;
use trinocular_tests::binary::Outcome;

use super::folder::{AT_REST, desk_with_views};
use super::run;

const STAGES: [&str; 6] = [
    "filter",
    "corners",
    "spatial",
    "search",
    "temporal",
    "consensus",
];

/// Returns the only JSON object printed, after checking its keys and the order of its times.
#[track_caller]
fn report(outcome: &Outcome) -> Value {
    let lines = outcome.good_json();
    assert_eq!(lines.len(), 1, "{}", outcome.stdout);
    for spread in ["frame_set_ms", "keyframe_ms"] {
        let [median, least] = ["median", "min"].map(|key| lines[0][spread][key].as_f64());
        assert!(
            least > Some(0.0) && median >= least,
            "{spread}: {}",
            lines[0]
        );
    }
    let stages = lines[0]["stages_ms"].as_object().expect("an object");
    for stage in STAGES {
        let median = stages.get(stage).and_then(Value::as_f64);
        assert!(median >= Some(0.0), "{stage}: {}", lines[0]);
    }
    assert_eq!(stages.len(), STAGES.len(), "{stages:?}");
    assert!(lines[0]["points"].as_u64() >= Some(8), "{}", lines[0]);
    lines[0].clone()
}

#[test]
fn folder_is_timed_as_often_as_asked() {
    let desk = desk_with_views(&[AT_REST, Some([2.0, -1.0, 0.0]), Some([4.0, 4.0, 1.0])]);
    let bench = |more: &[&str]| {
        let mut arguments = vec!["bench", "flow", "views"];
        arguments.extend(more);
        run(desk.folder.path(), &arguments)
    };
    let with_rig = ["--rig", "rig.toml", "--json", "--repeat", "2"];
    let one = report(&bench(&with_rig));
    // Each pass measures the second and the third of the three frame sets.
    assert_eq!(one["frame_sets"], 4, "{one}");
    assert_eq!(one["captures"], 3);
    assert_eq!(one["threads"], 1);
    assert_eq!(one["refused"], 0);
    // Threads share the work without changing the result.
    let two = report(&bench(&[&with_rig[..], &["--threads", "2"]].concat()));
    assert_eq!(two["threads"], 2);
    assert_eq!(two["points"], one["points"]);
    let fewer = report(&bench(&[&with_rig[..], &["--corners", "50"]].concat()));
    assert_eq!(fewer["corners"], 50);
    assert!(
        fewer["points"].as_u64() < one["points"].as_u64(),
        "{fewer} {one}"
    );

    let table = bench(&["--rig", "rig.toml", "--repeat", "1"]);
    assert_eq!(table.code, Some(0), "{}", table.stderr);
    for part in ["frame set", "keyframe", "spatial", "points"] {
        assert!(table.stdout.contains(part), "{}", table.stdout);
    }
}

#[test]
fn photographs_are_timed_with_rig() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let rig = "images/teddy/rig.toml";
    let mut bench = vec!["bench", "flow", "images/teddy", "--repeat", "1", "--json"];
    // Without the rig file, the message asks for it.
    let outcome = run(root, &bench);
    assert_eq!(outcome.code, Some(2), "{}", outcome.stderr);
    assert!(
        outcome.stderr.contains("--rig <RIG.toml>"),
        "{}",
        outcome.stderr
    );
    bench.extend(["--rig", rig]);
    report(&run(root, &bench));
}

#[test]
fn unusable_input_is_refused() {
    let desk = desk_with_views(&[None]);
    let bench = |words: &[&str]| run(desk.folder.path(), words);
    bench(&["bench", "flow", "nowhere", "--rig", "rig.toml", "--json"])
        .failed(1, &["nowhere", "no such folder"]);
    let blank = ["bench", "flow", "views", "--rig", "rig.toml"];
    bench(&blank).failed(1, &["views", "texture"]);
    for misused in [
        &["bench"][..],
        &["bench", "flow"],
        &["bench", "pose", "--trials", "0"],
        &[
            "bench", "flow", "views", "--rig", "rig.toml", "--repeat", "0",
        ],
        &[
            "bench",
            "flow",
            "views",
            "--rig",
            "rig.toml",
            "--threads",
            "0",
        ],
    ] {
        assert_eq!(bench(misused).code, Some(2), "{misused:?}");
    }
}

#[test]
fn folder_beyond_memory_is_refused() {
    let desk = super::Desk::new();
    let line = desk.change("rig.toml", "[320, 240]", "[8000, 6000]");
    assert_eq!(line, 1);
    // The focal lengths must fit the size.
    let text = desk.read("rig.toml");
    let lines = text.lines().map(|line| match line.starts_with("focal_px") {
        true => "focal_px = [9000.0, 9000.0]",
        false => line,
    });
    desk.write("rig.toml", lines.collect::<Vec<_>>().join("\n"));
    for camera in ["left", "middle", "right"] {
        std::fs::create_dir_all(desk.path("views").join(camera)).expect("ours");
        for number in 0..8 {
            desk.write(&format!("views/{camera}/{number}.png"), "");
        }
    }
    let arguments = ["bench", "flow", "views", "--rig", "rig.toml"];
    let outcome = run(desk.folder.path(), &arguments);
    outcome.failed(
        1,
        &["views", "8 frame sets", "1024 MB", "7 frame sets or fewer"],
    );
}

#[test]
fn pose_table_repeats_and_ends_with_ranges() {
    let desk = super::Desk::new();
    let bench = || run(desk.folder.path(), &["bench", "pose", "--trials", "50"]);
    let outcome = bench();
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert_eq!(outcome.stdout, bench().stdout);
    for part in [
        "poster",
        "relief",
        "wide",
        "Kabsch: displacement",
        "times the bound",
    ] {
        assert!(outcome.stdout.contains(part), "{}", outcome.stdout);
    }
}
