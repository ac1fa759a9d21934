//! `trinocular tables`: the paper's tables and figures, computed values beside the printed ones.

use super::progress::Progress;
use super::report_option::ReportOption;
use super::scene::SceneOptions;
use crate::commands::failure::Failure;
use clap::Args;
use std::io::Write;
use trinocular::paper::tables::{PaperTables, TablesError};

/// Print the paper's Tables 1, 2, 5 and 6, ours beside the printed values
///
/// Tables 1 and 2 are computed from 1,000 random point sets without noise; Table 5 from rendered
/// images of resting cameras; Table 6 in closed loop on the twin. A last table compares all
/// estimators with the Cramér-Rao bound.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct TablesOptions {
    /// Print one JSON object instead: table1, table2, table5, table6, settings (mm)
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    report: ReportOption,

    #[command(flatten)]
    scene: SceneOptions,
}

const EXAMPLES: &str = "\
Examples:
  trinocular tables
  trinocular tables --json > tables.json
  trinocular tables --texture blobs --seed 7 --report tables.html";

/// Runs the command.
pub fn run(options: &TablesOptions, out: &mut impl Write) -> Result<(), Failure> {
    let report = options.report.open()?;
    let scene = options.scene.settings();
    let (texture, seed) = (options.scene.texture, options.scene.seed);
    let mut progress = Progress::new("tracking");
    let tables = PaperTables::run(texture, seed, scene, |share| progress.at(share));
    drop(progress);
    let tables = tables.map_err(|error| match error {
        TablesError::Estimate(refusal) => Failure::Estimate(refusal),
        TablesError::Servo(error) => Failure::of_servo(None, error),
    })?;
    report.write(|| tables.page())?;
    if options.json {
        super::json::line(out, &tables.to_json())?;
        return Ok(());
    }
    for table in tables.simulated() {
        writeln!(out, "{}", table.to_text())?;
    }
    writeln!(out, "{}", tables.single_moves().to_text())?;
    for (true_mm, reason) in tables.refused_moves() {
        writeln!(out, "{true_mm:?} refused: {reason}")?;
    }
    for table in tables.stops() {
        writeln!(out, "{}", table.to_text())?;
    }
    Ok(())
}
