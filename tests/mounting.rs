//! `calibrate-stage` as a user meets it: with a simulated stage, and with a station on a port and
//! images that another program puts into a folder.

use nalgebra::{Matrix3, Rotation3, Vector3};
use serde_json::Value;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Output, Stdio};
use tempfile::TempDir;
use trinocular_client::stage::default_stage;
use trinocular_rig::rig_file::{Care, RigFile};
use trinocular_tests::binary::trinocular;
use trinocular_tests::far_end::station;
use trinocular_vision::images::folder::save;
use trinocular_vision::images::{Scene, SceneSettings, Texture};

/// Returns a folder with a rig file that has a wrong matrix and comments.
fn desk() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let mut rig = RigFile::paper();
    rig.stage = Some(default_stage());
    let text = format!("# our bench\n{}", rig.to_toml());
    std::fs::write(folder.path().join("rig.toml"), text).expect("it is ours");
    folder
}

fn run(folder: &Path, words: &str) -> Output {
    let done = trinocular()
        .args(words.split_whitespace())
        .current_dir(folder)
        .output();
    done.expect("trinocular runs")
}

fn rows(value: &Value) -> Matrix3<f64> {
    let rows = value.as_array().expect("rows");
    Matrix3::from_fn(|i, j| rows[i][j].as_f64().expect("a number"))
}

/// Returns the motion of the cameras per mm of commanded stage motion.
fn mounted(turned_deg: [f64; 3], axes: [f64; 3]) -> Matrix3<f64> {
    let turn = Rotation3::new(Vector3::from(turned_deg).map(f64::to_radians));
    turn.matrix() * Matrix3::from_diagonal(&Vector3::from(axes))
}

/// Returns the largest error in standard deviations.
#[track_caller]
fn judge(fit: &Value, mounted: Matrix3<f64>) -> f64 {
    let truth = mounted.try_inverse().expect("a mounting");
    let (matrix, sigma) = (rows(&fit["matrix"]), rows(&fit["sigma"]));
    assert!(sigma.max() < 0.002, "{sigma}");
    let off = (matrix - truth).component_div(&sigma).abs().max();
    assert!(off < 3.0, "{off} sigma: {matrix} and not {truth}");
    off
}

