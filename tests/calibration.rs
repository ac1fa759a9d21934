//! `calibrate` and `convert` as a user meets them, and rigs that are not parallel.

#[path = "calibration/boards.rs"]
mod boards;
#[path = "calibration/chessboard.rs"]
mod chessboard;
#[path = "calibration/convert.rs"]
mod convert;
#[path = "calibration/drawn.rs"]
mod drawn;
#[path = "calibration/rectified.rs"]
mod rectified;

use std::path::Path;

use serde_json::Value;
use trinocular_tests::binary::{Outcome, trinocular};

/// Runs the program with `arguments` in `folder`.
fn run(folder: &Path, arguments: &[&str]) -> Outcome {
    Outcome::of(trinocular().args(arguments).current_dir(folder))
}

/// Returns the numbers under `key`.
#[track_caller]
fn numbers(value: &Value, key: &str) -> Vec<f64> {
    let list = value[key]
        .as_array()
        .unwrap_or_else(|| panic!("{key} in {value}"));
    list.iter()
        .map(|number| number.as_f64().expect("a number"))
        .collect()
}
