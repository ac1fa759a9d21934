//! `reference` saves a view; `estimate` and `track` measure from it, after other light, other
//! exposure and mishaps.

use std::fs;

use super::folder::{AT_REST, desk_with_views, grey_levels};
use super::{Desk, Outcome, run};
use trinocular_core::rig::{Camera, Rig};

const CAMERAS: [&str; 3] = ["left", "middle", "right"];

/// Displacement of the poster since the view was saved.
const SINCE_MM: [f64; 3] = [3.0, -2.0, 1.5];

/// Largest standard deviation, mm.
const SIGMA_MM: [f64; 3] = [0.02, 0.02, 0.11];

/// Returns a desk with a saved view, `view.mcap`, of the poster at rest.
fn desk_with_view() -> Desk {
    let desk = desk_with_views(&[AT_REST, AT_REST]);
    let saved = words(&desk, "reference views --rig rig.toml --out view.mcap");
    assert_eq!(saved.code, Some(0), "{}", saved.stderr);
    assert!(saved.stdout.starts_with("saved a reference view of "));
    desk
}

fn words(desk: &Desk, words: &str) -> Outcome {
    let words: Vec<&str> = words.split_whitespace().collect();
    run(desk.folder.path(), &words)
}

/// Writes a folder `later` with one frame set of the moved poster, seen by `camera` and lit by
/// `light`.
fn write_later(
    desk: &Desk,
    camera: impl Fn(usize, Camera) -> Camera,
    light: impl Fn(usize, f64) -> f64,
) {
    let rig = Rig::paper();
    let size_px = rig.image_size_px;
    for (index, name) in CAMERAS.iter().enumerate() {
        let camera = camera(index, rig.cameras[index]);
        let levels = grey_levels(&camera, size_px, SINCE_MM);
        let [width, height] = size_px;
        let mut pgm = format!("P5\n{width} {height}\n255\n").into_bytes();
        let lit = levels.iter().enumerate();
        pgm.extend(lit.map(|(pixel, grey)| light(pixel, *grey).round().clamp(0.0, 255.0) as u8));
        fs::create_dir_all(desk.path("later").join(name)).expect("the desk can be written to");
        desk.write(&format!("later/{name}/0.pgm"), pgm);
    }
}

fn same(_: usize, camera: Camera) -> Camera {
    camera
}

/// Asserts that a row states the displacement since the view was saved.
#[track_caller]
fn assert_since(row: &serde_json::Value) {
    assert_moved(row, SINCE_MM);
}

#[track_caller]
fn assert_moved(row: &serde_json::Value, expected_mm: [f64; 3]) {
    for axis in 0..3 {
        let number = |field: &str| row[field][axis].as_f64().expect("a number");
        let (error_mm, sigma_mm) = (
            number("displacement_mm") - expected_mm[axis],
            number("sigma_mm"),
        );
        assert!(sigma_mm <= SIGMA_MM[axis], "{row}");
        assert!(error_mm.abs() <= 3.0 * sigma_mm, "{row}");
    }
}

#[test]
fn displacement_since_is_right_in_other_light() {
    let desk = desk_with_view();
    let [width, _] = Rig::paper().image_size_px.map(|px| px as usize);
    let shade =
        |pixel: usize, grey: f64| grey * (0.4 + 0.6 * (pixel % width) as f64 / width as f64);
    let lights: [&dyn Fn(usize, f64) -> f64; 4] = [
        &|_, grey| grey,
        &|_, grey| 0.3 * grey + 10.0,
        &|_, grey| 255.0 * (grey / 255.0).powf(0.6),
        &shade,
    ];
    for light in lights {
        write_later(&desk, same, light);
        for rig in ["", "--rig rig.toml"] {
            let done = words(
                &desk,
                &format!("estimate later --reference view.mcap --json {rig}"),
            );
            assert_eq!(done.code, Some(0), "{}", done.stderr);
            let rows = done.json();
            assert_eq!(rows.len(), 1);
            assert_eq!(rows[0]["frame"], 1);
            assert_since(&rows[0]);
        }
    }
}

