//! From a rough pose to the one that most points agree on.

use super::consensus::{self, RigidConsensus, rigid_consensus};
use super::predictor::{Predictor, Surface};
use crate::flow::keyframe::ActiveKeyframe;
use crate::flow::temporal::TemporalMatcher;
use crate::flow::tracks::Tracks;
use crate::flow::{Correspondence, Flow, FlowRefusal, RejectedPoint};
use crate::matching::Reject;
use crate::matching::geometry::RigGeometry;
use crate::matching::stereo::StereoMatch;
use trinocular_core::estimate::pose::Estimate;

/// Most rounds of tracking with turned windows at full resolution.
const ROUNDS: usize = 2;
/// Least limit of an inlier's residual in the first consensus, px: coarse windows are followed less
/// well.
const ROUGH_INLIER_PX: f64 = 0.5;
/// Distance beyond which a point counts as simply wrong in the first consensus, px. With a larger
/// one, a blend of two objects would be nearer to all points than the pose of either.
pub(super) const ROUGH_FAR_PX: f64 = 2.0;
/// The same in a consensus of turned windows.
const FAR_PX: f64 = 0.5;
/// Share of inliers from which a consensus is clear.
const CLEAR: f64 = 0.9;
/// Least share of the coarse windows in view that must be found.
const COARSE_SHARE: f64 = 0.75;
/// Most points that are tracked in coarse windows: enough for a pose that draws the finer ones.
const MOST_COARSE: usize = 120;

impl Flow {
    /// Tracks all points with windows turned by the pose so far and finds the pose that most of
    /// them agree on, from the rough pose on. Also returns the points that were not found.
    pub(super) fn refined(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
        surface: Surface,
        rough: &Estimate,
    ) -> Result<(Tracks, RigidConsensus, Vec<RejectedPoint>), FlowRefusal> {
        let geometry = matcher.geometry;
        let mut pose = self.agreed_roughly(keyframe, matcher, surface, rough)?;
        let mut rounds = 0;
        loop {
            let drawn = Predictor::new(geometry, surface, &pose);
            let (tracks, reasons) = self.tracked(keyframe, |matched| {
                let point = drawn.track(matcher, matched)?;
                self.unmasked(&keyframe.active.cameras, point)
            })?;
            let found = self.consensus(geometry, &tracks.points, pose);
            let found = found.ok_or_else(|| tracks.no_agreement(0, f64::NAN))?;
            rounds += 1;
            if rounds == ROUNDS || drawn.turns_as(&found.model, keyframe.matches) {
                let lost = keyframe.matches.iter().zip(reasons);
                let lost = lost.filter_map(|(matched, reason)| {
                    Some(RejectedPoint {
                        pixels: drawn.expected_pixels(matched)?,
                        reason: reason?,
                    })
                });
                let lost = lost.collect();
                return Ok((tracks, found, lost));
            }
            pose = found.model;
        }
    }

    /// Finds the inliers of points that were tracked with windows turned by the pose `drawn`. If
    /// many contradict it, the pose of most of them is searched from nothing.
    fn consensus(
        &self,
        geometry: &RigGeometry,
        points: &[Correspondence],
        drawn: Estimate,
    ) -> Option<RigidConsensus> {
        let least_px = self.settings.min_inlier_px;
        let near = rigid_consensus(geometry, points, drawn, least_px);
        match near.filter(|found| is_clear(found, points.len(), least_px)) {
            Some(found) => Some(found),
            None => consensus::from_nothing(geometry, points, FAR_PX, least_px),
        }
    }

    /// Finds the pose that most points agree on, with windows turned by a rough pose: on one coarse
    /// level after another. At full resolution only if those points are not clearly of one target.
    fn agreed_roughly(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
        surface: Surface,
        rough: &Estimate,
    ) -> Result<Estimate, FlowRefusal> {
        let geometry = matcher.geometry;
        let mut pose = *rough;
        for level in (1..=self.refined_level()).rev() {
            let drawn = Predictor::new(geometry, surface, &pose);
            let Some((found, is_clear)) = self.agreed_at(level, keyframe, matcher, &drawn) else {
                continue;
            };
            // The finest level must be clear: full resolution decides otherwise.
            if level > 1 {
                pose = found.model;
            } else if is_clear {
                return Ok(found.model);
            }
        }
        let drawn = Predictor::new(geometry, surface, &pose);
        let (tracks, _) = self.tracked(keyframe, |matched| drawn.track(matcher, matched))?;
        let found = rough_consensus(geometry, &tracks.points, 1.0);
        let found = found.ok_or_else(|| tracks.no_agreement(0, f64::NAN))?;
        Ok(found.model)
    }

    /// Finds the pose that most points agree on in windows of a coarse level, and whether they are
    /// clearly of one target. `None` if few windows are found.
    fn agreed_at(
        &self,
        level: usize,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
        drawn: &Predictor<'_>,
    ) -> Option<(RigidConsensus, bool)> {
        let share = keyframe.matches.len().div_ceil(MOST_COARSE);
        let matches: Vec<&StereoMatch> = keyframe.matches.iter().step_by(share).collect();
        let track = |matched: &StereoMatch| drawn.track_coarse(matcher, level, matched);
        let tracked = self.thread_pool.map(matches, track);
        let is_in_view =
            |point: &&Result<Correspondence, Reject>| !matches!(point, Err(Reject::OutOfView));
        let in_view = tracked.iter().filter(is_in_view).count();
        let points: Vec<Correspondence> = tracked.into_iter().flatten().collect();
        if (points.len() as f64) < COARSE_SHARE * in_view as f64 {
            return None;
        }
        // Pixels of level 1 are the unit: errors grow with those of the level.
        let scale = (1 << (level - 1)) as f64;
        let found = rough_consensus(matcher.geometry, &points, scale)?;
        let is_clear = is_clear(&found, points.len(), scale * ROUGH_INLIER_PX);
        Some((found, is_clear))
    }

    /// Tracks all points by `track`. Also returns why points were not found.
    ///
    /// # Errors
    /// [`FlowRefusal::FewTracks`].
    fn tracked(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        track: impl Fn(&StereoMatch) -> Result<Correspondence, Reject> + Sync,
    ) -> Result<(Tracks, Vec<Option<Reject>>), FlowRefusal> {
        let matches = keyframe.matches.iter().collect();
        let tracked = self
            .thread_pool
            .map(matches, |matched: &StereoMatch| track(matched));
        let reasons = tracked.iter().map(|point| point.as_ref().err().copied());
        let reasons = reasons.collect();
        let tracks = Tracks::of(keyframe, tracked);
        tracks.enough(self.settings.min_points)?;
        Ok((tracks, reasons))
    }
}

/// Finds the inliers of points that were tracked with roughly turned windows, by limits `scale`
/// times those of level 1.
fn rough_consensus(
    geometry: &RigGeometry,
    points: &[Correspondence],
    scale: f64,
) -> Option<RigidConsensus> {
    let [far_px, inlier_px] = [ROUGH_FAR_PX, ROUGH_INLIER_PX].map(|px| scale * px);
    consensus::from_nothing(geometry, points, far_px, inlier_px)
}

/// Returns true if nearly all of `count` points are inliers by the limit `least_px`: they are of
/// one target, and not of a blend of two.
fn is_clear(found: &RigidConsensus, count: usize, least_px: f64) -> bool {
    found.limit_px() <= least_px && found.count() as f64 >= CLEAR * count as f64
}
