//! Measurement of a frame set against the keyframe, by the cameras that both have.

use super::accept::Tracking;
use super::active_cameras::ActiveCameras;
use super::camera_refusal::CameraRefusal;
use super::corner_motion::DisplacedCorners;
use super::coverage::InlierCoverage;
use super::displacement_search::DisplacementSearch;
use super::keyframe::{ActiveKeyframe, Keyframe};
use super::measurement::RejectedPoint;
use super::temporal::{RefinedDisplacement, TemporalMatcher};
use super::tracks::Tracks;
use super::{
    Correspondence, FilteredFrameSet, Flow, FlowRefusal, Measurement, PipelineStage, StageObserver,
};
use crate::matching::Reject;
use crate::matching::stereo::StereoMatch;
use crate::matching::zncc::ZnccPlane;

/// Least mean correlation of the refined displacement.
const MIN_DISPLACEMENT_ZNCC: f32 = 0.4;

/// Least distance in the image between two displacements that count as different, px.
const DISTINCT_PX: f64 = 2.0;

impl Flow {
    /// Does the same as [`Flow::measure`] with a frame set that is already filtered.
    ///
    /// # Errors
    /// [`FlowRefusal`] if the displacement cannot be measured; the keyframe stays.
    pub fn measure_filtered(
        &self,
        now: &FilteredFrameSet,
        observer: &mut dyn StageObserver,
    ) -> Result<Measurement, FlowRefusal> {
        if let Some(reduced) = &self.reduced {
            let measured = reduced.measure_filtered(&reduced.halved(now), observer);
            return measured.map(Measurement::enlarged);
        }
        let keyframe = self.keyframe.as_ref().ok_or(FlowRefusal::NoKeyframe)?;
        let (mut measurement, refused_cameras) =
            self.track_synchronised(keyframe, now, |active| self.track(active, now, observer))?;
        measurement.refused_cameras = refused_cameras;
        Ok(measurement)
    }

    /// Tracks the keyframe's points with the cameras that are not refused, and again without a
    /// camera that is not synchronised. Returns the refused cameras, too.
    pub(super) fn track_synchronised<M>(
        &self,
        keyframe: &Keyframe,
        now: &FilteredFrameSet,
        mut track: impl FnMut(&ActiveKeyframe<'_>) -> Result<Tracking<M>, FlowRefusal>,
    ) -> Result<(M, Vec<(usize, CameraRefusal)>), FlowRefusal> {
        let mut refusals = keyframe.refusals(now);
        let Tracking {
            mut result,
            unsynchronised,
        } = self.with_active(keyframe, &refusals, &mut track)?;
        // An unsynchronised camera is left out, and the others measure again.
        if let Some((camera, share)) = unsynchronised
            && let Some(refusal) = refusals.get_mut(camera)
        {
            *refusal = Some(CameraRefusal::Unsynchronised { share });
            let without = self.with_active(keyframe, &refusals, &mut track);
            // If both are refused, the refusal with all cameras is the more precise one.
            result = (without.and_then(|tracking| tracking.result))
                .map_err(|refusal| result.err().unwrap_or(refusal));
        }
        let refused = refusals.into_iter().enumerate();
        let refused = refused.filter_map(|(k, refusal)| Some((k, refusal?)));
        Ok((result?, refused.collect()))
    }

    /// Calls `track` with the keyframe restricted to the cameras that are not refused.
    pub(super) fn with_active<T>(
        &self,
        keyframe: &Keyframe,
        refusals: &[Option<CameraRefusal>],
        track: impl FnOnce(&ActiveKeyframe<'_>) -> Result<T, FlowRefusal>,
    ) -> Result<T, FlowRefusal> {
        let active = self.active_cameras(refusals)?;
        if active.cameras == keyframe.active.cameras {
            return track(&keyframe.whole());
        }
        let (matches, coarse) = keyframe.restricted(&active, self.temporal_level());
        // Unmatched corners are pixels of the keyframe's reference camera only.
        let is_same_reference = active.reference_camera() == keyframe.active.reference_camera();
        let unmatched: &[[f64; 2]] = if is_same_reference {
            &keyframe.unmatched
        } else {
            &[]
        };
        let restricted = ActiveKeyframe {
            active: &active,
            coarse: &coarse,
            matches: &matches,
            unmatched,
            ..keyframe.whole()
        };
        track(&restricted)
    }

    /// Selects the cameras that are not refused.
    ///
    /// # Errors
    /// [`FlowRefusal::FewCameras`] unless two of them are in different places.
    pub(super) fn active_cameras(
        &self,
        refusals: &[Option<CameraRefusal>],
    ) -> Result<ActiveCameras, FlowRefusal> {
        let is_active = |k: usize| matches!(refusals.get(k), Some(None));
        let rig = &self.geometry.rig;
        let left = (0..rig.cameras.len()).filter(|k| is_active(*k)).count();
        ActiveCameras::of(rig, is_active).ok_or(FlowRefusal::FewCameras { left })
    }

    /// Tracks the keyframe's points into the frame set `now`. The result also names a camera that
    /// is not synchronised with the others.
    ///
    /// # Errors
    /// [`FlowRefusal`] for reasons that no single camera can cause.
    fn track(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        now: &FilteredFrameSet,
        observer: &mut dyn StageObserver,
    ) -> Result<Tracking, FlowRefusal> {
        let select = |pyramids| keyframe.active.select(pyramids);
        let (before, now) = (select(keyframe.pyramids), select(&now.pyramids));
        let matcher = TemporalMatcher {
            geometry: &keyframe.active.geometry,
            settings: &self.settings,
            before: &before,
            now: &now,
            thread_pool: &self.thread_pool,
        };

        // Displacement search on a coarse level, then refinement to a fraction of a pixel.
        let level = self.temporal_level();
        let coarse = ZnccPlane::new(&now[matcher.geometry.reference].coarse()[level - 1]);
        let search = self.search(keyframe, &coarse);
        let rough_mm = self.rough_displacement(keyframe, &matcher, &search, 1)?;
        observer.stage_done(PipelineStage::Search);

        // Lucas-Kanade at full resolution, every point in every camera.
        let matches: Vec<&StereoMatch> = keyframe.matches.iter().collect();
        let cameras = &keyframe.active.cameras;
        let track = |matched| {
            let point = matcher.track_point(matched, rough_mm);
            point.and_then(|point| self.unmasked(cameras, point))
        };
        let tracked = self.thread_pool.map(matches, track);
        let untracked = keyframe.matches.iter().zip(&tracked);
        let rejected_points = untracked.filter_map(|(matched, point)| {
            let reason = *point.as_ref().err()?;
            let pixels = matcher.expected_pixels(matched, rough_mm);
            Some(RejectedPoint { pixels, reason })
        });
        let rejected_points = rejected_points.collect();
        let tracks = Tracks::of(keyframe, tracked);
        observer.stage_done(PipelineStage::Temporal);

        // Consensus and the tests of its inliers.
        let expected = tracks.expected;
        let mut tracking = match tracks.enough(self.settings.min_points) {
            Ok(()) => self.accept(keyframe.active, tracks, rough_mm, rejected_points),
            Err(refusal) => Tracking::refused(refusal),
        };
        match &tracking.result {
            Ok(measurement) => {
                let motion = DisplacedCorners {
                    matcher: &matcher,
                    search: &search,
                    displacement_mm: measurement.displacement_mm,
                };
                let inliers = &measurement.correspondences;
                let coverage =
                    InlierCoverage::of(keyframe, &matcher, &motion, inliers, &self.regions);
                if let Err(refusal) = coverage.judge() {
                    tracking.result = Err(refusal);
                }
            }
            // An unsynchronised camera may have spoiled every point.
            Err(FlowRefusal::FewTracks { .. } | FlowRefusal::NoAgreement { .. }) => {
                tracking.unsynchronised =
                    self.find_unsynchronised(keyframe, &matcher, expected, rough_mm);
            }
            Err(_) => {}
        }
        observer.stage_done(PipelineStage::Consensus);
        Ok(tracking)
    }

    /// Creates the search for displacements from the keyframe to a coarse image.
    pub(super) fn search<'a>(
        &'a self,
        keyframe: &'a ActiveKeyframe<'_>,
        coarse: &'a ZnccPlane,
    ) -> DisplacementSearch<'a> {
        let [width, _] = coarse.size();
        DisplacementSearch {
            geometry: &keyframe.active.geometry,
            before: keyframe.coarse,
            now: coarse,
            scale: (1 << self.temporal_level()) as f64,
            range: (self.settings.search_range * width as f64).ceil() as usize,
            thread_pool: &self.thread_pool,
        }
    }

