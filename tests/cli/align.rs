//! `align`: images of a poster, taken with principal points that differ from those of the rig file.

use std::fs;
use std::path::Path;

use serde_json::Value;
use trinocular_core::rig::Rig;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::folder;
use trinocular_vision::images::{FrameSet, Image, Scene, SceneSettings, Texture};

use super::{Desk, Outcome, run};

/// Errors of the principal points across the line of cameras, left, middle and right, px. All of
/// them can be found.
const OFF_PX: [f64; 3] = [-2.6, 0.0, 1.7];

/// Error of the right principal point along the line of cameras, px. Constraint (3) shows only the
/// part that is not common to all disparities.
const ALONG_PX: f64 = 1.0;

/// Returns a desk with two frame sets in `views` and a comment in its rig file, and the true
/// heights of the principal points.
fn desk() -> (Desk, [f64; 3]) {
    let desk = Desk::new();
    let mut truth = Rig::paper();
    for (camera, off) in truth.cameras.iter_mut().zip(OFF_PX) {
        camera.principal_px[1] += off;
    }
    truth.cameras[2].principal_px[0] += ALONG_PX;
    let settings = SceneSettings {
        tilt_rad: [0.1, -0.2],
        ..SceneSettings::default()
    };
    let scene = Scene::new(&truth, &Texture::blobs(3), settings).expect("a scene");
    let names = RigFile::paper().names;
    for (index, x) in [0.0, 25.0].into_iter().enumerate() {
        let capture = scene.render([x, 0.0, 0.0], 0, index as u64);
        folder::save(&desk.path("views"), &names, index, &capture).expect("the desk");
    }
    let comment = "# lens 12 mm, March\n";
    desk.write("rig.toml", comment.to_owned() + &desk.read("rig.toml"));
    let heights = [0, 1, 2].map(|k| truth.cameras[k].principal_px[1]);
    (desk, heights)
}

fn align(desk: &Desk, more: &[&str]) -> Outcome {
    let mut arguments = vec!["align", "views", "--rig", "rig.toml"];
    arguments.extend(more);
    run(desk.folder.path(), &arguments)
}

#[track_caller]
fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

