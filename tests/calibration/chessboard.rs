//! Images of a real board, calibrated here and by OpenCV (`images/chessboard/opencv.json`).

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::{Outcome, numbers, run};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("images/chessboard")
}

fn calibrate(more: &[&str]) -> Outcome {
    let mut arguments = vec![
        "calibrate",
        ".",
        "--board",
        "9x6",
        "--square",
        "25",
        "--json",
    ];
    arguments.extend(more);
    run(&folder(), &arguments)
}

/// Returns OpenCV's results for corners refined within `half` px.
fn opencv(half: &str) -> Value {
    let text = fs::read_to_string(folder().join("opencv.json")).expect("the reference figures");
    let all: Value = serde_json::from_str(&text).expect("JSON");
    all["half_windows"][half].clone()
}

/// Checks that every focal length and principal point agrees within `share` standard deviations of
/// either result, and the distortion within twice as many.
#[track_caller]
fn assert_agree(ours: &Value, theirs: &Value, share: f64) {
    for (key, sigma, share) in [
        ("focal_px", "focal_sigma_px", share),
        ("principal_px", "principal_sigma_px", share),
        ("distortion", "distortion_sigma", 2.0 * share),
    ] {
        let sigmas = numbers(ours, sigma).into_iter().zip(numbers(theirs, sigma));
        let values = numbers(ours, key).into_iter().zip(numbers(theirs, key));
        for ((a, b), (own, other)) in values.zip(sigmas) {
            let bound = share * own.min(other);
            assert!(
                (a - b).abs() <= bound,
                "{} {key}: {a} and {b}, bound {bound}",
                ours["camera"]
            );
        }
    }
}

fn used(camera: &Value) -> usize {
    let images = camera["images"].as_array().expect("a list of images");
    images
        .iter()
        .filter(|image| image["rms_px"].is_f64())
        .count()
}

#[test]
fn calibration_agrees_with_opencv() {
    let lines = calibrate(&[]).good_json();
    let reference = opencv("5");
    assert_eq!(lines.len(), 3);
    for (camera, name) in lines.iter().zip(["left", "right"]) {
        assert_eq!(camera["camera"], name);
        assert_eq!(used(camera), 13, "{camera}");
        let theirs = &reference[name];
        assert_agree(camera, theirs, 1.0);
        let [own, other] = [camera, theirs].map(|c| c["rms_px"].as_f64().expect("a number"));
        assert!(own <= 1.02 * other, "{name}: {own} px, OpenCV's {other} px");
    }
    let rig = &lines[2]["rig"];
    let right = &rig["cameras"][1];
    let own = |key: &str| right[key].as_f64().expect("a number");
    let theirs = &reference["rig"];
    let expected = theirs["baseline_mm"].as_f64().expect("a number");
    assert!(
        (own("baseline_mm") - expected).abs() <= own("baseline_sigma_mm"),
        "{rig}"
    );
    let own_rms = rig["rms_px"].as_f64().expect("a number");
    assert!(
        own_rms <= 1.02 * theirs["rms_px"].as_f64().expect("a number"),
        "{rig}"
    );
}

/// With OpenCV's window the corners are OpenCV's, and the same corners give the same camera but for
/// rounding.
#[test]
fn same_window_gives_same_result() {
    for half in ["5", "11"] {
        let lines = calibrate(&["--window", half, "--outlier", "99"]).good_json();
        let reference = opencv(half);
        for (camera, name) in lines.iter().zip(["left", "right"]) {
            let theirs = &reference[name];
            assert_eq!(used(camera), 13, "{camera}");
            assert_agree(camera, theirs, 0.05);
            let images = camera["images"].as_array().expect("a list of images");
            for image in images {
                let file = image["file"].as_str().expect("a name");
                let expected = theirs["images"][file].as_f64().expect("a number");
                let own = image["rms_px"].as_f64().expect("a number");
                assert!(
                    (own - expected).abs() < 0.002,
                    "{name}/{file}: {own} and {expected} px"
                );
            }
        }
    }
}

/// The large window includes the board's border on some images; exactly these are rejected.
#[test]
fn large_residuals_are_rejected_by_name() {
    let lines = calibrate(&["--window", "11"]).good_json();
    let rejected = |camera: &Value| -> Vec<String> {
        let images = camera["images"].as_array().expect("a list of images");
        let reason = |image: &Value| {
            Some((
                image["file"].as_str()?.to_owned(),
                image["rejected"].as_str()?.to_owned(),
            ))
        };
        let all: Vec<(String, String)> = images.iter().filter_map(reason).collect();
        assert!(
            all.iter()
                .all(|(_, reason)| reason.contains("times the median image's")),
            "{all:?}"
        );
        all.into_iter().map(|(file, _)| file).collect()
    };
    assert_eq!(rejected(&lines[0]), ["02.jpg"]);
    assert_eq!(rejected(&lines[1]), ["02.jpg", "05.jpg"]);
    let left_out = |instant: &Value| {
        instant["left_out"]
            .is_string()
            .then(|| instant["name"].clone())
    };
    let instants = lines[2]["rig"]["instants"].as_array().expect("a list");
    assert_eq!(
        instants.iter().filter_map(left_out).collect::<Vec<_>>(),
        ["02", "05"]
    );
}

#[test]
fn wrong_board_is_reported() {
    let outcome = run(
        &folder(),
        &["calibrate", ".", "--board", "8x6", "--square", "25"],
    );
    outcome.failed_after_notes(
        1,
        &[
            "camera `left`",
            "0 of 13 images",
            "01.jpg, 02.jpg, 03.jpg, ",
            "14.jpg: a grid of 9 x 6 inner corners",
        ],
    );
    let outcome = run(
        &folder(),
        &["calibrate", ".", "--board", "10x7", "--square", "25"],
    );
    outcome.failed_after_notes(
        1,
        &[
            "camera `left`",
            "0 of 13 images",
            "01.jpg, 02.jpg, 03.jpg, ",
            "14.jpg: a grid of 9 x 6 inner corners",
        ],
    );
    for (board, square) in [
        ("9x", "25"),
        ("9x6", "0"),
        ("9x6", "-25"),
        ("9x6", "nan"),
        ("2x6", "25"),
    ] {
        let outcome = run(
            &folder(),
            &["calibrate", ".", "--board", board, "--square", square],
        );
        outcome.failed_after_notes(2, &["invalid value"]);
    }
}
