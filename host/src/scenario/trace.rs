//! What happened in a scenario: the truth at every millisecond, and what the station said.

use serde::Serialize;
use shared::frame::message::Denial;
use shared::safety::{Fault, State};
use shared::track::pursuit::Sight;
use std::collections::BTreeMap;
use std::fmt::Display;

/// Between two samples, s.
pub const SAMPLE_S: f64 = 1e-3;

/// The truth at one instant. Positions are mm from where target and cameras were at the keyframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Since the keyframe, s.
    pub time_s: f64,
    /// Where the target is.
    pub target_mm: [f64; 3],
    /// Where the cameras are, by the edges at the step pins.
    pub camera_mm: [f64; 3],
    /// Reversals of direction at the step pins since the start, per axis.
    pub reversals: [u32; 3],
    /// What the station says it is doing.
    pub state: State,
}

impl Sample {
    /// Cameras minus target, mm.
    pub fn error_mm(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.camera_mm[i] - self.target_mm[i])
    }
}

/// What became of the frames.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Frames {
    /// Captures.
    pub taken: u32,
    /// Captures that gave no frame, by reason.
    pub refused: BTreeMap<String, u32>,
    /// Frames that never left the host: dropped, or the host was silent.
    pub lost: u32,
    /// Frames that the station used.
    pub used: u32,
    /// Frames that the station did not use, by reason.
    pub denied: BTreeMap<String, u32>,
    /// Frames without an answer at the end.
    pub unanswered: u32,
    /// Frames that had not arrived at the end.
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

/// A whole run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// Every millisecond.
    pub samples: Vec<Sample>,
    /// States of the station in their order, by its reports.
    pub states: Vec<State>,
    /// What the station knew of the target, in order, by its reports.
    pub sights: Vec<Sight>,
    /// Faults in their order; one that is latched anew counts anew.
    pub faults: Vec<Fault>,
    /// Instants at which the stage may have stopped without a ramp, s.
    pub abrupt_s: Vec<f64>,
    /// When each capture was taken, s.
    pub captures_s: Vec<f64>,
    /// From capture to the first port word that the frame could change, µs, for every frame used.
    pub latencies_us: Vec<u32>,
    /// What became of the frames.
    pub frames: Frames,
    /// Silences of the host that are longer than the heartbeat: from its last ping to its next, s.
    pub silences_s: Vec<[f64; 2]>,
    /// Commands that the station refused, in words.
    pub refused_commands: Vec<String>,
    /// Steps at the pins from start to end.
    pub steps: [i64; 3],
    /// Steps that the station planned and the pins did not make, per axis.
    pub missing_steps: [i64; 3],
}

impl Trace {
    /// The samples in `from_s..until_s`.
    pub fn within(&self, from_s: f64, until_s: f64) -> &[Sample] {
        let index = |time_s: f64| {
            let samples = (time_s / SAMPLE_S - 1e-6).ceil().max(0.0) as usize;
            samples.min(self.samples.len())
        };
        let (from, until) = (index(from_s), index(until_s));
        self.samples.get(from..until).unwrap_or_default()
    }
}
