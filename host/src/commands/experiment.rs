//! `trinocular` without a command: the paper's tracking experiment in closed loop.

use super::progress::Progress;
use super::scene::SceneOptions;
use clap::Args;
use host::error::Failure;
use host::experiment::{present, tracking};
use host::report::write_atomically;
use std::io::Write;
use std::path::PathBuf;

/// What the experiment without a command takes.
#[derive(Debug, Args)]
#[command(next_help_heading = "Options of the experiment (without a command)")]
pub struct Options {
    /// Where the HTML report goes
    #[arg(
        long,
        value_name = "FILE.html",
        default_value = "trinocular-report.html"
    )]
    report: PathBuf,

    /// Also write the tracking path (Fig. 7) as a picture
    #[arg(long, value_name = "FILE.svg")]
    figure: Option<PathBuf>,

    #[command(flatten)]
    scene: SceneOptions,
}

/// Runs the experiment.
pub fn run(options: &Options, out: &mut impl Write) -> Result<(), Failure> {
    let settings = tracking::Settings {
        texture: options.scene.texture,
        seed: options.scene.seed,
        scene: options.scene.settings(),
        ..tracking::Settings::default()
    };
    let mut progress = Progress::new("tracking");
    let run = tracking::run(&settings, |share| progress.at(share)).map_err(super::failed)?;
    drop(progress);
    writeln!(out, "{}", present::stops("midpoint", &run.stops).to_text())?;
    for (name, value) in present::facts(&settings, &run) {
        writeln!(out, "{name:>22}: {value}")?;
    }
    present::page(&settings, &run)
        .write(&options.report)
        .map_err(super::unwritable)?;
    if let Some(path) = &options.figure {
        let picture = present::path(&run, None).sized(760, 520).to_svg();
        picture
            .and_then(|svg| write_atomically(path, &svg))
            .map_err(super::unwritable)?;
    }
    let [x, y, z] = run.worst_mm();
    writeln!(
        out,
        "{:>22}: {x:.4} {y:.4} {z:.4} mm (the paper's: 0.2345 0.2626 0.1856 mm)",
        "largest error"
    )?;
    writeln!(out, "{:>22}: {}", "report", options.report.display())?;
    if run.succeeded() {
        return Ok(());
    }
    Err(Failure::Station(
        "the stops are not within 0.02, 0.02, 0.05 mm, or steps were lost".to_owned(),
    ))
}
