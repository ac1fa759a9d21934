//! `trinocular verify`: predicts the precision and limits of a rig.

use std::io::Write;
use std::path::PathBuf;

use crate::commands::failure::Failure;
use clap::Args;
use trinocular::budget::limitation::Severity;
use trinocular::budget::{Settings, Verification, present};
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;

use super::json;
use super::report_option::ReportOption;

/// Predict what a rig can measure, and name what limits it
///
/// From the rig file alone: the standard deviation of a displacement per axis over depth and number
/// of points, that of a rotation and of a pivot's displacement, the space that the cameras see,
/// step rates and stopping distances of the stage, and the headroom of all numbers in their
/// fixed-point formats. No image is taken and nothing moves.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct VerifyOptions {
    /// The rig file (TOML)
    #[arg(value_name = "RIG.toml")]
    rig: PathBuf,

    /// Standard deviation of the flow of one point in one camera, each component, px
    ///
    /// With 2 of 255 grey levels of noise, sharp images have 0.012 to 0.015 px, soft ones 0.03 to
    /// 0.054 px.
    /// The flow has two ends, so it is 1.41 times the noise of a point at one instant.
    #[arg(long, value_name = "PX", default_value_t = Settings::default().noise_px)]
    noise: f64,

    /// Numbers of points to predict for, separated by commas
    #[arg(
        long,
        value_name = "N,...",
        value_delimiter = ',',
        default_values_t = Settings::default().points,
        value_parser = clap::value_parser!(u32).range(1..=65_535)
    )]
    points: Vec<u32>,

    /// Nearest and farthest depth of the target, mm
    #[arg(
        long,
        value_name = "MM",
        num_args = 2,
        default_values_t = Settings::default().depth_range_mm
    )]
    depth_range: Vec<f64>,

    /// Width and height of a flat target, mm, whose rotation and pivots are predicted [default: all
    /// that the cameras see in common]
    ///
    /// It faces the cameras in the middle of what all of them see. Sigma of its rotation about x
    /// and y grows with the inverse square of its size.
    #[arg(long, value_name = "W,H", value_delimiter = ',')]
    target: Option<Vec<f64>>,

    /// Print one JSON object instead
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    report: ReportOption,
}

const EXAMPLES: &str = "\
Examples:
  trinocular verify rig.toml
  trinocular verify rig.toml --noise 0.1 --points 20,100 --report rig.html
  trinocular verify rig.toml --depth-range 600 1200 --json
  trinocular verify rig.toml --target 200,150

The exit code is 1 if the station would refuse the rig's stage.";

/// Runs the command.
pub fn run(options: &VerifyOptions, out: &mut impl Write) -> Result<(), Failure> {
    let settings = settings(options)?;
    let rig = RigFile::read(&options.rig)?;
    super::warnings::rig(&options.rig, &rig);
    let report = options.report.open()?;
    let found = Verification::of(&rig, settings);
    report.write(|| present::page(&options.rig.display().to_string(), &found))?;
    if options.json {
        json::line(out, &found)?;
    } else {
        print(&found, out)?;
    }
    out.flush()?;
    let refused = (found.limitations.iter()).find(|limit| limit.severity == Severity::Refusal);
    match refused {
        None => Ok(()),
        Some(limit) => {
            let reason = format!(
                "the station would refuse this: {}: {}",
                limit.name, limit.text
            );
            Err(InputError::file(&options.rig, reason).into())
        }
    }
}

fn settings(options: &VerifyOptions) -> Result<Settings, Failure> {
    let usage = |text: &str| Err(Failure::Usage(text.to_owned()));
    if !(options.noise > 0.0 && options.noise <= 100.0) {
        return usage("--noise must be greater than 0 and at most 100 px");
    }
    let &[near, far] = options.depth_range.as_slice() else {
        return usage("--depth-range takes two depths");
    };
    if !(near >= 1.0 && near < far && far <= 1e6) {
        return usage("--depth-range must go from at least 1 mm up to at most 1000000 mm");
    }
    let target_mm = match options.target.as_deref() {
        None => None,
        Some(&[width, height]) if [width, height].iter().all(|mm| (1.0..=1e6).contains(mm)) => {
            Some([width, height])
        }
        Some(_) => return usage("--target takes width and height, 1 to 1000000 mm: 200,150"),
    };
    Ok(Settings {
        target_mm,
        noise_px: options.noise,
        points: options.points.clone(),
        depth_range_mm: [near, far],
    })
}

fn print(found: &Verification, out: &mut impl Write) -> Result<(), Failure> {
    for table in present::tables(found) {
        writeln!(out, "{}", table.to_text())?;
    }
    for (name, value) in present::facts(found) {
        writeln!(out, "{name:>18}: {value}")?;
    }
    for limit in &found.limitations {
        let severity = limit.severity.name();
        writeln!(out, "{severity:>18}: {}: {}", limit.name, limit.text)?;
    }
    Ok(())
}
