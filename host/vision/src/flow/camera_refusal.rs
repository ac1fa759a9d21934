//! Refusals of single cameras: a camera with an unusable image is left out, the others carry on.

use crate::images::Image;

/// Reason why a camera takes no part in a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraRefusal {
    /// The camera gave no image.
    Missing,
    /// The camera's image has no contrast, while another camera's has.
    Blank,
    /// The camera gives images, but gave none for the keyframe.
    MissingInKeyframe,
    /// The camera's image of the keyframe has no contrast, while another camera's has.
    BlankInKeyframe,
    /// The camera's image equals its last one, to the last bit of noise, while another camera's
    /// has changed.
    Frozen,
    /// The camera's shutter opens later or earlier than the others'.
    Unsynchronised {
        /// Share of the motion that the camera saw in excess of the others, negative for less:
        /// 0.05 is a twentieth more.
        share: f64,
    },
}

/// A camera that sees less of the motion by this share, or sees it reversed, is not merely early.
const NEARLY_ALL: f64 = 0.9;

impl std::fmt::Display for CameraRefusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Missing => write!(f, "gave no image"),
            Self::Blank => write!(f, "shows nothing: dark, covered or out of light"),
            Self::MissingInKeyframe => write!(f, "gave no image for the keyframe"),
            Self::BlankInKeyframe => {
                write!(
                    f,
                    "showed nothing in the keyframe: dark, covered or out of light"
                )
            }
            Self::Frozen => write!(f, "is frozen: it gave the same image again"),
            Self::Unsynchronised { share } if *share < -NEARLY_ALL => {
                let percent = 100.0 * (1.0 + share);
                write!(
                    f,
                    "sees {percent:.1} % of the motion that the others see: see that its images \
                     and its place in the rig are its own"
                )
            }
            Self::Unsynchronised { share } => {
                let percent = 100.0 * share.abs();
                let (amount, when) = if share > &0.0 {
                    ("more", "later")
                } else {
                    ("less", "earlier")
                };
                write!(
                    f,
                    "sees {percent:.1} % {amount} of the motion than the others: it takes its \
                     images {when}"
                )
            }
        }
    }
}

impl CameraRefusal {
    /// Returns the reason for a later frame set, if this one was the keyframe's.
    pub(super) const fn in_keyframe(self) -> Self {
        match self {
            Self::Missing => Self::MissingInKeyframe,
            Self::Blank => Self::BlankInKeyframe,
            other => other,
        }
    }
}

/// Describes each refused camera in a sentence, by its name.
pub fn remarks(refused: &[(usize, CameraRefusal)], names: &[String]) -> Vec<String> {
    let remark = |(k, refusal): &(usize, CameraRefusal)| {
        let name = names.get(*k).map_or("?", String::as_str);
        format!("camera {name} {refusal}; measured without it")
    };
    refused.iter().map(remark).collect()
}

/// Largest contrast of a blank image, as a share of the largest contrast of all images.
const BLANK: f64 = 0.2;

/// Finds images that are missing or blank, given the contrast of each. None is blank if fewer than
/// two usable images would be left: in the dark, no single camera is at fault.
pub(super) fn unusable(images: &[Image], contrasts: &[f64]) -> Vec<Option<CameraRefusal>> {
    let most = contrasts.iter().copied().fold(0.0, f64::max);
    let missing = |image: &Image| image.is_missing().then_some(CameraRefusal::Missing);
    let refusals: Vec<Option<CameraRefusal>> = (images.iter().zip(contrasts))
        .map(|(image, contrast)| {
            missing(image).or((*contrast < BLANK * most).then_some(CameraRefusal::Blank))
        })
        .collect();
    if refusals.iter().filter(|r| r.is_none()).count() >= 2 {
        refusals
    } else {
        images.iter().map(missing).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unusable_images_never_leave_one_camera() {
        let image = |grey| Image {
            width: 7,
            height: 5,
            grey: vec![grey; 35],
        };
        let images = [image(1), Image::missing(), image(2), image(3)];
        let found = unusable(&images, &[40.0, 0.0, 0.5, 35.0]);
        let expected = [
            None,
            Some(CameraRefusal::Missing),
            Some(CameraRefusal::Blank),
            None,
        ];
        assert_eq!(found, expected);
        // In the dark, no single camera is at fault.
        let images = [image(1), image(2), image(3)];
        assert_eq!(unusable(&images, &[0.4, 0.5, 0.6]), [None; 3]);
        assert_eq!(unusable(&images, &[0.0; 3]), [None; 3]);
        assert_eq!(unusable(&images, &[40.0, 0.1, 0.2]), [None; 3]);
    }

    #[test]
    fn remarks_tell_keyframe_from_present() {
        let names = ["left".to_owned(), "right".to_owned()];
        let missing = CameraRefusal::Missing;
        let told = |refusal| remarks(&[(1, refusal)], &names).concat();
        assert_eq!(
            told(missing),
            "camera right gave no image; measured without it"
        );
        assert_eq!(
            told(missing.in_keyframe()),
            "camera right gave no image for the keyframe; measured without it"
        );
        assert_eq!(missing.in_keyframe().in_keyframe(), missing.in_keyframe());
        assert!(
            told(CameraRefusal::Blank.in_keyframe()).contains("showed nothing in the keyframe")
        );
    }

    #[test]
    fn remarks_name_size_of_skew() {
        let late = CameraRefusal::Unsynchronised { share: 0.05 };
        assert!(late.to_string().contains("5.0 % more") && late.to_string().contains("later"));
        let early = CameraRefusal::Unsynchronised { share: -0.05 };
        assert!(early.to_string().contains("5.0 % less") && early.to_string().contains("earlier"));
        let reversed = CameraRefusal::Unsynchronised { share: -1.5 }.to_string();
        assert!(
            reversed.contains("sees -50.0 % of the motion"),
            "{reversed}"
        );
    }
}
