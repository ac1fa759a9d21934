//! Numbers of the last seconds of a run: samples for the plots, rates, latencies and counts.

use crate::hub::{Setup, Turn};
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use trinocular_core::frame::message::Mounting;
use trinocular_rig::rig_file::along_stage;

/// Samples that a new page gets: half a minute at 60 frame sets per second.
const HISTORY: usize = 1_800;

/// Frame sets behind rates and latencies.
const WINDOW: usize = 300;

/// Numbers of one turn of the loop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Capture time, s since the first turn.
    pub at_s: f64,
    /// Displacement of the target since the keyframe, mm, camera axes.
    pub displacement_mm: Option<[f64; 3]>,
    /// Standard deviation of the displacement, mm.
    pub sigma_mm: Option<[f64; 3]>,
    /// Following error in stage axes, µm.
    pub error_um: Option<[f64; 3]>,
    /// Position of the stage, mm.
    pub stage_mm: [f64; 3],
    /// Position of the target in stage axes, mm.
    pub target_mm: Option<[f64; 3]>,
    /// Latency from the images to the first step that they could change, ms.
    pub latency_ms: Option<f64>,
    /// Points behind the displacement.
    pub points: usize,
}

impl Sample {
    /// Computes the numbers of a turn.
    pub fn of(setup: &Setup, at_s: f64, turn: &Turn<'_>) -> Self {
        let displacement_mm = turn.estimate.map(|estimate| estimate.displacement_mm);
        let minus = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] - b[i]);
        let plus = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] + b[i]);
        let in_space = displacement_mm.map(|mm| along_stage(&setup.stage.matrix, mm));
        let (error_mm, target_mm) = match setup.mounting {
            Mounting::OnStage => (in_space, in_space.map(|way| plus(turn.stage_mm, way))),
            Mounting::Fixed => (in_space.map(|way| minus(way, turn.stage_mm)), in_space),
        };
        Self {
            at_s,
            displacement_mm,
            sigma_mm: turn.estimate.and_then(|estimate| estimate.sigma_mm),
            error_um: error_mm.map(|mm| mm.map(|mm| 1e3 * mm)),
            stage_mm: turn.stage_mm,
            target_mm,
            latency_ms: (turn.estimate).map(|estimate| f64::from(estimate.latency_us) * 1e-3),
            points: turn.estimate.map_or(0, |estimate| estimate.points),
        }
    }

    /// Returns the numbers by their names, for scripts.
    pub fn named(&self) -> Value {
        let vector = |v: Option<[f64; 3]>| v.map(|v| v.map(short));
        json!({
            "at_s": short(self.at_s),
            "displacement_mm": vector(self.displacement_mm),
            "sigma_mm": vector(self.sigma_mm),
            "error_um": vector(self.error_um),
            "stage_mm": vector(Some(self.stage_mm)),
            "target_mm": vector(self.target_mm),
            "latency_ms": self.latency_ms.map(short),
            "points": self.points,
        })
    }
}

/// Rounds to a hundredth of a micrometre, which is enough for a plot.
fn short(number: f64) -> f64 {
    rounded(number, 1e5)
}

/// A row of numbers: `[at_s, displacement, sigma, error, stage, target, latency_ms, points]`, with
/// three numbers for each vector and null for each unknown number.
impl Serialize for Sample {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let none = [None; 3];
        let vector = |v: Option<[f64; 3]>| v.map_or(none, |v| v.map(Some));
        let mut row = vec![Some(self.at_s)];
        row.extend(vector(self.displacement_mm));
        row.extend(vector(self.sigma_mm));
        row.extend(vector(self.error_um));
        row.extend(self.stage_mm.map(Some));
        row.extend(vector(self.target_mm));
        row.push(self.latency_ms);
        row.push(Some(self.points as f64));
        let short = |x: Option<f64>| x.filter(|x| x.is_finite()).map(short);
        serializer.collect_seq(row.into_iter().map(short))
    }
}

