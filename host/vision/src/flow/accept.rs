//! Acceptance of tracked points: from correspondences to a measurement, or to a refusal.

use super::active_cameras::ActiveCameras;
use super::consensus::{Agreement, Consensus};
use super::keyframe::ActiveKeyframe;
use super::measurement::RejectedPoint;
use super::rigidity::parts::TwoParts;
use super::rotation::TargetRotation;
use super::sync::UnsynchronisedCamera;
use super::temporal::TemporalMatcher;
use super::tracks::Tracks;
use super::variance_inflation::{VarianceInflation, with_common_error};
use super::{Correspondence, Flow, FlowRefusal, Measurement};
use crate::matching::Reject;
use crate::matching::stereo::StereoMatch;
use trinocular_core::estimate::midpoint::Estimate;

/// A rotation is refused when `ω' C^-1 ω` is beyond this limit. With three degrees of freedom,
/// noise reaches it once in 65,000 cases.
const CERTAIN_CHI_SQUARED: f64 = 25.0;

/// Result of tracking with one set of active cameras.
#[derive(Debug)]
pub(super) struct Tracking<M = Measurement> {
    /// Measurement, or the reason why there is none.
    pub(super) result: Result<M, FlowRefusal>,
    /// Index in the rig of a camera that is not synchronised, if there is one, and the share of
    /// the motion that it saw in excess of the others.
    pub(super) unsynchronised: Option<(usize, f64)>,
}

impl<M> Tracking<M> {
    /// Creates the result of a refusal for which no camera is responsible.
    pub(super) fn refused(refusal: FlowRefusal) -> Self {
        Self {
            result: Err(refusal),
            unsynchronised: None,
        }
    }
}

impl Flow {
    /// Keeps the inliers of `tracks`, which must be most of the points in view; otherwise the target
    /// is unknown. Also finds a camera that is not synchronised.
    pub(super) fn accept(
        &self,
        active: &ActiveCameras,
        tracks: Tracks,
        rough_mm: [f64; 3],
        mut rejected_points: Vec<RejectedPoint>,
    ) -> Tracking {
        let (settings, geometry) = (&self.settings, &active.geometry);

        // Consensus: iteratively re-solved inliers of the midpoint model.
        let tracked = &tracks.points;
        let consensus = Consensus::of_points(geometry, tracked, rough_mm, settings.min_inlier_px);
        let Some(consensus) = consensus else {
            return Tracking::refused(tracks.no_agreement(0, f64::NAN));
        };
        let displacement_mm = consensus.model.estimate.displacement_mm;
        if let Err(refused) = self.agreed(&tracks, &consensus) {
            // Points that a rotation explains are refused for the rotation.
            let rotation = TargetRotation::of(geometry, tracked, displacement_mm, 1.0);
            let rotation = rotation.filter(|r| r.residual_share < 0.5 && self.is_excessive(r));
            let degrees = rotation.map(|r| r.degrees);
            let rotated = degrees.map(|degrees| FlowRefusal::Turned { degrees });
            return Tracking::refused(rotated.unwrap_or(refused));
        }
        let disagreement = tracks.no_agreement(consensus.count() / 2, consensus.median_px);
        let mut rejected = tracks.rejected;
        for outlier in consensus.outliers_of(tracked) {
            rejected.add(Reject::Outlier);
            rejected_points.push(RejectedPoint::outlier(outlier));
        }
        let inliers = consensus.inliers_of(tracks.points);

        // Variance inflation: correlated errors of overlapping windows and of cameras.
        let mut inflation = VarianceInflation::of(geometry, &inliers, displacement_mm);
        let skewed =
            UnsynchronisedCamera::find(geometry, &inliers, displacement_mm, inflation.factor);
        let unsynchronised = skewed.filter(UnsynchronisedCamera::is_unsynchronised);
        // An unsynchronised camera looks like a rotation, so it is left out first.
        if unsynchronised.is_none() {
            let rotation =
                TargetRotation::of(geometry, &inliers, displacement_mm, inflation.factor);
            let rotation = rotation.filter(TargetRotation::is_significant);
            if let Some(rotation) = rotation.filter(|r| self.is_excessive(r)) {
                let degrees = rotation.degrees;
                return Tracking::refused(FlowRefusal::Turned { degrees });
            }
            // Small rotations, skews and differences of parts stay in the measurement; sigma
            // contains their bias.
            let rotated = rotation.map_or(1.0, |r| {
                bias_inflation(&consensus.model.estimate, inflation.factor, r.bias_mm)
            });
            let parts = TwoParts::of(geometry, &inliers, displacement_mm, inflation.factor);
            if parts.are_certain() {
                return Tracking::refused(disagreement);
            }
            let skewed = skewed.map_or(1.0, |s| s.variance_inflation);
            inflation.factor *= skewed.max(rotated).max(parts.inflation_of_displacement());
        }
        inflation.factor = with_common_error(
            inflation.factor,
            consensus.model.estimate.sigma_px,
            consensus.model.components(),
        );
        let measurement = Measurement {
            correspondences: inliers,
            cameras: active.cameras.clone(),
            refused_cameras: Vec::new(),
            rejected,
            rejected_points,
            displacement_mm,
            variance_inflation: inflation,
            turn: None,
        };
        Tracking {
            result: Ok(measurement),
            unsynchronised: unsynchronised.and_then(|camera| camera.in_rig(active)),
        }
    }

