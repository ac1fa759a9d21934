//! `trinocular latency` as a user meets it: with a simulated stage on simulated time, and with a
//! station and cameras that another program simulates in real time.

#[path = "latency/live.rs"]
mod live;
#[path = "latency/simulated.rs"]
mod simulated;

use serde_json::Value;
use std::path::Path;
use tempfile::TempDir;
use trinocular_client::stage::default_stage;
use trinocular_rig::rig_file::RigFile;
use trinocular_tests::binary::{Outcome, trinocular};

/// Largest error of a delay at 60 images per second, ms.
const LIMIT_MS: f64 = 0.3;

/// Returns a folder with a rig file that has comments.
fn desk() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let mut rig = RigFile::paper();
    rig.stage = Some(default_stage());
    let text = format!("# our bench\n{}", rig.to_toml());
    std::fs::write(folder.path().join("rig.toml"), text).expect("it is ours");
    folder
}

fn run(folder: &Path, words: &str) -> Outcome {
    let mut command = trinocular();
    command.args(words.split_whitespace()).current_dir(folder);
    Outcome::of(&mut command)
}

fn number(object: &Value, key: &str) -> f64 {
    let number = object[key].as_f64();
    number.unwrap_or_else(|| panic!("no {key} in {object}"))
}

/// Returns the delays that a rig file has, ms.
fn written_ms(file: &Path) -> Vec<Option<f64>> {
    let rig = RigFile::read(file).expect("a rig file");
    rig.capture.iter().map(|camera| camera.delay_ms).collect()
}
