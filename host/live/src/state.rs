//! State of a run: what its turns said, and the copy of it that a page gets.

use crate::hub::{Setup, Turn};
use crate::images::Encoded;
use crate::telemetry::{Counts, Sample, Samples, percentiles, rounded};
use serde_json::{Value, json};
use std::collections::VecDeque;
use trinocular_client::diagnosis;
use trinocular_core::frame::message::Status;
use trinocular_vision::flow::CameraRefusal;

/// Notes that are kept.
const NOTES: usize = 30;

/// Note for the people at the pages.
#[derive(Clone, Debug)]
struct Note {
    number: u64,
    at_s: f64,
    kind: &'static str,
    text: String,
}

/// State of a run.
#[derive(Debug, Default)]
pub struct State {
    /// Numbers of the last turns.
    pub samples: Samples,
    /// Latest images.
    pub encoded: Option<Encoded>,
    /// True while the run follows its target.
    pub is_following: bool,
    /// Name of the file that the run is recorded in.
    pub recording: Option<String>,
    /// True after the end of the run.
    pub has_ended: bool,
    /// Capture time of the first turn, µs.
    first_us: Option<u64>,
    at_s: f64,
    status: Option<Status>,
    turns: u64,
    refusals: Counts,
    refusal: Option<String>,
    /// Drops per camera, by reason.
    drops: Vec<Counts>,
    notes: VecDeque<Note>,
    note_count: u64,
}

/// Copy of the state for one page.
#[derive(Debug)]
pub struct Snapshot {
    /// Number of the last sample.
    pub last_sample: u64,
    /// Number of the last note.
    pub last_note: u64,
    at_s: f64,
    samples: Vec<Sample>,
    notes: Vec<Note>,
    is_following: bool,
    recording: Option<String>,
    has_ended: bool,
    status: Option<Status>,
    rate_hz: Option<f64>,
    latencies_ms: Vec<f64>,
    turns: u64,
    refusals: Counts,
    refusal: Option<String>,
    drops: Vec<Counts>,
}

impl State {
    /// Makes the state of a run with this number of cameras.
    pub fn new(cameras: usize) -> Self {
        Self {
            drops: vec![Counts::new(); cameras],
            ..Self::default()
        }
    }

    /// Returns the time of an image since the first turn, s.
    pub fn since_first_s(&self, taken_us: u64) -> f64 {
        let first_us = self.first_us.unwrap_or(taken_us);
        taken_us.saturating_sub(first_us) as f64 * 1e-6
    }

    /// Takes in one turn of the loop.
    pub fn take(&mut self, setup: &Setup, turn: &Turn<'_>) {
        self.first_us.get_or_insert(turn.taken_us);
        self.at_s = self.since_first_s(turn.taken_us);
        self.turns += 1;
        self.samples.push(Sample::of(setup, self.at_s, turn));
        if let Some(status) = turn.status {
            self.note_fault(status);
            self.status = Some(*status);
        }
        self.refusal = turn.refusal.map(|(_, sentence)| sentence.to_owned());
        if let Some((name, _)) = turn.refusal {
            *self.refusals.entry(name).or_default() += 1;
        }
        for (camera, refusal) in turn.absent {
            if let Some(counts) = self.drops.get_mut(*camera) {
                *counts.entry(drop_name(refusal)).or_default() += 1;
            }
        }
    }

    /// Notes a fault that is reported for the first time since the last reset, whatever the run does.
    fn note_fault(&mut self, status: &Status) {
        let before = self.status.and_then(|status| status.fault);
        if status.fault == before {
            return;
        }
        match status.fault {
            Some(fault) => {
                let text = diagnosis::fault(fault);
                let number = fault.number();
                let warning = format!("fault {number}: {}; to do: {}", text.cause, text.action);
                self.note("warning", warning);
            }
            None => self.note("note", "no fault any more".to_owned()),
        }
    }

    /// Adds a note, and forgets the oldest if there are too many.
    pub fn note(&mut self, kind: &'static str, text: String) {
        self.note_count += 1;
        if self.notes.len() == NOTES {
            self.notes.pop_front();
        }
        self.notes.push_back(Note {
            number: self.note_count,
            at_s: self.at_s,
            kind,
            text,
        });
    }

    /// Returns the last sample by names; null before the first.
    pub fn latest(&self) -> Value {
        self.samples.last().map_or(Value::Null, Sample::named)
    }

    /// Copies the state with the samples after number `seen` and the notes after `noted`.
    pub fn snapshot(&self, seen: u64, noted: u64) -> Snapshot {
        let (samples, last_sample) = self.samples.since(seen);
        let notes = self.notes.iter().filter(|note| note.number > noted);
        Snapshot {
            last_sample,
            last_note: self.note_count,
            at_s: self.at_s,
            samples,
            notes: notes.cloned().collect(),
            is_following: self.is_following,
            recording: self.recording.clone(),
            has_ended: self.has_ended,
            status: self.status,
            rate_hz: self.samples.rate_hz(),
            latencies_ms: self.samples.latencies_ms(),
            turns: self.turns,
            refusals: self.refusals.clone(),
            refusal: self.refusal.clone(),
            drops: self.drops.clone(),
        }
    }
}

impl Snapshot {
    /// Adds images that never came to the loop, by camera and reason.
    pub fn add_drops(&mut self, drops: &[Vec<(&'static str, u64)>]) {
        for (counts, drops) in self.drops.iter_mut().zip(drops) {
            for (reason, count) in drops {
                *counts.entry(reason).or_default() += count;
            }
        }
    }

    /// Formats the message to a page.
    pub fn into_json(self) -> Value {
        let notes = self.notes.iter();
        let notes: Vec<Value> = notes
            .map(|note| {
                let at_s = rounded(note.at_s, 1e6);
                json!({"at_s": at_s, "kind": note.kind, "text": note.text})
            })
            .collect();
        json!({
            "type": "state",
            "at_s": rounded(self.at_s, 1e6),
            "samples": self.samples,
            "notes": notes,
            "following": self.is_following,
            "recording": self.recording,
            "ended": self.has_ended,
            "station": self.status.as_ref().map(condition),
            "rate_hz": self.rate_hz,
            "latency_ms": percentiles(self.latencies_ms),
            "turns": self.turns,
            "refusals": self.refusals,
            "refusal": self.refusal,
            "drops": self.drops,
        })
    }
}

/// Returns the name of a camera's refusal for the counts.
const fn drop_name(refusal: &CameraRefusal) -> &'static str {
    match refusal {
        CameraRefusal::Missing => "missing",
        CameraRefusal::Blank => "blank",
        CameraRefusal::MissingInKeyframe => "missing in the keyframe",
        CameraRefusal::BlankInKeyframe => "blank in the keyframe",
        CameraRefusal::Frozen => "frozen",
        CameraRefusal::Unsynchronised { .. } => "not synchronised",
    }
}

/// Describes a status in words.
fn condition(status: &Status) -> Value {
    let state = diagnosis::state(status.state);
    let fault = status.fault.map(|fault| {
        let text = diagnosis::fault(fault);
        json!({
            "number": fault.number(),
            "name": text.name.replace('_', " "),
            "cause": text.cause,
            "action": text.action,
        })
    });
    json!({
        "state": state.name,
        "meaning": state.meaning,
        "next": diagnosis::next_step(status),
        "fault": fault,
        "position": diagnosis::position(status.trust),
        "sight": diagnosis::sight(status.sight),
        "seen_ms": status.seen_ms,
        "motors": status.motors,
        "is_moving": status.state.is_moving(),
        "frames_used": status.frames_used,
        "frames_refused": status.frames_refused,
    })
}