    /// Rejects a point that some camera sees on its mask now.
    pub(super) fn unmasked(
        &self,
        cameras: &[usize],
        point: Correspondence,
    ) -> Result<Correspondence, Reject> {
        let mut pixels = cameras.iter().zip(&point.pixels);
        match pixels.all(|(camera, [_, now])| self.regions.allow(*camera, *now)) {
            true => Ok(point),
            false => Err(Reject::OutOfView),
        }
    }

    /// Finds the displacement to a fraction of a pixel of the level `finest`, without a prior.
    ///
    /// # Errors
    /// [`FlowRefusal::Lost`] if no displacement explains the images,
    /// [`FlowRefusal::AmbiguousMotion`] if several do.
    pub(super) fn rough_displacement(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
        search: &DisplacementSearch<'_>,
        finest: usize,
    ) -> Result<[f64; 3], FlowRefusal> {
        let hypotheses = search.hypotheses(keyframe.matches);
        let best_score = hypotheses.first().map_or(0.0, |h| h.score);
        let levels = finest..=self.refined_level();
        let mut refined: Vec<RefinedDisplacement> = hypotheses
            .iter()
            .filter_map(|h| matcher.refine(keyframe.matches, h.displacement_mm, levels.clone()))
            .collect();
        refined.sort_by(|a, b| b.zncc.total_cmp(&a.zncc));
        let Some(first) = refined.first() else {
            return Err(FlowRefusal::Lost { zncc: best_score });
        };
        if first.zncc < MIN_DISPLACEMENT_ZNCC {
            return Err(FlowRefusal::Lost { zncc: first.zncc });
        }
        // A rival displacement that differs in the image and correlates as well: ambiguous.
        let inverse_depths = keyframe.matches.iter().map(|m| m.ray.inverse_depth);
        let mean_inverse_depth = inverse_depths.sum::<f64>() / keyframe.matches.len() as f64;
        let margin = 2.0 * self.settings.matching.rival_zncc_margin;
        for rival in &refined[1..] {
            let [dx, dy] = [0, 1].map(|i| rival.displacement_mm[i] - first.displacement_mm[i]);
            let distance_px = dx.hypot(dy) * mean_inverse_depth * matcher.geometry.focal_px;
            if distance_px > DISTINCT_PX && rival.zncc > first.zncc - margin {
                return Err(FlowRefusal::AmbiguousMotion {
                    first: first.displacement_mm,
                    second: rival.displacement_mm,
                });
            }
        }
        Ok(first.displacement_mm)
    }
}
