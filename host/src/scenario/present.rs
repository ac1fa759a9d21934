//! Results of scenarios for the screen and for the page.

use super::csv;
use super::figures::Figures;
use super::file::{Happening, Scenario};
use super::trace::{SAMPLE_S, Sample, Trace};
use crate::report::{Cell, LinePlot, Mark, MarkKind, Page, Style, Table};
use crate::run_report::curves;
use crate::run_report::{Provenance, RunCurves, Story};
use trinocular_client::diagnosis;
use trinocular_core::frame::message::Mounting;

const AXES: [&str; 3] = ["X", "Y", "Z"];

/// Number of samples over which velocities are differences.
const VELOCITY_SAMPLES: usize = 10;

/// Most moments in pictures on a page, over all scenarios.
const MOST_MOMENTS: usize = 12;

/// A scenario that has been run, once or twice, and judged.
#[derive(Debug)]
pub struct Outcome {
    /// Name for the reader: that of its file.
    pub name: String,
    /// Scenario that was run.
    pub scenario: Scenario,
    /// Trace of the run.
    pub trace: Trace,
    /// Figures of the run.
    pub figures: Figures,
    /// Frame sets of the run; empty unless a page was requested.
    pub story: Story,
    /// The run without prediction, if the scenario wants one.
    pub unpredicted: Option<(Trace, Figures)>,
    /// Missed expectations.
    pub missed: Vec<String>,
}

/// Returns the tracking errors, one row per run; a run without prediction follows its scenario's.
pub fn following(outcomes: &[Outcome]) -> Table {
    let table = Table::new(
        "Cameras minus target",
        [
            "scenario",
            "rms X Y Z, mm",
            "largest X Y Z, mm",
            "lag, mm",
            "settled, ms",
            "overshoot, %",
            "verdict",
        ],
    );
    let row = |name: &str, figures: &Figures, verdict: Cell| {
        let optional = |value: Option<f64>, scale: f64, decimals: usize| {
            Cell::number(value.map_or(f64::NAN, |value| value * scale), decimals)
        };
        [
            Cell::text(name),
            Cell::vector(&figures.rms_mm, 4, 7),
            Cell::vector(&figures.max_mm, 3, 6),
            Cell::number(figures.lag_mm, 4),
            optional(figures.settle_ms, 1.0, 0),
            optional(figures.overshoot, 100.0, 1),
            verdict,
        ]
    };
    outcomes.iter().fold(table, |table, outcome| {
        let verdict = match outcome.missed.len() {
            0 => Cell::text("as expected").good(),
            n => Cell::text(format!("{n} missed")).bad(),
        };
        let table = table.row(row(&outcome.name, &outcome.figures, verdict));
        match &outcome.unpredicted {
            None => table,
            Some((_, figures)) => {
                let gain = figures.rms_3d_mm / outcome.figures.rms_3d_mm;
                let verdict = Cell::text(format!("rms {gain:.1} times larger")).muted();
                table.row(row("  without prediction", figures, verdict))
            }
        }
    })
}

/// Returns the motion of the stage, one row per scenario.
pub fn stage(outcomes: &[Outcome]) -> Table {
    let table = Table::new(
        "The stage",
        [
            "scenario",
            "off its mean X Y Z, mm",
            "reversals/s X Y Z",
            "latency p50 p99, ms",
            "frames used/taken",
            "steps lost",
            "faults",
        ],
    );
    outcomes.iter().fold(table, |table, outcome| {
        let figures = &outcome.figures;
        let latency = [figures.latency_ms.p50, figures.latency_ms.p99];
        table.row([
            Cell::text(&outcome.name),
            Cell::vector(&figures.jitter_mm, 4, 7),
            Cell::vector(&figures.reversals_per_s, 1, 4),
            Cell::vector(&latency.map(|ms| ms.unwrap_or(f64::NAN)), 1, 4),
            Cell::right(format!("{}/{}", figures.frames.used, figures.frames.taken)),
            Cell::right(figures.lost.to_string()),
            Cell::text(match figures.faults.as_slice() {
                [] => "none".to_owned(),
                faults => faults.join(", "),
            }),
        ])
    })
}

