//! Several targets in one view: two posters side by side, each measured by itself, one against the
//! other, and one followed by the stage.

use std::fs;

use super::folder::grey_levels;
use super::{Desk, Outcome, run};
use serde_json::Value;
use trinocular_core::rig::Rig;

/// First column of the right poster in every image, px.
const EDGE_PX: usize = 160;

/// Place of the right poster's texture, mm.
const ELSEWHERE_MM: f64 = 700.0;

const TARGETS: &str = "\n[[target]]\nname = \"deck\"\nroi = [75, 10, 65, 220]\n\n[[target]]\n\
                       name = \"pier\"\nroi = [215, 10, 60, 220]\n";

/// Displacements of both posters in each frame set, mm.
const MOVED_MM: [[[f64; 3]; 2]; 3] = [
    [[0.0; 3]; 2],
    [[1.0, -0.5, 0.4], [-0.6, 0.8, -0.3]],
    // The rig has moved: both by the same more.
    [[1.4, -0.1, 0.7], [-0.2, 1.2, 0.0]],
];

/// Returns a desk with a folder `views` and two rig files: `rig.toml` and `against.toml`, in which
/// the pier is the reference.
fn desk() -> Desk {
    let desk = Desk::new();
    let rig = Rig::paper();
    let [width, height] = rig.image_size_px;
    for (name, camera) in ["left", "middle", "right"].iter().zip(&rig.cameras) {
        fs::create_dir_all(desk.path("views").join(name)).expect("the desk can be written to");
        for (number, [deck_mm, pier_mm]) in MOVED_MM.into_iter().enumerate() {
            let elsewhere_mm = [pier_mm[0] + ELSEWHERE_MM, pier_mm[1], pier_mm[2]];
            let deck = grey_levels(camera, rig.image_size_px, deck_mm);
            let pier = grey_levels(camera, rig.image_size_px, elsewhere_mm);
            let mut pgm = format!("P5\n{width} {height}\n255\n").into_bytes();
            let pixels = deck.iter().zip(&pier).enumerate();
            pgm.extend(pixels.map(|(at, (deck, pier))| {
                let grey = if at % width as usize >= EDGE_PX {
                    pier
                } else {
                    deck
                };
                grey.round().clamp(0.0, 255.0) as u8
            }));
            desk.write(&format!("views/{name}/{number}.pgm"), pgm);
        }
    }
    let text = fs::read_to_string(desk.path("rig.toml")).expect("a rig file") + TARGETS;
    desk.write("rig.toml", &text);
    desk.write("against.toml", text + "reference = true\n");
    desk
}

fn words(desk: &Desk, words: &str) -> Outcome {
    let words: Vec<&str> = words.split_whitespace().collect();
    run(desk.folder.path(), &words)
}

#[track_caller]
fn assert_near(row: &Value, wanted_mm: [f64; 3]) {
    for (axis, wanted_mm) in wanted_mm.into_iter().enumerate() {
        let number = |key: &str| row[key][axis].as_f64().expect("a number");
        let (error_mm, sigma_mm) = (number("displacement_mm") - wanted_mm, number("sigma_mm"));
        assert!(error_mm.abs() <= 4.0 * sigma_mm, "{row}, not {wanted_mm}");
        assert!(sigma_mm <= [0.03, 0.03, 0.3][axis], "{row}");
    }
}

#[test]
fn each_target_has_a_row_per_frame() {
    let desk = desk();
    let rows = words(&desk, "estimate views --rig rig.toml --json").good_json();
    let label = |row: &Value| {
        (
            row["frame"].as_u64(),
            row["target"].as_str().map(str::to_owned),
        )
    };
    let labels: Vec<_> = rows.iter().map(label).collect();
    let wanted = [(1, "deck"), (1, "pier"), (2, "deck"), (2, "pier")];
    assert_eq!(
        labels,
        wanted.map(|(frame, name)| (Some(frame), Some(name.to_owned())))
    );
    for (row, moved_mm) in rows.iter().zip(MOVED_MM[1..].iter().flatten()) {
        assert_eq!(row["against"], Value::Null);
        assert_near(row, *moved_mm);
    }
    let text = words(&desk, "estimate views --rig against.toml").stdout;
    assert!(
        text.lines()
            .nth(1)
            .is_some_and(|line| line.ends_with("  deck against pier"))
    );
    let csv = words(&desk, "estimate views --rig against.toml --csv").stdout;
    let mut lines = csv.lines();
    assert!(
        lines
            .next()
            .is_some_and(|line| line.ends_with(",target,against"))
    );
    assert!(
        lines
            .next()
            .is_some_and(|line| line.ends_with(",deck,pier"))
    );
    assert!(lines.next().is_some_and(|line| line.ends_with(",pier,")));
}

#[test]
fn common_motion_drops_out() {
    let desk = desk();
    let rows = words(&desk, "estimate views --rig against.toml --json").good_json();
    let wanted_mm = [1.6, -1.3, 0.7];
    for deck in [&rows[0], &rows[2]] {
        assert_eq!(deck["against"], "pier");
        assert_near(deck, wanted_mm);
    }
    assert_near(&rows[3], MOVED_MM[2][1]);
}

