//! `trinocular convert`: rigs from and to the files of other programs.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;
use host::calibration::exchange::CameraFile;
use host::calibration::stand::{Stand, doubts, placed};
use host::error::{Failure, InputError};
use host::notice;
use host::rig_file::RigFile;
use shared::rig::{MAX_CAMERAS, Rig};

use super::destination::Destination;

/// Turn calibrations of OpenCV and ROS into a rig file, or a rig file into theirs
///
/// Reads one rig file (.toml), or one file per camera in the YAML of OpenCV's FileStorage or of ROS's camera_info (.yml, .yaml), whose
/// name is the camera's. Prints the rig file on standard output unless told where to write.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Options {
    /// A rig file, or the files of two to eight cameras
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,

    /// Where a camera is, right and down of the rig's origin in mm, if its file does not say; once for each camera
    ///
    /// Files that do say are ROS's with a projection matrix and OpenCV's with R and T (mm). Given, it counts instead of what the file says.
    #[arg(long = "offset", value_name = "CAMERA=X,Y", allow_hyphen_values = true)]
    offsets: Vec<Offset>,

    #[command(flatten)]
    destination: Destination,
}

const EXAMPLES: &str = "\
Examples:
  trinocular convert left.yml right.yml --offset left=0,0 --offset right=68,0 --out rig.toml
  trinocular convert ost/left.yaml ost/right.yaml --out rig.toml
  trinocular convert rig.toml --ros camera_info/ --opencv opencv/";

#[derive(Clone, Debug, PartialEq)]
struct Offset {
    camera: String,
    mm: [f64; 2],
}

impl FromStr for Offset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is not like left=-70,0: camera=X,Y in mm");
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
pub fn run(options: &Options, out: &mut impl Write) -> Result<(), Failure> {
    let is_toml = |file: &PathBuf| {
        file.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("toml"))
    };
    let rig = match options.files.as_slice() {
        [file] if is_toml(file) => match options.offsets.first() {
            None => RigFile::read(file)?,
            Some(_) => {
                return Err(Failure::Usage(
                    "a rig file says itself where its cameras are; leave --offset out".to_owned(),
                ));
            }
        },
        files if files.iter().any(is_toml) => {
            return Err(Failure::Usage(
                "give one rig file, or YAML files alone".to_owned(),
            ));
        }
        files => assemble(files, &options.offsets)?,
    };
    if !options.destination.is_some() {
        out.write_all(rig.to_toml().as_bytes())?;
        out.flush()?;
        return Ok(());
    }
    for path in options.destination.write(rig)? {
        writeln!(out, "{}", path.display())?;
    }
    out.flush()?;
    Ok(())
}

/// The rig of these cameras.
fn assemble(files: &[PathBuf], offsets: &[Offset]) -> Result<RigFile, Failure> {
    if !(2..=MAX_CAMERAS).contains(&files.len()) {
        let count = files.len();
        return Err(Failure::Usage(format!(
            "{count} file of a camera; a rig has 2 to {MAX_CAMERAS}"
        )));
    }
    let names: Vec<String> = files
        .iter()
        .map(|file| {
            file.file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    if let Some(unknown) = offsets
        .iter()
        .find(|offset| !names.contains(&offset.camera))
    {
        let reason = format!(
            "--offset {}: the files are those of {}",
            unknown.camera,
            names.join(", ")
        );
        return Err(Failure::Usage(reason));
    }
    let mut image_size_px = None;
    let (mut lenses, mut motions) = (Vec::new(), Vec::new());
    for (path, name) in files.iter().zip(&names) {
        let file = CameraFile::read(path)?;
        let size = *image_size_px.get_or_insert(file.image_size_px);
        if file.image_size_px != size {
            let ([w, h], [width, height]) = (file.image_size_px, size);
            let reason = format!(
                "its images are {w} x {h} px, those of `{}` {width} x {height} px",
                names[0]
            );
            return Err(InputError::file(path, reason).into());
        }
        let given = offsets
            .iter()
            .rev()
            .find(|offset| offset.camera == *name)
            .map(|offset| offset.mm);
        motions.push(motion(path, name, &file, given)?);
        lenses.push(file.lens);
    }
    let stands = placed(&motions);
    let known: Vec<&str> = names.iter().map(String::as_str).collect();
    for doubt in doubts(&known, &stands, &vec![Stand::default(); stands.len()]) {
        notice!("warning: {doubt}");
    }
    let cameras = stands
        .iter()
        .zip(&lenses)
        .map(|(stand, lens)| stand.camera(lens));
    let rig = Rig {
        image_size_px: image_size_px.unwrap_or_default(),
        cameras: cameras.collect(),
    };
    let rig = RigFile {
        names,
        rig,
        stage: None,
    };
    // Every rule of a rig file holds for rigs that come from elsewhere.
    RigFile::parse(Path::new("the cameras as a rig file"), &rig.to_toml()).map_err(Failure::from)
}

fn motion(
    path: &Path,
    name: &str,
    file: &CameraFile,
    offset_mm: Option<[f64; 2]>,
) -> Result<nalgebra::Isometry3<f64>, InputError> {
    let Some([x, y]) = offset_mm else {
        return file.motion.ok_or_else(|| {
            InputError::file(
                path,
                format!("does not say where the camera is; give --offset {name}=X,Y (mm)"),
            )
        });
    };
    let turn = file
        .motion
        .map(|motion| motion.rotation)
        .unwrap_or_default();
    Ok(nalgebra::Isometry3::from_parts(
        (turn * -nalgebra::Vector3::new(x, y, 0.0)).into(),
        turn,
    ))
}
