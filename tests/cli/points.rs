//! `estimate` on points: agreement with the reference cases, and the form of the output.

use std::fs;

use serde_json::{Value, json};
use trinocular_rig::pivot::Pivot;
use trinocular_rig::rig_file::RigFile;
use trinocular_tests::points::ideal_rig;

use super::{Desk, run};

/// Largest difference between the program's output and the reference, mm.
const TOLERANCE_MM: f64 = 1e-6;

const PRINCIPAL_PX: [f64; 2] = [160.0, 120.0];

fn reference_cases() -> Vec<Value> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/estimators.json");
    let text = fs::read_to_string(path).expect("the reference cases are committed");
    let file: Value = serde_json::from_str(&text).expect("they are JSON");
    file["cases"].as_array().expect("a list").clone()
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let list = value.as_array().expect("a list of numbers");
    assert_eq!(list.len(), N, "{value}");
    std::array::from_fn(|i| list[i].as_f64().expect("a number"))
}

/// Returns a desk with the reference case as a user's files.
fn desk_of(case: &Value) -> Desk {
    let desk = Desk::new();
    let offsets = case["camera_offsets_mm"].as_array().expect("a list");
    let offsets: Vec<[f64; 2]> = offsets.iter().map(numbers).collect();
    let mut rig = ideal_rig(case["focal_px"].as_f64().expect("a number"), &offsets);
    for camera in &mut rig.cameras {
        camera.principal_px = PRINCIPAL_PX;
    }
    let names: Vec<String> = match offsets.len() {
        3 => ["left", "middle", "right"].map(String::from).to_vec(),
        count => (1..=count).map(|i| format!("eye {i}")).collect(),
    };
    let mut csv = String::from("id,camera,x0,y0,x1,y1\n");
    for (id, point) in case["points"]
        .as_array()
        .expect("a list")
        .iter()
        .enumerate()
    {
        for (name, view) in names.iter().zip(point.as_array().expect("a list")) {
            let [x0, y0] = numbers(&view["t0"]);
            let [x1, y1] = numbers(&view["t1"]);
            let seen = [[x0, y0], [x1, y1]]
                .map(|[x, y]: [f64; 2]| format!("{},{}", x + PRINCIPAL_PX[0], y + PRINCIPAL_PX[1]));
            csv += &format!("{id},{name},{}\n", seen.join(","));
        }
    }
    let stage = None;
    desk.write(
        "rig.toml",
        RigFile {
            names,
            rig,
            stage,
            rotation: None,
            pivot: Pivot::Centroid,
            trigger: None,
            laser: None,
            targets: Vec::new(),
            capture: Vec::new(),
        }
        .to_toml(),
    );
    desk.write("points.csv", csv);
    desk
}

#[track_caller]
fn assert_close(got: &Value, expected: &Value, what: &str) {
    let (got, expected): ([f64; 3], [f64; 3]) = (numbers(got), numbers(expected));
    for axis in 0..3 {
        let error = (got[axis] - expected[axis]).abs();
        assert!(error <= TOLERANCE_MM, "{what}: {got:?}, not {expected:?}");
    }
}

#[test]
fn methods_agree_with_reference() {
    let mut compared = 0;
    for case in reference_cases() {
        let desk = desk_of(&case);
        let expected = &case["expected"];
        let points = case["points"].as_array().expect("a list").len();
        for (method, key) in [
            ("closed-form", "closed_form_mm"),
            ("least-squares", "least_squares_mm"),
            ("midpoint", "midpoint"),
        ] {
            let expected = &expected[key];
            if expected.is_null() {
                continue;
            }
            let what = format!("{} by {method}", case["name"]);
            let outcome = desk.estimate(&["--json", "--method", method]);
            assert_eq!(outcome.code, Some(0), "{what}: {}", outcome.stderr);
            let lines = outcome.json();
            assert_eq!(lines.len(), 1, "{what}");
            let line = &lines[0];
            assert_eq!(line["frame"], 1);
            assert_eq!(line["points"], points, "{what}");
            assert_eq!(line["rejected"], 0, "{what}");
            assert_eq!(line["method"], method);
            if method == "midpoint" {
                assert_close(
                    &line["displacement_mm"],
                    &expected["displacement_mm"],
                    &what,
                );
                // Printed with three significant digits.
                let (got, expected) = (&line["sigma_mm"], &expected["sigma_mm"]);
                for (got, expected) in numbers::<3>(got).iter().zip(numbers::<3>(expected)) {
                    let off = (got - expected).abs();
                    let bound = TOLERANCE_MM.max(0.005 * expected);
                    assert!(off <= bound, "{what}: {got}, not {expected}");
                }
            } else {
                assert_close(&line["displacement_mm"], expected, &what);
                assert!(line["sigma_mm"].is_null(), "{what}");
            }
            compared += 1;
        }
    }
    // Eight cases by three methods, the five cameras by one.
    assert_eq!(compared, 25);
}

