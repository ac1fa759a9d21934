//! `verify`: its output, and its messages about impossible rigs and options.

use serde_json::Value;

use super::{Desk, Outcome, run};

pub(super) const STAGE: &str = "
[stage]
steps_per_mm = [80.0, 80.0, 400.0]
max_speed_mm_s = [100.0, 100.0, 20.0]
max_acceleration_mm_s2 = [2000.0, 2000.0, 500.0]
max_jerk_mm_s3 = [50000.0, 50000.0, 20000.0]
travel_mm = [[-60.0, 60.0], [-60.0, 60.0], [0.0, 60.0]]
invert = [false, false, false]
matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
driver = \"TMC2209\"
";

/// Returns a desk whose rig has a stage.
fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("rig.toml", desk.read("rig.toml") + STAGE);
    desk
}

fn verify(desk: &Desk, more: &[&str]) -> Outcome {
    let mut arguments = vec!["verify", "rig.toml"];
    arguments.extend(more);
    run(desk.folder.path(), &arguments)
}

/// Returns the names of the limitations of one severity.
fn named(found: &Value, severity: &str) -> Vec<String> {
    let all = found["limitations"].as_array().expect("a list").iter();
    all.filter(|limit| limit["severity"] == severity)
        .map(|limit| limit["name"].as_str().expect("a name").to_owned())
        .collect()
}

