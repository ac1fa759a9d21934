//! Displacement and rotation of a rigid target.
//!
//! The search for a displacement, in images turned about z by one angle after another, finds where
//! the points are, roughly. The pose that most of them agree on predicts every point again, with
//! the window that a turned surface shows: each point has its own depth, and the surface through it
//! is parallel to the plane of all points. The points are tracked from there at half of the
//! resolution, and then at full resolution, once more if their windows do not fit the pose yet.
//!
//! ```text
//! search -> coarse turned windows -> tracks -> consensus
//!        -> (turned windows -> tracks -> consensus) once or twice -> pose
//! ```
//!
//! A target that does not turn is measured as by its displacement alone (`still`).
//!
//! The covariance of the pose is inflated for windows that overlap, as that of a displacement.

mod accept;
mod consensus;
mod corners;
mod errors;
pub(crate) mod offered;
mod pivot;
mod predictor;
mod refine;
mod search;
mod still;
mod turned_back;

use super::accept::Tracking;
use super::camera_refusal::CameraRefusal;
use super::coverage::InlierCoverage;
use super::keyframe::ActiveKeyframe;
use super::sync::UnsynchronisedCamera;
use super::temporal::TemporalMatcher;
use super::tracks::Tracks;
use super::variance_inflation::VarianceInflation;
use super::{
    Correspondence, FilteredFrameSet, Flow, FlowRefusal, LastPose, Measurement, RejectedPoint,
    TargetTurn,
};
use crate::images::FrameSet;
use crate::matching::RejectCounts;
use crate::matching::stereo::StereoMatch;
use crate::matching::zncc::ZnccPlane;
use corners::PosedCorners;
use predictor::{Predictor, Surface};
use refine::ROUGH_FAR_PX;
use search::RoughPose;
use trinocular_core::estimate::pose::Estimate;
use turned_back::TurnedBack;

/// Displacement and rotation of the target since the keyframe, and its points.
#[derive(Clone, Debug)]
pub struct PoseMeasurement {
    /// Pose with its covariance, inflated for correlated errors.
    pub pose: Estimate,
    /// Inliers: points that passed every test and move as one rigid target.
    pub correspondences: Vec<Correspondence>,
    /// Active cameras, as indices into the rig's cameras.
    pub cameras: Vec<usize>,
    /// Refused cameras, as indices into the rig's cameras, with the reasons.
    pub refused_cameras: Vec<(usize, CameraRefusal)>,
    /// Number of points left out, by reason; those of the keyframe included.
    pub rejected: RejectCounts,
    /// Matched points of the keyframe that were left out, each with its place and reason; those
    /// behind a camera have no place and are not here.
    pub rejected_points: Vec<RejectedPoint>,
    /// Inflation of the variances by correlated errors.
    pub variance_inflation: VarianceInflation,
}

impl PoseMeasurement {
    /// Returns the measurement as the displacement of the target's point that was at `pivot_mm` at
    /// the keyframe.
    pub(super) fn of_pivot(self, pivot_mm: [f64; 3]) -> Measurement {
        let there = self.pose.displacement_of(pivot_mm);
        Measurement {
            correspondences: self.correspondences,
            cameras: self.cameras,
            refused_cameras: self.refused_cameras,
            rejected: self.rejected,
            rejected_points: self.rejected_points,
            displacement_mm: there.displacement_mm,
            variance_inflation: self.variance_inflation,
            turn: Some(TargetTurn {
                rotation_deg: self.pose.rotation_deg(),
                rotation_sigma_deg: self.pose.rotation_sigma_deg(),
                pivot_mm,
                covariance_mm2: there.covariance_mm2,
                sigma: self.pose.sigma,
                is_significant: offered::is_significant(&self.pose),
            }),
        }
    }
}

impl Flow {
    /// Measures displacement and rotation of the target from the keyframe to `frame_set`.
    ///
    /// # Errors
    /// [`FlowRefusal`] if the pose cannot be measured; the keyframe stays.
    pub fn measure_pose(&mut self, frame_set: &FrameSet) -> Result<PoseMeasurement, FlowRefusal> {
        self.measure_with(frame_set, &mut (), |flow, filtered, _| {
            flow.measure_filtered_pose(filtered)
        })
    }

    /// Does the same as [`Flow::measure_pose`] with a frame set that is already filtered.
    ///
    /// # Errors
    /// [`FlowRefusal`] if the pose cannot be measured; the keyframe stays.
    pub fn measure_filtered_pose(
        &mut self,
        now: &FilteredFrameSet,
    ) -> Result<PoseMeasurement, FlowRefusal> {
        if let Some(reduced) = &mut self.reduced {
            let measured = reduced.measure_filtered_pose(&reduced.halved(now));
            return measured.map(PoseMeasurement::enlarged);
        }
        let alone = self.displacement_if_still(now);
        self.pose_of(now, alone.as_ref())
    }

    /// Measures the pose: from the displacement `alone` if that was measured and the target does
    /// not turn.
    fn pose_of(
        &mut self,
        now: &FilteredFrameSet,
        alone: Option<&Result<Measurement, FlowRefusal>>,
    ) -> Result<PoseMeasurement, FlowRefusal> {
        let keyframe = self.keyframe.as_ref().ok_or(FlowRefusal::NoKeyframe)?;
        if let Some(Ok(alone)) = alone
            && let Some(still) = self.still_pose(alone)
        {
            self.last_pose = Some(LastPose::of(&still.pose));
            return Ok(still);
        }
        let (mut measurement, refused_cameras) =
            self.track_synchronised(keyframe, now, |active| self.track_pose(active, now))?;
        measurement.refused_cameras = refused_cameras;
        self.last_pose = Some(LastPose::of(&measurement.pose));
        Ok(measurement)
    }

