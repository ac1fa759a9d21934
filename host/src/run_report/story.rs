//! The story of a run: its frame sets, events and a few pictures, collected as they come.

use super::album::Album;
use super::curves::{Measured, RunCurves};
use super::marks;
use crate::report::{Mark, Moment};
use crate::servo::recording::FrameSetTaker;
use std::sync::{Arc, Mutex, PoisonError};
use trinocular_core::frame::message::{Mounting, Status};
use trinocular_recording::export::Row;
use trinocular_recording::message::{Event, Measurement, Outcome, changes};
use trinocular_rig::rig_file::{Stage, along_stage};
use trinocular_vision::images::{FrameSet, Image};

/// One frame set, with what its row in the table does not have.
#[derive(Clone, Debug)]
pub struct Turn {
    /// Row of the table of measurements.
    pub row: Row,
    /// Instant at which the stage was where the row says, µs of the station's clock.
    pub stage_us: u64,
    /// Capture time of the keyframe, µs of the station's clock.
    pub reference_us: u64,
    /// Covariance of the displacement along the camera axes, mm².
    pub covariance_mm2: [[f64; 3]; 3],
    /// Cameras that were left out, in words; empty without any.
    pub absent: String,
}

/// Place of the cameras, and the directions of their axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandEye {
    /// Place of the cameras.
    pub mounting: Mounting,
    /// Hand-eye matrix, for [`along_stage`].
    pub matrix: [[f64; 3]; 3],
}

impl HandEye {
    /// Returns the place of cameras that are mounted like this beside or on a stage.
    pub fn of(stage: &Stage, mounting: Mounting) -> Self {
        Self {
            mounting,
            matrix: stage.matrix,
        }
    }
}

impl Default for HandEye {
    /// Cameras on the stage, with the same axes.
    fn default() -> Self {
        Self {
            mounting: Mounting::OnStage,
            matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        }
    }
}

/// Story of a run. All instants are of the station's clock.
#[derive(Clone, Debug, Default)]
pub struct Story {
    /// Names of the cameras.
    pub names: Vec<String>,
    /// Place of the cameras.
    pub hand_eye: HandEye,
    /// Frame sets in their order, keyframes included.
    pub turns: Vec<Turn>,
    /// Events in their order, as a recording has them.
    pub events: Vec<Event>,
    album: Album,
    last: Option<Status>,
    /// Capture time of the first keyframe, µs.
    zero_us: Option<u64>,
}

impl Story {
    /// Creates the empty story of a run with these cameras.
    pub fn new(names: &[String], hand_eye: HandEye) -> Self {
        Self {
            names: names.to_vec(),
            hand_eye,
            ..Self::default()
        }
    }

