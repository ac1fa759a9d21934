//! `trinocular estimate`: displacements from a points CSV or from a folder of frame sets.

mod images;
mod measurer;
mod pose;
mod printer;

use std::io::Write;
use std::path::{Path, PathBuf};

use super::frames::{RecordingInput, Rigged, rig_missing};
use super::reference_view::ReferenceView;
use super::region::RegionOption;
use crate::commands::failure::Failure;
use crate::commands::folder_input::PairOption;
use clap::{Args, ValueEnum};
use measurer::Label;
use pose::PoseOptions;
pub use pose::Rotation;
use printer::Printer;
use serde::Serialize;
use trinocular_recording::read::is_recording;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::{self, Rule};
use trinocular_vision::points;

/// Estimate the target's displacement from matched points or from images
///
/// Prints one line per displacement: x, y, z in mm, the standard deviation of each in mm where the
/// method gives it, and the numbers of points used and rejected. If the target has turned by more
/// than noise, a second line states its rotation vector in degrees about x, y and z.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct EstimateOptions {
    /// A CSV file of matched points, a folder of frame sets, or a recording (MCAP, ROS 2 bag)
    ///
    /// CSV: header `id,camera,x0,y0,x1,y1`, then one row per point and camera: pixel positions as
    /// seen (principal point not removed, from the centre of the top left pixel) at the reference
    /// instant and now. A point that some camera has not seen is rejected and counted.
    ///
    /// Folder: one subfolder per camera, named as in the rig file, with equal file names for images
    /// taken at the same instant (PNG, JPEG, PNM, TIFF, BMP or WebP). Or all images in one folder,
    /// each camera's name first (left1.png), or a TIFF stack (left.tif) or a Y4M video (left.y4m,
    /// also a named pipe) per camera. Colour becomes grey; values of more than 8 bits are scaled by
    /// the bits that they use. Frame sets are taken in the order of their names, in which numbers
    /// count as numbers. Frame 1 is the second frame set. If a camera's file is missing, the frame
    /// is measured without that camera, with a warning; if a file cannot be read, the frame is
    /// refused.
    ///
    /// Recording: a file of --record, or sensor_msgs/Image or CompressedImage of all cameras in an
    /// MCAP file or in the folder of a ROS 2 bag. Frame sets are matched by the stamps in the
    /// headers.
    input: PathBuf,

    /// The rig file (TOML): image size, focal lengths and principal points in px, camera positions
    /// in mm
    ///
    /// Without it a recording must hold one, or camera_info of all cameras.
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,

    /// Method from points to the displacement [default: midpoint]
    #[arg(long, value_enum)]
    method: Option<Method>,

    #[command(flatten)]
    pose: PoseOptions,

    /// Frame set from which displacements count: `first`, `previous`, or a saved view
    ///
    /// `first` is the first frame set, so that errors do not add up; `previous` the one before, for
    /// targets that leave the first view; neither gives the first frame set a displacement. A saved
    /// view is a file of `trinocular reference` or of --record: every frame set gets a displacement
    /// since then, frame 1 is the first, and --rig may be left out. A points CSV holds its own
    /// reference positions.
    #[arg(
        long,
        value_name = "first|previous|FILE",
        default_value = "first",
        value_parser = reference
    )]
    reference: Reference,

    /// Print one JSON object per displacement and line
    #[arg(long, long_help = JSON_HELP)]
    json: bool,

    /// Print a CSV table: a header, then one row per displacement with all that --json prints
    #[arg(long, conflicts_with = "json")]
    csv: bool,

    #[command(flatten)]
    pair: PairOption,

    #[command(flatten)]
    region: RegionOption,

    #[command(flatten)]
    recording: RecordingInput,
}

const JSON_HELP: &str = "\
Print one JSON object per displacement and line:

{\"version\":1,\"frame\":1,\"displacement_mm\":[x,y,z],\"sigma_mm\":[x,y,z],\"points\":50,\
\"rejected\":0,\"method\":\"midpoint\"}

`sigma_mm`, the standard deviation per axis, and `covariance_mm2`, whose diagonal is its square, are \
null for closed-form and least-squares. \
If the rotation is estimated, `rotation_deg` (rotation vector about x, y and z), \
`rotation_sigma_deg` and `pivot_mm` are there, too; `displacement_mm` is the pivot's. They are null \
if the points do not determine the rotation. \
If the rig file has `[[target]]` tables, there is one object per target: `target` is its name, and \
`against` that of the reference that the displacement is relative to. \
`warnings`, a list of sentences, is there only if a camera was left out, an image is badly exposed, \
or rows of a CSV do not fit the others. A frame without an \
estimate gives {\"frame\":1,\"refused\":\"reason\"}, and the exit code is 1 after the rest has \
been printed.";

const EXAMPLES: &str = "\
Examples:
  trinocular estimate points.csv --rig rig.toml
  trinocular estimate points.csv --rig rig.toml --pivot -12.5,8,850 --json
  trinocular estimate points.csv --rig rig.toml --method closed-form --json
  trinocular estimate captures/ --rig rig.toml --reference previous
  trinocular estimate run.mcap
  trinocular estimate bag/ --rig rig.toml --topic left=/cam0/image_raw";

/// The three estimators.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum Method {
    /// The paper's eq. 9; needs exactly the cameras left, middle and right, within a millimetre of
    /// one line
    ClosedForm,
    /// The paper's eq. 7; needs the same cameras as closed-form
    LeastSquares,
    /// Exact for finite displacements and with its standard deviation; any 2 to 8 cameras in a
    /// plane
    Midpoint,
}

