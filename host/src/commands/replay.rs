//! `trinocular replay`: runs a recording again and compares.

use super::json;
use super::progress::Count;
use super::record::here;
use crate::commands::failure::Failure;
use clap::Args;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use trinocular_recording::read::survey::Survey;
use trinocular_recording::read::{Source, calibration};
use trinocular_recording::regions;
use trinocular_recording::replay::{self, Comparison, Difference, Replayed, Settings};
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::pivot::{Pivot, PivotChoice};
use trinocular_rig::printable::printable_up_to;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::sums::Estimator;

/// Longest text of a recording that is printed, characters.
const LONGEST: usize = 300;

/// Run a recording again, and compare bit for bit
///
/// Every frame set is measured anew from the recorded images. The sums are compared with the frames
/// that went to the station. The twin gets its recorded inputs at their instants: its packets,
/// segments and step edges are compared with the recorded ones. The segments of a station on a
/// serial line are not recorded, so that only measurements and frames are compared.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ReplayOptions {
    /// The recording: a file of --record
    #[arg(value_name = "RUN.mcap")]
    file: PathBuf,

    /// Print one JSON object
    ///
    /// file, same (true or false), station (twin or line), the counts `same` and
    /// `different` of measurements, frames, packets, segments and edges, not_measured (frame sets
    /// whose images are not in the file, and those that depend on them), first_difference (at_us,
    /// message, field, recorded, replayed), origin (what differs between the recording's program
    /// or machine and this one: name, recorded, here), cut (why the end is missing).
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  trinocular track --sim --record run.mcap
  trinocular replay run.mcap
  trinocular replay run.mcap --json

The exit code is 1 if anything differs.";