#[test]
fn good_rig_is_described() {
    let desk = desk();
    let outcome = verify(&desk, &["--report", "rig.html"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert_eq!(outcome.stderr, "");
    for part in [
        "Predicted sigma X Y Z",
        "200 points",
        "working volume",
        "stop, mm",
        "silent host, mm",
        "bits left",
        "fixed point works",
        "1000000 words/s",
    ] {
        assert!(
            outcome.stdout.contains(part),
            "`{part}`: {}",
            outcome.stdout
        );
    }
    let page = desk.read("rig.html");
    assert!(page.contains("<svg") && page.contains("Sigma Z"));
    let again = verify(&desk, &[]);
    assert_eq!(again.stdout, outcome.stdout);
}

#[test]
fn json_has_every_prediction() {
    let desk = desk();
    let more = [
        "--json",
        "--noise",
        "0.1",
        "--points",
        "10,40",
        "--depth-range",
        "700",
        "900",
    ];
    let outcome = verify(&desk, &more);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let found = &outcome.json()[0];
    assert_eq!(found["settings"]["points"], serde_json::json!([10, 40]));
    let depths = found["depths"].as_array().expect("a list");
    assert_eq!(depths[0]["depth_mm"], 700.0);
    let sigma = |points: usize, axis: usize| {
        let value = &depths[0]["sigma_mm"][points][axis];
        value.as_f64().expect("a number")
    };
    // Four times the points give half the sigma, and a little more because windows overlap.
    let gain = sigma(0, 2) / sigma(1, 2);
    assert!((1.7..2.0).contains(&gain), "{gain}");
    assert!(sigma(0, 2) > 3.0 * sigma(0, 0));
    let axes = found["drive"]["axes"].as_array().expect("a list");
    assert_eq!(axes[2]["steps_per_s"], 8000.0);
    assert!(axes[0]["silence_mm"].as_f64() > axes[0]["stop_mm"].as_f64());
    assert!(found["volume"]["two_see_l"].as_f64() > found["volume"]["all_see_l"].as_f64());
    let rooms = found["headroom"]["rooms"].as_array().expect("a list");
    assert!(
        rooms
            .iter()
            .all(|room| room["bits_left"].as_f64() > Some(0.0))
    );
}

#[test]
fn limitations_are_named() {
    let desk = desk();
    desk.change("rig.toml", "[0.0, 60.0]]", "[0.0, 1.0]]");
    desk.change("rig.toml", "[-70.0,", "[-2.0,");
    desk.change("rig.toml", "[68.0,", "[2.0,");
    let outcome = verify(&desk, &["--json", "--noise", "2"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let names = named(&outcome.json()[0], "warning");
    for name in ["stage.max_speed_mm_s[2]", "sigma Z", "a1 b2 - a2 b1"] {
        assert!(names.iter().any(|n| n == name), "{name}: {names:?}");
    }
    desk.change("rig.toml", "[-2.0,", "[-400.0,");
    let names = named(&verify(&desk, &["--json"]).json()[0], "warning");
    assert!(names.iter().any(|n| n == "camera.offset_mm"), "{names:?}");
}

/// No sigma is stated for points that the matching drops.
#[test]
fn unmatched_points_get_no_sigma() {
    let desk = Desk::new();
    desk.change("rig.toml", "[-70.0,", "[-1.0,");
    desk.change("rig.toml", "[68.0,", "[1.0,");
    let outcome = verify(&desk, &["--json"]);
    let found = &outcome.json()[0];
    // 533.3 px of focal length on the mean and 1 mm: one pixel at 533.3 mm.
    for at in found["depths"].as_array().expect("a list") {
        let depth = at["depth_mm"].as_f64().expect("a number");
        let is_empty = at["sigma_mm"].as_array().expect("a list").is_empty();
        assert_eq!(is_empty, depth > 533.33, "{at}");
    }
    assert!((found["volume"]["to_mm"].as_f64().expect("a number") - 533.3).abs() < 0.1);
    let screen = verify(&desk, &[]).stdout;
    for part in [
        "not matched",
        "300 to 533 mm",
        "points beyond 533 mm are not matched",
    ] {
        assert!(screen.contains(part), "`{part}`: {screen}");
    }
    // Half of 320 px apart at 300 mm.
    desk.change("rig.toml", "[-1.0,", "[-140.0,");
    let screen = verify(&desk, &["--depth-range", "200", "2000"]).stdout;
    assert!(
        screen.contains("warning: image_size_px: points nearer than"),
        "{screen}"
    );
}

/// A focal length 1.3 times as long is still matched well enough, twice as long is not. A narrow
/// strip of an image holds only some points.
#[test]
fn unlike_lenses_are_named() {
    let desk = Desk::new();
    let warned = |desk: &Desk| {
        let found = verify(desk, &["--json"]).json().remove(0);
        named(&found, "warning")
    };
    desk.change("rig.toml", "533.16, 529.12", "690.0, 690.0");
    assert!(!warned(&desk).contains(&"camera.focal_px".to_owned()));
    desk.change("rig.toml", "690.0, 690.0", "1070.0, 1070.0");
    assert!(warned(&desk).contains(&"camera.focal_px".to_owned()));
    let screen = verify(&desk, &[]).stdout;
    assert!(
        screen.contains("left and middle differ 2.00 times"),
        "{screen}"
    );

    let desk = Desk::new();
    let depths = ["--json", "--depth-range", "260", "262"];
    let found = verify(&desk, &[&depths[..], &["--points", "200,4000"]].concat())
        .json()
        .remove(0);
    let at = &found["depths"][0];
    let room = at["room_for"].as_u64().expect("a number");
    assert!((60..150).contains(&room), "{at}");
    assert_eq!(at["sigma_mm"][0], at["sigma_mm"][1], "{at}");
    let notes = found["limitations"].to_string();
    assert!(
        notes.contains("points have room in the common view"),
        "{notes}"
    );
}

/// Z is never stated as more accurate than X, and no sigma has sixteen digits.
#[test]
fn extreme_angles_give_true_text() {
    let desk = Desk::new();
    for focal in ["533.16, 529.12", "538.14, 534.18", "534.55, 530.76"] {
        desk.change("rig.toml", focal, "20.0, 20.0");
    }
    let screen = verify(&desk, &["--noise", "3"]).stdout;
    assert!(screen.contains("the station's gate of 0.2 mm"), "{screen}");
    assert!(!screen.contains("times less certain"), "{screen}");
}

#[test]
fn stage_that_station_refuses_exits_1() {
    let desk = desk();
    desk.change("rig.toml", "TMC2209", "DRV8825");
    let outcome = verify(&desk, &[]);
    assert_eq!(outcome.code, Some(1));
    outcome.complained(&["rig.toml: ", "stage.driver", "step_high_ns", "1900 ns"]);
    assert!(outcome.stdout.contains("520000"), "{}", outcome.stdout);
    desk.change("rig.toml", "DRV8825", "A4988");
    desk.change("rig.toml", "100.0, 20.0]", "100.0, 2000.0]");
    let outcome = verify(&desk, &["--json"]);
    assert_eq!(outcome.code, Some(1));
    outcome.complained(&["stage.max_speed_mm_s[2]", "must be at most 1250"]);
    assert_eq!(
        named(&outcome.json()[0], "refusal"),
        ["stage.max_speed_mm_s[2]"]
    );
    // The stated heartbeat timeout stays above zero.
    desk.change("rig.toml", "[[1.0, 0.0, 0.0]", "[[5.0, 0.0, 0.0]");
    let screen = verify(&desk, &[]).stdout;
    assert!(screen.contains("matrix[0][0]"), "{screen}");
    assert!(screen.contains("may be silent for 100 ms"), "{screen}");
}

#[test]
fn other_rigs_are_verified() {
    let desk = Desk::new();
    let text = desk.read("rig.toml");
    let last = text.rfind("\n[[camera]]").expect("three cameras");
    desk.write("rig.toml", &text[..last]);
    let outcome = verify(&desk, &["--json"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let found = &outcome.json()[0];
    assert!(found["drive"].is_null());
    assert!(found["headroom"]["closed_form_to_mm"].is_null());
    assert_eq!(named(found, "note")[0], "camera");
}

#[test]
fn cameras_without_overlap_are_named() {
    let desk = Desk::new();
    desk.change("rig.toml", "[68.0,", "[9000.0,");
    let outcome = verify(&desk, &["--json"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let found = &outcome.json()[0];
    assert!(found["volume"]["from_mm"].is_null());
    assert!(found["headroom"].is_null());
    let text = verify(&desk, &[]).stdout;
    assert!(
        text.contains("and right have no common view between 300 and 2000 mm"),
        "{text}"
    );
}

#[test]
fn bad_rigs_and_options_fail() {
    let desk = desk();
    for (more, part) in [
        (&["--noise", "0"][..], "--noise"),
        (&["--noise", "nan"], "--noise"),
        (&["--depth-range", "900", "700"], "--depth-range"),
        (&["--depth-range", "0", "700"], "--depth-range"),
    ] {
        verify(&desk, more).failed(2, &[part]);
    }
    for more in [
        &["--points", "0"][..],
        &["--points", "many"],
        &["--depth-range", "7"],
    ] {
        let outcome = verify(&desk, more);
        assert_eq!((outcome.code, outcome.stdout.as_str()), (Some(2), ""));
    }
    verify(&desk, &["--report", "no/such/folder.html"]).failed(1, &["folder.html"]);
    let line = desk.change("rig.toml", "[100.0, 100.0, 20.0]", "[100.0, 100.0, -20.0]");
    let place = format!("rig.toml:{line}: field `stage.max_speed_mm_s[2]`: ");
    verify(&desk, &["--json"]).failed(1, &[&place, "greater than 0"]);
    run(desk.folder.path(), &["verify", "none.toml"]).failed(1, &["none.toml", "cannot read"]);
}

#[test]
fn absurd_lens_is_refused_by_field() {
    for focal in ["1e-308", "0.5", "1e7"] {
        let desk = desk();
        let line = desk.change("rig.toml", "533.16", focal);
        let place = format!("rig.toml:{line}: field `camera[0].focal_px[0]`");
        verify(&desk, &[]).failed(1, &[&place, "out of range"]);
    }
    let desk = desk();
    desk.change("rig.toml", "-70.0", "-0.01");
    verify(&desk, &[]).failed(1, &["rig.toml:", "camera[1].offset_mm", "0.1 mm apart"]);
}

#[test]
fn home_switch_inside_travel_is_doubted() {
    let desk = desk();
    let with_switch = |position_mm: &str| {
        let stage = format!(
            "{STAGE}home_switch = [\"negative\", \"positive\", \"none\"]\n\
             home_position_mm = {position_mm}\n"
        );
        desk.write(
            "rig.toml",
            trinocular_rig::rig_file::RigFile::paper().to_toml() + &stage,
        );
        named(&verify(&desk, &["--json"]).good_json()[0], "warning")
    };
    let doubted = |warnings: &[String], axis: usize| {
        let name = format!("stage.home_position_mm[{axis}]");
        warnings.contains(&name)
    };
    let outside = with_switch("[-61, 61, 0]");
    assert!(
        !doubted(&outside, 0) && !doubted(&outside, 1),
        "{outside:?}"
    );
    let inside = with_switch("[-50, 61, 0]");
    assert!(doubted(&inside, 0) && !doubted(&inside, 1), "{inside:?}");
    let inside = with_switch("[-61, 20, 0]");
    assert!(!doubted(&inside, 0) && doubted(&inside, 1), "{inside:?}");
}

#[test]
fn prediction_that_is_off_is_named() {
    let desk = desk();
    let name = "stage.prediction".to_owned();
    let found = verify(&desk, &["--json"]).good_json();
    assert!(!named(&found[0], "warning").contains(&name));
    desk.write("rig.toml", desk.read("rig.toml") + "prediction = false\n");
    let found = verify(&desk, &["--json"]).good_json();
    assert!(named(&found[0], "warning").contains(&name), "{found:?}");
    assert!(verify(&desk, &[]).stdout.contains("lost steps"));
}

#[test]
fn rotation_of_stated_target_is_predicted() {
    let desk = desk();
    let lines = "rotation = \"estimate\"\npivot = \"spot\"\n";
    let laser = "[laser]\nfrom_mm = [20, 40, 0]\ndirection = [0, -0.05, 1]\n";
    desk.write(
        "rig.toml",
        format!("{lines}{}{laser}", desk.read("rig.toml")),
    );
    let words = ["--depth-range", "800", "1600", "--points", "2,100"];
    let target = |size: &str| {
        let outcome = verify(&desk, &[&words[..], &["--target", size, "--json"]].concat());
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        outcome.json()[0].clone()
    };
    let [small, large] = ["100,75", "200,150"].map(target);
    assert_eq!(
        large["settings"]["target_mm"],
        serde_json::json!([200.0, 150.0])
    );
    let at = |found: &Value| found["depths"][0]["rotation"].clone();
    let sigma = |found: &Value| {
        let rotation = &at(found)["rotation_sigma_deg"];
        assert!(rotation[0].is_null(), "two points");
        [0, 1, 2].map(|i| rotation[1][i].as_f64().expect("a number"))
    };
    // With the inverse square of the size about x and y, with the inverse size about z, and more
    // where the windows of a small target overlap.
    let [small_x, _, small_z] = sigma(&small);
    let [large_x, _, large_z] = sigma(&large);
    assert!(
        (3.0..6.0).contains(&(small_x / large_x)),
        "{small_x} {large_x}"
    );
    assert!(
        (1.9..4.0).contains(&(small_z / large_z)),
        "{small_z} {large_z}"
    );
    let spot = &at(&large)["pivots"][3];
    assert_eq!(spot["name"], "spot");
    assert_eq!(spot["place_mm"], serde_json::json!([20.0, 0.0, 800.0]));
    let outcome = verify(&desk, &[&words[..], &["--report", "rig.html"]].concat());
    for part in ["rotation about x, y, z, degrees", "100 mm beside", "spot"] {
        assert!(
            outcome.stdout.contains(part),
            "`{part}`: {}",
            outcome.stdout
        );
        assert!(desk.read("rig.html").contains(part), "`{part}`");
    }
    for wrong in ["0,100", "100", "100,nan", "1,2,3"] {
        verify(&desk, &["--target", wrong]).failed(2, &["--target takes width and height"]);
    }
}
