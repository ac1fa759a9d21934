//! Displacement and rotation of a rigid target.
//!
//! The search for a displacement, in images turned about z by one angle after another, finds where
//! the points are, roughly. The pose that most of them agree on predicts every point again, with
//! the window that a turned surface shows: each point has its own depth, and the surface through it
//! is parallel to the plane of all points. The points are tracked again from there, twice, until
//! their windows fit the pose.
//!
//! ```text
//! search -> tracks -> consensus -> (turned windows -> tracks -> consensus) twice -> pose
//! ```
//!
//! The covariance of the pose is inflated for windows that overlap, as that of a displacement.

mod consensus;
mod predictor;

use super::active_cameras::{self, ActiveCameras};
use super::camera_refusal::{self, CameraRefusal};
use super::displacement_search::DisplacementSearch;
use super::keyframe::ActiveKeyframe;
use super::temporal::TemporalMatcher;
use super::variance_inflation::VarianceInflation;
use super::{Correspondence, FilteredFrameSet, Flow, FlowRefusal};
use crate::images::FrameSet;
use crate::matching::geometry::RigGeometry;
use crate::matching::pyramid::Pyramid;
use crate::matching::stereo::StereoMatch;
use crate::matching::zncc::ZnccPlane;
use crate::matching::{Reject, RejectCounts};
use crate::rigid;
use consensus::{RigidConsensus, rigid_consensus};
use nalgebra::Vector3;
use predictor::{Predictor, Surface};
use trinocular_core::estimate::pose::{Estimate, Observation};
use trinocular_core::rig::Rig;
use trinocular_core::sums::View;

/// Rounds of tracking with turned windows.
const ROUNDS: usize = 2;
/// Step of the angles about z that are tried, degrees: the search bears half of it.
const TURN_DEG: f64 = 2.0;
/// Number of steps in either direction.
const TURNS: u32 = 8;
/// Least limit of an inlier's residual in the first consensus, px: windows that are not turned yet
/// are followed less well.
const ROUGH_INLIER_PX: f64 = 0.5;

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
}

impl PoseMeasurement {
    /// Returns the rig of the active cameras, given the whole rig.
    pub fn rig(&self, whole: &Rig) -> Rig {
        active_cameras::subset(whole, &self.cameras)
    }

    /// Describes each refused camera in a sentence, given the names of all cameras.
    pub fn remarks(&self, names: &[String]) -> Vec<String> {
        camera_refusal::remarks(&self.refused_cameras, names)
    }
}

impl Flow {
    /// Measures displacement and rotation of the target from the keyframe to `frame_set`.
    ///
    /// In contrast to [`Flow::measure`] it finds neither a camera that is late nor a target that is
    /// the smaller part of what moves: the inliers need not cover the image.
    ///
    /// # Errors
    /// [`FlowRefusal`] if the pose cannot be measured; the keyframe stays.
    pub fn measure_pose(&mut self, frame_set: &FrameSet) -> Result<PoseMeasurement, FlowRefusal> {
        self.keyframe.as_ref().ok_or(FlowRefusal::NoKeyframe)?;
        let thread_pool = self.thread_pool.clone();
        let (measurement, filtered) = thread_pool.run(|| {
            let filtered = self.filter_observed(frame_set, &mut ())?;
            let measurement = self.measure_filtered_pose(&filtered);
            Ok((measurement, filtered))
        })?;
        self.pyramid_pool.put(filtered);
        measurement
    }

    /// Returns the mean of the keyframe's points in the rig's axes, mm. It stays the same while the
    /// keyframe does, whichever points are found later.
    pub fn keyframe_centroid_mm(&self) -> Option<[f64; 3]> {
        let keyframe = self.keyframe.as_ref()?;
        let [cx, cy] = keyframe.active.geometry.arms.centre_mm();
        let count = keyframe.matches.len() as f64;
        let place = |matched: &StereoMatch| {
            let z = 1.0 / matched.ray.inverse_depth;
            let [alpha, beta] = matched.ray.direction;
            Vector3::new(alpha * z + cx, beta * z + cy, z)
        };
        let sum: Vector3<f64> = keyframe.matches.iter().map(place).sum();
        Some((sum / count).into())
    }

    fn measure_filtered_pose(
        &self,
        now: &FilteredFrameSet,
    ) -> Result<PoseMeasurement, FlowRefusal> {
        let keyframe = self.keyframe.as_ref().ok_or(FlowRefusal::NoKeyframe)?;
        let refusals = keyframe.refusals(now);
        let mut measurement =
            self.with_active(keyframe, &refusals, |active| self.track_pose(active, now))?;
        let refused = refusals.into_iter().enumerate();
        measurement.refused_cameras = refused
            .filter_map(|(k, refusal)| Some((k, refusal?)))
            .collect();
        Ok(measurement)
    }

