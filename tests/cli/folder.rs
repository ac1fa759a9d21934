//! `estimate` on folders of images: a textured poster in front of the paper's rig, drawn from its
//! geometry alone.

use std::fs;
use std::path::Path;

use serde_json::Value;
use trinocular_core::rig::{Camera, Rig};
use trinocular_rig::random::Random;

use super::{Desk, Outcome, run};

/// Initial distance of the poster from the cameras, mm.
const DEPTH_MM: f64 = 900.0;

/// Returns the poster's grey level at a position on it, mm: smooth random blots in three sizes, the
/// smallest five pixels wide.
fn poster(x: f64, y: f64) -> f64 {
    let octaves = [(37.0, 60.0), (19.0, 35.0), (9.0, 25.0)];
    let blots = octaves
        .iter()
        .zip(1..)
        .map(|((cell, contrast), seed)| contrast * blot(x / cell, y / cell, seed));
    128.0 + blots.sum::<f64>()
}

/// Returns a random number from -1 to 1, interpolated smoothly between the nodes of a grid.
fn blot(x: f64, y: f64, seed: i64) -> f64 {
    let node = |i: f64, j: f64| {
        let key = (i as i64) * 0x1F12_3BB5 + (j as i64) * 0x5851_F42D + seed * 0x2545_F491;
        Random::seeded(key as u64).between(-1.0, 1.0)
    };
    let (i, j) = (x.floor(), y.floor());
    let ease = |t: f64| t * t * t * (t * (6.0 * t - 15.0) + 10.0);
    let (u, v) = (ease(x - i), ease(y - j));
    let row = |j: f64| node(i, j) * (1.0 - u) + node(i + 1.0, j) * u;
    row(j) * (1.0 - v) + row(j + 1.0) * v
}

/// Renders a camera's image of the poster after its displacement, as a binary PGM.
fn view(camera: &Camera, size_px: [u32; 2], moved_mm: [f64; 3]) -> Vec<u8> {
    let [width, height] = size_px;
    let mut pgm = format!("P5\n{width} {height}\n255\n").into_bytes();
    let levels = grey_levels(camera, size_px, moved_mm).into_iter();
    pgm.extend(levels.map(|grey| grey.round().clamp(0.0, 255.0) as u8));
    pgm
}

/// Renders a camera's image of the poster after its displacement, row by row.
pub fn grey_levels(camera: &Camera, [width, height]: [u32; 2], moved_mm: [f64; 3]) -> Vec<f64> {
    let mut levels = Vec::new();
    let depth = DEPTH_MM + moved_mm[2];
    for row in 0..height {
        for column in 0..width {
            let [xi, eta] = camera.normalise([f64::from(column), f64::from(row)]);
            let x = xi * depth + camera.offset_mm[0] - moved_mm[0];
            let y = eta * depth + camera.offset_mm[1] - moved_mm[1];
            levels.push(poster(x, y));
        }
    }
    levels
}

fn blank([width, height]: [u32; 2]) -> Vec<u8> {
    let mut pgm = format!("P5\n{width} {height}\n255\n").into_bytes();
    pgm.resize(pgm.len() + (width * height) as usize, 100);
    pgm
}

/// Returns a desk with a folder `views`: one frame set per displacement, and a dark one for each
/// `None`.
pub fn desk_with_views(displacements_mm: &[Option<[f64; 3]>]) -> Desk {
    let desk = Desk::new();
    let rig = Rig::paper();
    for (name, camera) in ["left", "middle", "right"].iter().zip(&rig.cameras) {
        fs::create_dir_all(desk.path("views").join(name)).expect("the desk can be written to");
        for (number, moved) in displacements_mm.iter().enumerate() {
            let pgm = match moved {
                Some(moved) => view(camera, rig.image_size_px, *moved),
                None => blank(rig.image_size_px),
            };
            desk.write(&format!("views/{name}/{number:04}.pgm"), pgm);
        }
    }
    desk
}

fn estimate(desk: &Desk, more: &[&str]) -> Outcome {
    let mut arguments = vec!["estimate", "views", "--rig", "rig.toml"];
    arguments.extend(more);
    run(desk.folder.path(), &arguments)
}

/// Displacement of the poster's initial position.
pub const AT_REST: Option<[f64; 3]> = Some([0.0; 3]);

#[track_caller]
fn assert_moved(line: &Value, expected_mm: [f64; 3]) {
    let got = line["displacement_mm"].as_array().expect("a displacement");
    for ((got, expected), bound) in got.iter().zip(expected_mm).zip(TOLERANCE_MM) {
        let error = (got.as_f64().expect("a number") - expected).abs();
        assert!(error <= bound, "{line}, not {expected_mm:?}");
    }
}