/// A difference of origin: name, value in the recording, value here.
type OriginDifference = (&'static str, String, String);

/// Runs the command.
pub fn run(options: &ReplayOptions, out: &mut impl Write) -> Result<(), Failure> {
    let source = Source::open(&options.file)?;
    let survey = Survey::of(&source)?;
    let Some(origin) = &survey.origin else {
        if let (Some(cut), true) = (&survey.cut, survey.topics.is_empty()) {
            let reason = format!("holds nothing of a recording: it {}", cut.reason);
            return Err(InputError::file(&options.file, reason).into());
        }
        let reason = "is no recording of this program: `replay` runs the files of --record; \
                      `estimate` reads the images of others";
        return Err(InputError::file(&options.file, reason).into());
    };
    let differences = origin_differences(origin);
    if !options.json {
        for (name, recorded, here) in &differences {
            notice!("{name}: recorded by {recorded}, replayed by {here}");
        }
    }
    let settings = settings(&source, &survey, origin)?;
    let mut count = Count::new("frame sets replayed");
    let replayed = replay::replay(&source, &settings, |frame| count.at(frame as usize + 1))?;
    drop(count);
    match options.json {
        true => {
            let object = object(options, &settings, &replayed, &differences);
            json::line(out, &object)?;
        }
        false => print(&settings, &replayed, out)?,
    }
    out.flush()?;
    let is_empty = |(_, comparison): (_, &Comparison)| comparison.same + comparison.different == 0;
    if replayed.comparisons().into_iter().all(is_empty) {
        let reason = match replayed.cut {
            Some(_) => "holds nothing to compare: it was cut off before its first frame set",
            None => "holds nothing to compare: no frame set, and no run of the twin",
        };
        return Err(InputError::file(&options.file, reason).into());
    }
    match replayed.first_difference() {
        None => Ok(()),
        Some(difference) => {
            let mut reason = format!("the replay differs: {}", text(difference));
            if !differences.is_empty() {
                reason.push_str("; another program or machine recorded it");
            }
            Err(InputError::file(&options.file, reason).into())
        }
    }
}

fn settings(
    source: &Source,
    survey: &Survey,
    origin: &BTreeMap<String, String>,
) -> Result<Settings, Failure> {
    let Some((rig, _)) = calibration::rig(source, survey)? else {
        return Err(InputError::file(source.path(), "holds no rig file").into());
    };
    let estimator = match origin.get("estimator").map(String::as_str) {
        Some("midpoint") => Estimator::Midpoint,
        Some("closed-form") => Estimator::ClosedForm,
        other => {
            let other = other.unwrap_or_default();
            let reason = format!("its estimator {other:?} is none of midpoint, closed-form");
            return Err(InputError::file(source.path(), reason).into());
        }
    };
    let pivot = origin.get("pivot").map(|text| pivot(text, &rig));
    let pivot = pivot
        .transpose()
        .map_err(|reason| InputError::file(source.path(), reason))?;
    let cameras = (rig.names.as_slice(), rig.rig.image_size_px);
    Ok(Settings {
        regions: regions::read(source.path(), cameras, survey)?,
        rig: rig.rig,
        names: rig.names,
        estimator,
        pivot,
        twin: origin.get("twin").cloned(),
    })
}

/// Reads the pivot of a recording, whose rig is `rig`.
fn pivot(text: &str, rig: &RigFile) -> Result<Pivot, String> {
    let chosen: Result<PivotChoice, _> = text.parse();
    let chosen = chosen.map_err(|error| format!("its pivot {text:?}: {error}"))?;
    let pivot = chosen.in_rig(rig.laser);
    pivot.map_err(|no_laser| format!("its pivot {text:?}: {no_laser}"))
}

/// Returns what differs between the recording's program or machine and this one.
fn origin_differences(origin: &BTreeMap<String, String>) -> Vec<OriginDifference> {
    let differs = |(name, here): (&'static str, String)| {
        let recorded = origin.get(name).cloned().unwrap_or_default();
        let recorded = printable_up_to(LONGEST, recorded);
        (recorded != here).then_some((name, recorded, here))
    };
    here().into_iter().filter_map(differs).collect()
}

fn text(difference: &Difference) -> String {
    format!(
        "at {:.6} s, {}, {}: recorded {}, replayed {}",
        difference.at_us as f64 * 1e-6,
        difference.message,
        difference.field,
        difference.recorded,
        difference.replayed
    )
}

fn object(
    options: &ReplayOptions,
    settings: &Settings,
    replayed: &Replayed,
    differences: &[OriginDifference],
) -> Value {
    let difference = replayed.first_difference().map(|difference| {
        json!({
            "at_us": difference.at_us,
            "message": difference.message,
            "field": difference.field,
            "recorded": difference.recorded,
            "replayed": difference.replayed,
        })
    });
    let origin = differences
        .iter()
        .map(|(name, recorded, here)| json!({"name": name, "recorded": recorded, "here": here}));
    let mut object = json!({
        "file": options.file.display().to_string(),
        "same": difference.is_none(),
        "station": if settings.twin.is_some() { "twin" } else { "line" },
        "not_measured": replayed.not_measured,
        "first_difference": difference,
        "origin": origin.collect::<Vec<_>>(),
        "cut": replayed.cut.as_ref().map(ToString::to_string),
    });
    for (name, comparison) in replayed.comparisons() {
        object[name] = json!({"same": comparison.same, "different": comparison.different});
    }
    object
}

fn print(settings: &Settings, replayed: &Replayed, out: &mut impl Write) -> Result<(), Failure> {
    if let Some(cut) = &replayed.cut {
        notice!("warning: {cut}");
    }
    writeln!(out, "{:>14} {:>10} {:>10}", "", "same", "different")?;
    for (name, comparison) in replayed.comparisons() {
        let is_station = ["packets", "segments", "edges"].contains(&name);
        if is_station && settings.twin.is_none() {
            continue;
        }
        let (same, different) = (comparison.same, comparison.different);
        writeln!(out, "{name:>14} {same:>10} {different:>10}")?;
    }
    if settings.twin.is_none() {
        notice!("the station was on a line: its segments are not recorded");
    }
    if replayed.not_measured > 0 {
        let count = replayed.not_measured;
        notice!("{count} frame sets without recorded images, or after such, were not measured");
    }
    Ok(())
}
