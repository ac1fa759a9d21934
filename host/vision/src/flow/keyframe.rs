//! Keyframe: points matched in all cameras at one instant, with the templates to track.

use super::active_cameras::ActiveCameras;
use super::camera_refusal::CameraRefusal;
use super::frozen;
use super::{FilteredFrameSet, Flow, FlowRefusal, StageObserver};
use crate::matching::RejectCounts;
use crate::matching::pyramid::FramePyramid;
use crate::matching::stereo::StereoMatch;
use crate::matching::zncc::ZnccPlane;

/// Matched points and images of the keyframe.
#[derive(Clone, Debug)]
pub(super) struct Keyframe {
    /// Cameras that took part. All fields but `filtered` cover only these.
    pub(super) active: ActiveCameras,
    /// Images of all cameras of the rig.
    pub(super) filtered: FilteredFrameSet,
    /// Coarse image of the reference camera, for the displacement search.
    pub(super) coarse: ZnccPlane,
    /// Matched points, the best of every part of the image first.
    pub(super) matches: Vec<StereoMatch>,
    /// Corners without a match, the best of every part of the image first: pixels of the reference
    /// camera.
    pub(super) unmatched: Vec<[f64; 2]>,
    /// Number of corners without a match, by reason.
    pub(super) rejected: RejectCounts,
}

/// Keyframe as seen by the cameras that are active now, which may be fewer than at the keyframe.
#[derive(Clone, Copy, Debug)]
pub(super) struct ActiveKeyframe<'a> {
    /// Cameras that take part now. All fields but `pyramids` cover only these.
    pub(super) active: &'a ActiveCameras,
    /// Images of all cameras of the rig.
    pub(super) pyramids: &'a [FramePyramid],
    /// Coarse image of the reference camera.
    pub(super) coarse: &'a ZnccPlane,
    /// Matched points.
    pub(super) matches: &'a [StereoMatch],
    /// Corners without a match.
    pub(super) unmatched: &'a [[f64; 2]],
    /// Number of corners without a match, by reason.
    pub(super) rejected: RejectCounts,
}

impl Keyframe {
    /// Returns the keyframe with all of its own cameras.
    pub(super) fn whole(&self) -> ActiveKeyframe<'_> {
        ActiveKeyframe {
            active: &self.active,
            pyramids: &self.filtered.pyramids,
            coarse: &self.coarse,
            matches: &self.matches,
            unmatched: &self.unmatched,
            rejected: self.rejected,
        }
    }

    /// Returns the cameras that take no part in a measurement: unusable now, or at the keyframe.
    pub(super) fn refusals(&self, now: &FilteredFrameSet) -> Vec<Option<CameraRefusal>> {
        let mut refusals = now.camera_refusals.clone();
        let before = &self.filtered;
        frozen::mark_frozen(&mut refusals, &now.fingerprints, &before.fingerprints);
        for (refusal, before) in refusals.iter_mut().zip(&before.camera_refusals) {
            *refusal = refusal.or(before.map(CameraRefusal::in_keyframe));
        }
        refusals
    }

    /// Restricts the matches to `active`, some of the keyframe's cameras, and returns them with the
    /// coarse image of the new reference camera at `level`.
    pub(super) fn restricted(
        &self,
        active: &ActiveCameras,
        level: usize,
    ) -> (Vec<StereoMatch>, ZnccPlane) {
        let kept: Vec<usize> = (self.active.cameras.iter().enumerate())
            .filter(|(_, camera)| active.cameras.contains(camera))
            .map(|(index, _)| index)
            .collect();
        let restrict = |matched: &StereoMatch| {
            let normalised: Vec<[f64; 2]> = kept.iter().map(|k| matched.normalised[*k]).collect();
            StereoMatch {
                pixels: kept.iter().map(|k| matched.pixels[*k]).collect(),
                ray: active.geometry.fit(&normalised),
                normalised,
                templates: kept.iter().map(|k| matched.templates[*k].clone()).collect(),
            }
        };
        let reference = active.cameras[active.geometry.reference];
        let plane = &self.filtered.pyramids[reference].coarse()[level - 1];
        let matches = self.matches.iter().map(restrict).collect();
        (matches, ZnccPlane::new(plane))
    }
}

impl Flow {
    /// Does the same as [`Flow::set_keyframe`] with a frame set that is already filtered, for
    /// instance by the last measurement.
    ///
    /// # Errors
    /// [`FlowRefusal`] if the points cannot be matched; there is no keyframe then.
    pub fn set_filtered_keyframe(
        &mut self,
        mut filtered: FilteredFrameSet,
        observer: &mut dyn StageObserver,
    ) -> Result<(), FlowRefusal> {
        // The old keyframe's memory is freed only after the new one is complete. Otherwise the
        // allocator would return it to the system and ask for it again at once.
        let old = self.keyframe.take();
        self.reduced = None;
        self.last_pose = None;
        // Corners are chosen in the whole image of the reference camera.
        let active = self.active_cameras(&filtered.camera_refusals);
        let reference = active.ok().and_then(|active| active.reference_camera());
        if let Some(pyramid) = reference.and_then(|k| filtered.pyramids.get_mut(k)) {
            pyramid.prepare_fine(&self.thread_pool);
        }
        match self.match_corners(&filtered, observer) {
            Ok(matched) => {
                self.keyframe = Some(Keyframe {
                    active: matched.active,
                    filtered,
                    coarse: matched.coarse,
                    matches: matched.matches,
                    unmatched: matched.unmatched,
                    rejected: matched.rejected,
                });
            }
            Err(refusal) => {
                let reduced = self.with_reduced_keyframe(&filtered, &refusal, observer);
                self.reduced = Some(reduced.ok_or(refusal)?);
            }
        }
        if let Some(old) = old {
            self.pyramid_pool.put(old.filtered);
        }
        Ok(())
    }
}
