//! The paper's experiments as a user runs them: Tables 1, 2, 5 and 6 from the program's own output.

use serde_json::Value;
use std::process::Output;
use trinocular_client::stage::default_stage;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_tests::binary::trinocular;

fn run(arguments: &[&str]) -> Output {
    trinocular()
        .args(arguments)
        .output()
        .expect("the program starts")
}

fn vector(value: &Value) -> [f64; 3] {
    std::array::from_fn(|i| {
        value[i]
            .as_f64()
            .unwrap_or_else(|| panic!("not a vector: {value}"))
    })
}

fn off(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| (a[i] - b[i]).abs())
}

fn within(off: [f64; 3], bound: [f64; 3]) -> bool {
    off.iter().zip(bound).all(|(o, b)| *o <= b)
}

/// The whole path must reach these figures, read from `tables --json`.
#[test]
fn tables_reach_their_figures() {
    let output = run(&["tables", "--json"]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let tables: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    let rows = |name: &str| {
        tables[name]
            .as_array()
            .unwrap_or_else(|| panic!("no {name}"))
            .clone()
    };
    assert_eq!(
        ["table1", "table2", "table5", "table6"].map(|t| rows(t).len()),
        [11, 2, 8, 5]
    );
    for row in rows("table1").iter().chain(&rows("table2")) {
        let (truth, paper) = (vector(&row["true"]), vector(&row["paper"]));
        assert!(
            within(off(vector(&row["closed_form"]), paper), [0.01; 3]),
            "{row}"
        );
        assert!(
            within(off(vector(&row["midpoint"]), truth), [0.001; 3]),
            "{row}"
        );
        assert!(
            within(vector(&row["midpoint_worst_error"]), [0.001; 3]),
            "{row}"
        );
        assert!(
            within(
                off(vector(&row["least_squares"]), vector(&row["closed_form"])),
                [1e-6; 3]
            ),
            "{row}"
        );
    }
    for row in rows("table5") {
        assert!(
            within(
                off(vector(&row["midpoint"]), vector(&row["true"])),
                [0.02, 0.02, 0.05]
            ),
            "{row}"
        );
    }
    for row in rows("table6") {
        assert!(
            within(
                off(vector(&row["tracked"]), vector(&row["true"])),
                [0.02, 0.02, 0.05]
            ),
            "{row}"
        );
    }
    for row in tables["cramer_rao"]["rows"].as_array().unwrap() {
        let (bound, error) = (vector(&row["bound_mm"]), vector(&row["error_mm"][2]));
        assert!((0..3).all(|i| error[i] <= 1.10 * bound[i]), "{row}");
    }
    let settings = &tables["settings"];
    assert_eq!(settings["pulses_commanded"], settings["pulses_counted"]);
}

#[test]
fn no_command_tracks_and_writes_report() {
    let folder = tempfile::tempdir().unwrap();
    let (page, figure) = (
        folder.path().join("run.html"),
        folder.path().join("path.svg"),
    );
    let output = run(&[
        "--report",
        page.to_str().unwrap(),
        "--figure",
        figure.to_str().unwrap(),
    ]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}");
    assert!(
        text.contains("Table 6")
            && text.contains("4.1351")
            && text.contains("equal")
            && !text.contains("NOT EQUAL"),
        "{text}"
    );
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.contains("Fig. 7") && html.contains("Fig. 8") && html.contains("<svg"));
    let links = html.matches("href=\"").count();
    let inside = ["href=\"#", "href=\"data:image/jpeg;base64,"];
    let inside = inside.map(|link| html.matches(link).count());
    assert!(
        !html.contains("src=") && links == inside.iter().sum::<usize>(),
        "the page must be self-contained"
    );
    assert!(inside[1] >= 9 && html.contains("A begins a move"));
    assert!(
        std::fs::read_to_string(&figure)
            .unwrap()
            .starts_with("<svg")
    );
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        2,
        "nothing half-written is left"
    );
    // Progress goes to standard error.
    assert!(String::from_utf8_lossy(&output.stderr).contains("tracking"));
}

#[test]
fn stage_of_rig_file_is_moved() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let stage = Stage {
        steps_per_mm: [200.0, 200.0, 400.0],
        ..default_stage()
    };
    let mut rig = RigFile::paper();
    for (name, stage) in [("without.toml", None), ("with.toml", Some(stage))] {
        rig.stage = stage;
        std::fs::write(path(name), rig.to_toml()).unwrap();
    }
    let report = path("run.html");
    let track = |rig: &str| run(&["--rig", &path(rig), "--report", &report]);
    let output = track("with.toml");
    let text = String::from_utf8(output.stdout).unwrap();
    let said = "200 200 400 steps/mm: one step is 0.005 0.005 0.0025 mm";
    assert!(output.status.success() && text.contains(said), "{text}");
    let output = track("without.toml");
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("without.toml: has no [stage]"), "{text}");
}

#[test]
fn repeating_poster_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("run.html");
    let output = run(&["--texture", "bricks", "--report", page.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("ambiguous"));
    assert!(!page.exists());
}

#[test]
fn closed_loop_follows_circle() {
    for method in ["midpoint", "closed-form"] {
        let output = run(&[
            "track",
            "--sim",
            "--seconds",
            "2",
            "--json",
            "--method",
            method,
        ]);
        assert!(output.status.success());
        let lines: Vec<Value> = output
            .stdout
            .split(|b| *b == b'\n')
            .filter_map(|line| serde_json::from_slice(line).ok())
            .collect();
        assert_eq!(lines.len(), 119, "{method}");
        assert!(
            lines
                .iter()
                .all(|line| line["points"].as_u64().is_some_and(|points| points > 50)),
            "{method}"
        );
        // It lags by the latency and the time to catch up, but does not run away.
        for line in &lines {
            assert!(
                within(
                    off(vector(&line["camera_mm"]), vector(&line["target_mm"])),
                    [2.0, 2.0, 0.6]
                ),
                "{method} {line}"
            );
        }
    }
}

#[test]
fn recorded_images_drive_stage() {
    let images = concat!(env!("CARGO_MANIFEST_DIR"), "/images/teddy");
    let rig = format!("{images}/rig.toml");
    let output = run(&["track", "--images", images, "--rig", &rig, "--json"]);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let lines: Vec<Value> = output
        .stdout
        .split(|b| *b == b'\n')
        .filter_map(|line| serde_json::from_slice(line).ok())
        .collect();
    assert_eq!(lines.len(), 3);
    for (line, x) in lines.iter().zip([-1.0, -2.0, -3.0]) {
        assert!(
            within(
                off(vector(&line["displacement_mm"]), [x, 0.0, 0.0]),
                [0.04, 0.03, 0.05]
            ),
            "{line}"
        );
    }
    assert!(String::from_utf8_lossy(&output.stderr).contains("came to rest"));
}

#[test]
fn impossible_options_exit_2() {
    for arguments in [
        &["track"][..],
        &["track", "--sim", "--fps", "0"],
        &["track", "--sim", "--images", "x"],
        &["track", "--images", "x"],
        &["track", "--sim", "--depth", "-5"],
        &["--texture", "wood"],
        &["tables", "--noise", "NaN"],
    ] {
        let output = run(arguments);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{arguments:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        assert!(output.stdout.is_empty());
    }
}