#[test]
fn json_line_has_documented_keys() {
    let outcome = Desk::new().estimate(&["--json"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert_eq!(outcome.stderr, "");
    for part in [
        "\"version\":1",
        "\"frame\":1,",
        "\"displacement_mm\":[",
        "\"sigma_mm\":[",
        "\"points\":5,",
        "\"rejected\":0,",
        "\"method\":\"midpoint\"",
        "\"rotation_deg\":[",
        "\"rotation_sigma_deg\":[",
        "\"pivot_mm\":[",
    ] {
        assert!(outcome.stdout.contains(part), "{}", outcome.stdout);
    }
    assert_eq!(outcome.json()[0].as_object().map(|o| o.len()), Some(11));
    let alone = Desk::new().estimate(&["--json", "--rotation", "refuse"]);
    assert_eq!(alone.json()[0].as_object().map(|o| o.len()), Some(8));
}

#[test]
fn table_shows_same_figures() {
    let desk = Desk::new();
    let outcome = desk.estimate(&[]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let rows: Vec<Vec<&str>> = outcome
        .stdout
        .lines()
        .map(|line| line.split_whitespace().collect())
        .collect();
    assert_eq!(rows.len(), 2, "{}", outcome.stdout);
    assert_eq!(rows[1].len(), 9, "{}", outcome.stdout);
    assert_eq!(rows[1][..2], ["1", "1.0000"]);
    assert_eq!(rows[1][7..], ["5", "0"]);
    for component in &rows[1][2..7] {
        assert_eq!(*component, "0.0000");
    }
    let closed_form = desk.estimate(&["--method", "closed-form"]);
    assert!(closed_form.stdout.contains(" - "), "{}", closed_form.stdout);
}

#[test]
fn points_missing_in_a_camera_are_counted() {
    let desk = Desk::new();
    let text = desk.read("points.csv");
    let kept: Vec<&str> = text
        .lines()
        .filter(|l| {
            !l.starts_with("3,middle") && !l.starts_with("4,left") && !l.starts_with("4,right")
        })
        .collect();
    desk.write("points.csv", kept.join("\n"));
    for method in ["midpoint", "closed-form", "least-squares"] {
        let line = &desk.estimate(&["--json", "--method", method]).json()[0];
        assert_eq!([&line["points"], &line["rejected"]], [&json!(3), &json!(2)]);
        let [x, _, _] = numbers::<3>(&line["displacement_mm"]);
        assert!((x - 1.0).abs() < TOLERANCE_MM, "{x}");
    }
}

#[test]
fn points_off_the_rig_are_rejected() {
    let desk = Desk::new();
    let lower = |row: &str| match row.split(',').collect::<Vec<_>>().as_slice() {
        [id, "right", x0, y0, x1, y1] => {
            let [y0, y1] = [y0, y1].map(|y| y.parse::<f64>().expect("a number") + 13.0);
            format!("{id},right,{x0},{y0},{x1},{y1}")
        }
        _ => row.to_owned(),
    };
    let rows: Vec<String> = desk.read("points.csv").lines().map(lower).collect();
    desk.write("points.csv", rows.join("\n") + "\n");
    let arguments = ["estimate", "points.csv", "--rig", "rig.toml", "--json"];
    let outcome = run(desk.folder.path(), &arguments);
    assert_eq!(outcome.code, Some(1), "{}", outcome.stderr);
    let refused = outcome.json()[0]["refused"]
        .as_str()
        .expect("a reason")
        .to_owned();
    for part in ["0 points, 5 rejected", "5 of 5 points contradict the rig"] {
        assert!(refused.contains(part), "{refused}");
    }
}

#[test]
fn point_behind_cameras_is_rejected() {
    let desk = Desk::new();
    // Left and right swapped: the disparity is negative.
    let rows = "9,left,100,120,101,120\n9,middle,160,120,161,120\n9,right,220,120,221,120\n";
    desk.write("points.csv", desk.read("points.csv") + rows);
    for method in ["midpoint", "closed-form", "least-squares"] {
        let line = &desk.estimate(&["--json", "--method", method]).json()[0];
        assert_eq!([&line["points"], &line["rejected"]], [&json!(5), &json!(1)]);
    }
}

#[test]
fn degenerate_points_are_refused() {
    let desk = Desk::new();
    // Each point is missing from some camera, each camera has seen some point.
    desk.write(
        "points.csv",
        "id,camera,x0,y0,x1,y1\n1,left,9,9,9,9\n2,middle,9,9,9,9\n3,right,9,9,9,9\n",
    );
    let outcome = desk.estimate(&["--json"]);
    assert_eq!(outcome.code, Some(1));
    outcome.complained(&["points.csv", "1 of 1 frames refused"]);
    let lines = outcome.json();
    assert_eq!(lines.len(), 1);
    assert_eq!(lines[0].as_object().map(|o| o.len()), Some(3));
    assert_eq!(lines[0]["frame"], 1);
    let reason = lines[0]["refused"].as_str().expect("a text");
    assert!(reason.contains("too few points"), "{reason}");
    assert!(reason.contains("3 rejected"), "{reason}");
    let table = desk.estimate(&[]);
    assert_eq!(table.code, Some(1));
    assert!(
        table.stdout.contains("1 refused: too few"),
        "{}",
        table.stdout
    );
}

#[test]
fn two_cameras_need_midpoint() {
    let desk = Desk::new();
    let rig = RigFile::read(&desk.path("rig.toml")).expect("the rig just written");
    let two = RigFile {
        names: vec!["upper".to_owned(), "lower".to_owned()],
        rig: trinocular_core::rig::Rig {
            image_size_px: rig.rig.image_size_px,
            cameras: rig.rig.cameras.iter().take(2).copied().collect(),
        },
        stage: None,
        rotation: None,
        pivot: Pivot::Centroid,
        trigger: None,
        laser: None,
        targets: Vec::new(),
        capture: Vec::new(),
    };
    desk.write("rig.toml", two.to_toml());
    let text = desk.read("points.csv");
    let rows: Vec<&str> = text.lines().filter(|l| !l.contains("right")).collect();
    let csv = rows
        .join("\n")
        .replace("left", "upper")
        .replace("middle", "lower");
    desk.write("points.csv", csv);
    let outcome = desk.estimate(&["--json"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let [x, y, z] = numbers::<3>(&outcome.json()[0]["displacement_mm"]);
    assert!((x - 1.0).abs().max(y.abs()).max(z.abs()) < TOLERANCE_MM);
    for method in ["closed-form", "least-squares"] {
        let outcome = desk.estimate(&["--method", method]);
        outcome.failed(
            1,
            &[
                "rig.toml",
                "rig.toml:3: field `camera`: ",
                method,
                "left, middle, right",
                "upper",
            ],
        );
    }
}

#[test]
fn cameras_off_line_need_midpoint() {
    let desk = Desk::new();
    let line = desk.change("rig.toml", "[68.0, 0.0]", "[68.0, 1.0]");
    assert_eq!(desk.estimate(&[]).code, Some(0));
    let outcome = desk.estimate(&["--method", "closed-form"]);
    let place = format!("rig.toml:{line}: field `camera[2].offset_mm[1]`: ");
    outcome.failed(1, &[&place, "closed-form", "in line"]);
}

#[test]
fn references_are_equal_for_points() {
    let desk = Desk::new();
    let first = desk.estimate(&["--json", "--reference", "first"]);
    let previous = desk.estimate(&["--json", "--reference", "previous"]);
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    assert_eq!(first.stdout, previous.stdout);
    assert_eq!(first.stdout, desk.estimate(&["--json"]).stdout);
}

#[test]
fn absolute_paths_are_accepted() {
    let desk = Desk::new();
    let (points, rig) = (desk.path("points.csv"), desk.path("rig.toml"));
    let elsewhere = tempfile::tempdir().expect("a temporary folder");
    let paths = [points.to_str(), rig.to_str()].map(|path| path.expect("UTF-8"));
    let outcome = run(elsewhere.path(), &["estimate", "--rig", paths[1], paths[0]]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
}