#[test]
fn driving_target_is_followed_and_all_are_listed() {
    let desk = desk();
    let done = words(
        &desk,
        "track --images views --rig against.toml --json --record run.mcap",
    );
    let rows = done.good_json();
    assert_eq!(rows.len(), 2);
    for (row, [deck_mm, pier_mm]) in rows.iter().zip(&MOVED_MM[1..]) {
        assert_near(row, *deck_mm);
        let targets = row["targets"].as_array().expect("the targets");
        assert_eq!(targets[0]["against"], "pier");
        assert_near(&targets[0], [0, 1, 2].map(|i| deck_mm[i] - pier_mm[i]));
        assert_near(&targets[1], *pier_mm);
    }
    let replayed = words(&desk, "replay run.mcap");
    assert_eq!(replayed.code, Some(0), "{}", replayed.stderr);
    let text = words(&desk, "track --images views --rig against.toml").stdout;
    assert!(text.contains("\n       deck against pier: 1.5"), "{text}");
    // The other one drives.
    let text = fs::read_to_string(desk.path("rig.toml")).expect("a rig file");
    desk.write("other.toml", text + "drives = true\n");
    let rows = words(&desk, "track --images views --rig other.toml --json").good_json();
    assert_near(&rows[0], MOVED_MM[1][1]);
}

/// A replay measures the same points as the run.
#[test]
fn regions_are_recorded_and_replayed() {
    let desk = desk();
    let plain = fs::read_to_string(desk.path("rig.toml")).expect("a rig file");
    desk.write("plain.toml", plain.replace(TARGETS, ""));
    let mut mask = b"P5\n320 240\n255\n".to_vec();
    mask.extend((0..320 * 240).map(|at| if at % 320 < EDGE_PX { 255 } else { 0 }));
    desk.write("mask.pgm", mask);
    for region in [
        "--roi middle=75,10,65,220",
        "--mask mask.pgm",
        "--mask middle=mask.pgm --roi left=120,10,40,220",
    ] {
        let done = words(
            &desk,
            &format!("track --images views --rig plain.toml --json --record run.mcap {region}"),
        );
        let rows = done.good_json();
        assert_near(&rows[0], MOVED_MM[1][0]);
        let replayed = words(&desk, "replay run.mcap --json");
        assert_eq!(replayed.code, Some(0), "{region}: {}", replayed.stderr);
        let replayed = &replayed.json()[0];
        let same = replayed["measurements"]["same"].as_u64();
        assert!(same >= Some(3), "{replayed}");
    }
}

/// A rectangle may be in the image of any camera.
#[test]
fn target_may_be_chosen_in_any_camera() {
    let desk = desk();
    for (camera, left_px) in [("left", 125), ("right", 20)] {
        let text = fs::read_to_string(desk.path("rig.toml")).expect("a rig file");
        let roi = format!("roi = [{left_px}, 10, 35, 220]\ncamera = \"{camera}\"");
        desk.write("other.toml", text.replace("roi = [75, 10, 65, 220]", &roi));
        let rows = words(&desk, "estimate views --rig other.toml --json").good_json();
        assert_near(&rows[0], MOVED_MM[1][0]);
        let [points, rejected] = ["points", "rejected"].map(|key| rows[0][key].as_u64());
        assert!(points > Some(20) && rejected.is_some(), "{}", rows[0]);
    }
}

#[test]
fn view_without_one_of_its_targets_is_refused() {
    let desk = desk();
    let text = fs::read_to_string(desk.path("rig.toml")).expect("a rig file");
    desk.write(
        "small.toml",
        text.replace("[215, 10, 60, 220]", "[300, 200, 8, 8]"),
    );
    let saved = words(&desk, "reference views --rig small.toml --out view.mcap");
    saved.failed(1, &["views", "the target pier"]);
    assert!(!desk.path("view.mcap").exists());
    let saved = words(&desk, "reference views --rig rig.toml --out view.mcap");
    assert!(saved.stdout.contains("deck: ") && saved.stdout.contains("pier: "));
}

#[test]
fn rows_of_targets_have_rotations() {
    let desk = desk();
    let words_of = |form: &str| {
        words(
            &desk,
            &format!("track --images views --rig against.toml --rotation estimate {form}"),
        )
    };
    let rows = words_of("--json").good_json();
    let deck = &rows[0]["targets"][0];
    for key in ["rotation_deg", "rotation_sigma_deg", "pivot_mm"] {
        assert_eq!(deck[key].as_array().map(Vec::len), Some(3), "{key}: {deck}");
    }
    let csv = words_of("--csv").stdout;
    let row = csv.lines().nth(1).expect("a row");
    let at = row.find("\"[{").expect("a list of objects");
    let cell = row[at + 1..].trim_end_matches('"').replace("\"\"", "\"");
    let list: Value = serde_json::from_str(&cell).expect("JSON");
    assert_eq!(list.as_array().map(Vec::len), Some(2));
}
