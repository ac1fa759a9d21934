//! Exposure of images: pixels at the end of the scale carry no texture, and a dark image has few
//! grey levels.

use super::{FrameSet, Image};

/// Grey level at which a pixel is saturated.
const WHITE: u8 = 255;
/// Largest share of saturated pixels without a warning.
pub const MOST_SATURATED: f64 = 0.01;
/// Grey level that some pixels of an image should reach: below it, noise is a large part of the
/// contrast.
const DIM: u8 = 32;

/// Fault of an image's exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExposureFault {
    /// Share of the pixels that are at the end of the scale.
    Saturated(f64),
    /// The brightest of all pixels.
    Dim(u8),
}

impl std::fmt::Display for ExposureFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Saturated(share) => {
                let percent = 100.0 * share;
                write!(
                    f,
                    "has {percent:.1} % of its pixels saturated; shorten the exposure"
                )
            }
            Self::Dim(brightest) => write!(
                f,
                "has no pixel brighter than {brightest} of 255; lengthen the exposure or add light"
            ),
        }
    }
}

/// Judges the exposure of an image; `None` if it is fit, or missing.
pub fn judge(image: &Image) -> Option<ExposureFault> {
    if image.is_missing() {
        return None;
    }
    let white = image.grey.iter().filter(|grey| **grey == WHITE).count();
    let share = white as f64 / image.grey.len().max(1) as f64;
    if share > MOST_SATURATED {
        return Some(ExposureFault::Saturated(share));
    }
    let brightest = image.grey.iter().copied().max().unwrap_or(0);
    (brightest < DIM).then_some(ExposureFault::Dim(brightest))
}

impl ExposureFault {
    /// Returns the fault as a sentence about a camera, from 0, of these names.
    pub fn sentence(self, names: &[String], camera: usize) -> String {
        let name = names.get(camera).map_or("?", String::as_str);
        format!("camera {name} {self}")
    }
}

/// Returns each camera whose image is not fit, from 0, with the fault.
pub fn faults(frame_set: &FrameSet) -> Vec<(usize, ExposureFault)> {
    let images = frame_set.images.iter().enumerate();
    images
        .filter_map(|(camera, image)| Some((camera, judge(image)?)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposure_of_each_camera_is_judged() {
        let image = |grey: Vec<u8>| Image {
            width: grey.len(),
            height: 1,
            grey,
        };
        let mut bright = vec![100; 200];
        bright[..2].fill(255);
        let fit = image(bright.clone());
        bright[2] = 255;
        let images = vec![fit, image(bright), image(vec![31; 200]), Image::missing()];
        let found = faults(&FrameSet { time_us: 0, images });
        let expected = [
            (1, ExposureFault::Saturated(0.015)),
            (2, ExposureFault::Dim(31)),
        ];
        assert_eq!(found, expected);
        let names = ["left", "right"].map(String::from);
        let said = found[0].1.sentence(&names, found[0].0);
        assert!(
            said.starts_with("camera right has 1.5 % of its pixels"),
            "{said}"
        );
    }
}
