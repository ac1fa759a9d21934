//! `trinocular calibrate`: cameras and rig from photographs of a chessboard.

use std::io::Write;
use std::path::PathBuf;

use crate::commands::failure::Failure;
use clap::Args;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::printable::printable;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::calibration::board::{Board, Pattern};
use trinocular_vision::calibration::check::{doubt_square, obedient, refuse_same_camera};
use trinocular_vision::calibration::folder::{
    Calibration, CalibrationSettings, CameraResult, calibrate_listed,
};
use trinocular_vision::calibration::intrinsics::Verdict;
use trinocular_vision::calibration::photographs::list_paired;
use trinocular_vision::calibration::result_json::objects;
use trinocular_vision::calibration::rig::RigSolution;

use super::destination::Destination;
use super::folder_input::PairOption;
use super::json;
use super::progress::Progress;
use super::region::RoiOption;

/// Calibrate cameras and rig from photographs of a chessboard
///
/// Finds the board's inner corners, solves every camera by Zhang's method (focal lengths, principal
/// point, distortion k1 k2 p1 p2 k3), rejects bad images by name, then places the cameras by the
/// images they took at the same instant. Every figure comes with its standard deviation.
///
/// Take 10 or more images in which the board fills a good part of the view, tilted by 20 to 40
/// degrees in different directions, some of them reaching into the corners. The board must be flat,
/// sharp and evenly lit. One with an even and an odd number of inner corners is best, because its
/// colours distinguish its two ends.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
#[command(mut_arg("roi", |roi| roi.help(ROI).long_help(format!("{ROI}\n\n{ROI_EFFECT}"))))]
pub struct CalibrateOptions {
    /// The photographs: a subfolder per camera, equal file names for images of the same instant
    ///
    /// PNG, JPEG, PNM, TIFF, BMP or WebP. The subfolders' names become the cameras' names: left,
    /// middle, right for the paper's rig. Or all images in one folder, named by camera and number:
    /// left01.jpg, right01.jpg. Names with a date or a time are those of one camera. Or a TIFF stack
    /// (left.tif) or a Y4M video (left.y4m, also a named pipe) per camera. One camera alone is
    /// calibrated too, but makes no rig: a folder, one stack or video, or `-`, a Y4M video on
    /// standard input.
    input: PathBuf,

    #[command(flatten)]
    pair: PairOption,

    /// Inner corners of the board along its two sides, where four squares meet
    #[arg(long, value_name = "9x6")]
    board: Pattern,

    /// Side of one square, mm
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true)]
    square: f64,

    #[command(flatten)]
    roi: RoiOption,

    #[command(flatten)]
    destination: Destination,

    /// Reject images whose residual is larger than this many times the median image's
    #[arg(long, value_name = "TIMES", default_value_t = 3.0, value_parser = at_least_one)]
    outlier: f64,

    /// Half the window in which corners are refined, px
    ///
    /// Without it the window follows the size of the squares, small enough that the board's border
    /// stays outside. 11 reproduces what most examples of OpenCV do.
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u8).range(2..=50))]
    window: Option<u8>,

    /// Print JSON: one line per camera, then one for the rig
    #[arg(long)]
    json: bool,
}

/// Help of `--roi`, where it differs from that of other commands.
const ROI: &str = "Rectangle in which the command looks for the board, px: left, top, width, height; \
                   of all cameras, or once per camera: left=40,30,200,150";
const ROI_EFFECT: &str =
    "What lies beyond it, such as another board or a reflection, has no effect.";

const EXAMPLES: &str = "\
Residuals are root mean square distances of corners from where they should be. A camera's offset \
is right, down and forward of the origin, the middle or first camera, in mm; its rotation is axis \
times angle in degrees, from the rig's axes to the camera's. The rig's x axis runs along the line \
of the cameras. Rotations are undone exactly by all commands that read the rig file; the offset \
forward is not, and should be small.