#[test]
fn align_prints_offsets_and_writes_rig() {
    let (desk, heights) = desk();
    let outcome = align(&desk, &["--out", "aligned.toml"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    for part in [
        "Offsets of the principal points",
        "kept",
        "Z penalty before",
        "Z penalty after",
        "a common error of all disparities",
        "--depth",
        "aligned.toml",
    ] {
        assert!(
            outcome.stdout.contains(part),
            "`{part}`: {}",
            outcome.stdout
        );
    }
    let text = desk.read("aligned.toml");
    assert!(text.starts_with("# lens 12 mm, March\n"), "{text}");
    let aligned = RigFile::read(&desk.path("aligned.toml")).expect("a rig file");
    for (camera, height) in aligned.rig.cameras.iter().zip(heights) {
        let error = camera.principal_px[1] - height;
        assert!(error.abs() <= 0.02, "{error} px");
    }
    // A second alignment finds no offset.
    fs::copy(desk.path("aligned.toml"), desk.path("rig.toml")).expect("the desk");
    let again = &align(&desk, &["--json"]).json()[0];
    for camera in again["cameras"].as_array().expect("a list") {
        for i in 0..2 {
            let rest = number(&camera["offset_px"][i]);
            assert!(rest.abs() < 0.01, "{camera}");
        }
    }
}

#[test]
fn json_has_offsets_and_sigma() {
    let (desk, _) = desk();
    let outcome = align(&desk, &["--json"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let found = &outcome.json()[0];
    assert_eq!(found["reference"], "middle");
    assert_eq!(found["captures"], serde_json::json!([2, 2]));
    for (camera, off) in found["cameras"]
        .as_array()
        .expect("a list")
        .iter()
        .zip(OFF_PX)
    {
        let error = number(&camera["offset_px"][1]) - off;
        let sigma = number(&camera["sigma_px"][1]);
        assert!(error.abs() <= 0.02 && sigma < 0.02, "{camera}");
        assert!(error.abs() <= 4.0 * sigma, "{camera}");
    }
    let penalty = |when: &str, who: &str| number(&found["penalty"][when][who]).abs();
    let [before, after] =
        ["before_percent", "after_percent"].map(|when| penalty(when, "closed_form"));
    assert!(before > 50.0 && after < 0.1 * before, "{before} {after}");
    // Offsets that a scene reveals cost the midpoint nothing.
    assert!(penalty("before_percent", "midpoint") < 1e-6);
    assert!((0.1..0.2).contains(&penalty("tenth_px_percent", "midpoint")));
    assert_eq!(outcome.stdout, align(&desk, &["--json"]).stdout);
    let one = &align(&desk, &["--json", "--most", "1"]).json()[0];
    assert_eq!(one["captures"], serde_json::json!([1, 1]));
}

#[test]
fn existing_file_needs_force() {
    let (desk, _) = desk();
    let before = desk.read("rig.toml");
    align(&desk, &["--out", "rig.toml"]).failed(1, &["rig.toml", "exists", "--force"]);
    assert_eq!(desk.read("rig.toml"), before);
    let forced = align(&desk, &["--out", "rig.toml", "--force"]);
    assert_eq!(forced.code, Some(0), "{}", forced.stderr);
    assert_ne!(desk.read("rig.toml"), before);
    let names = fs::read_dir(desk.folder.path()).expect("the desk").count();
    assert_eq!(names, 3, "nothing is left behind");
}

#[test]
fn bad_folders_and_options_fail() {
    let (desk, _) = desk();
    for (more, part) in [
        (&["--reach", "0"][..], "--reach"),
        (&["--reach", "nan"], "--reach"),
        (&["--depth", "0"], "--depth"),
    ] {
        align(&desk, more).failed(2, &[part]);
    }
    for more in [&["--force"][..], &["--most", "0"], &["--depth", "far"]] {
        let outcome = align(&desk, more);
        assert_eq!((outcome.code, outcome.stdout.as_str()), (Some(2), ""));
    }
    let out = ["--out", "no/such/folder.toml"];
    align(&desk, &out).failed(1, &["folder.toml"]);
    let arguments = ["align", "nowhere", "--rig", "rig.toml"];
    run(desk.folder.path(), &arguments).failed(1, &["nowhere", "no such folder"]);
    let view = Path::new("views").join("right").join("000001.png");
    fs::remove_file(desk.path(view.to_str().expect("UTF-8"))).expect("it was there");
    align(&desk, &[]).failed(1, &["000001.png", "missing"]);
    let line = desk.change(
        "rig.toml",
        "principal_px = [170.59",
        "principal_px = [-170.59",
    );
    let place = format!("rig.toml:{line}: field `camera[1].principal_px[0]`: ");
    align(&desk, &[]).failed(1, &[&place, "outside"]);
}

#[test]
fn blank_images_are_refused() {
    let desk = Desk::new();
    let blank = Image {
        width: 320,
        height: 240,
        grey: vec![100; 320 * 240],
    };
    let capture = FrameSet {
        time_us: 0,
        images: vec![blank; 3],
    };
    let names = RigFile::paper().names;
    folder::save(&desk.path("views"), &names, 0, &capture).expect("the desk");
    align(&desk, &["--out", "aligned.toml"]).failed(1, &["views: ", "texture"]);
    assert!(!desk.path("aligned.toml").exists());
}

/// On images of a real scene with depth, `align` finds the errors that were put into the rig file.
#[test]
fn photographs_show_errors_of_rig_file() {
    let teddy = Path::new(env!("CARGO_MANIFEST_DIR")).join("images/teddy");
    let teddy = teddy.to_str().expect("UTF-8");
    let desk = Desk::new();
    let text = fs::read_to_string(Path::new(teddy).join("rig.toml")).expect("the rig file");
    let offsets = |text: &str| -> Vec<[f64; 2]> {
        desk.write("teddy.toml", text);
        let arguments = ["align", teddy, "--rig", "teddy.toml", "--json"];
        let outcome = run(desk.folder.path(), &arguments);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let found = &outcome.json()[0];
        let cameras = found["cameras"].as_array().expect("a list").iter();
        cameras
            .map(|camera| [0, 1].map(|i| number(&camera["offset_px"][i])))
            .collect()
    };
    let right = offsets(&text);
    // Left is 6 px too high and 3 px too far left. With equal baselines, half of the latter shows
    // in left and half in right.
    let wrong = offsets(&text.replacen("[224.5, 187.0]", "[221.5, 181.0]", 1));
    let expected = [[1.5, 6.0], [0.0, 0.0], [1.5, 0.0]];
    for ((wrong, right), expected) in wrong.iter().zip(right).zip(expected) {
        for i in 0..2 {
            let error = wrong[i] - right[i] - expected[i];
            assert!(error.abs() <= 0.02, "{error} px: {wrong:?} {right:?}");
        }
    }
}
