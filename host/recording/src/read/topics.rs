//! Topics with the images of each camera.

use super::image::KINDS;
use super::survey::Survey;
use std::path::Path;
use trinocular_rig::error::InputError;

/// Topic of each camera, in the rig's order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topics(Vec<String>);

/// Returns true for messages of this type and encoding that hold images that are read.
pub(super) fn is_image(kind: &str, encoding: &str) -> bool {
    KINDS.contains(&kind) && encoding == "cdr"
}

impl Topics {
    /// Finds the topic with the images of each camera: the one that `chosen` names for it, or the
    /// only one with the camera's name between two slashes.
    ///
    /// # Errors
    /// [`InputError`] with the topics that have images, if none or several fit a camera.
    pub fn find(
        path: &Path,
        survey: &Survey,
        names: &[String],
        chosen: &[(String, String)],
    ) -> Result<Self, InputError> {
        let images = survey.topics.iter();
        let images = images.filter(|(_, topic)| is_image(&topic.kind, &topic.encoding));
        let images: Vec<&str> = images.map(|(name, _)| name.as_str()).collect();
        if let (true, Some(reason)) = (images.is_empty(), survey.imageless()) {
            return Err(InputError::file(path, reason));
        }
        let listed = || match images.as_slice() {
            [] => "no topic has images (sensor_msgs/Image or CompressedImage in CDR)".to_owned(),
            images => format!("topics with images: {}", images.join(", ")),
        };
        if let Some((camera, _)) = chosen.iter().find(|(camera, _)| !names.contains(camera)) {
            let reason = format!("--topic names the camera {camera:?}, which the rig has not");
            return Err(InputError::file(path, reason));
        }
        let of_camera = |name: &String| {
            if let Some((_, topic)) = chosen.iter().find(|(camera, _)| camera == name) {
                return match images.contains(&topic.as_str()) {
                    true => Ok(topic.clone()),
                    false => {
                        let reason = format!("has no images on {topic}; {}", listed());
                        Err(InputError::file(path, reason))
                    }
                };
            }
            let fits = |topic: &&&str| topic.split('/').any(|part| part == name);
            let fitting: Vec<&&str> = images.iter().filter(fits).collect();
            let raw = fitting.iter().find(|topic| topic.ends_with("/image_raw"));
            match (fitting.as_slice(), raw) {
                ([topic], _) => Ok((**topic).to_owned()),
                (_, Some(raw)) => Ok((**raw).to_string()),
                (fitting, None) => {
                    let count = if fitting.is_empty() {
                        "no"
                    } else {
                        "more than one"
                    };
                    let reason = format!(
                        "{count} topic has images of the camera {name:?}; name it with --topic \
                         {name}=/TOPIC; {}",
                        listed()
                    );
                    Err(InputError::file(path, reason))
                }
            }
        };
        let topics: Vec<String> = names.iter().map(of_camera).collect::<Result<_, _>>()?;
        for (index, topic) in topics.iter().enumerate() {
            if topics[..index].contains(topic) {
                let reason = format!("{topic} would be the images of two cameras");
                return Err(InputError::file(path, reason));
            }
        }
        Ok(Self(topics))
    }

    /// Returns the topic of each camera.
    pub fn names(&self) -> &[String] {
        &self.0
    }
}
