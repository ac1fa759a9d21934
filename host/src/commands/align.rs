//! `trinocular align`: corrections of the principal points from images of any textured scene.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::region::RegionOption;
use crate::commands::failure::Failure;
use crate::commands::folder_input::PairOption;
use clap::Args;
use trinocular::report::{Cell, Table};
use trinocular_rig::error::InputError;
use trinocular_rig::output::{Output, Replace};
use trinocular_rig::printable::printable;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::alignment::{
    Alignment, AlignmentRefusal, AlignmentSettings, present, rewrite,
};
use trinocular_vision::flow::mistake::hint;
use trinocular_vision::images::FrameSet;

/// Correct a rig's principal points from images of any textured scene
///
/// The paper's section 4.1: principal points from a calibration are off by a pixel or more, which
/// costs the closed form most of its Z. In parallel cameras every point of a scene must have equal
/// heights, and disparities in the ratio of the baselines. The command prints the offsets that make
/// it so with their standard deviation, and writes them into a corrected rig file. A camera that is
/// rolled against the others by more than three standard deviations gets a new `rotation_deg`.
///
/// Two things do not show in a scene of unknown depth and stay as they are: a common shift of all
/// images (the camera in the middle keeps its principal point), and a common error of all
/// disparities, as if infinity were elsewhere (no depth is changed). A flat target at a known
/// --depth shows the second. Cameras that stand elsewhere than `offset_mm` says look like offsets
/// too where a scene has but one depth: measure them well.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct AlignOptions {
    /// A folder of frame sets: one subfolder per camera, equal file names, or a stack or video per
    /// camera, as for `estimate`
    ///
    /// One frame set of a scene that fills the images with texture is enough; several make it
    /// better.
    #[arg(value_name = "FOLDER")]
    captures: PathBuf,

    /// The rig file (TOML)
    #[arg(long, value_name = "RIG.toml")]
    rig: PathBuf,

    /// Write the corrected rig file here: the same text with other principal points, and other
    /// rotations of rolled cameras
    #[arg(long, value_name = "FILE.toml")]
    out: Option<PathBuf>,

    /// Replace the file given by --out if it exists
    #[arg(long, requires = "out")]
    force: bool,

    #[command(flatten)]
    pair: PairOption,

    #[command(flatten)]
    region: RegionOption,

    /// Distance of a flat target, mm, along the axis of the camera in the middle, if it is known
    ///
    /// Measured from the plane of the cameras' entrance pupils. The target may be tilted. 1 mm of
    /// error in it moves the outer principal points of the paper's rig by 0.05 px.
    #[arg(long, value_name = "MM")]
    depth: Option<f64>,

    /// Largest offset in the search, px
    #[arg(long, value_name = "PX", default_value_t = AlignmentSettings::default().reach_px)]
    reach: f64,

    /// Largest number of frame sets to use, evenly spread
    #[arg(
        long,
        value_name = "N",
        default_value_t = 20,
        value_parser = clap::value_parser!(u16).range(1..=200)
    )]
    most: u16,

    /// Print one JSON object instead
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  trinocular align captures/ --rig rig.toml
  trinocular align captures/ --rig rig.toml --out aligned.toml
  trinocular align wall/ --rig rig.toml --depth 1200 --out rig.toml --force";

/// Runs the command.
pub fn run(options: &AlignOptions, out: &mut impl Write) -> Result<(), Failure> {
    let mut settings = settings(options)?;
    let (rig, text) = RigFile::read_with_text(&options.rig)?;
    settings.regions = options.region.regions(&rig)?;
    super::warnings::rig(&options.rig, &rig);
    let replace = Replace::Nothing.or_forced(options.force);
    let open = |path: &PathBuf| Output::open_successor(path, replace, &options.rig);
    let output = options.out.as_ref().map(open).transpose()?;
    let captures = captures(options, &rig)?;
    let found = Alignment::of(&rig, &captures, &settings).map_err(|refusal| {
        let is_explained = matches!(refusal, AlignmentRefusal::SameImages { .. });
        let first = captures.first().filter(|_| !is_explained);
        let hint = first.and_then(|first| hint(&rig.rig, &rig.names, first));
        let hint = hint.map_or(String::new(), |hint| format!("; {hint}"));
        InputError::file(&options.captures, format!("{refusal}{hint}"))
    })?;
    if let Some(output) = output {
        write(&options.rig, &text, output, &found)?;
    }
    if options.json {
        let mut object = serde_json::to_value(&found).map_err(std::io::Error::from)?;
        object["warnings"] = present::warnings(&found).into();
        super::json::line(out, &object)?;
    } else {
        print(options, &found, out)?;
    }
    out.flush()?;
    Ok(())
}

fn settings(options: &AlignOptions) -> Result<AlignmentSettings, Failure> {
    let usage = |text: &str| Err(Failure::Usage(text.to_owned()));
    if !(options.reach >= 1.0 && options.reach <= 500.0) {
        return usage("--reach must be from 1 to 500 px");
    }
    if (options.depth).is_some_and(|depth| !(1.0..=1e6).contains(&depth)) {
        return usage("--depth must be from 1 to 1000000 mm");
    }
    Ok(AlignmentSettings {
        reach_px: options.reach,
        depth_mm: options.depth,
        ..AlignmentSettings::default()
    })
}

fn captures(options: &AlignOptions, rig: &RigFile) -> Result<Vec<FrameSet>, InputError> {
    let folder = options.pair.open(&options.captures, rig)?.complete()?;
    let most = usize::from(options.most);
    let Some(all) = folder.count() else {
        // The number of frame sets from pipes is unknown.
        return folder.frame_sets().take(most).collect();
    };
    let used = all.min(most);
    let chosen: Vec<usize> = (0..used).map(|i| i * all / used).collect();
    (folder.frame_sets().enumerate())
        .filter(|(index, _)| chosen.contains(index))
        .map(|(_, capture)| capture)
        .collect()
}

fn write(rig: &Path, text: &str, to: Output, found: &Alignment) -> Result<(), InputError> {
    let corrections: Vec<_> = found.cameras.iter().map(Into::into).collect();
    let text = rewrite::corrected(rig, text, &corrections)?;
    to.write(&text)
}

fn print(options: &AlignOptions, found: &Alignment, out: &mut impl Write) -> Result<(), Failure> {
    writeln!(out, "{}", table(found).to_text())?;
    for (name, value) in present::facts(found) {
        writeln!(out, "{name:>16}: {value}")?;
    }
    for warning in present::warnings(found) {
        writeln!(out, "{:>16}: {warning}", "warning")?;
    }
    if let Some(path) = &options.out {
        writeln!(
            out,
            "{:>16}: {}",
            "corrected rig",
            printable(path.display())
        )?;
    }
    Ok(())
}

/// Makes the table of offsets and new principal points, as in the paper's Table 4.
fn table(found: &Alignment) -> Table {
    let mut table = Table::new(
        "Offsets of the principal points (the paper's Table 4), px",
        ["camera", "X", "Y", "sigma X", "sigma Y", "principal point"],
    );
    for camera in &found.cameras {
        let sigma = camera.sigma_px.map(|sigma| {
            if sigma > 0.0 {
                Cell::number(sigma, 4)
            } else {
                Cell::right("kept")
            }
        });
        let [sigma_x, sigma_y] = sigma;
        table = table.row([
            Cell::text(camera.name.as_str()),
            Cell::number(camera.offset_px[0], 3),
            Cell::number(camera.offset_px[1], 3),
            sigma_x,
            sigma_y,
            Cell::vector(&camera.principal_px, 3, 8),
        ]);
    }
    table
}
