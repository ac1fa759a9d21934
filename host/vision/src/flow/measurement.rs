//! Results of the flow: correspondences, their displacement, and the cameras that took part.

use super::active_cameras;
use super::camera_refusal::{self, CameraRefusal};
use super::variance_inflation::VarianceInflation;
use crate::matching::{Reject, RejectCounts};
use trinocular_core::rig::Rig;
use trinocular_core::sums::View;

/// One scene point, matched in all active cameras at the keyframe and now.
#[derive(Clone, Debug, PartialEq)]
pub struct Correspondence {
    /// Pixel at the keyframe and pixel now, per active camera in the rig's order. Pixels are as
    /// seen: principal point and distortion are not removed.
    pub pixels: Vec<[[f64; 2]; 2]>,
    /// Normalised coordinates of the same pixels, per active camera.
    pub views: Vec<View>,
}

impl Correspondence {
    /// Normalises the pixels of one point, given per camera of `rig`: at the keyframe and now.
    ///
    /// ```
    /// use trinocular_core::rig::Rig;
    /// use trinocular_vision::flow::Correspondence;
    ///
    /// let rig = Rig::paper();
    /// let (before, now) = ([10.0, 5.0, 850.0], [14.0, 5.0, 850.0]);
    /// let pixels = rig.cameras.iter().map(|c| [c.project(before), c.project(now)]);
    /// let point = Correspondence::from_pixels(&rig, pixels.collect());
    /// assert!((point.views[0].flow()[0] - 4.0 / 850.0).abs() < 1e-12);
    /// ```
    pub fn from_pixels(rig: &Rig, pixels: Vec<[[f64; 2]; 2]>) -> Self {
        let cameras = rig.cameras.iter().zip(&pixels);
        let views = cameras.map(|(camera, [start, end])| View::from_pixels(camera, *start, *end));
        Self {
            views: views.collect(),
            pixels,
        }
    }
}

/// Point of the keyframe that was left out of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct RejectedPoint {
    /// Place in each active camera, in the rig's order, px: where an outlier was found, and where
    /// any other point was expected.
    pub pixels: Vec<[f64; 2]>,
    /// Reason to leave it out.
    pub reason: Reject,
}

impl RejectedPoint {
    /// Creates a point that was found where it disagrees with the others.
    pub(super) fn outlier(outlier: &Correspondence) -> Self {
        Self {
            pixels: outlier.pixels.iter().map(|[_, now]| *now).collect(),
            reason: Reject::Outlier,
        }
    }
}

/// Displacement of the target since the keyframe, and its points.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Inliers: points that passed every test and move as one.
    pub correspondences: Vec<Correspondence>,
    /// Active cameras, as indices into the rig's cameras.
    pub cameras: Vec<usize>,
    /// Refused cameras, as indices into the rig's cameras, with the reasons.
    pub refused_cameras: Vec<(usize, CameraRefusal)>,
    /// Number of points left out, by reason; those of the keyframe included.
    pub rejected: RejectCounts,
    /// Matched points of the keyframe that were left out, each with its place and reason.
    pub rejected_points: Vec<RejectedPoint>,
    /// Displacement of the inliers by the midpoint model, or of the pivot, mm.
    pub displacement_mm: [f64; 3],
    /// Inflation of the displacement's variance by correlated errors.
    pub variance_inflation: VarianceInflation,
    /// Rotation, if it was estimated; the displacement is then that of the pivot.
    pub turn: Option<TargetTurn>,
}

/// Rotation of the target since the keyframe, and the covariance of its pivot's displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetTurn {
    /// Rotation vector about the cameras' axes, degrees.
    pub rotation_deg: [f64; 3],
    /// Standard deviation of the rotation about each axis, degrees.
    pub rotation_sigma_deg: [f64; 3],
    /// Point of the target at the keyframe whose displacement is measured, mm.
    pub pivot_mm: [f64; 3],
    /// Covariance of the pivot's displacement, mm².
    pub covariance_mm2: [[f64; 3]; 3],
    /// Standard deviation of one normalised coordinate, dimensionless.
    pub sigma: f64,
    /// True if noise imitates the rotation in less than one of 1,000 cases.
    pub is_significant: bool,
}

impl Measurement {
    /// Returns the rig of the active cameras, given the whole rig.
    pub fn rig(&self, whole: &Rig) -> Rig {
        active_cameras::subset(whole, &self.cameras)
    }

    /// Describes each refused camera in a sentence, given the names of all cameras.
    pub fn remarks(&self, names: &[String]) -> Vec<String> {
        camera_refusal::remarks(&self.refused_cameras, names)
    }
}