/// Returns further facts of a run, as name and value.
pub fn facts(outcome: &Outcome) -> Vec<(String, String)> {
    let figures = &outcome.figures;
    let frames = &figures.frames;
    let mut facts = vec![
        ("states".to_owned(), figures.states.join(", ")),
        ("target".to_owned(), figures.sights.join(", ")),
        (
            "steps at the pins".to_owned(),
            format!("{:?}", figures.steps),
        ),
        (
            "greatest speed".to_owned(),
            format!("{:.1?} mm/s", figures.speed_mm_s),
        ),
        (
            "greatest acceleration".to_owned(),
            format!("{:.0?} mm/s²", figures.acceleration_mm_s2),
        ),
    ];
    for (reason, count) in &frames.refused {
        facts.push((
            "frame sets without a flow frame".to_owned(),
            format!("{count}: {reason}"),
        ));
    }
    for (reason, count) in &frames.denied {
        facts.push(("frames not used".to_owned(), format!("{count}: {reason}")));
    }
    if frames.lost > 0 {
        facts.push(("frames never sent".to_owned(), frames.lost.to_string()));
    }
    for silence in &figures.silences {
        let text = format!(
            "went {:.2?} mm from {:.1?} mm/s, bound {:.2?} mm",
            silence.way_mm, silence.speed_mm_s, silence.bound_mm
        );
        facts.push((format!("silence at {} s", silence.at_s), text));
    }
    for missed in &outcome.missed {
        facts.push(("missed".to_owned(), missed.clone()));
    }
    facts
}

/// Returns the page: the tables, and every scenario over time.
pub fn page(outcomes: &[Outcome], provenance: &Provenance) -> Page {
    let page = Page::new("Trinocular: scenarios", "on the built-in twin")
        .section(
            "Figures",
            "Positions are counted from the edges at the step pins, every millisecond; the error \
             is cameras minus target, each from its place at the keyframe.",
        )
        .table(following(outcomes))
        .table(stage(outcomes));
    let page = outcomes.iter().fold(page, |page, outcome| {
        let mut curves = curves(outcome);
        let most = (MOST_MOMENTS / outcomes.len().max(1)).max(1);
        let every = curves.moments.len().div_ceil(most).max(1);
        curves.moments = curves.moments.into_iter().step_by(every).collect();
        let page = page
            .section(&outcome.name, &outcome.scenario.title)
            .facts(&facts(outcome));
        let page = curves.add_to(page, true);
        let page = page
            .subsection("Velocity", "")
            .plot(velocities(outcome, &curves));
        match &outcome.unpredicted {
            None => page,
            Some((trace, _)) => {
                let unpredicted = RunCurves {
                    marks: curves.marks.clone(),
                    ..of_trace(trace)
                };
                let page = page.subsection("Error without prediction", "");
                page.plots(unpredicted.errors())
            }
        }
    });
    let runs = outcomes.iter();
    let runs = runs.map(|outcome| (outcome.name.as_str(), &outcome.trace));
    let whole = "`trinocular simulate SCENARIO.toml --csv FILE.csv` writes all rows.";
    let page = page.section("Data", "");
    let page = curves::add_table(page, "Positions, one row per ms", &csv::table(runs), whole);
    provenance.add_to(page)
}

/// Returns the plain values of a run: true positions, measurements of the images, and marks of the
/// scenario's own events beside those of the frame sets and of the station.
fn curves(outcome: &Outcome) -> RunCurves {
    let story = &outcome.story;
    let mut marks = story.marks();
    // An occlusion of the scenario says why its frame sets were refused.
    marks.extend(outcome.scenario.events.iter().map(|event| {
        let (kind, text) = described(&event.what);
        let until_s = event.at_s + event.what.seconds();
        Mark::spanning(kind, event.at_s, until_s, text)
    }));
    marks.extend(states(&outcome.trace));
    marks.sort_by(|a, b| a.from.total_cmp(&b.from));
    RunCurves {
        measured: story.measured(),
        moments: story.moments(),
        marks,
        ..of_trace(&outcome.trace)
    }
}

