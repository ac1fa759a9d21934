//! Photographs: a real scene, and a real photograph as poster.

use std::path::{Path, PathBuf};

use serde_json::Value;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::images::folder::{DEFAULT_PERIOD_US, Folder};
use trinocular_vision::images::{FrameSet, SceneSettings, Texture};

use super::bench::{Bench, TOLERANCE_MM, Watch};

fn teddy_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("images/teddy")
}

fn teddy() -> (RigFile, Vec<FrameSet>) {
    let rig = RigFile::read(&teddy_folder().join("rig.toml")).expect("the rig file");
    let folder = Folder::open(
        &teddy_folder(),
        &rig.names,
        rig.rig.image_size_px,
        DEFAULT_PERIOD_US,
    );
    let folder = folder.expect("the folder");
    let captures = folder.frame_sets().collect::<Result<_, _>>();
    (rig, captures.expect("images"))
}

/// Returns the true displacements from the first frame set, and the largest error of an estimate.
fn teddy_truth() -> (Vec<[f64; 3]>, [f64; 3]) {
    let text = std::fs::read_to_string(teddy_folder().join("truth.json")).expect("the truth");
    let truth: Value = serde_json::from_str(&text).expect("JSON");
    let triple = |value: &Value| -> [f64; 3] {
        let number = |i: usize| value[i].as_f64().expect("a number");
        std::array::from_fn(number)
    };
    let expected = truth["expected"].as_array().expect("a list");
    (
        expected.iter().map(triple).collect(),
        triple(&truth["tolerance"]),
    )
}

#[test]
fn teddy_is_right_from_first() {
    let (rig, captures) = teddy();
    let (truth, tolerance) = teddy_truth();
    let mut watch = Watch::new(&rig.rig, &captures[0]).expect("a reference");
    assert_eq!(captures.len(), truth.len() + 1);
    for (capture, moved) in captures[1..].iter().zip(truth) {
        let got = watch.measure(capture).expect("the scene is still in view");
        got.assert_within(moved, tolerance, "teddy");
    }
}

#[test]
fn teddy_is_right_from_previous() {
    let (rig, captures) = teddy();
    let (truth, tolerance) = teddy_truth();
    for pair in captures.windows(2) {
        let mut watch = Watch::new(&rig.rig, &pair[0]).expect("a reference");
        let got = watch.measure(&pair[1]).expect("the scene is still in view");
        got.assert_within(truth[0], tolerance, "teddy");
    }
}

#[test]
fn photograph_poster_is_as_exact_as_drawn() {
    let (_, captures) = teddy();
    let texture = Texture::from_image(&captures[0].images[1], 1.2);
    let bench = Bench::new(&texture, SceneSettings::default());
    let moves = [
        [10.0, 10.0, 0.0],
        [20.0, 20.0, 2.0],
        [0.0, 0.0, 7.0],
        [-12.0, 3.0, -5.0],
        [1.3, -0.6, 0.4],
        [-30.0, 0.0, 0.0],
    ];
    for seed in 0..3 {
        for (moved, got) in moves.into_iter().zip(bench.measure_all(&moves, seed)) {
            let got = got.expect("a photograph has texture");
            got.assert_within(moved, TOLERANCE_MM, "photograph");
        }
    }
}
