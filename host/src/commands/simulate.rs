//! `trinocular simulate`: runs scenarios on the twin and checks their expectations.

use super::progress::Progress;
use super::record::{Opened, Origin, RecordOption};
use super::report_option::ReportOption;
use crate::commands::failure::Failure;
use clap::Args;
use serde::Serialize;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trinocular::run_report::{HandEye, Provenance, StoryTaker};
use trinocular::scenario::csv;
use trinocular::scenario::figures::Figures;
use trinocular::scenario::file::{ImageSource, Scenario};
use trinocular::scenario::present::{self, Outcome};
use trinocular::scenario::run::{self, ScenarioOptions};
use trinocular::scenario::trace::Trace;
use trinocular::servo::recording::{FrameSetTaker, Takers};
use trinocular_core::frame::message::Mounting;
use trinocular_recording::recorder::Tap;
use trinocular_rig::error::InputError;
use trinocular_rig::output::{Output, Replace};
use trinocular_rig::pivot::Rotation;
use trinocular_rig::printable::printable;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::sums::Estimator;

/// Run scenarios on the built-in twin: target motion, occlusions, lost frames, faults
///
/// A scenario file describes the motion of the target, faults and their times, and the expected
/// figures. The controller board's own code follows on virtual time, and every figure is taken from
/// the edges at its step pins. tests/scenarios has examples of everything.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct SimulateOptions {
    /// Scenario files (TOML)
    #[arg(value_name = "SCENARIO.toml", required = true)]
    scenarios: Vec<PathBuf>,

    /// Switch the station's prediction off, to compare; expectations are not judged
    #[arg(long)]
    no_prediction: bool,

    /// Use ideal points with 0.01 px of noise instead of rendered images: a hundred times faster
    #[arg(long)]
    points: bool,

    /// Print one JSON object per scenario and line
    #[arg(long)]
    json: bool,

    /// Also write true positions, error and state at every millisecond as a CSV table
    ///
    /// An existing file is only replaced with --force.
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,

    #[command(flatten)]
    report: ReportOption,

    #[command(flatten)]
    record: RecordOption,
}

const EXAMPLES: &str = "\
Figures, of the scenario's measured time:
  rms_mm max_mm    error per axis: cameras minus target, every millisecond
  settle_ms        of a step: from the arrival of the first frame that shows it until the error
                   stays within 0.03, 0.03, 0.08 mm (or as the scenario says)
  latency_ms       from a frame set to the first step that its frame can change
  steps, lost      at the pins from start to end; planned and not made