/// The stage is rotated by 5 degrees, moves 1.02 times the commanded distance, and has one axis
/// reversed.
#[test]
fn turned_stage_is_found_within_3_sigma() {
    let desk = desk();
    let options = "--turned 2.6726 -1.3363 4.0089 --scaled 1.02";
    for (seed, mirrored, axes) in [
        (1, "y", [1.02, -1.02, 1.02]),
        (2, "x", [-1.02, 1.02, 1.02]),
        (3, "z", [1.02, 1.02, -1.02]),
    ] {
        let words = format!(
            "calibrate-stage --sim --rig rig.toml {options} --mirrored {mirrored} --seed {seed} \
             --json --out new.toml --force"
        );
        let done = run(desk.path(), &words);
        let error = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(0), "{error}");
        let found: Value = serde_json::from_slice(&done.stdout).expect("one JSON object");
        assert_eq!(found["fit"]["mirrored"], true);
        let off = judge(&found["fit"], mounted([2.6726, -1.3363, 4.0089], axes));
        println!(
            "{mirrored} mirrored: {off:.2} sigma off, sigma {}",
            found["fit"]["sigma"]
        );
        // The rig file has the new matrix and still its comment.
        let text = std::fs::read_to_string(desk.path().join("new.toml")).expect("it was written");
        assert!(text.starts_with("# our bench\n"));
        let written = RigFile::parse(Path::new("new.toml"), &text).expect("a rig file");
        let matrix = rows(&found["fit"]["matrix"]);
        let stage = written.stage.expect("its stage");
        for i in 0..3 {
            for j in 0..3 {
                assert!((stage.matrix[i][j] - matrix[(i, j)]).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn stamp_delay_is_found_within_3_sigma() {
    let desk = desk();
    for (seed, late_ms) in [(1, 0.0), (2, 12.5), (3, -30.0)] {
        let words = format!("calibrate-stage --sim --rig rig.toml --late {late_ms} --seed {seed}");
        let done = run(desk.path(), &format!("{words} --json"));
        let error = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(0), "{error}");
        let found: Value = serde_json::from_slice(&done.stdout).expect("one JSON object");
        let number = |key: &str| found["delay"][key].as_f64().expect("a number");
        let (delay_ms, sigma_ms) = (number("delay_ms"), number("sigma_ms"));
        println!("late by {late_ms} ms: found {delay_ms:.3} ± {sigma_ms:.3} ms");
        assert!(
            (delay_ms - late_ms).abs() < 3.0 * sigma_ms + 0.05,
            "{}",
            found["delay"]
        );
        assert!(sigma_ms < 0.2, "{}", found["delay"]);
    }
    let words = "calibrate-stage --sim --rig rig.toml --late 12.5";
    let text = String::from_utf8(run(desk.path(), words).stdout).expect("UTF-8");
    assert!(text.contains("use `track --delay 12.5`"), "{text}");
}

/// With the calibrated matrix, a stage with this mount follows the target.
#[test]
fn station_on_port_is_calibrated() {
    let end = station();
    let desk = desk();
    let mounted = mounted([0.0, 0.0, 5.0], [1.0, 1.0, 1.0]);
    let rig = RigFile::paper();
    let scene = Scene::new(&rig.rig, &Texture::natural(4), SceneSettings::default());
    let scene = scene.expect("a scene");
    let captures = desk.path().join("captures");
    std::fs::create_dir(&captures).expect("it is ours");
    let zero = run(
        desk.path(),
        &format!("zero --rig rig.toml --heartbeat 5000 --port {}", end.path),
    );
    assert!(zero.status.success());
    let words = format!(
        "calibrate-stage --rig rig.toml --heartbeat 5000 --images captures --json --port {}",
        end.path
    );
    let mut child = trinocular()
        .args(words.split_whitespace())
        .current_dir(desk.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("trinocular runs");
    let stderr = child.stderr.take().expect("a pipe");
    let mut index = 0;
    for line in BufReader::new(stderr).lines() {
        let line = line.expect("UTF-8");
        if !line.contains("take an image") {
            continue;
        }
        let position = end.steps().map(|steps| steps as f64 / 80.0);
        let relative = -(mounted * Vector3::from(position));
        index += 1;
        let capture = scene.render(relative.into(), 0, index as u64);
        save(&captures, &rig.names, index, &capture).expect("it is ours");
    }
    let mut text = String::new();
    let mut stdout = child.stdout.take().expect("a pipe");
    stdout.read_to_string(&mut text).expect("UTF-8");
    assert!(child.wait().expect("it ends").success());
    assert_eq!(index, 19);
    let found: Value = serde_json::from_str(&text).expect("one JSON object");
    judge(&found["fit"], mounted);
    assert_eq!(found["fit"]["mirrored"], false);
    assert_eq!(end.standing(), [0; 3]);
}

#[test]
fn impossible_calibration_is_refused() {
    let desk = desk();
    let mut rig = RigFile::paper();
    std::fs::write(desk.path().join("cameras.toml"), rig.to_toml()).expect("it is ours");
    let mut short = default_stage();
    short.travel_mm[1] = [-3.0, 9.0];
    short.care = Care::default();
    rig.stage = Some(short);
    std::fs::write(desk.path().join("short.toml"), rig.to_toml()).expect("it is ours");
    for (words, code, part) in [
        ("--sim", 2, "--rig"),
        ("--rig rig.toml", 2, "--sim"),
        ("--rig rig.toml --port /dev/no-such-port", 2, "--images"),
        ("--sim --rig rig.toml --reach 0", 2, "--reach"),
        ("--sim --rig rig.toml --scaled 9", 2, "--scaled"),
        ("--sim --rig rig.toml --late 900", 2, "--late"),
        ("--sim --rig cameras.toml", 1, "[stage]"),
        ("--sim --rig rig.toml --out rig.toml", 1, "rig.toml"),
        ("--sim --rig short.toml", 2, "soft limits are -3 to 9 mm"),
        ("--sim --rig rig.toml --texture bricks", 1, "cannot be used"),
        ("--sim --rig rig.toml --reach 0.1 --noise 40", 1, "known to"),
        (
            "--rig rig.toml --port /dev/no-such-port --images none",
            1,
            "no such folder",
        ),
        (
            "--rig rig.toml --port /dev/no-such-port --images .",
            1,
            "/dev/no-such-port",
        ),
    ] {
        let done = run(desk.path(), &format!("calibrate-stage {words}"));
        let error = String::from_utf8_lossy(&done.stderr);
        assert_eq!(done.status.code(), Some(code), "{words}: {error}");
        assert!(error.contains(part), "{words}: {error}");
    }
}