The paper's estimators (closed-form, least-squares) want cameras in line: heights (the second \
number of offset_mm) that cost Y more than 0.3 % of a displacement along Z are refused. In the \
paper's rig that is 0.64 mm. The midpoint takes any.

Examples:
  trinocular calibrate boards/ --board 9x6 --square 25 --out rig.toml
  trinocular calibrate boards/ --board 9x6 --square 25 --roi 0,40,640,400 --out rig.toml
  trinocular calibrate boards/ --board 9x6 --square 25 --ros camera_info/ --json";

/// Reason why a text is not the number that an option takes.
#[derive(Clone, Copy, Debug, thiserror::Error)]
enum WrongNumber {
    #[error("expected a number, with a decimal point")]
    NotANumber,
    #[error("must be greater than 0 and less than 100000")]
    OutOfRange,
    #[error("must be at least 1")]
    BelowOne,
}

fn positive(text: &str) -> Result<f64, WrongNumber> {
    let number: f64 = text.parse().map_err(|_| WrongNumber::NotANumber)?;
    if number > 0.0 && number < 1e5 {
        Ok(number)
    } else {
        Err(WrongNumber::OutOfRange)
    }
}

fn at_least_one(text: &str) -> Result<f64, WrongNumber> {
    match positive(text)? {
        number if number >= 1.0 => Ok(number),
        _ => Err(WrongNumber::BelowOne),
    }
}

/// Runs the command.
pub fn run(options: &CalibrateOptions, out: &mut impl Write) -> Result<(), Failure> {
    // Refuse before the work what would be refused after it.
    let photographs = list_paired(&options.input, options.pair.rule())?;
    super::warnings::unread(&photographs.warnings);
    super::folder_input::say(photographs.pairing.as_deref());
    let names = photographs.series.iter();
    let names: Vec<String> = names.map(|series| series.name.clone()).collect();
    let rectangles_px = options.roi.rectangles_px(&names)?;
    let destination = options.destination.open(&names)?;
    if let Some(doubt) = doubt_square(options.square) {
        super::warnings::raise(doubt);
    }
    let board = Board {
        corners: options.board.0,
        square_mm: options.square,
    };
    let settings = CalibrationSettings {
        half_window: options.window.map(usize::from),
        outlier: options.outlier,
        rectangles_px,
        ..CalibrationSettings::new(board)
    };
    let mut progress = Progress::new("looking for the board");
    let result = calibrate_listed(&options.input, &photographs, &settings, &mut |share| {
        progress.at(share);
    });
    drop(progress);
    let result = result?;
    refuse_same_camera(&options.input, &result, options.square)?;
    let mut warnings = result.warnings();
    warnings.extend(result.rig_file().iter().flat_map(RigFile::doubts));
    for warning in &warnings {
        super::warnings::raise(warning.as_str());
    }
    // Written first, because its warnings belong to the first object; what was found is printed
    // even if it cannot be written.
    let written = match options.destination.is_some() {
        true => rig_file(options, &result)
            .map_err(Failure::from)
            .and_then(|rig| destination.write(rig)),
        false => Ok(Vec::new()),
    };
    if options.json {
        print_json(&result, &warnings, out)?;
    } else {
        print_text(&result, out)?;
    }
    for path in written? {
        notice!("written: {}", printable(path.display()));
    }
    out.flush()?;
    Ok(())
}

/// Makes the rig file, if the rig obeys every rule of one.
fn rig_file(options: &CalibrateOptions, result: &Calibration) -> Result<RigFile, InputError> {
    obedient(&options.input, result)?.ok_or_else(|| {
        InputError::file(&options.input, "makes no rig: it takes two cameras or more")
    })
}

fn print_text(result: &Calibration, out: &mut impl Write) -> Result<(), Failure> {
    for camera in &result.cameras {
        print_camera(camera, out)?;
    }
    if let Some(rig) = &result.rig {
        print_rig(result, rig, out)?;
    }
    Ok(())
}

