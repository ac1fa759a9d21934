//! Results of scenarios for the screen and for the page.

use super::figures::Figures;
use super::file::Scenario;
use super::trace::{SAMPLE_S, Sample, Trace};
use crate::report::{Cell, Figure, LinePlot, Page, Style, Table};

const AXES: [&str; 3] = ["X", "Y", "Z"];

/// Number of samples over which velocities are differences.
const VELOCITY_SAMPLES: usize = 10;

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
pub fn page(outcomes: &[Outcome]) -> Page {
    let page = Page::new("Trinocular: scenarios", "on the built-in twin")
        .section(
            "Figures",
            "Positions are counted from the edges at the step pins, every millisecond; the error \
             is cameras minus target, each from its place at the keyframe.",
        )
        .table(following(outcomes))
        .table(stage(outcomes));
    outcomes.iter().fold(page, |page, outcome| {
        let page = page
            .section(&outcome.name, &outcome.scenario.title)
            .facts(&facts(outcome))
            .plots(curves(&outcome.trace));
        match &outcome.unpredicted {
            None => page,
            Some((trace, _)) => page.plots([error_plot("Error without prediction", trace)]),
        }
    })
}

/// Returns target and stage on each axis, their difference, and their velocities.
pub fn curves(trace: &Trace) -> Vec<Figure> {
    let positions = (0..3).map(|i| {
        let of = |get: fn(&Sample) -> [f64; 3]| {
            let samples = trace.samples.iter();
            samples.map(move |sample| [sample.time_s, get(sample)[i]])
        };
        let title = format!("{} of target and stage", AXES[i]);
        LinePlot::new(title, "time, s", "mm")
            .series("target", Style::Dashed, of(|sample| sample.target_mm))
            .series("stage", Style::Line, of(|sample| sample.camera_mm))
            .into()
    });
    let velocities = LinePlot::new("Velocity of the stage", "time, s", "mm/s");
    let velocities = (0..3).fold(velocities, |plot, i| {
        plot.series(AXES[i], Style::Line, velocity(trace, i))
    });
    positions
        .chain([
            error_plot("Error, stage - target", trace),
            velocities.into(),
        ])
        .collect()
}

fn error_plot(title: &str, trace: &Trace) -> Figure {
    let plot = LinePlot::new(title, "time, s", "mm").including(0.0);
    let plot = (0..3).fold(plot, |plot, i| {
        let error = trace.samples.iter();
        let error = error.map(move |sample| [sample.time_s, sample.error_mm()[i]]);
        plot.series(AXES[i], Style::Line, error)
    });
    plot.into()
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