Examples:
  trinocular simulate tests/scenarios/step.toml
  trinocular simulate tests/scenarios/*.toml --report scenarios.html
  trinocular simulate tests/scenarios/step.toml --csv step.csv
  trinocular simulate tests/scenarios/lissajous.toml --no-prediction --json

The exit code is 1 if anything that a scenario expects was missed.";

/// Runs the command.
pub fn run(options: &SimulateOptions, out: &mut impl Write) -> Result<(), Failure> {
    // Read all files before the first run, so that an error in the last one shows at once.
    let read = options.scenarios.iter().map(|path| {
        let scenario = Scenario::read(path)?;
        Ok(match options.points {
            true => scenario.with_points(),
            false => scenario,
        })
    });
    let scenarios: Vec<Scenario> = read.collect::<Result<_, InputError>>()?;
    let report = options.report.open()?;
    let replace = Replace::Nothing.or_forced(options.report.is_forced());
    let open = |path: &PathBuf| Output::open(path, replace);
    let table = options.csv.as_ref().map(open).transpose()?;
    if options.record.is_given() && scenarios.len() > 1 {
        let reason = "--record goes with one scenario: a recording holds one run";
        return Err(Failure::Usage(reason.to_owned()));
    }
    let mut recording = Some(options.record.open(options.report.is_forced())?);
    let provenance = provenance(&scenarios);
    let mut work = Work::of(&scenarios, options);
    let mut outcomes = Vec::with_capacity(scenarios.len());
    let mut recorded = Ok(());
    for (path, scenario) in options.scenarios.iter().zip(scenarios) {
        let opened = recording.take();
        let (outcome, ended) = simulate(path, scenario, options, opened, &mut work)?;
        recorded = recorded.and(ended);
        if options.json {
            print_json(&outcome, out)?;
        }
        outcomes.push(outcome);
    }
    drop(work);
    if !options.json {
        print(&outcomes, out)?;
    }
    report.write(|| present::page(&outcomes, &provenance))?;
    if let Some(table) = table {
        let runs = outcomes.iter();
        let runs = runs.map(|outcome| (outcome.name.as_str(), &outcome.trace));
        table.write(csv::table(runs))?;
    }
    out.flush()?;
    let failed = options.scenarios.iter().zip(&outcomes);
    let mut failed = failed.filter(|(_, outcome)| !outcome.missed.is_empty());
    match failed.next() {
        None => Ok(recorded?),
        Some((path, outcome)) => {
            let others = match failed.count() {
                0 => String::new(),
                n => format!(" (and {n} more files)"),
            };
            let reason = format!("missed: {}{others}", outcome.missed.join("; "));
            Err(InputError::file(path, reason).into())
        }
    }
}

/// Progress of all runs, in seconds of rendered images.
struct Work {
    /// Progress bar; `None` if the work takes too little time for one.
    progress: Option<Progress>,
    done_s: f64,
    total_s: f64,
}

impl Work {
    fn of(scenarios: &[Scenario], options: &SimulateOptions) -> Self {
        let of = |scenario: &Scenario| match is_compared(scenario, !options.no_prediction) {
            true => 2.0 * work_s(scenario),
            false => work_s(scenario),
        };
        let total_s: f64 = scenarios.iter().map(of).sum();
        Self {
            progress: (total_s > 0.0).then(|| Progress::new("simulating")),
            done_s: 0.0,
            total_s,
        }
    }

    fn run(
        &mut self,
        scenario: &Scenario,
        prediction: bool,
        tap: Option<Arc<Tap>>,
        takers: Takers,
    ) -> Result<Trace, Failure> {
        let options = ScenarioOptions {
            prediction,
            ..ScenarioOptions::default()
        };
        let run_s = work_s(scenario);
        let tell = |share: f64| {
            if let Some(progress) = &mut self.progress {
                progress.at((self.done_s + share * run_s) / self.total_s);
            }
        };
        let run = run::run_recorded(scenario, options, tap, takers, tell);
        let run = run.map_err(|error| Failure::of_servo(None, error))?;
        self.done_s += run_s;
        Ok(run.trace)
    }
}

/// Returns the work of one run, in seconds of rendered images; 0 for ideal points.
fn work_s(scenario: &Scenario) -> f64 {
    match scenario.cameras.sight {
        ImageSource::Rendered { .. } => scenario.seconds(),
        ImageSource::Points { .. } => 0.0,
    }
}

/// Returns true if a scenario runs a second time, without prediction.
fn is_compared(scenario: &Scenario, prediction: bool) -> bool {
    prediction && scenario.expect.prediction_gain.is_some()
}

/// Returns the origin of a scenario's recording.
fn origin(scenario: &Scenario) -> Origin {
    Origin {
        rig: RigFile {
            stage: Some(scenario.stage.clone()),
            // The targets of scenarios do not turn.
            rotation: Some(Rotation::Refuse),
            ..RigFile::paper()
        },
        rig_text: None,
        estimator: Estimator::Midpoint,
        twin: Some(ScenarioOptions::default().board),
        is_real: false,
        seed: Some(scenario.seed),
        regions: Regions::default(),
    }
}

/// Returns the provenance of a report, with the seeds of all scenarios.
fn provenance(scenarios: &[Scenario]) -> Provenance {
    let mut provenance = scenarios
        .first()
        .map(origin)
        .map_or_else(Provenance::default, |origin| origin.provenance());
    let seeds: BTreeSet<u64> = scenarios.iter().map(|scenario| scenario.seed).collect();
    let seeds: Vec<String> = seeds.iter().map(ToString::to_string).collect();
    provenance
        .origin
        .insert("seed".to_owned(), seeds.join(", "));
    if scenarios.len() > 1 {
        // Each scenario has a stage of its own.
        provenance.rig = None;
    }
    provenance
}

/// Runs a scenario; returns its outcome, and how its recording ended.
fn simulate(
    path: &Path,
    scenario: Scenario,
    options: &SimulateOptions,
    recording: Option<Opened>,
    work: &mut Work,
) -> Result<(Outcome, Result<(), InputError>), Failure> {
    let prediction = !options.no_prediction;
    let name = path.file_stem().unwrap_or(path.as_os_str());
    let name = name.to_string_lossy().into_owned();
    let story = StoryTaker::new(
        &RigFile::paper().names,
        HandEye::of(&scenario.stage, Mounting::OnStage),
    );
    let takers: Takers = match options.report.is_given() {
        true => vec![Arc::clone(&story) as Arc<dyn FrameSetTaker>],
        false => Takers::new(),
    };
    let (trace, ended) = match recording {
        None => (work.run(&scenario, prediction, None, takers)?, Ok(())),
        Some(opened) => {
            let recording = opened.start(&origin(&scenario))?;
            let trace = work.run(&scenario, prediction, recording.tap(), takers);
            let ended = recording.end();
            (trace?, ended)
        }
    };
    let figures = Figures::of(&scenario, &trace);
    let mut unpredicted = None;
    if is_compared(&scenario, prediction) {
        let trace = work.run(&scenario, false, None, Takers::new())?;
        let figures = Figures::of(&scenario, &trace);
        unpredicted = Some((trace, figures));
    }
    let missed = match prediction {
        true => {
            let without = unpredicted.as_ref().map(|(_, figures)| figures);
            scenario.missed(&trace, &figures, without)
        }
        false => Vec::new(),
    };
    let outcome = Outcome {
        name,
        scenario,
        trace,
        figures,
        story: story.with(std::mem::take),
        unpredicted,
        missed,
    };
    Ok((outcome, ended))
}

/// Figures and verdict of a scenario, as they are printed.
#[derive(Serialize)]
struct ScenarioLine<'a> {
    scenario: &'a str,
    #[serde(flatten)]
    figures: &'a Figures,
    #[serde(skip_serializing_if = "Option::is_none")]
    without_prediction: Option<&'a Figures>,
    missed: &'a [String],
}

fn print_json(outcome: &Outcome, out: &mut impl Write) -> Result<(), Failure> {
    let line = ScenarioLine {
        scenario: &outcome.name,
        figures: &outcome.figures,
        without_prediction: outcome.unpredicted.as_ref().map(|(_, figures)| figures),
        missed: &outcome.missed,
    };
    Ok(super::json::line(out, &line)?)
}

fn print(outcomes: &[Outcome], out: &mut impl Write) -> Result<(), Failure> {
    writeln!(out, "{}", present::following(outcomes).to_text())?;
    writeln!(out, "{}", present::stage(outcomes).to_text())?;
    for outcome in outcomes {
        let title = printable(&outcome.scenario.title);
        writeln!(out, "{}: {title}", outcome.name)?;
        for (name, value) in present::facts(outcome) {
            writeln!(out, "{name:>26}: {value}")?;
        }
    }
    Ok(())
}