/// Returns the true positions of a trace.
fn of_trace(trace: &Trace) -> RunCurves {
    let points = |get: fn(&Sample) -> [f64; 3]| {
        let samples = trace.samples.iter();
        samples
            .map(move |sample| (sample.time_s, get(sample)))
            .collect()
    };
    RunCurves {
        mounting: Mounting::OnStage,
        target: points(|sample| sample.target_mm),
        stage: points(|sample| sample.camera_mm),
        ..RunCurves::default()
    }
}

/// Returns the marks of changes of the station's state and of its faults.
fn states(trace: &Trace) -> Vec<Mark> {
    let pairs = trace.samples.windows(2);
    let changes = pairs.filter_map(|pair| match pair {
        [before, after] if before.state != after.state => Some(after),
        _ => None,
    });
    let marks = changes.map(|sample| {
        let name = diagnosis::state(sample.state).name;
        Mark::at(MarkKind::State, sample.time_s, name)
    });
    let faults = trace.faults.iter().zip(&trace.faults_s);
    let faults = faults.map(|(fault, at_s)| {
        let text = format!("fault {}: {}", fault.number(), diagnosis::explain(*fault));
        Mark::at(MarkKind::Fault, *at_s, text)
    });
    marks.chain(faults).collect()
}

/// Returns kind and text of the mark of an event.
fn described(what: &Happening) -> (MarkKind, String) {
    let sets = |frames: u32| match frames {
        1 => "1 frame set".to_owned(),
        n => format!("{n} frame sets"),
    };
    match what {
        Happening::Occlusion { .. } => {
            (MarkKind::Occlusion, "the cameras see even grey".to_owned())
        }
        Happening::Drop { frames } => (MarkKind::Note, format!("{} dropped", sets(*frames))),
        Happening::Late { frames, by_ms } => (
            MarkKind::Note,
            format!("{} late by {by_ms} ms", sets(*frames)),
        ),
        Happening::Outlier { frames, by_mm } => (
            MarkKind::Note,
            format!("{} wrong by {by_mm:?} mm", sets(*frames)),
        ),
        Happening::Silence { .. } => (MarkKind::Note, "the host is silent".to_owned()),
        Happening::Limit { axis, end, .. } => {
            let end = ["negative", "positive"].get(*end).unwrap_or(&"");
            let axis = AXES.get(*axis).unwrap_or(&"");
            (
                MarkKind::Limit,
                format!("{end} limit switch of {axis} tripped"),
            )
        }
        Happening::EmergencyStop { .. } => (MarkKind::Limit, "emergency stop open".to_owned()),
        Happening::DriverFault { .. } => (MarkKind::Limit, "a driver reports a fault".to_owned()),
        Happening::Stop => (MarkKind::Note, "the host sends a stop".to_owned()),
        Happening::Reset => (MarkKind::Note, "the host sends a reset".to_owned()),
        Happening::Zero => (MarkKind::Note, "the position is declared zero".to_owned()),
    }
}

fn velocities(outcome: &Outcome, curves: &RunCurves) -> LinePlot {
    let plot = LinePlot::new("Velocity of the stage", "time, s", "mm/s").marked(&curves.marks);
    (0..3).fold(plot, |plot, i| {
        plot.series(AXES[i], Style::Line, velocity(&outcome.trace, i))
    })
}

fn velocity(trace: &Trace, axis: usize) -> impl Iterator<Item = [f64; 2]> + '_ {
    let pairs = trace.samples.windows(VELOCITY_SAMPLES + 1);
    let seconds = VELOCITY_SAMPLES as f64 * SAMPLE_S;
    pairs.filter_map(move |window| {
        let (first, last) = (window.first()?, window.last()?);
        let moved_mm = last.camera_mm[axis] - first.camera_mm[axis];
        Some([(first.time_s + last.time_s) / 2.0, moved_mm / seconds])
    })
}
