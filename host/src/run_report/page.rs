//! The page of one run, from its story.

use super::curves::{RunCurves, add_table};
use super::marks::without_numbers;
use super::{Provenance, Story};
use crate::report::Page;
use crate::scenario::figures::{largest, percentile, rms};
use std::collections::BTreeMap;
use trinocular_recording::message::Outcome;
use trinocular_rig::printable::printable_up_to;

/// Figures of a run, as name and value and for JSON.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figures {
    /// Frame sets without the keyframes.
    pub frames: usize,
    /// Frame sets that the station used.
    pub used: usize,
    /// Frame sets with a displacement and without an answer in the recording.
    pub measured: usize,
    /// Frame sets that were not used, by reason.
    pub refused: BTreeMap<String, usize>,
    /// Time from the first keyframe to the last frame set, s.
    pub seconds: f64,
    /// Root mean square of the measured error per axis, µm.
    pub error_rms_um: Option<[f64; 3]>,
    /// Largest measured error per axis, µm.
    pub error_max_um: Option<[f64; 3]>,
    /// Median and 99th percentile of the latency, ms.
    pub latency_ms: Option<[f64; 2]>,
    /// Number of events and spans that are marked.
    pub events: usize,
}

impl Figures {
    /// Computes the figures of a story.
    pub fn of(story: &Story, curves: &RunCurves) -> Self {
        let mut figures = Self::default();
        // The first sentence of each reason, by the reason without its numbers.
        let mut sentences: BTreeMap<String, String> = BTreeMap::new();
        let turns = story.turns.iter();
        for turn in turns.filter(|turn| turn.row.outcome != Outcome::Keyframe) {
            figures.frames += 1;
            figures.seconds = story.time_s(turn.row.capture_us);
            match turn.row.outcome {
                Outcome::Used => figures.used += 1,
                // Ideal points leave no displacement in the recording.
                Outcome::Measured if turn.row.displacement_mm.is_none() => {}
                Outcome::Measured => figures.measured += 1,
                _ => {
                    let reason = &turn.row.reason;
                    let sentence = sentences.entry(without_numbers(reason));
                    let sentence = sentence.or_insert_with(|| reason.clone());
                    *figures.refused.entry(sentence.clone()).or_default() += 1;
                }
            }
        }
        let mut errors = curves.measured_error();
        errors.retain(|((_, mm), _)| mm.iter().all(|mm| mm.is_finite()));
        if !errors.is_empty() {
            let um = |axis: usize| errors.iter().map(move |((_, mm), _)| 1e3 * mm[axis]);
            figures.error_rms_um = Some([0, 1, 2].map(|axis| rms(um(axis))));
            let largest_of = |axis| largest(um(axis).map(f64::abs));
            figures.error_max_um = Some([0, 1, 2].map(largest_of));
        }
        let latencies = curves.measured.iter().map(|seen| seen.latency_ms);
        let mut latencies: Vec<f64> = latencies.filter(|ms| ms.is_finite()).collect();
        latencies.sort_by(f64::total_cmp);
        let at = |share| percentile(&latencies, share);
        figures.latency_ms = at(0.5).zip(at(0.99)).map(|(p50, p99)| [p50, p99]);
        figures.events = curves.marks.len();
        figures
    }

    /// Returns the figures as name and value for the reader.
    pub fn facts(&self) -> Vec<(String, String)> {
        let refused: usize = self.refused.values().sum();
        let mut facts = vec![(
            "frame sets".to_owned(),
            format!("{} in {:.2} s", self.frames, self.seconds),
        )];
        let without = self
            .frames
            .saturating_sub(self.used + self.measured + refused);
        if without > 0 {
            let name = "without a displacement in the recording";
            facts.push((name.to_owned(), without.to_string()));
        } else if self.measured > 0 {
            facts.push(("measured".to_owned(), self.measured.to_string()));
        } else {
            facts.push(("used by the station".to_owned(), self.used.to_string()));
        }
        facts.push(("not used".to_owned(), refused.to_string()));
        let vector = |um: [f64; 3]| um.map(|um| format!("{um:.1}")).join(" ");
        let facts_of_error = [
            ("error, rms X Y Z, µm", self.error_rms_um),
            ("error, largest X Y Z, µm", self.error_max_um),
        ];
        for (name, um) in facts_of_error {
            facts.extend(um.map(|um| (name.to_owned(), vector(um))));
        }
        if let Some([p50, p99]) = self.latency_ms {
            let text = format!("{p50:.1} {p99:.1}");
            facts.push(("latency p50 p99, ms".to_owned(), text));
        }
        for (reason, count) in &self.refused {
            facts.push((format!("{count} not used"), reason.clone()));
        }
        facts
    }
}

