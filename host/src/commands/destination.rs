//! Where a rig is written to: our rig file, OpenCV's or ROS's files. Nothing that exists is overwritten unasked.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use host::calibration::exchange;
use host::error::{Failure, InputError};
use host::report::write_atomically;
use host::rig_file::RigFile;

/// Files to write.
#[derive(Debug, Args)]
pub struct Destination {
    /// Write the rig as a rig file, for `--rig` of the other commands
    #[arg(long, value_name = "RIG.toml")]
    out: Option<PathBuf>,

    /// Write CAMERA.yml for OpenCV's FileStorage into this folder
    ///
    /// Each holds image_width, image_height, camera_matrix, distortion_coefficients, and R and T, which take a point along the rig's
    /// axes to the camera's (mm).
    #[arg(long, value_name = "DIR")]
    opencv: Option<PathBuf>,

    /// Write CAMERA.yaml, ROS's camera_info, into this folder
    ///
    /// Rectification and projection matrix of each describe the rectified rig (m, as ROS has it).
    #[arg(long, value_name = "DIR")]
    ros: Option<PathBuf>,

    /// Overwrite files that exist
    ///
    /// A rig file's stage section is kept even so; a rig file that cannot be read is not overwritten.
    #[arg(long)]
    force: bool,
}

impl Destination {
    /// Whether anything is to be written.
    pub fn is_some(&self) -> bool {
        self.out.is_some() || self.opencv.is_some() || self.ros.is_some()
    }

    /// Refuses what would overwrite a file, before any work is done.
    pub fn check(&self, names: &[String]) -> Result<(), Failure> {
        let files = self
            .out
            .iter()
            .cloned()
            .chain(names.iter().flat_map(|name| self.per_camera(name)));
        if let Some(folder) = self.out.as_ref().and_then(|path| path.parent()) {
            // The parent of a bare name is the empty path: the current folder.
            if !folder.as_os_str().is_empty() && !folder.is_dir() {
                return Err(InputError::file(folder, "no such folder").into());
            }
        }
        for file in files {
            refuse_existing(&file, self.force)?;
        }
        Ok(())
    }

    fn per_camera(&self, name: &str) -> impl Iterator<Item = PathBuf> {
        let opencv = self
            .opencv
            .as_ref()
            .map(|dir| dir.join(format!("{name}.yml")));
        let ros = self
            .ros
            .as_ref()
            .map(|dir| dir.join(format!("{name}.yaml")));
        opencv.into_iter().chain(ros)
    }

    /// Writes the rig. Returns the files that have been written.
    pub fn write(&self, mut rig: RigFile) -> Result<Vec<PathBuf>, Failure> {
        self.check(&rig.names)?;
        let mut written = Vec::new();
        if let Some(path) = &self.out {
            if path.exists() {
                rig.stage = RigFile::read(path)?.stage.or(rig.stage);
            }
            rig.write(path)?;
            written.push(path.clone());
        }
        let cameras = || rig.names.iter().zip(&rig.rig.cameras);
        if let Some(dir) = &self.opencv {
            for (name, camera) in cameras() {
                let text = exchange::opencv(camera, rig.rig.image_size_px);
                written.push(save(dir, &format!("{name}.yml"), &text)?);
            }
        }
        if let Some(dir) = &self.ros {
            for (name, camera) in cameras() {
                let text = exchange::ros(name, camera, &rig.rig);
                written.push(save(dir, &format!("{name}.yaml"), &text)?);
            }
        }
        Ok(written)
    }
}

/// Refuses a file that exists, unless it may be overwritten.
pub fn refuse_existing(path: &Path, force: bool) -> Result<(), InputError> {
    if path.exists() && !force {
        return Err(InputError::file(
            path,
            "exists; give --force to overwrite it",
        ));
    }
    Ok(())
}

fn save(dir: &Path, name: &str, text: &str) -> Result<PathBuf, Failure> {
    fs::create_dir_all(dir).map_err(|cause| InputError::io(dir, "make the folder", &cause))?;
    let path = dir.join(name);
    write_atomically(&path, text).map_err(|error| InputError::unwritten(&path, error))?;
    Ok(path)
}
