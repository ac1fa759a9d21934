//! Files that a rig is written to: a rig file, OpenCV's or ROS's files. Existing files are
//! overwritten only with --force.

use std::path::{Path, PathBuf};

use crate::commands::failure::Failure;
use crate::commands::warnings;
use clap::Args;
use trinocular_rig::error::InputError;
use trinocular_rig::output::{NewFolders, Output, Replace, write_all};
use trinocular_rig::printable::printable;
use trinocular_rig::rig_file::RigFile;
use trinocular_rig::rig_file::edit::with_cameras;
use trinocular_vision::calibration::exchange;

/// Files to write.
#[derive(Debug, Args)]
pub struct Destination {
    /// Write the rig as a rig file, for `--rig` of the other commands
    #[arg(long, value_name = "RIG.toml")]
    out: Option<PathBuf>,

    /// Write CAMERA.yml for OpenCV's FileStorage into this folder
    ///
    /// Each holds image_width, image_height, camera_matrix, distortion_coefficients, and R and T,
    /// which map a point along the rig's axes to the camera's (mm).
    #[arg(long, value_name = "DIR")]
    opencv: Option<PathBuf>,

    /// Write CAMERA.yaml, ROS's camera_info, into this folder
    ///
    /// Rectification and projection matrix of each describe the rectified rig (m, as ROS has it).
    #[arg(long, value_name = "DIR")]
    ros: Option<PathBuf>,

    /// Overwrite files that exist
    ///
    /// A rig file's stage section is kept nevertheless, and its comments too if its cameras have
    /// the same names. A rig file that cannot be read is not overwritten. All files are written, or
    /// none if one of them cannot be written.
    #[arg(long)]
    force: bool,
}

/// Files opened before the work whose result they take.
pub struct Opened {
    out: Option<(Output, Option<Predecessor>)>,
    /// Name and file of each camera.
    opencv: Vec<(String, Output)>,
    ros: Vec<(String, Output)>,
    /// New folders, which are removed again if no file was written into them.
    _folders: NewFolders,
}

impl Destination {
    /// Returns true if any file was requested.
    pub fn is_some(&self) -> bool {
        self.out.is_some() || self.opencv.is_some() || self.ros.is_some()
    }

    /// Opens the files for cameras of these names; refuses to overwrite a file without --force.
    pub fn open(&self, names: &[String]) -> Result<Opened, Failure> {
        let replace = Replace::Nothing.or_forced(self.force);
        let out = self.out.as_ref().map(|path| rig_file(path, replace));
        let mut folders = NewFolders::default();
        let mut per_camera = |folder: &Option<PathBuf>, ending: &str| {
            let Some(folder) = folder else {
                return Ok(Vec::new());
            };
            folders.make(folder)?;
            let file = |name: &String| folder.join(format!("{name}.{ending}"));
            let open = |name| Ok((String::clone(name), Output::open(&file(name), replace)?));
            names.iter().map(open).collect::<Result<_, InputError>>()
        };
        let opened = Opened {
            out: out.transpose()?,
            opencv: per_camera(&self.opencv, "yml")?,
            ros: per_camera(&self.ros, "yaml")?,
            _folders: folders,
        };
        opened.check_distinct()?;
        Ok(opened)
    }
}

/// Rig file that is replaced: the new one keeps its stage, and its comments if it has the same
/// cameras.
struct Predecessor {
    rig: RigFile,
    text: String,
}

impl Predecessor {
    /// Returns the text of the rig file with the cameras of `rig`.
    fn with_cameras(self, path: &Path, mut rig: RigFile) -> String {
        match with_cameras(path, &self.text, &rig) {
            Ok(text) => text,
            Err(_) => {
                if self.text.contains('#') {
                    warnings::raise(format!(
                        "{}: its comments are dropped, because the cameras have other names; \
                         only the stage is kept",
                        printable(path.display())
                    ));
                }
                rig.stage = self.rig.stage.or(rig.stage);
                rig.to_toml()
            }
        }
    }
}

/// Opens the rig file; returns it with the file that it replaces.
fn rig_file(path: &Path, replace: Replace) -> Result<(Output, Option<Predecessor>), InputError> {
    // The file itself is read below, because its stage section is kept. All other inputs have been
    // read.
    Output::open(path, replace)?;
    let output = Output::open_successor(path, replace, path)?;
    let predecessor = match output.replaces_file() {
        true => {
            let (rig, text) = RigFile::read_with_text(path)?;
            Some(Predecessor { rig, text })
        }
        false => None,
    };
    Ok((output, predecessor))
}

impl Opened {
    fn outputs(&self) -> impl Iterator<Item = &Output> {
        let per_camera = self.opencv.iter().chain(&self.ros);
        let out = self.out.iter().map(|(output, _)| output);
        out.chain(per_camera.map(|(_, output)| output))
    }

    fn check_distinct(&self) -> Result<(), Failure> {
        for (index, output) in self.outputs().enumerate() {
            if self.outputs().take(index).any(|o| o.is_same_file(output)) {
                let path = output.path().display();
                return Err(Failure::Usage(format!("{path} would be written twice")));
            }
        }
        Ok(())
    }

    /// Writes the rig; returns the paths of the files.
    pub fn write(self, rig: RigFile) -> Result<Vec<PathBuf>, Failure> {
        let paths = self.outputs().map(|output| output.path().to_owned());
        let paths = paths.collect();
        let mut files = Vec::new();
        let camera = |rig: &RigFile, name: &str| {
            let named = rig.names.iter().position(|known| known == name);
            named.and_then(|index| rig.rig.cameras.get(index).copied())
        };
        for (name, output) in self.opencv {
            if let Some(camera) = camera(&rig, &name) {
                let text = exchange::opencv(&camera, rig.rig.image_size_px);
                files.push((output, text));
            }
        }
        for (name, output) in self.ros {
            if let Some(camera) = camera(&rig, &name) {
                files.push((output, exchange::ros(&name, &camera, &rig.rig)));
            }
        }
        if let Some((output, predecessor)) = self.out {
            let text = match predecessor {
                Some(predecessor) => predecessor.with_cameras(output.path(), rig),
                None => rig.to_toml(),
            };
            files.push((output, text));
        }
        write_all(files)?;
        Ok(paths)
    }
}

/// Refuses a file that exists, unless `force` is set, an input other than the rig file `rig`, and a
/// place that cannot be written.
pub fn refuse_existing(path: &Path, force: bool, rig: &Path) -> Result<(), InputError> {
    Output::open_successor(path, Replace::Nothing.or_forced(force), rig).map(drop)
}
