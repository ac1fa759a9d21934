//! Regions of interest: the pixels of each camera in which points may be.
//!
//! A *rectangle* selects the target at the keyframe: points are chosen in it and followed beyond
//! it. A *mask* excludes pixels at any time, such as a lamp, a frame or the stage itself: points on
//! them are neither chosen nor followed.

use std::sync::Arc;

use crate::images::Image;

/// Grey level from which a pixel of a mask may be used.
pub const USED: u8 = 128;

/// Pixels of one camera in which points may be.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Region {
    /// Left, top, width and height in which points are chosen, px; `None` for the whole image.
    pub rectangle_px: Option<[u32; 4]>,
    /// Mask of the image's size, whose bright pixels may be used; `None` for all.
    pub mask: Option<Arc<Image>>,
}

impl Region {
    /// Returns true if a point may be chosen at this pixel.
    pub fn allows_start(&self, pixel: [f64; 2]) -> bool {
        let is_inside = |[left, top, width, height]: [u32; 4]| {
            let within = |at: f64, start: u32, length: u32| {
                let start = f64::from(start);
                (start..start + f64::from(length)).contains(&(at + 0.5))
            };
            within(pixel[0], left, width) && within(pixel[1], top, height)
        };
        self.rectangle_px.is_none_or(is_inside) && self.allows(pixel)
    }

    /// Returns true if a point may be followed to this pixel.
    pub fn allows(&self, [x, y]: [f64; 2]) -> bool {
        let Some(mask) = &self.mask else {
            return true;
        };
        let [x, y] = [x, y].map(|at| at.round().max(0.0) as usize);
        let is_within = x < mask.width && y < mask.height;
        let grey = is_within
            .then(|| mask.grey.get(y * mask.width + x))
            .flatten();
        grey.is_some_and(|grey| *grey >= USED)
    }
}

/// Regions of all cameras of a rig; a camera without one may have points everywhere.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Regions(pub Vec<Region>);

impl Regions {
    /// Returns true if these cameras show what the rectangles select: one of them has a rectangle,
    /// or no camera has.
    pub(super) fn select_in(&self, cameras: &[usize]) -> bool {
        let has_rectangle = |region: &Region| region.rectangle_px.is_some();
        let mut seen = cameras.iter().filter_map(|camera| self.0.get(*camera));
        seen.any(has_rectangle) || !self.0.iter().any(has_rectangle)
    }

    /// Returns true if a point may be chosen at this pixel of a camera.
    pub fn allow_start(&self, camera: usize, pixel: [f64; 2]) -> bool {
        let region = self.0.get(camera);
        region.is_none_or(|region| region.allows_start(pixel))
    }