    /// Finds an unsynchronised camera that keeps points from agreeing.
    ///
    /// Each camera tracks on its own, without the tests between cameras. Most of the `expected`
    /// points in view must then move as one, except for the share of the motion that one camera saw
    /// in excess.
    pub(super) fn find_unsynchronised(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
        expected: usize,
        rough_mm: [f64; 3],
    ) -> Option<(usize, f64)> {
        let (settings, geometry) = (&self.settings, matcher.geometry);
        let matches = keyframe.matches.iter().collect();
        let track = |matched: &StereoMatch| matcher.track_per_camera(matched, rough_mm).ok();
        let tracked = self.thread_pool.map(matches, track);
        let tracked: Vec<Correspondence> = tracked.into_iter().flatten().collect();
        let consensus = Consensus::of_points(geometry, &tracked, rough_mm, settings.min_inlier_px)?;
        let inliers = consensus.inliers_of(tracked);
        if inliers.len() < settings.min_points || 2 * inliers.len() < expected {
            return None;
        }
        let displacement_mm = consensus.model.estimate.displacement_mm;
        let factor = VarianceInflation::of(geometry, &inliers, displacement_mm).factor;
        let camera = UnsynchronisedCamera::find(geometry, &inliers, displacement_mm, factor)?;
        let camera = Some(camera).filter(UnsynchronisedCamera::is_unsynchronised)?;
        camera.in_rig(keyframe.active)
    }

    /// Refuses an agreement of too few points, of less than half of the points in view, or of points
    /// that scatter too much.
    pub(super) fn agreed<M>(
        &self,
        tracks: &Tracks,
        agreement: &Agreement<M>,
    ) -> Result<(), FlowRefusal> {
        let (agree, median_px) = (agreement.count(), agreement.median_px);
        let settings = &self.settings;
        if agree >= settings.min_points
            && 2 * agree >= tracks.expected
            && median_px <= settings.max_median_residual_px
        {
            return Ok(());
        }
        Err(tracks.no_agreement(agree, median_px))
    }

    /// Returns true if the target rotates certainly, and by more than the settings allow.
    fn is_excessive(&self, rotation: &TargetRotation) -> bool {
        rotation.chi_squared > CERTAIN_CHI_SQUARED
            && rotation.angle_deg() > self.settings.max_rotation_deg
    }
}

/// Computes the factor by which the variance, already inflated by `factor`, must grow to contain a
/// bias, on the axis with the largest factor.
fn bias_inflation(estimate: &Estimate, factor: f64, bias_mm: [f64; 3]) -> f64 {
    let of_axis = |i: usize| bias_mm[i].powi(2) / (factor * estimate.covariance_mm2[i][i]);
    1.0 + (0..3).map(of_axis).fold(0.0, f64::max)
}