/// Numbered samples of the last seconds.
#[derive(Debug, Default)]
pub struct Samples {
    kept: VecDeque<Sample>,
    /// Number of samples so far.
    count: u64,
}

impl Samples {
    /// Adds a sample, and forgets the oldest if there are too many.
    pub fn push(&mut self, sample: Sample) {
        if self.kept.len() == HISTORY {
            self.kept.pop_front();
        }
        self.kept.push_back(sample);
        self.count += 1;
    }

    /// Returns the samples after number `seen` that are still kept, and the number of the last one.
    pub fn since(&self, seen: u64) -> (Vec<Sample>, u64) {
        let new = self.count.saturating_sub(seen).min(self.kept.len() as u64) as usize;
        let first = self.kept.len() - new;
        (self.kept.range(first..).copied().collect(), self.count)
    }

    /// Returns the last sample.
    pub fn last(&self) -> Option<&Sample> {
        self.kept.back()
    }

    /// Returns the frame sets per second, of the last ones.
    pub fn rate_hz(&self) -> Option<f64> {
        let (first, last) = (self.recent().next()?, self.kept.back()?);
        let span = last.at_s - first.at_s;
        (span > 0.0).then(|| (self.recent().count() - 1) as f64 / span)
    }

    /// Returns the latencies of the last frame sets, ms, in their order.
    pub fn latencies_ms(&self) -> Vec<f64> {
        self.recent()
            .filter_map(|sample| sample.latency_ms)
            .collect()
    }

    fn recent(&self) -> impl Iterator<Item = &Sample> {
        self.kept.range(self.kept.len().saturating_sub(WINDOW)..)
    }
}

/// Number of events by reason.
pub type Counts = BTreeMap<&'static str, u64>;

/// Returns the median and the 99th percentile of the values.
pub fn percentiles(mut values: Vec<f64>) -> Option<[f64; 2]> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let at = |share: f64| values.get((share * last as f64).round() as usize).copied();
    Some([at(0.5)?, at(0.99)?])
}

/// Rounds a number to a multiple of `1 / parts`.
pub fn rounded(value: f64, parts: f64) -> f64 {
    (value * parts).round() / parts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(at_s: f64) -> Sample {
        Sample {
            at_s,
            latency_ms: Some(at_s),
            ..Sample::default()
        }
    }

    #[test]
    fn samples_since_last_visit_are_returned() {
        let mut samples = Samples::default();
        for at in 0..5 {
            samples.push(sample(f64::from(at)));
        }
        let (new, last) = samples.since(3);
        assert_eq!(new, [sample(3.0), sample(4.0)]);
        assert_eq!(last, 5);
        assert!(samples.since(5).0.is_empty());
    }

    #[test]
    fn old_samples_are_forgotten() {
        let mut samples = Samples::default();
        for at in 0..2 * HISTORY {
            samples.push(sample(at as f64));
        }
        let (all, last) = samples.since(0);
        assert_eq!((all.len(), last), (HISTORY, 2 * HISTORY as u64));
        assert_eq!(all[0], sample(HISTORY as f64));
    }

    #[test]
    fn latency_percentiles_match_sorted_list() {
        let mut samples = Samples::default();
        assert_eq!(percentiles(samples.latencies_ms()), None);
        for at in (0..=100).rev() {
            samples.push(sample(f64::from(at)));
        }
        assert_eq!(percentiles(samples.latencies_ms()), Some([50.0, 99.0]));
    }

    #[test]
    fn unknown_numbers_become_null() {
        let bad = Sample {
            stage_mm: [f64::NAN, 0.123_456_789, -1.0],
            ..Sample::default()
        };
        let text = serde_json::to_string(&bad).unwrap();
        assert!(text.contains("null,0.12346,-1.0"), "{text}");
        assert_eq!(text.matches(',').count(), 17, "{text}");
    }
}
