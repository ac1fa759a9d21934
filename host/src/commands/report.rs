//! `trinocular report`: the page of a recording.

use super::json;
use crate::commands::failure::Failure;
use clap::Args;
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use trinocular::report::Page;
use trinocular::run_report::page::{self, Figures};
use trinocular::run_report::{foreign, reading};
use trinocular_recording::message::Outcome;
use trinocular_recording::read::Source;
use trinocular_recording::read::survey::Survey;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::output::{Output, OwnFile, Replace};
use trinocular_rig::printable::printable;

/// Write the page of a recording: plots, events, pictures and data in one HTML file
///
/// The page shows target and stage over time, the error in µm with its sigma, the path in space,
/// what the cameras saw, and every fault, occlusion and refused frame. It needs no network and no
/// other file. Of an MCAP file or ROS 2 bag of another program it shows topics and images.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ReportOptions {
    /// The recording: a file of --record, another MCAP file, or the folder of a ROS 2 bag
    #[arg(value_name = "RUN.mcap")]
    input: PathBuf,

    /// File of the page [default: the recording's name with the ending .html, beside it]
    ///
    /// It replaces an earlier report of this program, but no other file without --force.
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,

    /// Replace the file of the page even if it is no report of this program
    #[arg(long)]
    force: bool,

    /// Print one JSON object
    ///
    /// file, report (path of the page), kind (run, or images for a recording without measurements),
    /// seconds, frames, used, measured (without an answer in the recording), refused (counts by
    /// reason), events (marks in the plots), error_rms_um and error_max_um (stage minus target as
    /// the cameras measured it), latency_ms (p50, p99), cut (why the end is missing).
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  trinocular track --sim --record run.mcap
  trinocular report run.mcap
  trinocular report run.mcap --out run-17.html --json

`--report FILE.html` of track, simulate and the experiment writes the same without a recording.";

/// Runs the command.
pub fn run(options: &ReportOptions, out: &mut impl Write) -> Result<(), Failure> {
    let source = Source::open(&options.input)?;
    let path = match &options.out {
        Some(path) => path.clone(),
        None => beside(&options.input),
    };
    let output = Output::open(
        &path,
        Replace::Own(OwnFile::Report).or_forced(options.force),
    )?;
    let survey = Survey::of(&source)?;
    if let Some(cut) = &survey.cut {
        notice!("warning: {cut}");
    }
    let name = options
        .input
        .file_name()
        .unwrap_or(options.input.as_os_str());
    let title = format!("Trinocular: {}", name.to_string_lossy());
    let (page, figures) = match &survey.origin {
        Some(_) => of_run(options, &title, &source, &survey)?,
        None => (of_images(options, &title, &source, &survey)?, None),
    };
    page.write(output)?;
    if options.json {
        let cut = survey.cut.as_ref().map(ToString::to_string);
        let object = object(options, &path, &figures, cut);
        json::line(out, &object)?;
        return Ok(());
    }
    for (name, value) in figures.iter().flat_map(Figures::facts) {
        writeln!(out, "{:>26}: {}", printable(name), printable(value))?;
    }
    writeln!(out, "{:>26}: {}", "report", printable(path.display()))?;
    Ok(())
}

/// Returns the default path of the page.
fn beside(input: &Path) -> PathBuf {
    let name = input.file_stem().unwrap_or("recording".as_ref());
    let mut name = name.to_owned();
    name.push(".html");
    input.with_file_name(name)
}

/// Makes the page of a recording of this program.
fn of_run(
    options: &ReportOptions,
    title: &str,
    source: &Source,
    survey: &Survey,
) -> Result<(Page, Option<Figures>), Failure> {
    let reading = reading::read(source, survey)?;
    let story = &reading.story;
    let mut notes = Vec::new();
    if let Some(cut) = &reading.cut {
        notes.push(format!(
            "The end of the run is missing: the recording {}.",
            cut.reason
        ));
    }
    let [frame_sets, messages] = reading.dropped;
    if frame_sets + messages > 0 {
        notes.push(format!(
            "The disk was too slow: {frame_sets} frame sets and {messages} other messages are \
             missing in the recording."
        ));
    }
    if !story
        .turns
        .iter()
        .any(|turn| turn.row.outcome != Outcome::Keyframe)
    {
        let reason = "holds no measurement: it was cut off before its first frame set, or nothing \
                      was followed";
        return Err(InputError::file(&options.input, reason).into());
    }
    let (page, figures) = page::page(title, story, &notes.join(" "), &reading.provenance);
    Ok((page, Some(figures)))
}

/// Makes the page of a recording of another program.
fn of_images(
    options: &ReportOptions,
    title: &str,
    source: &Source,
    survey: &Survey,
) -> Result<Page, Failure> {
    if let (Some(cut), true) = (&survey.cut, survey.topics.is_empty()) {
        let reason = format!("holds nothing to report: it {}", cut.reason);
        return Err(InputError::file(&options.input, reason).into());
    }
    if foreign::image_topics(survey) == 0 {
        let reason = "is no recording of this program, and no topic has images \
                      (sensor_msgs/Image or CompressedImage in CDR): there is nothing to report";
        return Err(InputError::file(&options.input, reason).into());
    }
    notice!("no recording of this program: the page shows topics and images, no measurements");
    Ok(foreign::page(title, source, survey)?)
}

fn object(
    options: &ReportOptions,
    path: &Path,
    figures: &Option<Figures>,
    cut: Option<String>,
) -> Value {
    let kind = if figures.is_some() { "run" } else { "images" };
    let figures = figures.clone().unwrap_or_default();
    json!({
        "file": options.input.display().to_string(),
        "report": path.display().to_string(),
        "kind": kind,
        "seconds": figures.seconds,
        "frames": figures.frames,
        "used": figures.used,
        "measured": figures.measured,
        "refused": figures.refused,
        "events": figures.events,
        "error_rms_um": figures.error_rms_um,
        "error_max_um": figures.error_max_um,
        "latency_ms": figures.latency_ms.map(|[p50, p99]| json!({"p50": p50, "p99": p99})),
        "cut": cut,
    })
}
