//! Bad input ends with exit code 1, an empty standard output, no new files, and one line that names
//! file, line and field. (The rules of the two file formats are tested beside their readers.)

use std::fs;

use super::{Desk, run};

/// Returns the names in the desk's folder; a bad input must not add to them.
fn listing(desk: &Desk) -> Vec<String> {
    let entries = fs::read_dir(desk.folder.path()).expect("the folder is there");
    let mut names: Vec<String> = entries
        .map(|entry| entry.expect("an entry").file_name())
        .map(|name| name.into_string().expect("UTF-8"))
        .collect();
    names.sort();
    names
}

/// Changes one place of `file` and checks that the program names file, line and `field` with
/// `reason`.
#[track_caller]
fn refused(file: &str, from: &str, to: &str, field: &str, reason: &str) {
    let desk = Desk::new();
    let before = listing(&desk);
    let line = desk.change(file, from, to);
    for form in [&["--json"][..], &[]] {
        let place = format!("{file}:{line}: field `{field}`: ");
        desk.estimate(form).failed(1, &[&place, reason]);
    }
    assert_eq!(listing(&desk), before);
}

/// Keeps only the lines of `points.csv` for which `keep` returns true.
fn keep_lines(desk: &Desk, keep: impl Fn(&str) -> bool) {
    let text = desk.read("points.csv");
    let kept: Vec<&str> = text.lines().filter(|line| keep(line)).collect();
    desk.write("points.csv", kept.join("\n"));
}

#[test]
fn wrong_header() {
    refused(
        "points.csv",
        "x0,y0,x1,y1",
        "x0,y0,u1,y1",
        "x1",
        "found `u1`",
    );
    refused(
        "points.csv",
        "x0,y0,x1,y1",
        "x0,y0,x1,y1,z",
        "column 7",
        "one column too many",
    );
    refused(
        "points.csv",
        "id,camera",
        "camera,id",
        "id",
        "id,camera,x0,y0,x1,y1",
    );
}

#[test]
fn wrong_field_in_row() {
    refused(
        "points.csv",
        "2,middle,",
        "2,middle,abc",
        "x0",
        "not a number",
    );
    refused(
        "points.csv",
        "2,middle,",
        "2,middle,7,",
        "column 7",
        "one column too many",
    );
    refused("points.csv", "2,middle,", "2,centre,", "camera", "`centre`");
    refused("points.csv", "2,middle,", "1,middle,", "id", "already");
}

#[test]
fn non_finite_coordinate() {
    for word in ["NaN", "nan", "inf", "-inf", "1e999"] {
        let desk = Desk::new();
        let row = format!("5,left,160,120,161,{word}\n");
        desk.write("points.csv", desk.read("points.csv") + &row);
        desk.estimate(&[])
            .failed(1, &["points.csv:17: field `y1`: ", "not a finite number"]);
    }
}

#[test]
fn point_far_outside_image() {
    let desk = Desk::new();
    desk.write(
        "points.csv",
        desk.read("points.csv") + "5,left,160,120,640.5,1\n",
    );
    desk.estimate(&["--json"])
        .failed(1, &["points.csv:17: field `x1`: ", "320 px"]);
}

#[test]
fn camera_missing_from_points() {
    let desk = Desk::new();
    keep_lines(&desk, |line| !line.contains("right"));
    desk.estimate(&["--json"])
        .failed(1, &["points.csv:11: field `camera`: ", "`right`"]);
}

#[test]
fn camera_missing_from_rig() {
    let desk = Desk::new();
    let text = desk.read("rig.toml");
    let last = text.rfind("\n[[camera]]").expect("three cameras");
    desk.write("rig.toml", &text[..last]);
    desk.estimate(&[]).failed(
        1,
        &["points.csv:4: field `camera`: ", "`right`", "left, middle"],
    );
    desk.estimate(&["--method", "closed-form"])
        .failed(1, &["rig.toml:3: field `camera`: ", "left, middle, right"]);
}

#[test]
fn rig_of_one_camera() {
    let desk = Desk::new();
    let text = desk.read("rig.toml");
    let blocks: Vec<&str> = text.split("\n[[camera]]").collect();
    desk.write("rig.toml", blocks[..2].join("\n[[camera]]"));
    desk.estimate(&[])
        .failed(1, &["rig.toml:3: field `camera`: ", "1 given", "2 to 8"]);
}