    fn track_pose(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        now: &FilteredFrameSet,
    ) -> Result<PoseMeasurement, FlowRefusal> {
        let select = |pyramids| keyframe.active.select(pyramids);
        let (before, now) = (select(keyframe.pyramids), select(&now.pyramids));
        let geometry = &keyframe.active.geometry;
        let matcher = TemporalMatcher {
            geometry,
            settings: &self.settings,
            before: &before,
            now: &now,
            thread_pool: &self.thread_pool,
        };
        let rough = self.rough_pose(keyframe, &matcher)?;
        let matches: Vec<&StereoMatch> = keyframe.matches.iter().collect();

        // Windows turned by the pose so far, and the pose that most points agree on.
        let surface = Surface::of(keyframe.matches);
        let track_all = |pose: &Estimate| {
            let predictor = Predictor {
                geometry,
                pose,
                surface,
            };
            let track = |matched: &StereoMatch| {
                let point = predictor.track(&matcher, matched)?;
                self.unmasked(&keyframe.active.cameras, point)
            };
            Tracks::of(keyframe, self.thread_pool.map(matches.clone(), track))
        };
        let mut tracks = track_all(&rough);
        self.enough(keyframe, &tracks)?;
        let start = rigid::motion(&geometry.arms, &tracks.observed(geometry));
        let mut found = start
            .and_then(|start| rigid_consensus(geometry, &tracks, start, ROUGH_INLIER_PX))
            .ok_or_else(|| tracks.no_agreement(keyframe, 0, f64::NAN))?;
        for _ in 0..ROUNDS {
            tracks = track_all(&found.model);
            self.enough(keyframe, &tracks)?;
            found = rigid_consensus(geometry, &tracks, found.model, self.settings.min_inlier_px)
                .ok_or_else(|| tracks.no_agreement(keyframe, 0, f64::NAN))?;
        }
        let agree = found.count();
        if agree < self.settings.min_points
            || 2 * agree < tracks.expected(keyframe)
            || found.median_px > self.settings.max_median_residual_px
        {
            return Err(tracks.no_agreement(keyframe, agree, found.median_px));
        }
        Ok(accepted(keyframe.active, tracks, &found))
    }

    /// Finds displacement and rotation about z roughly.
    ///
    /// The displacement is searched in the image of the reference camera, which is turned back by
    /// one angle after another. Rotations about x and y change the image less, so that the search
    /// needs no prior for them.
    ///
    /// # Errors
    /// [`FlowRefusal::Lost`] if no angle explains the images, or the refusal at the first angle
    /// that does.
    fn rough_pose(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
    ) -> Result<Estimate, FlowRefusal> {
        let geometry = matcher.geometry;
        let level = self.temporal_level();
        let reference = geometry.reference;
        let mut lost = FlowRefusal::Lost { zncc: 0.0 };
        for step in 0..=2 * TURNS {
            // 0, 1, -1, 2, -2 ...
            let turn =
                f64::from(step.div_ceil(2)) * if step % 2 == 1 { TURN_DEG } else { -TURN_DEG };
            let turned;
            let mut now = matcher.now.to_vec();
            if step > 0 {
                turned = turned_back(geometry, matcher.now[reference], turn.to_radians());
                now[reference] = &turned;
            }
            let matcher = TemporalMatcher {
                now: &now,
                ..*matcher
            };
            let coarse = ZnccPlane::new(&now[reference].levels[level]);
            let [width, _] = coarse.size();
            let search = DisplacementSearch {
                geometry,
                before: keyframe.coarse,
                now: &coarse,
                scale: (1 << level) as f64,
                range: (self.settings.search_range * width as f64).ceil() as usize,
                thread_pool: &self.thread_pool,
            };
            match self.rough_displacement(keyframe, &matcher, &search) {
                Ok(moved) => return Ok(about_axis(geometry, turn.to_radians(), moved)),
                Err(FlowRefusal::Lost { zncc }) if step == 0 => lost = FlowRefusal::Lost { zncc },
                Err(FlowRefusal::Lost { .. }) => {}
                Err(refusal) => return Err(refusal),
            }
        }
        Err(lost)
    }

    /// Refuses too few tracks.
    fn enough(&self, keyframe: &ActiveKeyframe<'_>, tracks: &Tracks) -> Result<(), FlowRefusal> {
        let (followed, least) = (tracks.points.len(), self.settings.min_points);
        if followed >= least {
            return Ok(());
        }
        Err(FlowRefusal::FewTracks {
            followed,
            matched: keyframe.matches.len(),
            least,
        })
    }
}

