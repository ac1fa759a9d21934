//! `trinocular convert`: rigs from and to the files of other programs.

use std::io::Write;
use std::path::PathBuf;
use std::str::FromStr;

use crate::commands::failure::Failure;
use clap::Args;
use serde_json::{Value, json};
use trinocular_core::rig::Camera;
use trinocular_rig::printable::printable;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::calibration::exchange::{self, Assembled, NoRig};

use super::destination::Destination;
use super::json;

/// Turn calibrations of OpenCV and ROS into a rig file, or a rig file into theirs
///
/// Reads one rig file (.toml), or one file per camera, whose name is the camera's: the YAML, JSON
/// or XML of OpenCV's FileStorage (also .gz), ROS's camera_info as YAML, as printed by rostopic
/// echo, or as the INI file of its calibration program, or MATLAB's Calib_Results.m. A Kalibr
/// camchain, or intrinsics and extrinsics of OpenCV's stereo_calib, hold all cameras. Prints the
/// rig file on standard output unless an option names a file or folder.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ConvertOptions {
    /// A rig file, or the files of two to eight cameras
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,

    /// Position of a camera, right and down of the rig's origin in mm, if its file has none; once
    /// for each camera
    ///
    /// ROS's files with a projection matrix and OpenCV's with R and T (mm) have one. This option
    /// overrides it.
    #[arg(long = "offset", value_name = "CAMERA=X,Y", allow_hyphen_values = true)]
    offsets: Vec<Offset>,

    /// Width and height of the images, px, for files of OpenCV's stereo_calib, which lack it:
    /// 640x480
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    image_size: Option<Size>,

    #[command(flatten)]
    destination: Destination,

    /// Print one JSON object instead of text: the rig, and the files that were written
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  trinocular convert left.yml right.yml --offset left=0,0 --offset right=68,0 --out rig.toml
  trinocular convert ost/left.yaml ost/right.yaml --out rig.toml
  trinocular convert camchain.yaml --out rig.toml
  trinocular convert intrinsics.yml extrinsics.yml --image-size 640x480 --out rig.toml
  trinocular convert rig.toml --ros camera_info/ --opencv opencv/";

/// Width and height, px.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Size([u32; 2]);

fn size(text: &str) -> Result<Size, String> {
    let side = |text: &str| text.parse().ok().filter(|side| (8..=65_535).contains(side));
    let sides = text.split_once(['x', 'X']);
    let sides = sides.and_then(|(width, height)| Some([side(width)?, side(height)?]));
    sides
        .map(Size)
        .ok_or_else(|| "must be WIDTHxHEIGHT in px, such as 640x480".to_owned())
}

#[derive(Clone, Debug, PartialEq)]
struct Offset {
    camera: String,
    mm: [f64; 2],
}

/// Error of a text that is no [`Offset`].
#[derive(Clone, Debug, thiserror::Error)]
#[error("`{0}` is not like left=-70,0: camera=X,Y in mm")]
struct WrongOffset(String);

impl FromStr for Offset {
    type Err = WrongOffset;

    fn from_str(text: &str) -> Result<Self, WrongOffset> {
        let wrong = || WrongOffset(text.to_owned());
        let (camera, place) = text.split_once('=').ok_or_else(wrong)?;
        let (x, y) = place.split_once(',').ok_or_else(wrong)?;
        let number = |text: &str| {
            text.trim()
                .parse()
                .ok()
                .filter(|n: &f64| n.is_finite())
                .ok_or_else(wrong)
        };
        Ok(Self {
            camera: camera.trim().to_owned(),
            mm: [number(x)?, number(y)?],
        })
    }
}

/// Runs the command.
pub fn run(options: &ConvertOptions, out: &mut impl Write) -> Result<(), Failure> {
    let is_toml = |file: &PathBuf| {
        file.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("toml"))
    };
    if options.image_size.is_some() && options.files.iter().any(is_toml) {
        return Err(Failure::Usage(
            "a rig file says itself how large its images are; leave --image-size out".to_owned(),
        ));
    }
    let rig = match options.files.as_slice() {
        [file] if is_toml(file) => match options.offsets.first() {
            None => RigFile::read(file).inspect(|rig| super::warnings::rig(file, rig))?,
            Some(_) => {
                return Err(Failure::Usage(
                    "a rig file says itself where its cameras are; leave --offset out".to_owned(),
                ));
            }
        },
        files if files.iter().any(is_toml) => {
            return Err(Failure::Usage(
                "give one rig file, or camera files alone".to_owned(),
            ));
        }
        files => {
            let rig = assemble(options)?;
            if let Some(first) = files.first() {
                super::warnings::rig(first, &rig);
            }
            rig
        }
    };
    let mut object = options.json.then(|| to_json(&rig));
    if let (Some(object), false) = (&object, options.destination.is_some()) {
        return Ok(json::line(out, object)?);
    }
    if !options.destination.is_some() {
        out.write_all(rig.to_toml().as_bytes())?;
        out.flush()?;
        return Ok(());
    }
    let destination = options.destination.open(&rig.names)?;
    let written = destination.write(rig)?;
    let written = written.iter().map(|path| printable(path.display()));
    match &mut object {
        Some(object) => {
            object["written"] = written.collect();
            json::line(out, object)?;
        }
        None => {
            for path in written {
                writeln!(out, "{path}")?;
            }
        }
    }
    out.flush()?;
    Ok(())
}

/// Assembles the rig of these cameras.
fn assemble(options: &ConvertOptions) -> Result<RigFile, Failure> {
    let offsets = options.offsets.iter();
    let offsets: Vec<_> = offsets
        .map(|given| (given.camera.clone(), given.mm))
        .collect();
    let size = options.image_size.map(|size| size.0);
    let assembled = exchange::rig_of(&options.files, &offsets, size);
    let Assembled { rig, doubts } = assembled.map_err(|error| match error {
        NoRig::File(error) => error.into(),
        NoRig::Argument(reason) => Failure::Usage(reason),
    })?;
    for doubt in doubts {
        super::warnings::raise(doubt);
    }
    Ok(rig)
}

/// Returns cameras and image size of the rig; no file is written yet.
fn to_json(rig: &RigFile) -> Value {
    let camera = |(name, camera): (&String, &Camera)| {
        json!({
            "name": name,
            "focal_px": camera.focal_px,
            "principal_px": camera.principal_px,
            "distortion": camera.coefficients(),
            "offset_mm": camera.offset_mm,
            "rotation_deg": camera.rotation.degrees(),
        })
    };
    let cameras: Vec<Value> = rig.names.iter().zip(&rig.rig.cameras).map(camera).collect();
    json!({"image_size_px": rig.rig.image_size_px, "cameras": cameras, "written": []})
}