/// Returns the page of a run, and its figures.
///
/// `note` stands at the top if it is not empty: that the recording is cut off, for example.
pub fn page(title: &str, story: &Story, note: &str, provenance: &Provenance) -> (Page, Figures) {
    let curves = story.curves();
    let figures = Figures::of(story, &curves);
    let command = provenance.origin.get("command");
    let subtitle = command.map_or("a recorded run", String::as_str);
    let subtitle = printable_up_to(300, subtitle).to_string();
    let page = Page::new(title, subtitle).section("Summary", note);
    let page = curves.add_to(page.facts(&figures.facts()), false);
    let whole = "`trinocular export RUN.mcap --csv FILE.csv` writes all rows of a recording.";
    let page = page.section("Data", "");
    let page = add_table(page, "Measurements", &story.table(), whole);
    (provenance.add_to(page), figures)
}

#[cfg(test)]
mod tests {
    use super::super::HandEye;
    use super::*;
    use crate::report::balance;
    use trinocular_core::frame::message::Mounting;
    use trinocular_recording::message::Measurement;
    use trinocular_vision::images::Image;

    #[test]
    fn page_of_hostile_texts_is_well_formed() {
        let hostile = "</script><b>&\"'\u{1b}[2J";
        let hand_eye = HandEye {
            mounting: Mounting::Fixed,
            ..HandEye::default()
        };
        let mut story = Story::new(&[hostile.to_owned()], hand_eye);
        for (index, outcome) in [Outcome::Keyframe, Outcome::Refused, Outcome::Used]
            .into_iter()
            .enumerate()
        {
            let measurement = Measurement {
                capture_us: 10_000 * index as u64,
                outcome,
                reason: hostile.to_owned(),
                cameras: vec![0],
                pixels: vec![1.0, 2.0, f64::NAN, 4.0],
                absent: vec![(0, hostile.to_owned()), (9, String::new())],
                displacement_mm: [f64::NAN, f64::INFINITY, 1e300],
                ..Measurement::default()
            };
            let grey = vec![0; 16];
            let image = Image {
                width: 4,
                height: 4,
                grey,
            };
            story.turn(&measurement, 0, || Some(vec![image].into()));
        }
        story.event(5_000, hostile, hostile);
        let origin = [
            ("command", hostile.to_owned()),
            ("seed", hostile.to_owned()),
        ];
        let provenance = Provenance::new(origin, Some(hostile.to_owned()));
        let (page, _) = page(hostile, &story, hostile, &provenance);
        let html = page.to_html();
        assert_eq!(balance::fault(&html), None);
        assert_eq!(html.matches("<script").count(), 1);
        assert!(!html.contains('\u{1b}'));
    }

    #[test]
    fn empty_story_makes_a_page() {
        let (page, figures) = page("t", &Story::default(), "", &Provenance::default());
        let html = page.to_html();
        assert_eq!(balance::fault(&html), None);
        assert_eq!(figures, Figures::default());
    }

    /// The stage's axes are turned by 90 degrees about Z, so that the cameras see its Y as their X.
    #[test]
    fn errors_are_along_the_axes_of_the_stage() {
        let hand_eye = HandEye {
            matrix: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            ..HandEye::default()
        };
        let mut story = Story::new(&["left".to_owned()], hand_eye);
        let mut covariance_mm2 = [0.0; 9];
        covariance_mm2[0] = 1e-4;
        covariance_mm2[4] = 4e-4;
        let measurement = Measurement {
            capture_us: 10_000,
            outcome: Outcome::Used,
            cameras: vec![0],
            displacement_mm: [0.3, 0.0, 0.0],
            covariance_mm2,
            ..Measurement::default()
        };
        story.turn(&measurement, 10_000, || None);
        let curves = story.curves();
        let figures = Figures::of(&story, &curves);
        assert_eq!(figures.error_max_um, Some([0.0, 300.0, 0.0]));
        let ((_, error_mm), sigma_mm) = curves.measured_error()[0];
        assert_eq!(error_mm, [0.0, -0.3, 0.0]);
        assert!((sigma_mm[0] - 0.02).abs() < 1e-12 && (sigma_mm[1] - 0.01).abs() < 1e-12);
    }

    #[test]
    fn refusals_are_counted_without_their_numbers() {
        let mut story = Story::default();
        for points in 3..8 {
            let measurement = Measurement {
                outcome: Outcome::Refused,
                reason: format!("too few points: {points} of 40"),
                ..Measurement::default()
            };
            story.turn(&measurement, 0, || None);
        }
        let refused = Figures::of(&story, &story.curves()).refused;
        assert_eq!(
            refused.into_iter().collect::<Vec<_>>(),
            [("too few points: 3 of 40".to_owned(), 5)]
        );
    }
}