    /// Tracks the keyframe's points into the frame set `now`: near the last pose if the target has
    /// turned far, then from nothing, and if that finds nothing near a last pose that is not far.
    /// The result also names a camera that is not synchronised with the others.
    ///
    /// # Errors
    /// [`FlowRefusal`] for reasons that no single camera can cause.
    fn track_pose(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        now: &FilteredFrameSet,
    ) -> Result<Tracking<PoseMeasurement>, FlowRefusal> {
        let select = |pyramids| keyframe.active.select(pyramids);
        let (before, now) = (select(keyframe.pyramids), select(&now.pyramids));
        let matcher = TemporalMatcher {
            geometry: &keyframe.active.geometry,
            settings: &self.settings,
            before: &before,
            now: &now,
            thread_pool: &self.thread_pool,
        };
        let surface = Surface::of(keyframe.matches);
        let track = |rough: RoughPose| self.track_from(keyframe, &matcher, surface, &rough);
        let track_near = |last| {
            let rough = self.rough_pose_near(keyframe, &matcher, surface, last);
            rough.ok().map(track)
        };
        let turned = self.last_pose.filter(|last| !last.is_still());
        let last = turned.and_then(|last| last.pose(matcher.geometry));
        let is_far = turned.is_some_and(|last| last.is_far());
        let near = match last.filter(|_| is_far).and_then(track_near) {
            Some(tracking) if tracking.result.is_ok() => return Ok(tracking),
            refused => refused,
        };
        match self.rough_pose(keyframe, &matcher, surface) {
            Ok(rough) => Ok(track(rough)),
            // The last pose explains the images better than none.
            Err(lost) => {
                let near = near.or_else(|| last.filter(|_| !is_far).and_then(track_near));
                near.ok_or(lost)
            }
        }
    }

    /// Tracks all points from a rough pose.
    fn track_from(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
        surface: Surface,
        rough: &RoughPose,
    ) -> Tracking<PoseMeasurement> {
        let geometry = matcher.geometry;
        let mut tracking = match self.refined(keyframe, matcher, surface, &rough.pose) {
            Ok((tracks, found, lost)) => self.accept_pose(keyframe.active, tracks, &found, lost),
            Err(refusal) => Tracking::refused(refusal),
        };
        match &tracking.result {
            Ok(measurement) => {
                let level = self.temporal_level();
                let upright = (rough.turned_back.as_ref())
                    .map(|_| ZnccPlane::new(&matcher.now[geometry.reference].coarse()[level - 1]));
                let turned_back = (rough.turned_back.as_ref())
                    .map(|pose| TurnedBack::new(geometry, surface, pose));
                let upright = upright.as_ref().map(|coarse| (coarse, None));
                let planes = upright.into_iter().chain([(&rough.coarse, turned_back)]);
                let motion = PosedCorners {
                    matcher,
                    predictor: Predictor::new(geometry, surface, &measurement.pose),
                    searches: planes
                        .map(|(coarse, turned_back)| (self.search(keyframe, coarse), turned_back))
                        .collect(),
                };
                let inliers = &measurement.correspondences;
                let coverage =
                    InlierCoverage::of(keyframe, matcher, &motion, inliers, &self.regions);
                if let Err(refusal) = coverage.judge() {
                    tracking.result = Err(refusal);
                }
            }
            // An unsynchronised camera may have spoiled every point.
            Err(FlowRefusal::FewTracks { .. } | FlowRefusal::NoAgreement { .. }) => {
                tracking.unsynchronised =
                    self.find_unsynchronised_turned(keyframe, matcher, surface, &rough.pose);
            }
            Err(_) => {}
        }
        tracking
    }

    /// Finds an unsynchronised camera that keeps points from agreeing, as
    /// [`Flow::find_unsynchronised`] does for a target that does not turn.
    fn find_unsynchronised_turned(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
        surface: Surface,
        rough: &Estimate,
    ) -> Option<(usize, f64)> {
        let geometry = matcher.geometry;
        let predictor = Predictor::new(geometry, surface, rough);
        let track = |matched: &StereoMatch| predictor.track_per_camera(matcher, matched);
        let matches = keyframe.matches.iter().collect();
        let tracks = Tracks::of(keyframe, self.thread_pool.map(matches, track));
        let least_px = self.settings.min_inlier_px;
        let found = consensus::from_nothing(geometry, &tracks.points, ROUGH_FAR_PX, least_px)?;
        if found.count() < self.settings.min_points || 2 * found.count() < tracks.expected {
            return None;
        }
        let inliers = found.inliers_of(tracks.points);
        let factor = errors::inflation(geometry, &inliers, &found.model).factor;
        let camera = errors::unsynchronised(geometry, &inliers, &found.model, factor)?;
        let camera = Some(camera).filter(UnsynchronisedCamera::is_unsynchronised)?;
        camera.in_rig(keyframe.active)
    }
}

#[cfg(test)]
mod tests;
