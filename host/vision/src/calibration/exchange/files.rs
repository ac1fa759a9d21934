//! The rig of a list of files: one per camera, a camchain, or the pair of `stereo_calib`.

use std::path::PathBuf;

use super::{Assembled, CameraFile, Member, NamedCamera, assemble, camera_name, several};
use trinocular_core::rig::MAX_CAMERAS;
use trinocular_rig::error::InputError;

/// Reason why files make no rig.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoRig {
    /// A file is bad.
    #[error(transparent)]
    File(#[from] InputError),
    /// The arguments do not go with the files.
    #[error("{0}")]
    Argument(String),
}

/// Assembles the rig of these files. `offsets_mm` gives the place of a camera, right and down of
/// the rig's origin, instead of the one in its file; the last one of a name counts. `image_size_px`
/// goes with the files of `stereo_calib`, which lack it.
///
/// # Errors
/// [`NoRig`] with the file, or with the argument in the words of the command line.
pub fn rig_of(
    files: &[PathBuf],
    offsets_mm: &[(String, [f64; 2])],
    image_size_px: Option<[u32; 2]>,
) -> Result<Assembled, NoRig> {
    let several = several(files, image_size_px)?;
    let lacks_size = several.as_ref().is_some_and(|several| several.lacks_size);
    let cameras = match several {
        _ if image_size_px.is_some() && !lacks_size => {
            return Err(NoRig::Argument(
                "--image-size goes with the files of OpenCV's stereo_calib; all others hold it"
                    .to_owned(),
            ));
        }
        Some(several) => several.cameras,
        None => single(files)?,
    };
    let is_known = |name: &str| cameras.iter().any(|(known, ..)| known == name);
    if let Some((unknown, _)) = offsets_mm.iter().find(|(name, _)| !is_known(name)) {
        let names: Vec<&str> = cameras.iter().map(|(name, ..)| name.as_str()).collect();
        let reason = format!("--offset {unknown}: the cameras are {}", names.join(", "));
        return Err(NoRig::Argument(reason));
    }
    let member = |(name, path, file): NamedCamera| {
        let given = offsets_mm.iter().rev().find(|(camera, _)| *camera == name);
        Member {
            offset_mm: given.map(|(_, offset_mm)| *offset_mm),
            path,
            name,
            file,
        }
    };
    let members: Vec<Member> = cameras.into_iter().map(member).collect();
    Ok(assemble(&members)?)
}

/// Reads files of single cameras, which have the cameras' names.
fn single(files: &[PathBuf]) -> Result<Vec<NamedCamera>, NoRig> {
    if !(2..=MAX_CAMERAS).contains(&files.len()) {
        // A file of all cameras, as other programs write, is named for what it is.
        if let [only] = files {
            CameraFile::read(only)?;
        }
        let count = files.len();
        return Err(NoRig::Argument(format!(
            "{count} file of a camera; a rig has 2 to {MAX_CAMERAS}"
        )));
    }
    let camera = |path: &PathBuf| {
        let file = CameraFile::read(path)?;
        Ok((camera_name(path), path.clone(), file))
    };
    files.iter().map(camera).collect()
}
