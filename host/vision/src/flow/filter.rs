//! Filtered frame sets: image pyramids, and the cameras whose images are unusable.

use super::camera_refusal::{self, CameraRefusal};
use super::frozen::fingerprint;
use super::{Flow, FlowRefusal, PipelineStage, StageObserver};
use crate::images::{FrameSet, Image};
use crate::matching::pyramid::{Plane, Pyramid};

/// Pyramids of a frame set's images, one per camera. They need no other frame set.
#[derive(Clone, Debug)]
pub struct FilteredFrameSet {
    pub(super) pyramids: Vec<Pyramid>,
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
        let buffers = buffers.chain(std::iter::repeat_with(Pyramid::default));
        let jobs = frame_set.images.iter().zip(buffers).collect();
        let seen = (self.thread_pool).map(jobs, |(image, mut pyramid): (&Image, Pyramid)| {
            if image.is_missing() {
                return (Pyramid::default(), 0.0, 0);
            }
            pyramid.refill(image, levels);
            let contrast = pyramid.levels.last().map_or(0.0, Plane::contrast);
            (pyramid, contrast, fingerprint(image))
        });
        let contrasts: Vec<f64> = seen.iter().map(|(_, contrast, _)| *contrast).collect();
        let (pyramids, fingerprints): (Vec<Pyramid>, Vec<u64>) = seen
            .into_iter()
            .map(|(pyramid, _, fingerprint)| (pyramid, fingerprint))
            .unzip();
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
