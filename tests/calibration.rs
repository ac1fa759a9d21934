//! `calibrate` and `convert` as their user meets them, and rigs that are not parallel.

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
use trinocular_tests::binary::trinocular;

/// What a run of the program left behind.
struct Outcome {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl Outcome {
    /// Every line of standard output as JSON.
    #[track_caller]
    fn json(&self) -> Vec<Value> {
        assert_eq!(self.code, Some(0), "{}", self.stderr);
        let lines = self.stdout.lines();
        lines
            .map(|line| serde_json::from_str(line).expect("each line is one JSON value"))
            .collect()
    }

    /// The run ended with `code` and an error line that contains all of `parts`.
    #[track_caller]
    fn failed(&self, code: i32, parts: &[&str]) {
        assert_eq!(self.code, Some(code), "{}", self.stderr);
        let last = self
            .stderr
            .lines()
            .find(|line| line.starts_with("error: "))
            .unwrap_or_default();
        for part in parts {
            assert!(last.contains(part), "`{part}` is not in: {}", self.stderr);
        }
    }
}

/// Runs the program with `arguments` in `folder`.
fn run(folder: &Path, arguments: &[&str]) -> Outcome {
    let output = trinocular()
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("the program starts");
    let text = |bytes| String::from_utf8(bytes).expect("the program writes UTF-8");
    Outcome {
        code: output.status.code(),
        stdout: text(output.stdout),
        stderr: text(output.stderr),
    }
}

/// Numbers under `key`.
#[track_caller]
fn numbers(value: &Value, key: &str) -> Vec<f64> {
    let list = value[key]
        .as_array()
        .unwrap_or_else(|| panic!("{key} in {value}"));
    list.iter()
        .map(|number| number.as_f64().expect("a number"))
        .collect()
}
