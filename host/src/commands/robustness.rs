//! `trinocular bench robustness`: measures the effect of bad images.

use super::json;
use super::progress::Progress;
use crate::commands::failure::Failure;
use clap::Args;
use std::io::Write;
use std::sync::Mutex;
use trinocular::accuracy_study::condition::{self, Condition};
use trinocular::accuracy_study::tally::{Tally, failures_of_all};
use trinocular::accuracy_study::{phase, present, sweep};
use trinocular::turning_study;
use trinocular_rig::choice;
use trinocular_vision::images::SceneError;

/// Measure rendered posters under bad conditions, and compare errors with the stated sigma
///
/// One row per condition: numbers of measured and refused displacements with the reasons; points;
/// root mean square error; mean of (error/sigma)², which is 1 where sigma is right; the share
/// within three sigma (worst axis); gross errors, beyond five sigma and 0.02 mm. A second table
/// holds the common error of all points at every sub-pixel phase. A third one holds targets that
/// turn by up to 12 degrees: alone, before a background, behind a cover, and two objects that move
/// apart, each measured with a rotation and as if nothing turned.
///
/// The exit code is 1 if a claim does not hold: error²/sigma² between 0.8 and 1.3 per axis over all
/// rows, 99 % within three sigma, at most one gross error in 10,000 measurements, every condition
/// measured or refused as it should be, cameras that fail or are late named, a bias below 0.0005 px
/// at every phase; no gross error of displacement and rotation with targets that turn, and of those
/// alone 95 % measured, error²/sigma² between 0.8 and 1.3, and 99 % within three sigma.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct RobustnessOptions {
    /// Posters per condition; each is measured four times at every noise
    #[arg(
        long,
        value_name = "N",
        default_value_t = 6,
        value_parser = clap::value_parser!(u32).range(1..=10_000)
    )]
    seeds: u32,

    /// Run only this condition, `bias` or `turning`; may be given several times
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,

    /// Print a line for every noise, too
    #[arg(long)]
    noise: bool,

    /// Threads that share the work; results do not depend on it
    #[arg(
        long,
        value_name = "T",
        default_value_t = 2,
        value_parser = clap::value_parser!(u8).range(1..=64)
    )]
    threads: u8,

    /// Print the tables as Markdown
    #[arg(long, conflicts_with = "json")]
    markdown: bool,

    /// Print one JSON object per row and line
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  trinocular bench robustness
  trinocular bench robustness --only plain --only occluded --noise
  trinocular bench robustness --only bias --seeds 20
  trinocular bench robustness --only turning --seeds 20 --noise
  trinocular bench robustness --seeds 60 --markdown";

/// Names of the second and the third table.
const TABLES: [&str; 2] = ["bias", "turning"];

/// Runs the command.
pub fn run(options: &RobustnessOptions, out: &mut impl Write) -> Result<(), Failure> {
    let chosen = chosen(&options.only)?;
    let mut failures = Vec::new();
    if !chosen.is_empty() {
        failures = conditions(options, &chosen, out)?;
    }
    let [is_bias, is_turning] =
        TABLES.map(|table| options.only.is_empty() || options.only.iter().any(|n| n == table));
    if is_bias {
        failures.extend(bias(options, out)?);
    }
    if is_turning {
        failures.extend(turning(options, out)?);
    }
    if failures.is_empty() {
        return Ok(());
    }
    Err(Failure::Claims(failures))
}

/// Returns the conditions of these names, or all.
fn chosen(names: &[String]) -> Result<Vec<&'static Condition>, Failure> {
    let known = |name: &&String| {
        TABLES.contains(&name.as_str())
            || condition::ALL
                .iter()
                .any(|condition| condition.name == **name)
    };
    if let Some(unknown) = names.iter().find(|name| !known(name)) {
        let conditions = condition::ALL.iter().map(|condition| condition.name);
        let all: Vec<&str> = conditions.chain(TABLES).collect();
        return Err(Failure::Usage(choice::unknown("condition", unknown, &all)));
    }
    let wanted = |c: &&Condition| names.is_empty() || names.iter().any(|name| name == c.name);
    Ok(condition::ALL.iter().filter(wanted).collect())
}

fn conditions(
    options: &RobustnessOptions,
    chosen: &[&'static Condition],
    out: &mut impl Write,
) -> Result<Vec<String>, Failure> {
    let progress = Mutex::new(Progress::new("measuring"));
    let told = |share| {
        if let Ok(mut progress) = progress.lock() {
            progress.at(share);
        }
    };
    let (seeds, threads) = (options.seeds.into(), options.threads.into());
    let rows = sweep::run(chosen, seeds, threads, told).map_err(unrendered)?;
    drop(progress);
    let mut total = Tally::default();
    rows.iter().for_each(|row| total.merge(&row.tally));
    if options.json {
        for row in &rows {
            json::line(out, &present::json(row.condition.name, &row.tally))?;
            for (noise, tally) in row.by_noise.iter().filter(|_| options.noise) {
                let name = format!("{}, noise {noise}", row.condition.name);
                json::line(out, &present::json(&name, tally))?;
            }
        }
        json::line(out, &present::json("all", &total))?;
    } else {
        let table = present::table(&rows, &total, options.noise, options.markdown);
        writeln!(out, "{table}")?;
    }
    let failures = rows
        .iter()
        .flat_map(|row| row.tally.failures(row.condition));
    let mut failures: Vec<String> = failures.collect();
    // There are no claims about the average of a single condition.
    if options.only.is_empty() {
        failures.extend(failures_of_all(&total, 1.0));
    }
    Ok(failures)
}

fn bias(options: &RobustnessOptions, out: &mut impl Write) -> Result<Vec<String>, Failure> {
    let mut progress = Progress::new("phases");
    let told = |share| progress.at(share);
    let phases = phase::run(options.seeds.into(), told).map_err(unrendered)?;
    drop(progress);
    if options.json {
        for phase in &phases {
            json::line(out, &present::phase_json(phase))?;
        }
    } else {
        write!(out, "{}", present::phases(&phases, options.markdown))?;
    }
    let large = phases.iter().filter(|phase| !phase.is_small());
    Ok(large
        .map(|phase| {
            format!(
                "bias at phase {:.1} is {:+.5?} px",
                phase.shift_px, phase.bias_px
            )
        })
        .collect())
}

fn turning(options: &RobustnessOptions, out: &mut impl Write) -> Result<Vec<String>, Failure> {
    let progress = Mutex::new(Progress::new("turning"));
    let told = |share| {
        if let Ok(mut progress) = progress.lock() {
            progress.at(share);
        }
    };
    let (seeds, threads) = (options.seeds.into(), options.threads.into());
    let rows = turning_study::sweep::run(seeds, threads, told).map_err(unrendered)?;
    drop(progress);
    if options.json {
        for row in &rows {
            json::line(out, &turning_study::present::json(row))?;
        }
    } else {
        let table = turning_study::present::table(&rows, options.noise);
        write!(out, "\n{}", table.to_text())?;
    }
    Ok(turning_study::sweep::failures(&rows, 1.0))
}

fn unrendered(error: SceneError) -> Failure {
    Failure::Images(error.to_string())
}
