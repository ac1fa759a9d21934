//! Marks of a run: its events, and the spans of frame sets without effect.

use super::story::{Story, Turn};
use crate::report::{Mark, MarkKind};
use trinocular_recording::message::{Event, Outcome};

/// Longest pause between two frame sets of one span, s.
const PAUSE_S: f64 = 0.25;

/// Returns the marks of a story in the order of their time.
pub(super) fn of_story(story: &Story) -> Vec<Mark> {
    let mut marks = refused(story);
    marks.extend(absent(story));
    marks.extend(events(story));
    marks.sort_by(|a, b| a.from.total_cmp(&b.from));
    marks
}

/// Returns the spans of frame sets that were not used, each with the reasons and their number.
fn refused(story: &Story) -> Vec<Mark> {
    let reason = |turn: &Turn| match turn.row.outcome {
        Outcome::Refused | Outcome::Unused => Some(turn.row.reason.clone()),
        _ => None,
    };
    let spans = spans(story, reason);
    let mark = |span: Span| {
        let text = format!("{} not used: {}", sets(span.count), span.text);
        Mark::spanning(MarkKind::Refused, span.from_s, span.until_s, text)
    };
    spans.into_iter().map(mark).collect()
}

/// Returns the spans in which cameras were left out.
fn absent(story: &Story) -> Vec<Mark> {
    let reason = |turn: &Turn| {
        // If the whole frame set was refused, its span says so.
        let is_used = matches!(turn.row.outcome, Outcome::Used | Outcome::Measured);
        (is_used && !turn.absent.is_empty()).then(|| turn.absent.clone())
    };
    let spans = spans(story, reason);
    let mark = |span: Span| {
        let text = format!("{} without {}", sets(span.count), span.text);
        Mark::spanning(MarkKind::Occlusion, span.from_s, span.until_s, text)
    };
    spans.into_iter().map(mark).collect()
}

fn sets(count: usize) -> String {
    match count {
        1 => "1 frame set".to_owned(),
        n => format!("{n} frame sets"),
    }
}

struct Span {
    from_s: f64,
    until_s: f64,
    count: usize,
    text: String,
}

/// Returns a reason without its numbers, such as a likeness or a count of points: the same reason
/// has other numbers in every frame set.
pub(super) fn without_numbers(reason: &str) -> String {
    reason.split(|c: char| c.is_ascii_digit()).collect()
}

/// Joins neighbouring frame sets for which `reason` returns the same text but for its numbers. The
/// text of the first one stays.
fn spans(story: &Story, reason: impl Fn(&Turn) -> Option<String>) -> Vec<Span> {
    let mut spans: Vec<Span> = Vec::new();
    let mut was_there = false;
    for turn in &story.turns {
        let Some(text) = reason(turn) else {
            was_there &= turn.row.outcome == Outcome::Keyframe;
            continue;
        };
        let at_s = story.time_s(turn.row.capture_us);
        match spans.last_mut() {
            Some(span)
                if was_there
                    && without_numbers(&span.text) == without_numbers(&text)
                    && at_s - span.until_s < PAUSE_S =>
            {
                span.until_s = at_s;
                span.count += 1;
            }
            _ => spans.push(Span {
                from_s: at_s,
                until_s: at_s,
                count: 1,
                text,
            }),
        }
        was_there = true;
    }
    spans
}

/// Returns the marks of events. The target is not seen from an event that says so until the next
/// that says it is seen again.
fn events(story: &Story) -> Vec<Mark> {
    let is_seen = |event: &Event| {
        ["Tracking", "None"]
            .iter()
            .any(|s| event.text.starts_with(s))
    };
    let mut marks = Vec::new();
    for (index, event) in story.events.iter().enumerate() {
        let at_s = story.time_s(event.at_us);
        let kind = match event.kind.as_str() {
            "fault" | "line" => MarkKind::Fault,
            "switches" => MarkKind::Limit,
            "state" => MarkKind::State,
            "sight" if is_seen(event) => continue,
            "sight" => {
                let later = story.events[index + 1..].iter();
                let mut later = later.filter(|event| event.kind == "sight");
                let last_us = story.turns.last().map_or(event.at_us, |turn| turn.stage_us);
                let end_us = later.next().map_or(last_us, |event| event.at_us);
                let (until_s, text) = (story.time_s(end_us.max(event.at_us)), &event.text);
                let word = text.split(',').next().unwrap_or_default().to_lowercase();
                let text = format!("target not in sight: {word}");
                marks.push(Mark::spanning(MarkKind::Occlusion, at_s, until_s, text));
                continue;
            }
            _ => MarkKind::Note,
        };
        marks.push(Mark::at(kind, at_s, event.text.clone()));
    }
    marks
}

#[cfg(test)]
mod tests {
    use super::super::HandEye;
    use super::*;
    use trinocular_recording::message::Measurement;

    /// Returns a story with one frame set per 10 ms, from 10 ms after the keyframe on.
    fn story(outcomes: &[(Outcome, &str)]) -> Story {
        let mut story = Story::new(&["left".to_owned()], HandEye::default());
        for (index, (outcome, reason)) in outcomes.iter().enumerate() {
            let capture_us = 1_010_000 + 10_000 * index as u64;
            let measurement = Measurement {
                capture_us,
                reference_us: 1_000_000,
                outcome: *outcome,
                reason: (*reason).to_owned(),
                ..Measurement::default()
            };
            story.turn(&measurement, capture_us, || None);
        }
        story
    }

    #[test]
    fn neighbouring_refusals_are_one_span() {
        let used = (Outcome::Used, "");
        let story = story(&[
            used,
            (Outcome::Refused, "dark: 3 of 40"),
            (Outcome::Refused, "dark: 12 of 40"),
            (Outcome::Refused, "dark: 7 of 9"),
            used,
            (Outcome::Unused, "old"),
        ]);
        let marks = of_story(&story);
        assert_eq!(marks.len(), 2, "{marks:?}");
        assert!((marks[0].from - 0.02).abs() < 1e-9 && (marks[0].until - 0.04).abs() < 1e-9);
        assert_eq!(marks[0].text, "3 frame sets not used: dark: 3 of 40");
        assert_eq!(marks[1].text, "1 frame set not used: old");
    }

    #[test]
    fn lost_target_is_marked_until_seen() {
        let mut story = story(&[(Outcome::Used, ""); 9]);
        story.event(1_020_000, "sight", "Coasting, was Tracking");
        story.event(1_050_000, "sight", "Tracking, was Coasting");
        story.event(1_060_000, "fault", "fault 3: x");
        let marks = of_story(&story);
        assert_eq!(marks.len(), 2, "{marks:?}");
        assert_eq!(marks[0].kind, MarkKind::Occlusion);
        assert!((marks[0].from - 0.02).abs() < 1e-9 && (marks[0].until - 0.05).abs() < 1e-9);
        assert_eq!(
            (marks[1].kind, marks[1].text.as_str()),
            (MarkKind::Fault, "fault 3: x")
        );
    }
}