    /// Returns true if a point may be followed to this pixel of a camera.
    pub fn allow(&self, camera: usize, pixel: [f64; 2]) -> bool {
        self.0.get(camera).is_none_or(|region| region.allows(pixel))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::{Flow, FlowRefusal, FlowSettings};
    use crate::images::{FrameSet, Scene, SceneSettings, Texture};
    use trinocular_core::rig::Rig;

    #[test]
    fn rectangle_holds_at_the_keyframe_only() {
        let region = Region {
            rectangle_px: Some([10, 20, 5, 4]),
            mask: None,
        };
        for (pixel, expected) in [
            ([10.0, 20.0], true),
            ([9.5, 19.5], true),
            ([14.4, 23.4], true),
            ([14.5, 22.0], false),
            ([9.4, 22.0], false),
        ] {
            assert_eq!(region.allows_start(pixel), expected, "{pixel:?}");
            assert!(region.allows(pixel));
        }
    }

    /// Returns two frame sets: a poster that moves to the right, covered by one at rest in the
    /// right part of every image.
    fn two_motions(rig: &Rig) -> [FrameSet; 2] {
        let scene =
            |seed| Scene::new(rig, &Texture::natural(seed), SceneSettings::default()).unwrap();
        let (moving, resting) = (scene(1), scene(2));
        [0.0, 4.0].map(|x_mm| {
            let mut seen = moving.render([x_mm, 0.0, 0.0], 0, 1 + x_mm as u64);
            let other = resting.render([0.0; 3], 0, 9 + x_mm as u64);
            for (image, other) in seen.images.iter_mut().zip(other.images) {
                let edge = image.width * 2 / 5;
                for (row, other) in image
                    .grey
                    .chunks_mut(image.width)
                    .zip(other.grey.chunks(image.width))
                {
                    row[edge..].copy_from_slice(&other[edge..]);
                }
            }
            seen
        })
    }

    fn measured(rig: &Rig, regions: Vec<Region>) -> Result<[f64; 3], FlowRefusal> {
        let [before, now] = two_motions(rig);
        let mut flow = Flow::new(rig, FlowSettings::default())?;
        flow.set_regions(Regions(regions));
        flow.set_keyframe(&before)?;
        Ok(flow.measure(&now)?.displacement_mm)
    }

    /// Without the rectangle's camera, the points would be those of the whole view.
    #[test]
    fn region_of_a_missing_camera_is_refused() {
        let rig = Rig::paper();
        let [mut before, _] = two_motions(&rig);
        let left = Region {
            rectangle_px: Some([0, 0, 100, 240]),
            mask: None,
        };
        let mut flow = Flow::new(&rig, FlowSettings::default()).unwrap();
        flow.set_regions(Regions(vec![left]));
        flow.set_keyframe(&before).unwrap();
        before.images[0] = Image::missing();
        assert_eq!(flow.set_keyframe(&before), Err(FlowRefusal::RegionUnseen));
        let rest = Regions(vec![Region::default(); 3]);
        assert!(rest.select_in(&[1]) && Regions::default().select_in(&[0]));
    }

    #[test]
    fn region_selects_what_is_measured() {
        let rig = Rig::paper();
        let [width, height] = rig.image_size_px;
        let near = |found: [f64; 3], x_mm: f64| {
            assert!((found[0] - x_mm).abs() < 0.1, "{found:?}, not {x_mm}");
        };
        // Most of the image rests.
        let unrestricted = measured(&rig, Vec::new());
        assert!(unrestricted.is_err() || unrestricted.unwrap()[0].abs() < 0.1);
        let rectangle = |left: u32, width: u32| Region {
            rectangle_px: Some([left, 0, width, height]),
            mask: None,
        };
        let left = vec![rectangle(0, width * 2 / 5 - 16); 3];
        near(measured(&rig, left).unwrap(), 4.0);
        let right = vec![rectangle(width / 2, width / 2); 3];
        near(measured(&rig, right).unwrap(), 0.0);
        let grey = (0..width * height).map(|i| match i % width < width * 2 / 5 - 8 {
            true => 255,
            false => 0,
        });
        let mask = Image {
            width: width as usize,
            height: height as usize,
            grey: grey.collect(),
        };
        let masked = Region {
            rectangle_px: None,
            mask: Some(Arc::new(mask)),
        };
        let masked = vec![masked; 3];
        near(measured(&rig, masked.clone()).unwrap(), 4.0);
        // The pose of the target, too, and no point of it on the mask.
        let [before, now] = two_motions(&rig);
        let mut flow = Flow::new(&rig, FlowSettings::default()).unwrap();
        flow.set_regions(Regions(masked.clone()));
        flow.set_keyframe(&before).unwrap();
        let pose = flow.measure_pose(&now).unwrap();
        let moved = pose.pose.displacement_of([0.0, 0.0, 850.0]).displacement_mm;
        assert!((moved[0] - 4.0).abs() < 0.3, "{moved:?}");
        let pixels = pose.correspondences.iter().flat_map(|point| &point.pixels);
        assert!(pixels.clone().all(|[_, now]| masked[0].allows(*now)));
    }
}