/// Returns the pose of a displacement that is then turned about the axis of the reference camera.
fn about_axis(geometry: &RigGeometry, radians: f64, moved_mm: [f64; 3]) -> Estimate {
    let [x, y] = geometry.rig.cameras[geometry.reference].offset_mm;
    let pivot = [x - moved_mm[0], y - moved_mm[1], -moved_mm[2]];
    Estimate::exact([0.0, 0.0, (0.5 * radians).tan()], pivot, moved_mm)
}

/// Returns the pyramid of the reference camera, turned back about its axis. Places that the image
/// does not show are as its border.
fn turned_back(geometry: &RigGeometry, pyramid: &Pyramid, radians: f64) -> Pyramid {
    let (sine, cosine) = radians.sin_cos();
    let k = geometry.reference;
    let mut turned = pyramid.clone();
    // Displacements are not searched at full resolution.
    for (level, (plane, from)) in turned
        .levels
        .iter_mut()
        .zip(&pyramid.levels)
        .enumerate()
        .skip(1)
    {
        let scale = f64::from(1u32 << level);
        for row in 0..from.height {
            for column in 0..from.width {
                let pixel = [column as f64 * scale, row as f64 * scale];
                let [x, y] = geometry.normalise(k, pixel);
                let place = [cosine * x - sine * y, sine * x + cosine * y];
                let place = geometry.pixel(k, place).map(|p| (p / scale) as f32);
                plane.grey[row * from.stride + column] = from.between(place);
            }
            let last = plane.grey[row * from.stride + from.width - 1];
            plane.grey[row * from.stride + from.width..(row + 1) * from.stride].fill(last);
        }
    }
    turned
}

/// Returns the measurement of the inliers, with the inflated covariance.
fn accepted(active: &ActiveCameras, tracks: Tracks, found: &RigidConsensus) -> PoseMeasurement {
    let geometry = &active.geometry;
    let mut rejected = tracks.rejected;
    for _ in found.outliers_of(&tracks.points) {
        rejected.add(Reject::Outlier);
    }
    let inliers = found.inliers_of(tracks.points);
    let inflation = VarianceInflation::of_residuals(geometry, &inliers, 6.0, |inlier| {
        let observed = Observation::new(&geometry.arms, &inlier.views)?;
        let [alpha, beta, rho] = observed.start;
        let expected = found.model.moved(&geometry.arms, observed.start)?;
        let arms = geometry.arms.arms_mm().iter().zip(&inlier.views);
        let residual = move |(arm, view): (&[f64; 2], &View)| {
            let flow = view.flow();
            let start = [alpha - arm[0] * rho, beta - arm[1] * rho];
            let end = [
                expected[0] - arm[0] * expected[2],
                expected[1] - arm[1] * expected[2],
            ];
            [0, 1].map(|axis| flow[axis] - (end[axis] - start[axis]))
        };
        Some(arms.map(residual))
    });
    PoseMeasurement {
        pose: found.model.inflated(inflation.of_windows),
        correspondences: inliers,
        cameras: active.cameras.clone(),
        refused_cameras: Vec::new(),
        rejected,
    }
}

/// Points that were tracked, and the numbers of those that were not.
struct Tracks {
    points: Vec<Correspondence>,
    rejected: RejectCounts,
}

impl Tracks {
    fn of(keyframe: &ActiveKeyframe<'_>, all: Vec<Result<Correspondence, Reject>>) -> Self {
        let mut tracks = Self {
            points: Vec::with_capacity(all.len()),
            rejected: keyframe.rejected,
        };
        for point in all {
            match point {
                Ok(point) => tracks.points.push(point),
                Err(reason) => tracks.rejected.add(reason),
            }
        }
        tracks
    }

    fn observed(&self, geometry: &RigGeometry) -> Vec<Observation> {
        let observe = |point: &Correspondence| Observation::new(&geometry.arms, &point.views);
        self.points.iter().filter_map(observe).collect()
    }

    /// Returns the number of matched points that are in view now.
    fn expected(&self, keyframe: &ActiveKeyframe<'_>) -> usize {
        let before = keyframe.rejected.of(Reject::OutOfView);
        keyframe.matches.len() - (self.rejected.of(Reject::OutOfView) - before)
    }

    fn no_agreement(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        agree: usize,
        median_px: f64,
    ) -> FlowRefusal {
        FlowRefusal::NoAgreement {
            agree,
            expected: self.expected(keyframe),
            median_px,
        }
    }
}

#[cfg(test)]
mod tests;
