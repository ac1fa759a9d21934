//! `trinocular tables`: the paper's tables and figures, ours beside the printed values.

use super::progress::Progress;
use super::report::ReportOption;
use super::scene::SceneOptions;
use clap::Args;
use host::error::Failure;
use host::experiment::follower::Place;
use host::experiment::tracking::Stop;
use host::experiment::{moves, present, tracking};
use host::report::Page;
use host::station::stage::default_stage;
use host::sums::Estimator;
use host::validation::Validation;
use host::validation::recovery::Row;
use serde_json::{Value, json};
use std::io::Write;

/// Print the paper's Tables 1, 2, 5 and 6, ours beside the printed values
///
/// Tables 1 and 2 are computed from 1,000 random point sets without noise; Table 5 from rendered
/// pictures of resting cameras; Table 6 in closed loop on the twin. A last table holds all
/// estimators against the Cramér-Rao bound.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Options {
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
pub fn run(options: &Options, out: &mut impl Write) -> Result<(), Failure> {
    let report = options.report.open()?;
    let scene = options.scene.settings();
    let (texture, seed) = (options.scene.texture, options.scene.seed);
    let validation = Validation::run().map_err(|refusal| Failure::Station(refusal.to_string()))?;
    let rows = moves::run(texture, seed, scene).map_err(super::failed)?;
    let settings = tracking::Settings {
        texture,
        seed,
        scene,
        ..tracking::Settings::default()
    };
    // Least squares does not run on the station; it equals the closed form to a nanometre in every
    // table.
    let stage = default_stage();
    let mut progress = Progress::new("tracking");
    let run = tracking::run(&settings, &stage, Place::Twin, |share| {
        progress.at(0.5 * share)
    })
    .map_err(super::failed)?;
    let closed_form = tracking::Settings {
        estimator: Estimator::ClosedForm,
        ..settings
    };
    let closed_form = tracking::run(&closed_form, &stage, Place::Twin, |share| {
        progress.at(0.5 + 0.5 * share)
    })
    .map_err(super::failed)?;
    drop(progress);

    report.write(|| {
        let subtitle =
            "every table and figure of the paper that has numbers, ours beside the printed ones";
        let page = validation.add_to(Page::new("Trinocular: the paper's tables", subtitle));
        let page = page
            .section(
                "Single moves (section 4.2)",
                "Rendered pictures, the whole vision path.",
            )
            .table(present::moves(&rows));
        page.section("Tracking (section 4.3)", "In closed loop on the twin.")
            .table(present::stops("midpoint", &run.stops))
            .table(present::stops("closed form", &closed_form.stops))
            .facts(&present::facts(&settings, &run))
            .plots([
                present::path(&run, Some(&closed_form)).into(),
                present::laser(&run).into(),
            ])
    })?;
    if options.json {
        let of = |table: u8| -> Vec<Value> {
            let rows = validation
                .recovery
                .rows
                .iter()
                .filter(|row| row.printed.table == table);
            rows.map(recovered).collect()
        };
        let object = json!({
            "table1": of(1),
            "table2": of(2),
            "table5": rows,
            "table6": stops(&run.stops, &closed_form.stops),
            "cramer_rao": validation.noise,
            "settings": {
                "table1_sets": validation.recovery.sets,
                "texture": texture.name(),
                "seed": seed,
                "depth_mm": scene.depth_mm,
                "tilt_rad": scene.tilt_rad,
                "blur_px": scene.blur_px,
                "noise_grey": scene.noise_grey,
                "frames_per_s": settings.timing.frames_per_s,
                "latency_ms": settings.timing.latency_us as f64 * 1e-3,
                "pulses_commanded": run.pulses.map(|pulses| pulses.commanded),
                "pulses_counted": run.pulses.map(|pulses| pulses.counted),
            },
        });
        writeln!(out, "{object}")?;
        return Ok(());
    }
    for table in validation.tables() {
        writeln!(out, "{}", table.to_text())?;
    }
    writeln!(out, "{}", present::moves(&rows).to_text())?;
    for row in &rows {
        if let Some(reason) = &row.refused {
            writeln!(out, "{:?} refused: {reason}", row.true_mm)?;
        }
    }
    writeln!(out, "{}", present::stops("midpoint", &run.stops).to_text())?;
    let closed_form = present::stops("closed form", &closed_form.stops);
    writeln!(out, "{}", closed_form.to_text())?;
    Ok(())
}

/// Table 6: where B stood with the midpoint, and with the closed form.
fn stops(midpoint: &[Stop], closed_form: &[Stop]) -> Vec<Value> {
    let rows = midpoint.iter().zip(closed_form);
    rows.map(|(stop, other)| {
        json!({
            "true": stop.true_mm,
            "paper": stop.paper_mm,
            "tracked": stop.tracked_mm,
            "tracked_closed_form": other.tracked_mm,
        })
    })
    .collect()
}

/// A row of Tables 1 and 2: means over the point sets, and the closed form's spread.
fn recovered(row: &Row) -> Value {
    let [closed_form, least_squares, midpoint] = &row.recovered;
    json!({
        "true": row.printed.true_mm,
        "paper": row.printed.paper_mm,
        "closed_form": closed_form.mean_mm,
        "least_squares": least_squares.mean_mm,
        "midpoint": midpoint.mean_mm,
        "closed_form_deviation": closed_form.deviation_mm,
        "midpoint_worst_error": midpoint.worst_error_mm,
    })
}