    /// Takes in a frame set. `images` is called only for the few that become pictures.
    pub fn turn<'a>(
        &mut self,
        measurement: &Measurement,
        stage_us: u64,
        images: impl FnOnce() -> Option<std::borrow::Cow<'a, [Image]>>,
    ) {
        if self.album.wants(measurement.outcome)
            && let Some(images) = images()
        {
            self.album.take(&self.names, &images, measurement);
        }
        let absent = measurement.absent.iter().map(|(camera, reason)| {
            let name = self.names.get(usize::from(*camera));
            let name = name.map_or_else(|| format!("camera {camera}"), String::clone);
            format!("{name}: {reason}")
        });
        if measurement.outcome != Outcome::Keyframe {
            self.zero_us.get_or_insert(measurement.reference_us);
        }
        self.turns.push(Turn {
            row: Row::of(measurement),
            stage_us,
            reference_us: measurement.reference_us,
            covariance_mm2: covariance(measurement),
            absent: absent.collect::<Vec<_>>().join("; "),
        });
    }

    /// Sets the instants of the stage's positions to the capture times. A keyframe has none.
    pub fn place_stage_at_captures(&mut self) {
        let turns = self.turns.iter_mut();
        for turn in turns.filter(|turn| turn.row.outcome != Outcome::Keyframe) {
            turn.stage_us = turn.row.capture_us;
        }
    }

    /// Takes in an event of the run.
    pub fn event(&mut self, at_us: u64, kind: &str, text: impl Into<String>) {
        self.events.push(Event {
            at_us,
            kind: kind.to_owned(),
            text: text.into(),
        });
    }

    /// Takes in a status of the station: changes of state, sight and fault are events.
    pub fn status(&mut self, status: &Status) {
        let at_us = status.time.micros();
        let Some(last) = self.last.replace(*status) else {
            self.event(at_us, "state", format!("{:?}", status.state));
            return;
        };
        for (kind, text) in changes(&last, status) {
            self.event(at_us, kind, text);
        }
    }

    /// Returns the time since the first keyframe, s.
    pub fn time_s(&self, at_us: u64) -> f64 {
        (at_us as f64 - self.zero_us.unwrap_or(0) as f64) * 1e-6
    }

    /// Returns the table of all measurements, as `export` writes it.
    pub fn table(&self) -> String {
        trinocular_recording::export::csv(self.turns.iter().map(|turn| &turn.row))
    }

    /// Returns the marks of events and of frame sets without effect.
    pub fn marks(&self) -> Vec<Mark> {
        marks::of_story(self)
    }

    /// Returns the pictures.
    pub fn moments(&self) -> Vec<Moment> {
        self.album.moments(|us| self.time_s(us))
    }

    /// Returns what the images measured, by capture time.
    pub fn measured(&self) -> Vec<Measured> {
        let matrix = &self.hand_eye.matrix;
        let measured = self.turns.iter().filter_map(|turn| {
            let row = &turn.row;
            Some(Measured {
                time_s: self.time_s(row.capture_us),
                reference_s: self.time_s(turn.reference_us),
                displacement_mm: along_stage(matrix, row.displacement_mm?),
                sigma_mm: sigma_along_stage(matrix, &turn.covariance_mm2),
                points: row.points,
                rejected: row.rejected,
                latency_ms: match row.latency_us {
                    0 => f64::NAN,
                    us => f64::from(us) * 1e-3,
                },
                is_used: matches!(row.outcome, Outcome::Used | Outcome::Measured),
            })
        });
        measured.collect()
    }

    /// Returns the plain values of the run, as the page draws them: the target where the cameras
    /// measured it, the stage where the station reported it.
    pub fn curves(&self) -> RunCurves {
        let stage: Vec<(f64, [f64; 3])> = self
            .turns
            .iter()
            .filter(|turn| turn.row.outcome != Outcome::Keyframe)
            .map(|turn| (self.time_s(turn.stage_us), turn.row.stage_mm))
            .collect();
        RunCurves {
            mounting: self.hand_eye.mounting,
            stage,
            measured: self.measured(),
            marks: self.marks(),
            moments: self.moments(),
            ..RunCurves::default()
        }
    }
}

fn covariance(measurement: &Measurement) -> [[f64; 3]; 3] {
    let all = &measurement.covariance_mm2;
    std::array::from_fn(|row| std::array::from_fn(|column| all[3 * row + column]))
}

/// Returns the standard deviation along each stage axis; NaN without a variance.
fn sigma_along_stage(matrix: &[[f64; 3]; 3], covariance: &[[f64; 3]; 3]) -> [f64; 3] {
    matrix.map(|row| {
        let variance: f64 = (0..3)
            .flat_map(|i| (0..3).map(move |j| row[i] * covariance[i][j] * row[j]))
            .sum();
        match variance > 0.0 {
            true => variance.sqrt(),
            false => f64::NAN,
        }
    })
}

/// Story that is collected while a loop runs: give it to the loop as a taker, and read it at the
/// end.
#[derive(Debug)]
pub struct StoryTaker(Mutex<Story>);

impl StoryTaker {
    /// Creates the taker of a run with these cameras.
    pub fn new(names: &[String], hand_eye: HandEye) -> Arc<Self> {
        Arc::new(Self(Mutex::new(Story::new(names, hand_eye))))
    }

    /// Calls `change` with the story.
    pub fn with<T>(&self, change: impl FnOnce(&mut Story) -> T) -> T {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl FrameSetTaker for StoryTaker {
    fn take(&self, images: Option<&FrameSet>, measurement: Measurement) {
        let images = || images.map(|set| std::borrow::Cow::Borrowed(&set.images[..]));
        self.with(|story| {
            let stage_us = match measurement.outcome {
                // A keyframe has no capture time.
                Outcome::Keyframe => story.last.map_or(0, |status| status.time.micros()),
                _ => measurement.capture_us,
            };
            let mut measurement = measurement;
            measurement.frame = u32::try_from(story.turns.len()).unwrap_or(u32::MAX);
            story.turn(&measurement, stage_us, images);
        });
    }

    fn status(&self, status: &Status) {
        self.with(|story| story.status(status));
    }
}
