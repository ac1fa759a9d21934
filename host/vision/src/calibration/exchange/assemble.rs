//! Assembly of one rig from camera files of other programs, by all rules of a rig file.
//!
//! An error names the value in the camera's own file, or the offset that the user gave instead.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Vector3};
use trinocular_core::rig::{Camera, Rig};

use super::CameraFile;
use super::yaml::Place;
use crate::calibration::stand::{CameraPose, doubts, placed};
use trinocular_rig::error::InputError;
use trinocular_rig::pivot::Pivot;
use trinocular_rig::rig_file::RigFile;

/// One camera: file, name, content of the file, and the position if the user gave one.
#[derive(Clone, Debug)]
pub struct Member {
    /// Path that errors name.
    pub path: PathBuf,
    /// Name of the camera.
    pub name: String,
    /// Content of the file.
    pub file: CameraFile,
    /// Offset from the rig's origin to the right and down, mm; replaces the position in the file.
    pub offset_mm: Option<[f64; 2]>,
}

/// Assembled rig, with warnings about it.
#[derive(Clone, Debug)]
pub struct Assembled {
    /// Rig without a stage.
    pub rig: RigFile,
    /// Warnings for the user, in sentences.
    pub doubts: Vec<String>,
}

/// Assembles the rig of these cameras.
///
/// # Errors
/// [`InputError`] if the cameras do not form a rig.
pub fn assemble(members: &[Member]) -> Result<Assembled, InputError> {
    let [first, ..] = members else {
        return Err(InputError::file(Path::new(""), "no camera"));
    };
    let size = first.file.image_size_px;
    for Member { path, file, .. } in members {
        if file.image_size_px != size {
            let ([w, h], [width, height]) = (file.image_size_px, size);
            let reason = format!(
                "its images are {w} x {h} px, those of `{}` {width} x {height} px",
                first.name
            );
            return Err(InputError::file(path, reason));
        }
    }
    let motions: Vec<_> = members.iter().map(motion).collect::<Result<_, _>>()?;
    let stands = placed(&motions);
    for (member, stand) in members.iter().zip(&stands) {
        let mut numbers = stand.offset_mm.iter().chain(&stand.rotation_deg);
        if !numbers.all(|number| number.is_finite()) {
            let reason = "no axes of a rig follow from where the cameras are and look";
            return Err(member.fault(member.file.places.turn.as_ref(), reason));
        }
    }
    let names: Vec<String> = members.iter().map(|member| member.name.clone()).collect();
    let known: Vec<&str> = names.iter().map(String::as_str).collect();
    let doubts = doubts(&known, &stands, &vec![CameraPose::default(); stands.len()]);
    let cameras = stands.iter().zip(members);
    let cameras = cameras.map(|(stand, member)| Camera {
        rational: member.file.rational,
        ..stand.camera(&member.file.lens)
    });
    let rig = Rig {
        image_size_px: size,
        cameras: cameras.collect(),
    };
    let stage = None;
    let text = RigFile {
        names,
        rig,
        stage,
        rotation: None,
        pivot: Pivot::Centroid,
        trigger: None,
        laser: None,
        targets: Vec::new(),
        capture: Vec::new(),
    }
    .to_toml();
    let rig = RigFile::parse(&first.path, &text).map_err(|error| blame(members, error))?;
    Ok(Assembled { rig, doubts })
}

fn motion(member: &Member) -> Result<Isometry3<f64>, InputError> {
    let known = member.file.motion;
    let Some([x, y]) = member.offset_mm else {
        return known.ok_or_else(|| {
            let name = &member.name;
            let reason = format!("does not say where the camera is; give --offset {name}=X,Y (mm)");
            InputError::file(&member.path, reason)
        });
    };
    let turn = known.map(|motion| motion.rotation).unwrap_or_default();
    let shift = turn * -Vector3::new(x, y, 0.0);
    Ok(Isometry3::from_parts(shift.into(), turn))
}

/// Turns the error of a field such as `camera[2].offset_mm[1]` into that of the file it comes from.
fn blame(members: &[Member], error: InputError) -> InputError {
    let field = error.field.unwrap_or_default();
    let camera = field.strip_prefix("camera[").and_then(|rest| {
        let (number, field) = rest.split_once("].")?;
        Some((members.get(number.parse::<usize>().ok()?)?, field))
    });
    let Some((member, field)) = camera else {
        let path = members.first().map_or(Path::new(""), |member| &member.path);
        return InputError::file(path, format!("makes no rig: {}", error.reason));
    };
    let places = &member.file.places;
    let of_rig = format!("as {field} of the rig: {}", error.reason);
    match field.split('[').next().unwrap_or_default() {
        "name" => {
            let reason = format!("its name is the camera's: {}", error.reason);
            InputError::file(&member.path, reason)
        }
        "offset_mm" if member.offset_mm.is_some() => {
            let reason = format!("--offset {}: {}", member.name, error.reason);
            InputError::file(&member.path, reason)
        }
        "offset_mm" => member.fault(places.shift.as_ref(), of_rig),
        "rotation_deg" => member.fault(places.turn.as_ref(), of_rig),
        "distortion" => member.fault(Some(&places.distortion), error.reason),
        _ => member.fault(Some(&places.matrix), of_rig),
    }
}

impl Member {
    fn fault(&self, place: Option<&Place>, reason: impl Into<String>) -> InputError {
        match place {
            Some(Place { line, field }) => InputError::field(&self.path, *line, field, reason),
            None => InputError::file(&self.path, reason),
        }
    }
}
