//! The rig of a source: the rig file of an own recording, or `camera_info` of the cameras' topics.

use super::Source;
use super::survey::{CAMERA_INFO, Survey};
use crate::cdr::{CdrFault, Reader};
use crate::message::read_header;
use std::fmt::Write as _;
use std::path::PathBuf;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::calibration::exchange::{CameraFile, Member, assemble};

/// Returns the rig of the source, and where it was found; `None` if the source holds none.
///
/// # Errors
/// [`InputError`] if what the source holds is no rig.
pub fn rig(source: &Source, survey: &Survey) -> Result<Option<(RigFile, String)>, InputError> {
    let path = source.path();
    if let Some(text) = &survey.rig {
        let within = PathBuf::from(format!("{}#rig.toml", path.display()));
        let rig = RigFile::parse(&within, text)?;
        return Ok(Some((rig, "the rig file in the recording".to_owned())));
    }
    let infos = survey.topics.iter();
    let infos = infos.filter(|(_, topic)| topic.kind == CAMERA_INFO && topic.encoding == "cdr");
    let mut members = Vec::new();
    let mut topics = Vec::new();
    for (topic, info) in infos {
        let within = PathBuf::from(format!("{}#{topic}", path.display()));
        let (Some(name), Some(message)) = (camera(topic), &info.first) else {
            continue;
        };
        let malformed = |fault: CdrFault| InputError::file(&within, format!("malformed: {fault}"));
        let text = yaml(message).map_err(malformed)?;
        members.push(Member {
            file: CameraFile::parse(&within, text.as_bytes())?,
            path: within,
            name: name.to_owned(),
            offset_mm: None,
        });
        topics.push(topic.as_str());
    }
    if members.len() < 2 {
        return Ok(None);
    }
    let found = format!("camera_info of {}", topics.join(", "));
    Ok(Some((assemble(&members)?.rig, found)))
}

/// Returns the camera's name: the part in front of `camera_info`.
fn camera(topic: &str) -> Option<&str> {
    topic.strip_suffix("/camera_info")?.rsplit('/').next()
}

/// Converts a message to the YAML of ROS's calibration files, whose reader checks it.
fn yaml(message: &[u8]) -> Result<String, CdrFault> {
    let mut reader = Reader::new(message)?;
    read_header(&mut reader)?;
    let (height, width) = (reader.u32()?, reader.u32()?);
    let model: String = reader
        .text()?
        .chars()
        .filter(|c| c.is_ascii_graphic())
        .collect();
    let distortion = reader.f64s()?;
    let (k, r, p) = (
        reader.array::<9>()?,
        reader.array::<9>()?,
        reader.array::<12>()?,
    );
    let mut text = format!(
        "image_width: {width}\nimage_height: {height}\ndistortion_model: {:?}\n",
        if model.is_empty() {
            "plumb_bob"
        } else {
            &model
        }
    );
    let mut matrix = |name: &str, rows: usize, values: &[f64]| {
        let columns = values.len() / rows;
        let values: Vec<String> = values.iter().map(|value| format!("{value:?}")).collect();
        let _ = write!(
            text,
            "{name}:\n  rows: {rows}\n  cols: {columns}\n  data: [{}]\n",
            values.join(", ")
        );
    };
    matrix("camera_matrix", 3, &k);
    match distortion.as_slice() {
        [] => matrix("distortion_coefficients", 1, &[0.0; 5]),
        values => matrix("distortion_coefficients", 1, values),
    }
    if r.iter().any(|value| *value != 0.0) {
        matrix("rectification_matrix", 3, &r);
    }
    matrix("projection_matrix", 3, &p);
    Ok(text)
}
