//! Corners of a new keyframe: chosen in the reference camera's image, matched in the other images.

use super::active_cameras::ActiveCameras;
use super::depth_profile::{self, AmbiguousCorner};
use super::{FilteredFrameSet, Flow, FlowRefusal, PipelineStage, StageObserver};
use crate::matching::corner::{self, CornerSettings};
use crate::matching::lucas_kanade::FineTemplate;
use crate::matching::stereo::{StereoMatch, StereoMatcher};
use crate::matching::zncc::ZnccPlane;
use crate::matching::{Reject, RejectCounts};

/// Largest ratio of ambiguous corners to matched ones. Above it the texture repeats, unless all
/// corners together decide; below it the few matched corners decide, as those of walls, text and
/// boards can. Bricks and grids have next to none.
const MAX_AMBIGUOUS_PER_MATCH: usize = 3;

/// Corners of a frame set, matched or not: all of a keyframe but its images.
pub(super) struct MatchedCorners {
    /// Cameras that took part.
    pub(super) active: ActiveCameras,
    /// Coarse image of the reference camera.
    pub(super) coarse: ZnccPlane,
    /// Matched points.
    pub(super) matches: Vec<StereoMatch>,
    /// Corners without a match.
    pub(super) unmatched: Vec<[f64; 2]>,
    /// Number of corners without a match, by reason.
    pub(super) rejected: RejectCounts,
}

/// Points that are matched and corners that are not, with the reasons.
#[derive(Default)]
struct Tried {
    matches: Vec<StereoMatch>,
    unmatched: Vec<([f64; 2], Reject)>,
    /// Number of points outside the regions.
    excluded: usize,
}

impl Tried {
    fn corners(&self) -> usize {
        self.matches.len() + self.unmatched.len() + self.excluded
    }

    /// Returns the corners that have several matches.
    fn ambiguous(&self) -> Vec<[f64; 2]> {
        let is_ambiguous = |(_, reject): &&([f64; 2], Reject)| *reject == Reject::Ambiguous;
        let ambiguous = self.unmatched.iter().filter(is_ambiguous);
        ambiguous.map(|(place, _)| *place).collect()
    }

    /// Refuses repetitive texture and too few matches.
    fn enough(&self, least: usize) -> Result<(), FlowRefusal> {
        let (matched, corners) = (self.matches.len(), self.corners());
        let ambiguous = self.ambiguous().len();
        if ambiguous > MAX_AMBIGUOUS_PER_MATCH * matched && 4 * ambiguous > corners {
            return Err(FlowRefusal::AmbiguousDepth { ambiguous, matched });
        }
        if matched < least {
            return Err(FlowRefusal::FewMatches {
                matched,
                corners,
                least,
            });
        }
        Ok(())
    }
}

impl Flow {
    /// Chooses corners in the reference camera's image and matches them in the other images.
    pub(super) fn match_corners(
        &self,
        filtered: &FilteredFrameSet,
        observer: &mut dyn StageObserver,
    ) -> Result<MatchedCorners, FlowRefusal> {
        let (settings, thread_pool) = (&self.settings, &self.thread_pool);
        let active = self.active_cameras(&filtered.camera_refusals)?;
        let pyramids = active.select(&filtered.pyramids);
        let reference = active.geometry.reference;
        if !self.regions.select_in(&active.cameras) {
            return Err(FlowRefusal::RegionUnseen);
        }

        // Shi-Tomasi corners of the reference camera's image.
        let whole = active.cameras[reference];
        let regions = &self.regions;
        let corners = corner::corners_within(
            pyramids[reference].fine(),
            &CornerSettings {
                margin: FineTemplate::MARGIN + 1,
                spacing_px: settings.min_spacing_px,
                min_gradient: settings.min_gradient,
                count: settings.max_corners,
            },
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
        let planes = pyramids.iter().map(|p| &p.coarse()[level - 1]).collect();
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
        let mut tried = Tried::default();
        let mut untried = places.as_slice();
        while tried.matches.len() < settings.max_points && !untried.is_empty() {
            // A batch is never larger than the number of points still wanted, so that the same
            // corners are tried on any number of threads.
            let wanted = settings.max_points - tried.matches.len();
            let (batch, rest) = untried.split_at(wanted.min(untried.len()));
            untried = rest;
            let found = thread_pool.map(batch.to_vec(), |place| matcher.find(place));
            for (place, found) in batch.iter().zip(found) {
                match found {
                    Ok(matched) if !self.is_within(&active, &matched) => tried.excluded += 1,
                    Ok(matched) => tried.matches.push(matched),
                    Err(reject) => tried.unmatched.push((*place, reject)),
                }
            }
        }

        // Where single corners do not decide, all of them do.
        if tried.enough(least).is_err() {
            self.decide_together(&active, &matcher, &mut tried);
        }
        tried.enough(least)?;

        let mut rejected = RejectCounts::default();
        for (_, reject) in &tried.unmatched {
            rejected.add(*reject);
        }
        for _ in 0..tried.excluded {
            rejected.add(Reject::OutOfView);
        }
        let unmatched = tried.unmatched.into_iter().map(|(place, _)| place);
        let unmatched = unmatched.chain(untried.iter().copied()).collect();
        let coarse = ZnccPlane::new(&pyramids[reference].coarse()[self.temporal_level() - 1]);
        observer.stage_done(PipelineStage::Spatial);
        Ok(MatchedCorners {
            active,
            coarse,
            matches: tried.matches,
            unmatched,
            rejected,
        })
    }

    /// Decides between the depths of ambiguous corners by the depth profile on which most of them
    /// agree, and adds their matches. Without such a profile nothing changes.
    fn decide_together(
        &self,
        active: &ActiveCameras,
        matcher: &StereoMatcher<'_>,
        tried: &mut Tried,
    ) {
        let find_all = |place: [f64; 2]| AmbiguousCorner {
            at: active.geometry.normalise(active.geometry.reference, place),
            matches: matcher.find_all(place),
        };
        let places = tried.ambiguous();
        let found = self.thread_pool.map(places.clone(), find_all);
        let (places, corners): (Vec<[f64; 2]>, Vec<AmbiguousCorner>) = (places.into_iter())
            .zip(found)
            .filter(|(_, corner)| !corner.matches.is_empty())
            .unzip();
        for (index, refined) in depth_profile::agreed(&corners, matcher.px_per_inverse_mm()) {
            let Ok(matched) = matcher.completed(refined) else {
                continue;
            };
            tried.unmatched.retain(|(place, _)| *place != places[index]);
            match self.is_within(active, &matched) {
                true => tried.matches.push(matched),
                false => tried.excluded += 1,
            }
        }
        tried.matches.truncate(self.settings.max_points);
    }

    /// Returns true if the point is in the regions of all cameras.
    fn is_within(&self, active: &ActiveCameras, matched: &StereoMatch) -> bool {
        let mut cameras = active.cameras.iter().zip(&matched.pixels);
        cameras.all(|(camera, pixel)| self.regions.allow_start(*camera, *pixel))
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