/// Largest error of a displacement, mm.
const TOLERANCE_MM: [f64; 3] = [0.01, 0.01, 0.04];

#[test]
fn frame_sets_are_measured_from_first() {
    let desk = desk_with_views(&[
        AT_REST,
        Some([4.0, 4.0, 1.0]),
        Some([8.0, 8.0, 2.0]),
        Some([-3.0, 5.0, -2.0]),
    ]);
    let outcome = estimate(&desk, &["--json"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let lines = outcome.json();
    assert_eq!(lines.len(), 3);
    for (line, frame) in lines.iter().zip(1..) {
        assert_eq!(line["frame"], frame);
        assert_eq!(line["method"], "midpoint");
        assert!(line["points"].as_u64().is_some_and(|n| n >= 8), "{line}");
        assert!(line["rejected"].is_u64(), "{line}");
        assert_eq!(line["sigma_mm"].as_array().map(Vec::len), Some(3));
    }
    assert_moved(&lines[0], [4.0, 4.0, 1.0]);
    assert_moved(&lines[1], [8.0, 8.0, 2.0]);
    assert_moved(&lines[2], [-3.0, 5.0, -2.0]);
    // Frame sets are processed in order, so the same images always give the same lines.
    assert_eq!(outcome.stdout, estimate(&desk, &["--json"]).stdout);
    let first = estimate(&desk, &["--json", "--reference", "first"]);
    assert_eq!(outcome.stdout, first.stdout);
}

#[test]
fn frame_sets_are_measured_from_previous() {
    let desk = desk_with_views(&[AT_REST, Some([4.0, 4.0, 1.0]), Some([3.0, 9.0, -1.0])]);
    let outcome = estimate(&desk, &["--json", "--reference", "previous"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let lines = outcome.json();
    assert_eq!(lines.len(), 2);
    assert_moved(&lines[0], [4.0, 4.0, 1.0]);
    assert_moved(&lines[1], [-1.0, 5.0, -2.0]);
}

#[test]
fn paper_methods_work_on_images() {
    let desk = desk_with_views(&[AT_REST, Some([2.0, -1.0, 0.0])]);
    for method in ["closed-form", "least-squares"] {
        let outcome = estimate(&desk, &["--json", "--method", method]);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let line = &outcome.json()[0];
        assert_eq!(line["method"], method);
        assert!(line["sigma_mm"].is_null());
        let moved = line["displacement_mm"].as_array().expect("a displacement");
        // Their z comes from a small difference and leaks into x, so only signs and magnitude are
        // checked.
        for (got, expected) in moved.iter().zip([2.0, -1.0]) {
            assert!(
                (got.as_f64().expect("a number") - expected).abs() < 0.5,
                "{line}"
            );
        }
    }
}

#[test]
fn refused_frame_set_does_not_end_run() {
    let desk = desk_with_views(&[AT_REST, None, Some([4.0, 4.0, 1.0])]);
    let outcome = estimate(&desk, &["--json"]);
    assert_eq!(outcome.code, Some(1));
    outcome.complained(&["views", "1 of 2 frames refused"]);
    let lines = outcome.json();
    assert_eq!(lines.len(), 2);
    assert_eq!(lines[0]["frame"], 1);
    assert!(lines[0]["refused"].is_string(), "{}", lines[0]);
    assert_eq!(lines[1]["frame"], 2);
    assert_moved(&lines[1], [4.0, 4.0, 1.0]);

    // Measured against the previous frame set, the blank one spoils two frames.
    let outcome = estimate(&desk, &["--json", "--reference", "previous"]);
    assert_eq!(outcome.code, Some(1));
    outcome.complained(&["2 of 2 frames refused"]);
    assert!(outcome.json()[1]["refused"].is_string());

    let table = estimate(&desk, &[]);
    assert_eq!(table.code, Some(1));
    let rows: Vec<&str> = table.stdout.lines().map(str::trim_start).collect();
    assert_eq!(rows.len(), 3, "{}", table.stdout);
    let is_refused = |row: &&str| row.starts_with("1 refused: ");
    assert_eq!(
        rows.iter().filter(|row| is_refused(row)).count(),
        1,
        "{}",
        table.stdout
    );
}

#[test]
fn blank_keyframe_refuses_all_frames() {
    let desk = desk_with_views(&[None, AT_REST, AT_REST]);
    let outcome = estimate(&desk, &["--json"]);
    assert_eq!(outcome.code, Some(1));
    for line in outcome.json() {
        let reason = line["refused"].as_str().expect("a reason");
        assert!(reason.contains("texture"), "{reason}");
    }
    assert_eq!(outcome.json().len(), 2);
}

#[test]
fn folders_without_frame_sets_fail() {
    let desk = Desk::new();
    fs::create_dir(desk.path("views")).expect("the desk can be written to");
    estimate(&desk, &["--json"]).failed(1, &["left", "no such folder"]);
    for name in ["left", "middle", "right"] {
        fs::create_dir(desk.path("views").join(name)).expect("the desk can be written to");
    }
    estimate(&desk, &["--json"]).failed(1, &["views", "no images"]);
}

#[test]
fn single_frame_set_is_refused() {
    let desk = desk_with_views(&[AT_REST]);
    estimate(&desk, &["--json"]).failed(1, &["views", "at least two"]);
}

#[test]
fn missing_image_is_reported() {
    let moved = [[2.0, 2.0, 1.0], [3.0, 1.0, 1.0]];
    let desk = desk_with_views(&[AT_REST, Some(moved[0]), Some(moved[1])]);
    let second = fs::read(desk.path("views/left/0001.pgm")).expect("it was drawn");
    fs::remove_file(desk.path("views/left/0001.pgm")).expect("it was there");
    let outcome = estimate(&desk, &["--json"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let lines = outcome.json();
    let warning = "camera left gave no image; measured without it";
    assert_eq!(lines[0]["warnings"][0], warning, "{}", lines[0]);
    assert!(lines[1].get("warnings").is_none(), "{}", lines[1]);
    assert_moved(&lines[0], moved[0]);
    assert_moved(&lines[1], moved[1]);
    assert!(outcome.stderr.contains(warning), "{}", outcome.stderr);
    let table = estimate(&desk, &[]).stdout;
    let rows: Vec<bool> = table
        .lines()
        .map(|row| row.ends_with("  without left"))
        .collect();
    assert_eq!(rows, [false, true, false], "{table}");
    // The paper's methods need all three cameras, and the refusal names the missing one.
    let outcome = estimate(&desk, &["--json", "--method", "closed-form"]);
    let refused = outcome.json()[0]["refused"].to_string();
    assert!(refused.contains(warning), "{refused}");
    // A camera without an image of the keyframe is left out of every frame set, for that reason.
    let first = fs::read(desk.path("views/left/0000.pgm")).expect("it was drawn");
    fs::write(desk.path("views/left/0001.pgm"), second).expect("ours");
    fs::remove_file(desk.path("views/left/0000.pgm")).expect("it was there");
    let lines = estimate(&desk, &["--json"]).json();
    let warning = "camera left gave no image for the keyframe; measured without it";
    for line in &lines {
        assert_eq!(line["warnings"][0], warning, "{line}");
    }
    fs::write(desk.path("views/left/0000.pgm"), first).expect("ours");
    fs::remove_file(desk.path("views/left/0001.pgm")).expect("ours");
    // A single image is too few: only that frame set is refused.
    fs::remove_file(desk.path("views/right/0001.pgm")).expect("it was there");
    let outcome = estimate(&desk, &["--json"]);
    assert_eq!(outcome.code, Some(1));
    let lines = outcome.json();
    let refused = lines[0]["refused"].as_str().unwrap_or_default();
    assert!(refused.contains("camera"), "{}", lines[0]);
    assert_moved(&lines[1], moved[1]);
}

#[test]
fn missing_camera_is_named() {
    let desk = desk_with_views(&[AT_REST, AT_REST]);
    for frame in ["0000", "0001"] {
        fs::remove_file(desk.path(&format!("views/middle/{frame}.pgm"))).expect("it was there");
    }
    let name = Path::new("middle").join("0000.pgm");
    let name = name.to_str().expect("UTF-8");
    estimate(&desk, &["--json"]).failed(1, &[name, "missing"]);
    fs::remove_dir_all(desk.path("views").join("right")).expect("it was there");
    estimate(&desk, &["--json"]).failed(1, &["right", "no such folder"]);
}

#[test]
fn unequal_image_sizes_are_named() {
    let desk = desk_with_views(&[AT_REST, AT_REST]);
    desk.write("views/right/0000.pgm", blank([320, 200]));
    estimate(&desk, &["--json"]).failed(1, &["right", "0000.pgm", "320 x 200", "320 x 240"]);
}

#[test]
fn unreadable_image_is_reported() {
    let moved = [[2.0, 2.0, 1.0], [3.0, 1.0, 1.0], [3.0, 2.0, 1.0]];
    let desk = desk_with_views(&[AT_REST, Some(moved[0]), Some(moved[1]), Some(moved[2])]);
    desk.write("views/middle/0001.pgm", b"P5\n320 240\n255\ncut off");
    let refused = |line: &Value| line["refused"].as_str().map(str::to_owned);
    let outcome = estimate(&desk, &["--json"]);
    assert_eq!(outcome.code, Some(1));
    outcome.complained(&["views", "1 of 3 frames refused"]);
    let lines = outcome.json();
    let reason = refused(&lines[0]).expect("a reason");
    let name = Path::new("middle").join("0001.pgm");
    assert!(reason.contains(name.to_str().expect("UTF-8")), "{reason}");
    assert_moved(&lines[1], moved[1]);
    assert_moved(&lines[2], moved[2]);

    // The unreadable one does not become the keyframe, either.
    let outcome = estimate(&desk, &["--json", "--reference", "previous"]);
    assert_eq!(outcome.code, Some(1));
    let lines = outcome.json();
    let reason = refused(&lines[1]).expect("a reason");
    assert!(reason.contains("the frame set before"), "{reason}");
    assert_moved(&lines[2], [0.0, 1.0, 0.0]);
}

#[test]
fn non_image_file_is_named() {
    let desk = desk_with_views(&[AT_REST, AT_REST]);
    desk.write("views/left/0000.pgm", "P5\n320 240\n255\ntoo short");
    estimate(&desk, &["--json"]).failed(1, &["left", "0000.pgm", "cannot read the image"]);
    desk.write("views/left/0000.pgm", "no image at all");
    estimate(&desk, &["--json"]).failed(1, &["left", "0000.pgm"]);
}

/// Runs `trinocular track --images views --rig rig.toml`.
fn track(desk: &Desk) -> Outcome {
    let arguments = ["track", "--images", "views", "--rig", "rig.toml"];
    run(desk.folder.path(), &arguments)
}

#[cfg(unix)]
#[test]
fn unknown_file_type_is_named() {
    let moved = Some([2.0, -1.0, 0.0]);
    let desk = desk_with_views(&[AT_REST, moved, moved, moved, moved]);
    let mut files: Vec<_> = fs::read_dir(desk.path("views/left"))
        .expect("ours")
        .map(|entry| entry.expect("ours").path())
        .collect();
    files.sort();
    for file in &files[1..4] {
        fs::remove_file(file).expect("ours");
    }
    let made = std::process::Command::new("mkfifo").arg(&files[1]).status();
    assert!(made.expect("it runs").success());
    fs::create_dir(&files[2]).expect("ours");
    std::os::unix::fs::symlink("nowhere", &files[3]).expect("ours");
    let outcome = track(&desk);
    assert_eq!(outcome.code, Some(1), "{}", outcome.stderr);
    for (file, why) in files[1..4]
        .iter()
        .zip(["named pipe", "folder", "No such file"])
    {
        let name = file
            .file_name()
            .and_then(|name| name.to_str())
            .expect("UTF-8");
        let said = |line: &str| line.contains(name) && line.contains(why);
        assert!(
            outcome.stderr.lines().any(said),
            "{name}: {}",
            outcome.stderr
        );
    }
}

#[test]
fn unsupported_formats_are_named() {
    let desk = desk_with_views(&[AT_REST, Some([2.0, -1.0, 0.0])]);
    desk.write("views/left/9.gif", "GIF89a");
    desk.write("views/left/a.JP2", "JP2");
    desk.write("views/left/notes.txt", "");
    let outcome = track(&desk);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let told = outcome.stderr.matches("not read: 9.gif, a.JP2").count();
    assert_eq!(told, 1, "{}", outcome.stderr);
    assert!(!outcome.stderr.contains("notes.txt"), "{}", outcome.stderr);
    for camera in ["left", "middle", "right"] {
        fs::remove_dir_all(desk.path("views").join(camera)).expect("ours");
        fs::create_dir(desk.path("views").join(camera)).expect("ours");
        desk.write(&format!("views/{camera}/0.jxl"), "BM");
    }
    track(&desk).failed(1, &["views", "0.jxl", "PNG"]);
    let calibrate = ["calibrate", "views", "--board", "9x6", "--square", "25"];
    run(desk.folder.path(), &calibrate).failed(1, &["views", "0.jxl", "PNG"]);
}