#[test]
fn run_from_a_view_replays() {
    let desk = desk_with_view();
    write_later(&desk, same, |_, grey| 0.5 * grey + 30.0);
    let done = words(
        &desk,
        "track --images later --rig rig.toml --reference view.mcap --json --record run.mcap",
    );
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    let rows = done.json();
    assert_eq!(rows.len(), 1, "{}", done.stdout);
    assert_since(&rows[0]);
    let replayed = words(&desk, "replay run.mcap");
    assert_eq!(replayed.code, Some(0), "{}", replayed.stdout);
    // The recording of the run begins with the view, and so is one.
    let again = words(&desk, "estimate later --reference run.mcap --json");
    assert_since(&again.good_json()[0]);
}

#[test]
fn any_frame_set_of_a_recording_is_saved() {
    let desk = desk_with_views(&[AT_REST, Some([2.0, 1.0, 0.5])]);
    let done = words(
        &desk,
        "track --images views --rig rig.toml --record run.mcap",
    );
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    let saved = words(&desk, "reference run.mcap --frame 1 --out view.mcap --json");
    let saved = saved.good_json();
    assert_eq!(saved[0]["file"], "view.mcap");
    assert!(saved[0]["points"].as_u64() > Some(50), "{saved:?}");
    write_later(&desk, same, |_, grey| grey);
    let done = words(&desk, "estimate later --reference view.mcap --json");
    assert_moved(&done.good_json()[0], [1.0, -3.0, 1.0]);
    let beyond = words(&desk, "reference run.mcap --frame 2 --out other.mcap");
    beyond.failed_after_notes(1, &["run.mcap", "no frame set 2"]);
    let kept = words(&desk, "reference run.mcap --out view.mcap");
    kept.failed_after_notes(1, &["view.mcap", "--force"]);
}

/// A camera that was moved against the others after the view was saved spoils every displacement:
/// it is left out by name, or the row is refused.
#[test]
fn moved_camera_is_never_believed() {
    let desk = desk_with_view();
    let moves: [[f64; 2]; 5] = [[0.0, 3.0], [0.0, -1.5], [2.0, 0.0], [-6.0, 0.0], [1.0, 1.0]];
    for (index, name) in CAMERAS.iter().enumerate() {
        for [x_px, y_px] in moves {
            let moved = |k: usize, mut camera: Camera| {
                if k == index {
                    camera.principal_px[0] += x_px;
                    camera.principal_px[1] += y_px;
                }
                camera
            };
            write_later(&desk, moved, |_, grey| grey);
            let done = words(&desk, "estimate later --reference view.mcap --json");
            let row = &done.json()[0];
            if row["refused"].is_string() {
                assert_eq!(done.code, Some(1));
                continue;
            }
            assert_since(row);
            let warnings = row["warnings"].to_string();
            assert!(
                warnings.contains(name),
                "{name} by {x_px}, {y_px} px: {row}"
            );
        }
    }
}

#[test]
fn other_rig_is_named_by_field() {
    let desk = desk_with_view();
    write_later(&desk, same, |_, grey| grey);
    let text = fs::read_to_string(desk.path("rig.toml")).expect("a rig file");
    for (from, to, part) in [
        (
            "538.14",
            "539",
            "focal_px of camera middle is [539.0, 534.18]",
        ),
        ("170.59", "171", "principal_px of camera middle"),
        ("68.0", "69.0", "offset_mm of camera right"),
        ("[320, 240]", "[640, 480]", "its images have 640 x 480 px"),
    ] {
        assert!(text.contains(from), "{text}");
        desk.write("other.toml", text.replace(from, to));
        for command in ["estimate view.mcap", "track --images view.mcap"] {
            let done = words(
                &desk,
                &format!("{command} --reference view.mcap --rig other.toml"),
            );
            done.failed_after_notes(1, &["other.toml", "view.mcap", part]);
        }
    }
}