impl Method {
    /// Returns the library's name of the method.
    const fn estimator(self) -> estimation::Method {
        match self {
            Self::ClosedForm => estimation::Method::ClosedForm,
            Self::LeastSquares => estimation::Method::LeastSquares,
            Self::Midpoint => estimation::Method::Midpoint,
        }
    }

    /// Reads the rig; refuses one that does not suit the method.
    fn read_rig(self, path: &Path) -> Result<RigFile, InputError> {
        let rig = match self {
            Self::Midpoint => RigFile::read(path),
            Self::ClosedForm | Self::LeastSquares => RigFile::read_in_line(path),
        }?;
        super::warnings::rig(path, &rig);
        Ok(rig)
    }
}

/// The instant a displacement counts from.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Reference {
    /// The first frame set.
    First,
    /// The frame set before.
    Previous,
    /// A saved view.
    View(PathBuf),
}

fn reference(text: &str) -> Result<Reference, String> {
    match text {
        "first" => Ok(Reference::First),
        "previous" => Ok(Reference::Previous),
        file if Path::new(file).exists() => Ok(Reference::View(PathBuf::from(file))),
        _ => Err("must be first, previous, or a file that exists".to_owned()),
    }
}

/// Runs the command.
pub fn run(options: &EstimateOptions, out: &mut impl Write) -> Result<(), Failure> {
    let method = options.method.unwrap_or(Method::Midpoint);
    let is_recorded = is_recording(&options.input);
    let is_folder = options.input.is_dir() && !is_recorded;
    let is_points = !is_recorded && !is_folder;
    options.pair.goes_with(is_folder, "a folder")?;
    options.region.goes_with(!is_points, "images")?;
    let read = |path: &PathBuf| method.read_rig(path);
    let rig = options.rig.as_ref().map(read).transpose()?;
    let view = match &options.reference {
        Reference::View(path) if is_points => {
            let file = path.display();
            let reason = format!(
                "--reference {file} goes with images: a points CSV holds its own reference \
                 positions"
            );
            return Err(Failure::Usage(reason));
        }
        Reference::View(path) => Some(ReferenceView::open(path)?),
        Reference::First | Reference::Previous => None,
    };
    let rig = match &view {
        Some(view) if is_folder => rig.or_else(|| Some(view.rig.clone())),
        _ => rig,
    };
    let printer = Printer {
        options,
        method,
        out,
        rows: 0,
        refused: 0,
        is_points,
        warnings: Vec::new(),
        exposure: Vec::new(),
        absent: Vec::new(),
        targets: 1,
        label: Label::default(),
    };
    if is_recorded {
        let Rigged { frames, rig } = options.recording.open(&options.input, rig)?;
        method.estimator().check_rig(&options.input, &rig)?;
        let rule = options.pose.rule(&rig, options.method)?;
        return images::run(options, (&rig, view), rule, frames.frame_sets(), printer);
    }
    let Some(rig) = rig else {
        return Err(rig_missing("estimate INPUT --rig <RIG.toml>"));
    };
    let rule = options.pose.rule(&rig, options.method)?;
    match is_folder {
        true => {
            let folder = options.pair.open(&options.input, &rig)?;
            images::run(options, (&rig, view), rule, folder.frame_sets(), printer)
        }
        false => run_points(options, &rig, rule, printer),
    }
}

/// Estimates the one displacement of a points CSV.
fn run_points<W: Write>(
    options: &EstimateOptions,
    rig: &RigFile,
    rule: Rule,
    mut printer: Printer<'_, W>,
) -> Result<(), Failure> {
    let points = points::read(&options.input, rig)?;
    printer.warnings = points.warnings();
    let solution = rule.of_points(&rig.rig, &points, &mut printer.warnings);
    printer.solution(solution, points.correspondences.len(), points.rejected)?;
    printer.finish()
}
