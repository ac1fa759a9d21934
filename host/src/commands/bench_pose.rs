//! `trinocular bench pose`: accuracy of rotation and displacement against the Cramér-Rao bound.

use super::json;
use super::progress::Progress;
use crate::commands::failure::Failure;
use clap::Args;
use std::io::Write;
use trinocular::pose_study::{present, row};

/// Compare errors of rotation and displacement with the least that is possible
///
/// Random points on a poster, on a relief and in the whole picture, seen by three cameras, move by
/// (12, -8, 10) mm and turn about a slanted axis. One row per target, noise and angle: the
/// Cramér-Rao bound per axis, which is the least error of any unbiased estimator; the root mean
/// square error over it, for the pose estimator of `estimate` and for the alignment of triangulated
/// points (Kabsch), displacement and rotation; the mean of (error/sigma)², which is 1 where sigma
/// is right.
///
/// The exit code is 1 if a claim does not hold by more than chance: at most 1.06 times the bound,
/// error²/sigma² between 0.8 and 1.3, bias at most 0.01 mm and 0.02 degrees.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct PoseBenchOptions {
    /// Trials per row
    #[arg(
        long,
        value_name = "N",
        default_value_t = 500,
        value_parser = clap::value_parser!(u32).range(10..=100_000)
    )]
    trials: u32,

    /// Print one JSON object per row and line
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  trinocular bench pose
  trinocular bench pose --trials 2000 --json";

/// Runs the command.
pub fn run(options: &PoseBenchOptions, out: &mut impl Write) -> Result<(), Failure> {
    let mut progress = Progress::new("estimating");
    let rows = row::all(options.trials as usize, |share| progress.at(share));
    drop(progress);
    let rows = rows.map_err(|refusal| Failure::Images(refusal.to_string()))?;
    if options.json {
        for row in &rows {
            json::line(out, &present::json(row))?;
        }
    } else {
        writeln!(out, "{}", present::table(&rows).to_text())?;
        write!(out, "{}", present::summary(&rows))?;
    }
    let failures: Vec<String> = rows.iter().flat_map(row::Row::failures).collect();
    if failures.is_empty() {
        return Ok(());
    }
    Err(Failure::Claims(failures))
}