#[test]
fn files_that_are_no_view_are_named() {
    let desk = desk_with_views(&[None, AT_REST]);
    for (command, parts) in [
        (
            "estimate views --reference rig.toml",
            ["rig.toml", "trinocular reference"],
        ),
        (
            "estimate views --reference none.mcap",
            ["none.mcap", "must be first, previous"],
        ),
        (
            "reference views --rig rig.toml --out dark.mcap",
            ["views", "too little texture"],
        ),
        ("reference views --out dark.mcap", ["--rig", "is missing"]),
    ] {
        let done = words(&desk, command);
        assert_ne!(done.code, Some(0), "{}", done.stdout);
        for part in parts {
            assert!(done.stderr.contains(part), "{command}: {}", done.stderr);
        }
    }
    assert!(!desk.path("dark.mcap").exists());
    let points = words(
        &desk,
        "estimate points.csv --rig rig.toml --reference rig.toml",
    );
    points.failed(2, &["--reference", "goes with images"]);
    let simulated = words(&desk, "track --sim --reference rig.toml");
    simulated.failed(2, &["--reference", "--cameras"]);
}

/// A shift across the motion, or a small one, leaves the points in agreement.
#[test]
fn small_shift_of_a_camera_is_named() {
    let desk = desk_with_view();
    write_later(&desk, same, |_, grey| grey);
    let still = words(&desk, "estimate later --reference view.mcap --json").good_json();
    assert_eq!(still[0]["warnings"], serde_json::Value::Null);
    for (index, name) in CAMERAS.iter().enumerate() {
        for shift_px in [[0.0, 0.1], [0.3, 0.45], [0.2, 0.0]] {
            let moved = |k: usize, mut camera: Camera| {
                if k == index {
                    for (principal, shift) in camera.principal_px.iter_mut().zip(shift_px) {
                        *principal += shift;
                    }
                }
                camera
            };
            write_later(&desk, moved, |_, grey| grey);
            let done = words(&desk, "estimate later --reference view.mcap --json");
            let row = &done.json()[0];
            let told = row["warnings"].to_string() + &row["refused"].to_string();
            let is_named = told.contains("moved against the others") || told.contains(name);
            assert!(is_named, "{name} by {shift_px:?} px: {row}");
        }
    }
    let middle = |k: usize, mut camera: Camera| {
        if k == 1 {
            camera.principal_px[1] += 0.45;
            camera.principal_px[0] += 0.3;
        }
        camera
    };
    write_later(&desk, middle, |_, grey| grey);
    let followed = words(
        &desk,
        "track --images later --rig rig.toml --reference view.mcap",
    );
    assert!(
        followed.stderr.contains("moved against the others"),
        "{}",
        followed.stderr
    );
}

#[test]
fn view_keeps_its_regions_and_rig() {
    let desk = desk_with_views(&[AT_REST, AT_REST]);
    let saved = words(
        &desk,
        "reference views --rig rig.toml --roi middle=60,40,120,160 --out view.mcap --json",
    );
    let points = saved.good_json()[0]["points"].as_u64().expect("points");
    let whole = words(
        &desk,
        "reference views --rig rig.toml --out whole.mcap --json",
    );
    let whole = whole.good_json()[0]["points"].as_u64().expect("points");
    assert!(points < whole, "{points} of {whole}");
    write_later(&desk, same, |_, grey| grey);
    for command in ["estimate later", "track --images later"] {
        let done = words(&desk, &format!("{command} --reference view.mcap --json"));
        let count = format!("displacements count from view.mcap, {points} points");
        assert!(done.stderr.contains(&count), "{}", done.stderr);
        let rows = done.good_json();
        let followed = rows[0]["points"].as_u64().expect("points");
        assert!(followed <= points, "{rows:?}");
        assert_since(&rows[0]);
    }
}
