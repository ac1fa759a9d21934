//! `trinocular` without a command: the paper's tracking experiment in closed loop.

use super::json;
use super::port::PortOption;
use super::progress::Progress;
use super::record::{Origin, RecordOption};
use super::scene::SceneOptions;
use crate::commands::failure::Failure;
use clap::Args;
use serde_json::{Value, json};
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use trinocular::paper::{present, tracking};
use trinocular::run_report::{HandEye, StoryTaker};
use trinocular::servo::recording::FrameSetTaker;
use trinocular::servo::station_link::TWIN_B;
use trinocular_client::stage::default_stage;
use trinocular_core::frame::message::Mounting;
use trinocular_rig::error::InputError;
use trinocular_rig::output::{Output, OwnFile, Replace, marked};
use trinocular_rig::pivot::Rotation;
use trinocular_rig::printable::printable;
use trinocular_rig::rig_file::{RigFile, Stage};
use trinocular_vision::flow::region::Regions;

/// Options of the experiment without a command.
#[derive(Debug, Args)]
#[command(next_help_heading = "Options of the experiment (without a command)")]
pub struct ExperimentOptions {
    /// File of the HTML report
    ///
    /// It replaces an earlier report of this program, but no other file without --force.
    #[arg(
        long,
        value_name = "FILE.html",
        default_value = "trinocular-report.html"
    )]
    report: PathBuf,

    /// Also write the tracking path (Fig. 7) as an SVG drawing
    #[arg(long, value_name = "FILE.svg")]
    figure: Option<PathBuf>,

    /// Replace the files of --report, --figure and --record even if this program did not write them
    #[arg(long)]
    force: bool,

    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,

    /// A rig file (TOML) whose `[stage]` station B moves; the cameras stay the paper's
    ///
    /// Without it the stage is one of 80 steps/mm and 100 mm/s: give one with a --port that moves a
    /// real stage.
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,

    #[command(flatten)]
    station: PortOption,

    #[command(flatten)]
    scene: SceneOptions,

    #[command(flatten)]
    record: RecordOption,
}

/// Returns the stage of station B.
fn stage(options: &ExperimentOptions) -> Result<Stage, InputError> {
    let Some(path) = &options.rig else {
        return Ok(default_stage());
    };
    let reason = "has no [stage] section, the only one that this experiment takes from a rig file";
    let rig = RigFile::read(path)?;
    super::warnings::rig(path, &rig);
    let stage = rig.stage.ok_or_else(|| InputError::file(path, reason))?;
    super::warnings::stage(path, &stage);
    Ok(stage)
}

/// Opens the files of the report and of the figure.
fn outputs(options: &ExperimentOptions) -> Result<(Output, Option<Output>), Failure> {
    let open = |path: &PathBuf, kind| {
        let replace = Replace::Own(kind).or_forced(options.force);
        Output::open(path, replace)
    };
    let report = open(&options.report, OwnFile::Report)?;
    let figure = options.figure.as_ref();
    let figure = figure.map(|path| open(path, OwnFile::Figure)).transpose()?;
    match &figure {
        Some(figure) if figure.is_same_file(&report) => Err(Failure::Usage(
            "--report and --figure must be two files".to_owned(),
        )),
        _ => Ok((report, figure)),
    }
}

/// Runs the experiment.
pub fn run(options: &ExperimentOptions, out: &mut impl Write) -> Result<(), Failure> {
    let settings = tracking::Settings {
        texture: options.scene.texture,
        seed: options.scene.seed,
        scene: options.scene.settings(),
        ..tracking::Settings::default()
    };
    let stage = stage(options)?;
    let (report, figure) = outputs(options)?;
    let opened = options.record.open(options.force)?;
    if [Some(&report), figure.as_ref()]
        .into_iter()
        .flatten()
        .any(|o| opened.is_same_file(o))
    {
        let reason = "--report, --figure and --record must be different files";
        return Err(Failure::Usage(reason.to_owned()));
    }
    let port = options.station.resolve()?;
    let origin = Origin {
        rig: RigFile {
            stage: Some(stage.clone()),
            // The experiment is the paper's: its target does not turn.
            rotation: Some(Rotation::Refuse),
            ..RigFile::paper()
        },
        rig_text: None,
        estimator: settings.estimator,
        twin: port.is_none().then_some(TWIN_B),
        is_real: port.is_some(),
        seed: Some(settings.seed),
        regions: Regions::default(),
    };
    let recording = opened.start(&origin)?;
    let provenance = origin.provenance();
    let story = StoryTaker::new(&origin.rig.names, HandEye::of(&stage, Mounting::OnStage));
    let place = options.station.place(port.as_deref());
    let mut progress = Progress::new("tracking");
    let tell = |share| progress.at(share);
    let takers = vec![Arc::clone(&story) as Arc<dyn FrameSetTaker>];
    let run = tracking::run_recorded(&settings, &stage, place, recording.tap(), takers, tell);
    drop(progress);
    let run = run.map_err(|error| Failure::of_servo(port.as_deref(), error));
    let recorded = recording.end();
    let run = run?;
    if !options.json {
        writeln!(out, "{}", present::stops("midpoint", &run.stops).to_text())?;
        for (name, value) in present::facts(&settings, &run) {
            writeln!(out, "{name:>22}: {value}")?;
        }
    }
    let story = story.with(std::mem::take);
    present::page(&settings, &run, &story, &provenance).write(report)?;
    if let Some(output) = figure {
        let picture = present::path(&run, None).sized(760, 520).to_svg();
        output.write(marked(&picture))?;
    }
    let written = printable(options.report.display());
    if options.json {
        json::line(out, &to_json(&run, &written))?;
    } else {
        let mm = |[x, y, z]: [f64; 3]| format!("{x:.4} {y:.4} {z:.4} mm");
        let (ours, paper) = (mm(run.worst_mm()), mm(tracking::paper_worst_mm()));
        writeln!(
            out,
            "{:>22}: {ours} (the paper's: {paper})",
            "largest error"
        )?;
        writeln!(out, "{:>22}: {written}", "report")?;
    }
    if run.succeeded() {
        return Ok(recorded?);
    }
    let [x, y, z] = tracking::BOUND_MM;
    let reason = format!("the stops are not within {x}, {y}, {z} mm, or steps were lost");
    Err(Failure::Station(reason.into()))
}

/// Returns Table 6 with its largest error.
fn to_json(run: &tracking::Run, report: &str) -> Value {
    let pulses = run.pulses;
    json!({
        "stops": run.stops,
        "worst_mm": run.worst_mm(),
        "paper_worst_mm": tracking::paper_worst_mm(),
        "frames": run.steps.len(),
        "used": run.used(),
        "pulses_commanded": pulses.map(|pulses| pulses.commanded),
        "pulses_counted": pulses.map(|pulses| pulses.counted),
        "is_within_bounds": run.succeeded(),
        "report": report,
    })
}
