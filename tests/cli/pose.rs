//! `estimate` on points of targets that turn.

use std::fs;

use serde_json::Value;
use trinocular_core::rig::{Camera, Rig};
use trinocular_rig::pivot::Pivot;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::{Exposure, Pose, Scene, SceneSettings, Texture};

use super::{Desk, run};

/// Six decimals are printed.
const ROUNDED: f64 = 0.6e-6;

fn cases() -> Vec<Value> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/pose.json");
    let text = fs::read_to_string(path).expect("the reference cases are committed");
    let file: Value = serde_json::from_str(&text).expect("they are JSON");
    file["cases"].as_array().expect("a list").clone()
}

fn list(value: &Value) -> &Vec<Value> {
    value.as_array().expect("a list")
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    assert_eq!(list(value).len(), N, "{value}");
    std::array::from_fn(|i| value[i].as_f64().expect("a number"))
}

/// Returns a desk with a reference case as a user's files.
fn desk_of(case: &Value) -> Desk {
    let desk = Desk::new();
    let camera = |camera: &Value| {
        let [focal, principal] = ["focal_px", "principal_px"].map(|key| numbers(&camera[key]));
        Camera::ideal(focal, principal, numbers(&camera["offset_mm"]))
    };
    let rig = Rig {
        image_size_px: [320, 240],
        cameras: list(&case["cameras"]).iter().map(camera).collect(),
    };
    let names: Vec<String> = (1..=rig.cameras.len())
        .map(|k| format!("eye {k}"))
        .collect();
    let mut csv = String::from("id,camera,x0,y0,x1,y1\n");
    for (id, point) in list(&case["points_px"]).iter().enumerate() {
        for (name, seen) in names.iter().zip(list(point)) {
            let [x0, y0, x1, y1] = numbers(seen);
            csv += &format!("{id},{name},{x0},{y0},{x1},{y1}\n");
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

fn case(begin: &str) -> Value {
    let mut cases = cases().into_iter();
    let case = cases.find(|case| case["name"].as_str().expect("a name").starts_with(begin));
    case.expect("a case of this name")
}

fn pivot_of(case: &Value) -> String {
    let pivot: [f64; 3] = numbers(&case["truth"]["pivot_mm"]);
    pivot.map(|mm| mm.to_string()).join(",")
}

#[track_caller]
pub(super) fn assert_close(got: &Value, want: [f64; 3], bound: f64, what: &str) {
    let got: [f64; 3] = numbers(got);
    for (got, want) in got.iter().zip(want) {
        assert!(
            (got - want).abs() <= bound,
            "{what}: {got} instead of {want}"
        );
    }
}

#[test]
fn printed_pose_agrees_with_reference() {
    for case in cases() {
        let desk = desk_of(&case);
        let what = case["name"].as_str().expect("a name");
        let pivot = pivot_of(&case);
        let outcome = desk.estimate(&["--json", "--rotation", "estimate", "--pivot", &pivot]);
        assert_eq!(outcome.code, Some(0), "{what}: {}", outcome.stderr);
        assert_eq!(outcome.stderr, "", "{what}");
        let line = &outcome.json()[0];
        let expected = &case["expected"]["reweighted"];
        let displaced = numbers(&expected["displacement_mm"]);
        assert_close(&line["displacement_mm"], displaced, ROUNDED, what);
        let turned = numbers::<3>(&expected["rotation_rad"]).map(f64::to_degrees);
        assert_close(&line["rotation_deg"], turned, ROUNDED, what);
        assert_close(
            &line["pivot_mm"],
            numbers(&case["truth"]["pivot_mm"]),
            ROUNDED,
            what,
        );
        assert_eq!(line["method"], "midpoint");
    }
}

/// The true values are within a few of the stated deviations.
#[test]
fn truth_is_within_stated_sigma() {
    for case in cases() {
        let noise_px = case["noise_px"].as_f64().expect("a number");
        if noise_px == 0.0 {
            continue;
        }
        let desk = desk_of(&case);
        let pivot = pivot_of(&case);
        let line = &desk.estimate(&["--json", "--pivot", &pivot]).json()[0];
        let truth = &case["truth"];
        let turned = numbers::<3>(&truth["rotation_rad"]).map(f64::to_degrees);
        for (value, sigma, want) in [
            (
                "displacement_mm",
                "sigma_mm",
                numbers(&truth["displacement_mm"]),
            ),
            ("rotation_deg", "rotation_sigma_deg", turned),
        ] {
            let (got, sigma) = (numbers::<3>(&line[value]), numbers::<3>(&line[sigma]));
            for axis in 0..3 {
                let off = (got[axis] - want[axis]).abs() / sigma[axis];
                assert!(off < 3.5, "{}: {value} {off} sigma", case["name"]);
            }
        }
    }
}

#[test]
fn centroid_is_pivot_by_default() {
    let case = case("06");
    let desk = desk_of(&case);
    let alone = desk.estimate(&["--json"]);
    assert_eq!(
        alone.stdout,
        desk.estimate(&["--json", "--pivot", "centroid"]).stdout
    );
    let pivot = numbers(&case["truth"]["pivot_mm"]);
    assert_close(&alone.json()[0]["pivot_mm"], pivot, 1e-3, "centroid");
}

#[test]
fn pivot_with_negative_numbers_is_accepted() {
    let desk = desk_of(&case("02"));
    for pivot in ["--pivot=-10,-5.5,850", "--pivot=-10, -5.5, 850"] {
        let line = &desk.estimate(&["--json", pivot]).json()[0];
        assert_close(&line["pivot_mm"], [-10.0, -5.5, 850.0], 0.0, pivot);
    }
    let line = &desk.estimate(&["--json", "--pivot", "-10,-5.5,850"]).json()[0];
    // Five degrees about z, and (5, 5, -5) mm at (84, 41) mm.
    let arm = [-10.0 - 84.135, -5.5 - 41.176];
    let (sine, cosine) = 5.0f64.to_radians().sin_cos();
    let turned = [
        5.0 + (cosine - 1.0) * arm[0] - sine * arm[1],
        5.0 + sine * arm[0] + (cosine - 1.0) * arm[1],
        -5.0,
    ];
    assert_close(&line["displacement_mm"], turned, 1e-6, "pivot");
}

#[test]
fn turn_is_printed_below_its_row() {
    let desk = desk_of(&case("12"));
    let outcome = desk.estimate(&[]);
    let lines: Vec<&str> = outcome.stdout.lines().collect();
    assert_eq!(lines.len(), 3, "{}", outcome.stdout);
    assert!(lines[2].contains("turned by"), "{}", outcome.stdout);
    // A target that did not turn has no such line.
    let still = desk_of(&case("10")).estimate(&[]).stdout;
    assert_eq!(still.lines().count(), 2, "{still}");
}

#[test]
fn turned_target_is_refused_on_demand() {
    let desk = desk_of(&case("12"));
    let outcome = desk.estimate(&["--json", "--rotation", "refuse"]);
    assert_eq!(outcome.code, Some(1));
    let reason = outcome.json()[0]["refused"].as_str().map(str::to_owned);
    let reason = reason.expect("a reason");
    assert!(reason.contains("turns by 9.7"), "{reason}");
    assert!(reason.contains("--rotation estimate"), "{reason}");
    // A row that does not fit changes nothing.
    let text = desk.read("points.csv");
    let row = text.lines().nth(1).expect("a row");
    let (start, y1) = row.rsplit_once(',').expect("columns");
    let y1: f64 = y1.parse().expect("a number");
    desk.write(
        "points.csv",
        text.replace(row, &format!("{start},{}", y1 + 6.0)),
    );
    let outcome = desk.estimate(&["--json", "--rotation", "refuse"]);
    assert_eq!(outcome.code, Some(1), "{}", outcome.stderr);
    let reason = outcome.json()[0]["refused"].as_str().map(str::to_owned);
    let reason = reason.expect("a reason");
    assert!(reason.contains("turns by 9.7"), "{reason}");
    assert!(reason.contains("unless the rows"), "{reason}");
    // A method without rotation warns.
    let desk = desk_of(&case("16"));
    let outcome = desk.estimate(&["--json", "--method", "midpoint"]);
    assert_eq!(outcome.code, Some(0));
    assert!(
        outcome.stderr.contains("warning: the target turns by"),
        "{}",
        outcome.stderr
    );
    assert!(outcome.json()[0]["rotation_deg"].is_null());
    // One that does not turn is measured.
    let outcome = desk_of(&case("10")).estimate(&["--json", "--rotation", "refuse"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stdout);
}

#[test]
fn undetermined_rotation_is_named() {
    let desk = Desk::new();
    // The header, and two points of three cameras.
    let two: Vec<String> = desk
        .read("points.csv")
        .lines()
        .take(7)
        .map(str::to_owned)
        .collect();
    desk.write("points.csv", two.join("\n"));
    let outcome = desk.estimate(&["--json"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(
        outcome.stderr.contains("does not turn"),
        "{}",
        outcome.stderr
    );
    let line = &outcome.json()[0];
    assert_close(
        &line["displacement_mm"],
        [1.0, 0.0, 0.0],
        1e-6,
        "two points",
    );
    for key in ["rotation_deg", "rotation_sigma_deg", "pivot_mm"] {
        assert!(line[key].is_null() && line.get(key).is_some(), "{line}");
    }
    let refused = desk.estimate(&["--json", "--rotation", "estimate"]);
    assert_eq!(refused.code, Some(1));
    assert!(refused.stdout.contains("at least 3"), "{}", refused.stdout);
    assert!(
        refused.stdout.contains("--rotation refuse"),
        "{}",
        refused.stdout
    );
}

/// Writes rendered frame sets of a poster with these displacements and rotations.
pub(super) fn desk_of_images(poses: &[Pose]) -> Desk {
    let (desk, rig) = (Desk::new(), Rig::paper());
    let scene = Scene::new(&rig, &Texture::natural(3), SceneSettings::default());
    let scene = scene.expect("a scene in range");
    for (number, pose) in poses.iter().enumerate() {
        let exposures = [Exposure::of(*pose, 2.0); 3];
        let seen = scene.render_exposures(&exposures, 0, number as u64);
        for (name, image) in ["left", "middle", "right"].iter().zip(&seen.images) {
            fs::create_dir_all(desk.path("views").join(name)).expect("a folder");
            let mut pgm = format!("P5\n{} {}\n255\n", image.width, image.height).into_bytes();
            pgm.extend_from_slice(&image.grey);
            desk.write(&format!("views/{name}/{number}.pgm"), pgm);
        }
    }
    desk
}

#[test]
fn images_of_turning_target_are_measured() {
    let pose = |relative_mm, turned_deg| Pose {
        relative_mm,
        turned_deg,
    };
    let (small, large) = ([0.3, 0.2, -0.4], [2.0, -5.0, 9.0]);
    let desk = desk_of_images(&[
        Pose::default(),
        pose([3.0, -4.0, 5.0], small),
        pose([-6.0, 2.0, -8.0], large),
    ]);
    let estimate = |more: &[&str]| {
        let words = ["estimate", "views", "--rig", "rig.toml", "--json"];
        run(desk.folder.path(), &[&words[..], more].concat())
    };
    let outcome = estimate(&["--rotation", "estimate", "--pivot", "0,0,850"]);
    assert_eq!(
        outcome.code,
        Some(0),
        "{}{}",
        outcome.stdout,
        outcome.stderr
    );
    let lines = outcome.json();
    let moved = [[3.0, -4.0, 5.0], [-6.0, 2.0, -8.0]];
    for ((line, moved), turned) in lines.iter().zip(moved).zip([small, large]) {
        assert_close(&line["displacement_mm"], moved, 0.03, "displacement");
        assert_close(&line["rotation_deg"], turned, 0.02, "rotation");
        let sigma: [f64; 3] = numbers(&line["rotation_sigma_deg"]);
        assert!(sigma.iter().all(|deg| *deg > 0.0 && *deg < 0.01), "{line}");
    }
    // The pivot is that of the keyframe for all frames.
    let lines = estimate(&["--rotation", "estimate"]).json();
    assert_eq!(lines[0]["pivot_mm"], lines[1]["pivot_mm"]);
    // That is the default; a turn can be refused.
    assert_eq!(estimate(&[]).json(), lines);
    let refused = estimate(&["--rotation", "refuse"]);
    assert_eq!(refused.code, Some(1), "{}", refused.stdout);
}

#[test]
fn contradicting_options_exit_2() {
    let desk = Desk::new();
    for (options, part) in [
        (
            &["--rotation", "estimate", "--method", "closed-form"][..],
            "midpoint",
        ),
        (
            &["--rotation", "refuse", "--pivot", "1,2,3"],
            "--rotation estimate",
        ),
        (
            &["--method", "midpoint", "--pivot", "1,2,3"],
            "--rotation estimate",
        ),
        (&["--pivot", "1,2"], "12.5,-8,850"),
        (&["--pivot", "laser"], "centroid"),
        (&["--rotation", "perhaps"], "refuse"),
    ] {
        let outcome = desk.estimate(options);
        assert_eq!(
            (outcome.code, outcome.stdout.as_str()),
            (Some(2), ""),
            "{options:?}"
        );
        assert!(outcome.stderr.contains(part), "{}", outcome.stderr);
    }
}

/// Follows the images of a target that turns; returns the rows.
#[track_caller]
fn track(desk: &Desk, options: &[&str]) -> Vec<Value> {
    let words = ["track", "--images", "views", "--rig", "rig.toml", "--json"];
    let outcome = run(desk.folder.path(), &[&words[..], options].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    outcome.json()
}

#[test]
fn track_follows_pivot_of_turning_target() {
    let pose = |relative_mm, turned_deg| Pose {
        relative_mm,
        turned_deg,
    };
    let moved = [[1.0, -2.0, 1.0], [2.0, -3.0, 3.0]];
    let turned = [[0.5, 1.0, -0.5], [1.0, 3.0, -2.0]];
    let desk = desk_of_images(&[
        Pose::default(),
        pose(moved[0], turned[0]),
        pose(moved[1], turned[1]),
    ]);
    let options = ["--rotation", "estimate", "--pivot", "0,0,850"];
    let recorded = [&options[..], &["--record", "run.mcap"]].concat();
    let rows = track(&desk, &recorded);
    for ((row, moved), turned) in rows.iter().zip(moved).zip(turned) {
        assert_close(&row["displacement_mm"], moved, 0.03, "displacement");
        assert_close(&row["rotation_deg"], turned, 0.02, "rotation");
        assert_close(&row["pivot_mm"], [0.0, 0.0, 850.0], 0.0, "pivot");
        let sigma: [f64; 3] = numbers(&row["rotation_sigma_deg"]);
        assert!(sigma.iter().all(|deg| *deg > 0.0 && *deg < 0.01), "{row}");
    }
    // The recording is measured again with the same pivot, bit for bit.
    let replayed = run(desk.folder.path(), &["replay", "run.mcap"]);
    assert_eq!(
        replayed.code,
        Some(0),
        "{}{}",
        replayed.stdout,
        replayed.stderr
    );
    // The columns of a rotation come last, and only with one.
    let csv = |options: &[&str]| {
        let words = ["track", "--images", "views", "--rig", "rig.toml", "--csv"];
        run(desk.folder.path(), &[&words[..], options].concat()).stdout
    };
    let header = |text: String| text.lines().next().unwrap_or_default().to_owned();
    assert!(
        header(csv(&options)).ends_with("rotation_sigma_z_deg,pivot_x_mm,pivot_y_mm,pivot_z_mm")
    );
    assert!(!header(csv(&["--rotation", "refuse"])).contains("rotation"));
    // The rig file can say the same.
    let plain = desk.read("rig.toml");
    let lines = "rotation = \"estimate\"\npivot = [0, 0, 850]\n";
    desk.write("rig.toml", lines.to_owned() + &plain);
    assert_eq!(track(&desk, &[])[1], rows[1]);
    let words = ["track", "--images", "views", "--rig", "rig.toml", "--json"];
    let refused = |options: &[&str]| {
        let outcome = run(desk.folder.path(), &[&words[..], options].concat());
        let reason = outcome.json()[1]["refused"].as_str().map(str::to_owned);
        reason.is_some_and(|reason| reason.contains("turn"))
    };
    desk.write("rig.toml", "rotation = \"refuse\"\n".to_owned() + &plain);
    assert!(refused(&[]));
    // Without any choice the rotation is estimated about the centroid, unless the method knows
    // none.
    desk.write("rig.toml", plain);
    let by_default = track(&desk, &[]);
    assert_close(&by_default[1]["rotation_deg"], turned[1], 0.02, "rotation");
    assert!(refused(&["--method", "closed-form"]));
}

#[test]
fn track_refuses_pivot_without_rotation() {
    let desk = desk_of_images(&[Pose::default(), Pose::default()]);
    let words = ["track", "--images", "views", "--rig", "rig.toml"];
    for (options, part) in [
        (
            &["--rotation", "refuse", "--pivot", "0,0,850"][..],
            "--rotation estimate",
        ),
        (
            &["--pivot", "0,0,850", "--method", "closed-form"],
            "midpoint",
        ),
        (
            &["--rotation", "estimate", "--method", "closed-form"],
            "midpoint",
        ),
    ] {
        let outcome = run(desk.folder.path(), &[&words[..], options].concat());
        assert_eq!(outcome.code, Some(2), "{}", outcome.stderr);
        assert!(outcome.stderr.contains(part), "{}", outcome.stderr);
    }
}
