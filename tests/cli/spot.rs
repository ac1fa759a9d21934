//! The spot of a laser as the pivot of a target that turns.

use trinocular_core::rig::Rig;
use trinocular_vision::images::Pose;

use super::pose::{assert_close, desk_of_images};
use super::{Desk, Outcome, run};

/// Meets the poster, which is at 850 mm, at (20, -30) mm.
const LASER: &str = "[laser]\nfrom_mm = [20, 55, 0]\ndirection = [0, -0.2, 2]\n";
const SPOT_MM: [f64; 3] = [20.0, -30.0, 850.0];

fn add_laser(desk: &Desk) {
    desk.write("rig.toml", desk.read("rig.toml") + LASER);
}

/// Returns the motion of the spot of a poster that turns about z at its origin and moves, mm.
fn moved(degrees: f64, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    let [a, b, _] = SPOT_MM;
    [
        x + cosine * a - sine * b - a,
        y + sine * a + cosine * b - b,
        z,
    ]
}

fn ran(desk: &Desk, words: &[&str]) -> Outcome {
    let outcome = run(desk.folder.path(), words);
    assert_eq!(
        outcome.code,
        Some(0),
        "{}{}",
        outcome.stdout,
        outcome.stderr
    );
    outcome
}

#[test]
fn spot_of_laser_is_measured_and_followed() {
    let moves = [(-2.0, [1.0, -2.0, 1.0]), (5.0, [2.0, -3.0, 3.0])];
    let pose = |(degrees, relative_mm): (f64, [f64; 3])| Pose {
        relative_mm,
        turned_deg: [0.0, 0.0, degrees],
    };
    let desk = desk_of_images(&[Pose::default(), pose(moves[0]), pose(moves[1])]);
    add_laser(&desk);
    let words = ["--images", "views", "--rig", "rig.toml", "--json"];
    let spot = ["--rotation", "estimate", "--pivot", "spot"];
    let track = [&["track"], &words[..], &spot, &["--record", "run.mcap"]].concat();
    let estimate = [&["estimate"], &["views"], &words[2..], &spot].concat();
    for command in [&track, &estimate] {
        let rows = ran(&desk, command).json();
        assert_eq!(rows.len(), moves.len(), "{command:?}");
        for (row, (degrees, relative_mm)) in rows.iter().zip(moves) {
            assert_close(&row["pivot_mm"], SPOT_MM, 0.6, "spot");
            let moved_mm = moved(degrees, relative_mm);
            assert_close(&row["displacement_mm"], moved_mm, 0.06, "motion");
        }
    }
    // The recording is measured again with the laser of its rig file, bit for bit.
    ran(&desk, &["replay", "run.mcap"]);
    // The rig file can say the same, also for a reference view.
    write_turning_rig(&desk);
    ran(
        &desk,
        &[
            "reference",
            "views",
            "--rig",
            "turning.toml",
            "--out",
            "zero.mcap",
        ],
    );
    let rows = [
        "estimate",
        "views",
        "--rig",
        "turning.toml",
        "--json",
        "--reference",
        "zero.mcap",
    ];
    let rows = ran(&desk, &rows).json();
    assert_eq!(rows.len(), 3);
    for row in rows {
        assert_close(&row["pivot_mm"], SPOT_MM, 0.6, "spot");
    }
}

/// Writes `turning.toml`, whose pivot is the spot.
fn write_turning_rig(desk: &Desk) {
    let lines = "rotation = \"estimate\"\npivot = \"spot\"\n";
    desk.write("turning.toml", format!("{lines}{}", desk.read("rig.toml")));
}

#[test]
fn spot_of_points_is_found() {
    let desk = Desk::new();
    let mut csv = String::from("id,camera,x0,y0,x1,y1\n");
    for id in 0..30 {
        let [x, y] = [
            f64::from(id % 6) * 40.0 - 100.0,
            f64::from(id / 6) * 40.0 - 80.0,
        ];
        let start = [x, y, 850.0];
        let end = [x + 1.0, y, 851.0];
        for (name, camera) in ["left", "middle", "right"]
            .iter()
            .zip(&Rig::paper().cameras)
        {
            let [a, b] = [start, end].map(|at| camera.project(at));
            csv += &format!("{id},{name},{},{},{},{}\n", a[0], a[1], b[0], b[1]);
        }
    }
    desk.write("points.csv", csv);
    add_laser(&desk);
    write_turning_rig(&desk);
    let words = ["estimate", "points.csv", "--rig", "turning.toml", "--json"];
    let line = &ran(&desk, &words).json()[0];
    assert_close(&line["pivot_mm"], SPOT_MM, 1e-5, "spot");
    assert_close(&line["displacement_mm"], [1.0, 0.0, 1.0], 1e-5, "motion");
    // The centroid does not take the place of a spot that the ray misses.
    desk.change("turning.toml", "-0.2, 2", "-2, 2");
    let outcome = run(desk.folder.path(), &words[..4]);
    assert_eq!(outcome.code, Some(1));
    let reason = "refused: the laser's ray meets no point of the target";
    assert!(outcome.stdout.contains(reason), "{}", outcome.stdout);
}

#[test]
fn spot_without_laser_is_refused() {
    let desk = Desk::new();
    let estimate = |more: &[&str]| {
        let words = ["estimate", "points.csv", "--rig", "rig.toml"];
        run(desk.folder.path(), &[&words[..], more].concat())
    };
    let spot = ["--rotation", "estimate", "--pivot", "spot"];
    estimate(&spot).failed(2, &["--pivot spot", "add `[laser]`"]);
    let text = desk.read("rig.toml");
    let lines = "rotation = \"estimate\"\npivot = \"spot\"\n";
    desk.write("rig.toml", format!("{lines}{text}"));
    estimate(&[]).failed(1, &["rig.toml:2: field `pivot`", "add `[laser]`"]);
}
