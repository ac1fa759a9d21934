//! Keyframe: points matched in all cameras at one instant, with the templates to track.

use super::active_cameras::ActiveCameras;
use super::camera_refusal::CameraRefusal;
use super::frozen;
use super::{FilteredFrameSet, Flow, FlowRefusal, PipelineStage, StageObserver};
use crate::matching::corner;
use crate::matching::lucas_kanade::FineTemplate;
use crate::matching::pyramid::Pyramid;
use crate::matching::stereo::{StereoMatch, StereoMatcher};
use crate::matching::zncc::ZnccPlane;
use crate::matching::{Reject, RejectCounts};

/// Largest ratio of ambiguous corners to matched ones. Above it the texture repeats; below it the
/// few matched corners decide, as those of walls, text and boards can. Bricks and grids have next
/// to none.
const MAX_AMBIGUOUS_PER_MATCH: usize = 3;

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
    pub(super) pyramids: &'a [Pyramid],
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
            *refusal = refusal.or(*before);
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
        let plane = &self.filtered.pyramids[reference].levels[level];
        let matches = self.matches.iter().map(restrict).collect();
        (matches, ZnccPlane::new(plane))
    }
}

impl Flow {
    /// Returns true if the point is in the regions of all cameras.
    fn is_within(&self, active: &ActiveCameras, matched: &StereoMatch) -> bool {
        let mut cameras = active.cameras.iter().zip(&matched.pixels);
        cameras.all(|(camera, pixel)| self.regions.allow_start(*camera, *pixel))
    }

    /// Does the same as [`Flow::set_keyframe`] with a frame set that is already filtered, for
    /// instance by the last measurement.
    ///
    /// # Errors
    /// [`FlowRefusal`] if the points cannot be matched; there is no keyframe then.
    pub fn set_filtered_keyframe(
        &mut self,
        filtered: FilteredFrameSet,
        observer: &mut dyn StageObserver,
    ) -> Result<(), FlowRefusal> {
        // The old keyframe's memory is freed only after the new one is complete. Otherwise the
        // allocator would return it to the system and ask for it again at once.
        let old = self.keyframe.take();
        let (settings, thread_pool) = (&self.settings, &self.thread_pool);
        let active = self.active_cameras(&filtered.camera_refusals)?;
        let pyramids = active.select(&filtered.pyramids);
        let reference = active.geometry.reference;

        // Shi-Tomasi corners of the reference camera's image.
        let whole = active.cameras[reference];
        let regions = &self.regions;
        let corners = corner::corners_within(
            &pyramids[reference].levels[0],
            FineTemplate::MARGIN + 1,
            settings.min_spacing_px,
            settings.max_corners,
            thread_pool,
            |at| regions.allow_start(whole, at.map(|c| c as f64)),
        );
        observer.stage_done(PipelineStage::Corners);
        let (found, least) = (corners.len(), settings.min_points);
        if found < least {
            return Err(FlowRefusal::FewCorners { found, least });
        }

        // Multi-baseline stereo match of each corner, in batches.
        let level = self.spatial_level();
        let planes = pyramids.iter().map(|p| &p.levels[level]).collect();
        let planes = thread_pool.map(planes, ZnccPlane::new);
        let matcher = StereoMatcher {
            geometry: &active.geometry,
            settings: &settings.matching,
            pyramids: &pyramids,
            planes: &planes,
            level,
        };
        let places: Vec<[f64; 2]> = (corners.iter().enumerate())
            .map(|(index, corner)| spread_phase(index, *corner))
            .collect();
        let mut rejected = RejectCounts::default();
        let mut matches = Vec::with_capacity(settings.max_points);
        let mut unmatched = Vec::new();
        let mut untried = places.as_slice();
        while matches.len() < settings.max_points && !untried.is_empty() {
            // A batch is never larger than the number of points still wanted, so that the same
            // corners are tried on any number of threads.
            let wanted = settings.max_points - matches.len();
            let (batch, rest) = untried.split_at(wanted.min(untried.len()));
            untried = rest;
            let found = thread_pool.map(batch.to_vec(), |place| matcher.find(place));
            for (place, found) in batch.iter().zip(found) {
                match found {
                    Ok(matched) if !self.is_within(&active, &matched) => {
                        rejected.add(Reject::OutOfView);
                    }
                    Ok(matched) => matches.push(matched),
                    Err(reject) => {
                        unmatched.push(*place);
                        rejected.add(reject);
                    }
                }
            }
        }

        // Refuse repetitive texture and too few matches.
        let tried = places.len() - untried.len();
        let (matched, ambiguous) = (matches.len(), rejected.of(Reject::Ambiguous));
        if ambiguous > MAX_AMBIGUOUS_PER_MATCH * matched && 4 * ambiguous > tried {
            return Err(FlowRefusal::AmbiguousDepth { ambiguous, matched });
        }
        if matched < least {
            return Err(FlowRefusal::FewMatches {
                matched,
                corners: tried,
                least,
            });
        }

        unmatched.extend_from_slice(untried);
        let coarse = ZnccPlane::new(&pyramids[reference].levels[self.temporal_level()]);
        self.keyframe = Some(Keyframe {
            active,
            filtered,
            coarse,
            matches,
            unmatched,
            rejected,
        });
        if let Some(old) = old {
            self.pyramid_pool.put(old.filtered);
        }
        observer.stage_done(PipelineStage::Spatial);
        Ok(())
    }
}

/// Moves a corner by up to half a pixel, differently for every index.
///
/// Interpolation errs by up to a thousandth of a pixel, depending on the sub-pixel phase of a
/// template. If all templates had the same phase, all points would err alike: in a flow field that
/// grows from the middle outwards this looks like a motion along z. The phases are those of the R2
/// sequence (M. Roberts, *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018), evenly
/// spread at any count.
fn spread_phase(index: usize, corner: [usize; 2]) -> [f64; 2] {
    let step = [0.754_877_666_246_693, 0.569_840_290_998_053];
    core::array::from_fn(|i| corner[i] as f64 + (index as f64 * step[i]).fract() - 0.5)
}
