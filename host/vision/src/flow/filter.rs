//! Filtered frame sets: image pyramids, and the cameras whose images are unusable.

use super::camera_refusal::{self, CameraRefusal};
use super::frozen::{Fingerprint, fingerprint};
use super::{Flow, FlowRefusal, PipelineStage, StageObserver};
use crate::images::{FrameSet, Image};
use crate::matching::pyramid::{Band, FramePyramid, Plane};

/// Pyramids of a frame set's images, one per camera. They need no other frame set.
#[derive(Clone, Debug)]
pub struct FilteredFrameSet {
    pub(super) pyramids: Vec<FramePyramid>,
    /// Reason for each camera whose image is unusable.
    pub(super) camera_refusals: Vec<Option<CameraRefusal>>,
    /// Fingerprint of each image.
    pub(super) fingerprints: Vec<u64>,
}

impl Flow {
    /// Builds the pyramids of a frame set and finds cameras whose images are unusable.
    ///
    /// Frame sets must come in the order of their capture: an image equal to the one before marks
    /// its camera as frozen.
    ///
    /// # Errors
    /// [`FlowRefusal::WrongViews`] or [`FlowRefusal::WrongSize`] if number or size of the images
    /// are not those of the rig.
    pub fn filter(&mut self, frame_set: &FrameSet) -> Result<FilteredFrameSet, FlowRefusal> {
        self.filter_observed(frame_set, &mut ())
    }

    /// Does the same as [`Flow::filter`], with an observer of its only stage.
    ///
    /// # Errors
    /// [`FlowRefusal::WrongViews`] or [`FlowRefusal::WrongSize`] if number or size of the images
    /// are not those of the rig.
    pub fn filter_observed(
        &mut self,
        frame_set: &FrameSet,
        observer: &mut dyn StageObserver,
    ) -> Result<FilteredFrameSet, FlowRefusal> {
        self.check_images(&frame_set.images)?;
        let levels = self.levels();
        // Pyramids are built in the memory of old ones, as far as there are any.
        let buffers = self.pyramid_pool.take().into_iter();
        let buffers = buffers.chain(std::iter::repeat_with(FramePyramid::default));
        let mut pyramids: Vec<FramePyramid> = (frame_set.images.iter().zip(buffers))
            .map(|(image, buffer)| match image.is_missing() {
                true => FramePyramid::default(),
                false => buffer,
            })
            .collect();

        // Copy, fingerprint and finest levels, in bands of rows that threads share evenly.
        let windows = self.keyframe.as_ref().map_or(0, |k| k.matches.len());
        let bands = frame_set.images.iter().zip(&mut pyramids).enumerate();
        let bands = bands.filter(|(_, (image, _))| !image.is_missing());
        let bands = bands.flat_map(|(camera, (image, pyramid))| {
            let bands = pyramid.bands(image, levels, windows).into_iter();
            bands.map(move |band| (camera, band))
        });
        let fill = |(camera, band): (usize, Band<'_>)| {
            let part = fingerprint(band.grey());
            band.fill();
            (camera, part)
        };
        let mut fingerprints = vec![Fingerprint::default(); frame_set.images.len()];
        for (camera, part) in self.thread_pool.map(bands.collect(), fill) {
            fingerprints[camera].add(part);
        }
        let fingerprints: Vec<u64> = fingerprints.into_iter().map(|f| f.0).collect();

        // Levels above level 1, and the contrast of the last.
        let contrasts = (self.thread_pool).map(pyramids.iter_mut().collect(), |pyramid| {
            let pyramid: &mut FramePyramid = pyramid;
            pyramid.complete();
            pyramid.coarse().last().map_or(0.0, Plane::contrast)
        });
        let mut camera_refusals = camera_refusal::unusable(&frame_set.images, &contrasts);
        self.frozen_cameras
            .judge(&mut camera_refusals, &fingerprints);
        observer.stage_done(PipelineStage::Filter);
        Ok(FilteredFrameSet {
            pyramids,
            camera_refusals,
            fingerprints,
        })
    }

    /// Checks number and size of the images against the rig. A missing image has no size.
    fn check_images(&self, images: &[Image]) -> Result<(), FlowRefusal> {
        let (found, cameras) = (images.len(), self.geometry.cameras());
        if found != cameras {
            return Err(FlowRefusal::WrongViews { found, cameras });
        }
        let rig = self.geometry.rig.image_size_px.map(|side| side as usize);
        for (camera, image) in images.iter().enumerate() {
            if image.is_missing() {
                continue;
            }
            let found = [image.width, image.height];
            if found != rig || image.grey.len() != rig[0] * rig[1] || rig.contains(&0) {
                return Err(FlowRefusal::WrongSize { camera, found, rig });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::FlowSettings;
    use crate::images::{Scene, SceneSettings, Texture};
    use trinocular_core::rig::Rig;

    #[test]
    fn parts_of_level_0_give_bits_of_whole() {
        let rig = Rig::paper();
        let scene = Scene::new(&rig, &Texture::natural(3), SceneSettings::default()).unwrap();
        let [before, others @ ..] = [
            [0.0, 0.0, 0.0],
            [0.02, 0.0, 0.01],
            [1.0, -2.0, 3.0],
            [-14.0, 9.0, -20.0],
            [40.0, 30.0, 10.0],
        ]
        .map(|mm| scene.render(mm, 0, 1));
        let mut results = Vec::new();
        for (threads, are_whole) in [(1, true), (1, false), (2, true), (2, false)] {
            let settings = FlowSettings {
                threads,
                ..FlowSettings::default()
            };
            let mut flow = Flow::new(&rig, settings).unwrap();
            flow.set_keyframe(&before).unwrap();
            let measured = others.each_ref().map(|now| {
                let mut filtered = flow.filter(now).unwrap();
                let levels = flow.levels();
                for (pyramid, image) in filtered.pyramids.iter_mut().zip(&now.images) {
                    *pyramid = FramePyramid::new(image, levels);
                    if are_whole {
                        pyramid.prepare_fine(&flow.thread_pool);
                    }
                }
                // All numbers of a result, to the last bit.
                format!("{:?}", flow.measure_filtered(&filtered, &mut ()))
            });
            results.push(measured);
        }
        assert!(
            results[0][..3]
                .iter()
                .all(|result| result.starts_with("Ok"))
        );
        assert!(results[1..].iter().all(|other| *other == results[0]));
    }

    #[test]
    fn returning_camera_marks_none_as_frozen() {
        let rig = Rig::paper();
        let scene = Scene::new(&rig, &Texture::natural(3), SceneSettings::default()).unwrap();
        let whole = scene.render([0.0; 3], 0, 1);
        let mut first = whole.clone();
        first.images[0] = Image::missing();
        let mut flow = Flow::new(&rig, FlowSettings::default()).unwrap();
        let filtered = flow.filter(&first).unwrap();
        assert_eq!(
            filtered.camera_refusals,
            [Some(CameraRefusal::Missing), None, None]
        );
        // The other images repeat, but no image has changed.
        assert_eq!(flow.filter(&whole).unwrap().camera_refusals, [None; 3]);
    }
}
