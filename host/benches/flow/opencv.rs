//! OpenCV's frame set, computed by a Python process if one with OpenCV is installed.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::Value;
use trinocular_vision::images::{FrameSet, folder};

use crate::accuracy::Quality;
use crate::scene::Scene;

pub struct OpenCv {
    process: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    pub version: String,
    _images: tempfile::TempDir,
}

impl OpenCv {
    /// Starts the process. Returns `None` if `$PYTHON` (or `python3`) does not exist or has no
    /// OpenCV.
    pub fn start(scene: &Scene, frame_sets: &[FrameSet; 2], corners: usize) -> Option<Self> {
        let images = tempfile::tempdir().ok()?;
        let names = ["left", "middle", "right"].map(String::from);
        for (index, frame_set) in frame_sets.iter().enumerate() {
            folder::save(images.path(), &names, index, frame_set).ok()?;
        }
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/flow/opencv.py");
        let numbers = scene.disparity_px.into_iter().chain(scene.flow_px);
        let mut process = Command::new(std::env::var("PYTHON").unwrap_or("python3".into()))
            .arg(script)
            .arg(images.path())
            .args(numbers.map(|n| n.to_string()))
            .arg(corners.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let (input, output) = (
            process.stdin.take()?,
            BufReader::new(process.stdout.take()?),
        );
        let mut opencv = Self {
            process,
            input,
            output,
            version: String::new(),
            _images: images,
        };
        opencv.version = opencv.answer()?["version"].as_str()?.to_owned();
        Some(opencv)
    }

    fn answer(&mut self) -> Option<Value> {
        let mut line = String::new();
        self.output.read_line(&mut line).ok()?;
        serde_json::from_str(&line).ok()
    }

    /// Returns the times of `repetitions` runs, ms.
    pub fn times_ms(&mut self, repetitions: usize) -> Option<Vec<f64>> {
        writeln!(self.input, "{repetitions}").ok()?;
        let answer = self.answer()?;
        answer["times_ms"]
            .as_array()?
            .iter()
            .map(Value::as_f64)
            .collect()
    }

    /// Returns the accuracy: `{"points": .., "temporal": {"wrong": .., "right": .., "rms_px": ..},
    /// "spatial": {..}}`
    pub fn quality(&mut self) -> Option<Value> {
        writeln!(self.input).ok()?;
        self.answer()
    }
}

impl Drop for OpenCv {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Adds an answer of [`OpenCv::quality`] to the number of points and the accuracy.
pub fn add(answer: &Value, (points, quality): &mut (usize, Quality)) -> Option<()> {
    let count = |value: &Value| value.as_u64().map(|n| n as usize);
    *points += count(&answer["points"])?;
    let kinds = [
        ("temporal", &mut quality.temporal),
        ("spatial", &mut quality.spatial),
    ];
    for (kind, accuracy) in kinds {
        let of = &answer[kind];
        let rms_px = of["rms_px"].as_f64().unwrap_or(0.0);
        accuracy.extend(count(&of["wrong"])?, count(&of["right"])?, rms_px);
    }
    Some(())
}