fn print_camera(camera: &CameraResult, out: &mut impl Write) -> Result<(), Failure> {
    let intrinsics = &camera.intrinsics;
    let ([width, height], used) = (camera.image_size_px, intrinsics.used());
    let (name, given) = (printable(&camera.name), camera.files.len());
    writeln!(
        out,
        "{name}: {used} of {given} images used, {width} x {height} px"
    )?;
    for (file, verdict) in camera.files.iter().zip(&intrinsics.verdicts) {
        match verdict {
            Verdict::Used { rms_px } => {
                writeln!(out, "  {:<24} {rms_px:.3} px", printable(file))?;
            }
            Verdict::Rejected(reason) => {
                let (file, reason) = (printable(file), printable(reason));
                writeln!(out, "  {file:<24} rejected: {reason}")?;
            }
        }
    }
    let (value, sigma) = (intrinsics.lens.0, intrinsics.sigma());
    let px = |i: usize| format!("{:.2} ± {:.2}", value[i], sigma[i]);
    writeln!(out, "  focal lengths   {}   {} px", px(0), px(1))?;
    writeln!(out, "  principal point {}   {} px", px(2), px(3))?;
    for (i, name) in ["k1", "k2", "p1", "p2", "k3"].into_iter().enumerate() {
        writeln!(
            out,
            "  {name}              {:9.5} ± {:.5}",
            value[4 + i],
            sigma[4 + i]
        )?;
    }
    writeln!(out, "  residual        {:.3} px\n", intrinsics.rms_px)?;
    Ok(())
}

fn print_rig(result: &Calibration, rig: &RigSolution, out: &mut impl Write) -> Result<(), Failure> {
    let used = rig
        .instants
        .iter()
        .filter(|instant| instant.is_ok())
        .count();
    writeln!(
        out,
        "rig: {used} of {} instants used, residual {:.3} px",
        rig.instants.len(),
        rig.rms_px
    )?;
    for (name, instant) in result.instants.iter().zip(&rig.instants) {
        if let Err(reason) = instant {
            let (name, reason) = (printable(name), printable(reason));
            writeln!(out, "  {name:<24} left out: {reason}")?;
        }
    }
    let origin = printable(&result.cameras[rig.reference].name);
    for (k, camera) in result
        .cameras
        .iter()
        .enumerate()
        .filter(|(k, _)| *k != rig.reference)
    {
        let (length, sigma) = rig.baseline_mm(k);
        writeln!(
            out,
            "  {origin} - {}: {length:.3} ± {sigma:.3} mm",
            printable(&camera.name)
        )?;
    }
    for ((camera, stand), sigma) in result.cameras.iter().zip(&rig.stands).zip(&rig.sigma) {
        let list = |value: [f64; 3], sigma: [f64; 3]| {
            // Adding zero to what is left after rounding turns -0 into 0.
            let one = |i: usize| {
                format!(
                    "{:8.3} ± {:.3}",
                    (value[i] * 1e3).round() / 1e3 + 0.0,
                    sigma[i]
                )
            };
            [0, 1, 2].map(one).join("  ")
        };
        let name = printable(&camera.name);
        writeln!(
            out,
            "  {name:<10} offset   {} mm",
            list(stand.offset_mm, sigma.offset_mm)
        )?;
        writeln!(
            out,
            "  {:<10} rotation {} degrees",
            "",
            list(stand.rotation_deg, sigma.rotation_deg)
        )?;
    }
    let [x, y, z] = rig.axes_sigma_deg;
    writeln!(
        out,
        "  all cameras together are turned against the rig's axes by what stands above, \
         ± {x:.3} ± {y:.3} ± {z:.3} degrees about x, y, z;\n  \
         displacements are turned by as much: {:.2} % of a motion along z may appear in x, \
         {:.2} % in y",
        100.0 * y.to_radians().tan(),
        100.0 * x.to_radians().tan()
    )?;
    Ok(())
}

fn print_json(
    result: &Calibration,
    warnings: &[String],
    out: &mut impl Write,
) -> Result<(), Failure> {
    for object in objects(result, warnings) {
        json::line(out, &object)?;
    }
    Ok(())
}