#[test]
fn impossible_number_in_rig() {
    refused(
        "rig.toml",
        "538.14",
        "-538.14",
        "camera[1].focal_px[0]",
        "greater than 0",
    );
    refused(
        "rig.toml",
        "538.14",
        "nan",
        "camera[1].focal_px[0]",
        "finite",
    );
    refused(
        "rig.toml",
        "111.18",
        "1111.8",
        "camera[1].principal_px[1]",
        "outside",
    );
    refused(
        "rig.toml",
        "[320, 240]",
        "[320, 0]",
        "image_size_px[1]",
        "out of range",
    );
    refused(
        "rig.toml",
        "[68.0,",
        "[-68.0,",
        "camera[2].offset_mm",
        "left < middle < right",
    );
}

#[test]
fn unknown_or_missing_field_in_rig() {
    refused(
        "rig.toml",
        "focal_px",
        "focal_mm",
        "camera[0].focal_mm",
        "unknown field",
    );
    let desk = Desk::new();
    desk.change("rig.toml", "image_size_px = [320, 240]\n", "");
    desk.estimate(&[])
        .failed(1, &["rig.toml:1: field `image_size_px`: ", "missing"]);
}

#[test]
fn rig_that_is_not_toml() {
    refused("rig.toml", "\"right\"", "\"right", "name", "not valid TOML");
    let desk = Desk::new();
    desk.write("rig.toml", [0xff, 0xfe, 0x00]);
    desk.estimate(&[]).failed(1, &["rig.toml:1: ", "UTF-8"]);
}

#[test]
fn empty_and_binary_points() {
    let desk = Desk::new();
    desk.write("points.csv", "");
    desk.estimate(&["--json"])
        .failed(1, &["points.csv:1: ", "empty", "id,camera,x0,y0,x1,y1"]);
    desk.write("points.csv", "id,camera,x0,y0,x1,y1\n");
    desk.estimate(&["--json"])
        .failed(1, &["points.csv", "field `camera`", "`left`"]);
    desk.write("points.csv", b"id,camera,x0,y0,x1,y1\n1,left,\xff,1,1,1\n");
    desk.estimate(&["--json"])
        .failed(1, &["points.csv:2: field `x0`: ", "UTF-8"]);
}

#[test]
fn missing_files() {
    let desk = Desk::new();
    fs::remove_file(desk.path("points.csv")).expect("it was there");
    desk.estimate(&[])
        .failed(1, &["points.csv: ", "cannot read"]);
    fs::remove_file(desk.path("rig.toml")).expect("it was there");
    desk.estimate(&[]).failed(1, &["rig.toml: ", "cannot read"]);
}

/// A rig whose offsets are multiplied by `by`.
fn scaled_rig(folder: &std::path::Path, by: f64) {
    let mut file = trinocular_rig::rig_file::RigFile::paper();
    for camera in &mut file.rig.cameras {
        camera.offset_mm = camera.offset_mm.map(|mm| mm * by);
    }
    std::fs::write(folder.join("rig.toml"), file.to_toml()).expect("it is ours");
}

#[test]
fn rig_in_another_unit_is_doubted() {
    let desk = Desk::new();
    let folder = desk.folder.path();
    let commands = [
        &["verify", "rig.toml"][..],
        &["estimate", "points.csv", "--rig", "rig.toml"],
        &["convert", "rig.toml"],
    ];
    for (by, sign, unit) in [
        (1e-3, "error: rig.toml:", "in metres?"),
        (
            0.02,
            "warning: rig.toml: the cameras are at most 2.76 mm",
            "in centimetres?",
        ),
        (
            1e3,
            "warning: rig.toml: the cameras are at most 138",
            "in micrometres?",
        ),
    ] {
        scaled_rig(folder, by);
        for command in commands {
            let said = run(folder, command).stderr;
            assert!(
                said.contains(sign) && said.contains(unit),
                "{command:?}: {said}"
            );
        }
    }
    scaled_rig(folder, 1.0);
    for command in commands {
        let said = run(folder, command).stderr;
        assert!(!said.contains("warning"), "{command:?}: {said}");
    }
}
