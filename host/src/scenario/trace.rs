//! Trace of a scenario: true positions at every millisecond, and the station's reports.

use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Display;
use trinocular_core::frame::message::Denial;
use trinocular_core::safety::{Fault, State};
use trinocular_core::track::pursuit::Sight;

/// Time between two samples, s.
pub const SAMPLE_S: f64 = 1e-3;

/// True positions at one instant, in mm from the positions of target and cameras at the keyframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time since the keyframe, s.
    pub time_s: f64,
    /// Position of the target.
    pub target_mm: [f64; 3],
    /// Position of the cameras, by the edges at the step pins.
    pub camera_mm: [f64; 3],
    /// Number of reversals of direction at the step pins since the start, per axis.
    pub reversals: [u32; 3],
    /// State that the station reports.
    pub state: State,
}

impl Sample {
    /// Returns cameras minus target, mm.
    pub fn error_mm(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.camera_mm[i] - self.target_mm[i])
    }
}

/// Counts of frame sets and frames by result.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Frames {
    /// Number of frame sets taken.
    pub taken: u32,
    /// Number of frame sets that gave no frame, by reason.
    pub refused: BTreeMap<String, u32>,
    /// Number of frames that never left the host: dropped, or the host was silent.
    pub lost: u32,
    /// Number of frames that the station used.
    pub used: u32,
    /// Number of frames that the station did not use, by reason.
    pub denied: BTreeMap<String, u32>,
    /// Number of frames without an answer at the end.
    pub unanswered: u32,
    /// Number of frames that had not arrived at the end.
    pub under_way: u32,
}

impl Frames {
    pub(super) fn refuse(&mut self, reason: &impl Display) {
        *self.refused.entry(reason.to_string()).or_default() += 1;
    }

    pub(super) fn answer(&mut self, answer: Result<(), Denial>) {
        match answer {
            Ok(()) => self.used += 1,
            Err(denial) => *self.denied.entry(denial.to_string()).or_default() += 1,
        }
    }
}

/// Trace of a whole run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// Samples, one per millisecond.
    pub samples: Vec<Sample>,
    /// States of the station in their order, by its reports.
    pub states: Vec<State>,
    /// The station's knowledge of the target in its order, by its reports.
    pub sights: Vec<Sight>,
    /// Faults in their order; a fault that is latched again counts again.
    pub faults: Vec<Fault>,
    /// Time at which the station reported each fault, s.
    pub faults_s: Vec<f64>,
    /// Instants at which the stage may have stopped without a ramp, s.
    pub abrupt_s: Vec<f64>,
    /// Capture time of each frame set, s.
    pub captures_s: Vec<f64>,
    /// Time from capture to the first port word that the frame could change, µs, for every frame
    /// used.
    pub latencies_us: Vec<u32>,
    /// Counts of frame sets and frames by result.
    pub frames: Frames,
    /// Silences of the host that are longer than the heartbeat timeout: from its last ping to its
    /// next, s.
    pub silences_s: Vec<[f64; 2]>,
    /// Commands that the station refused, in words.
    pub refused_commands: Vec<String>,
    /// Steps at the pins from start to end.
    pub steps: [i64; 3],
    /// Steps that the station planned and the pins did not make, per axis.
    pub missing_steps: [i64; 3],
}

impl Trace {
    /// Returns the samples in `from_s..until_s`.
    pub fn within(&self, from_s: f64, until_s: f64) -> &[Sample] {
        let index = |time_s: f64| {
            let samples = (time_s / SAMPLE_S - 1e-6).ceil().max(0.0) as usize;
            samples.min(self.samples.len())
        };
        let (from, until) = (index(from_s), index(until_s));
        self.samples.get(from..until).unwrap_or_default()
    }
}
