//! Rough search of a pose: a displacement in images that are turned back by a pose.

use super::pivot::centroid_mm;
use super::predictor::Surface;
use super::turned_back::TurnedBack;
use crate::flow::keyframe::ActiveKeyframe;
use crate::flow::temporal::TemporalMatcher;
use crate::flow::{Flow, FlowRefusal};
use crate::matching::geometry::RigGeometry;
use crate::matching::stereo::StereoMatch;
use crate::matching::zncc::ZnccPlane;
use trinocular_core::estimate::pose::Estimate;

/// Step of the angles about z that are tried, degrees: the search tolerates half of it.
const TURN_DEG: f64 = 2.0;
/// Number of steps in either direction.
const TURNS: u32 = 10;
/// The same from the last pose.
const TURNS_SINCE_LAST: u32 = 5;

/// Angle of the rotations about x and y that are tried, degrees: the search tolerates some 12 to
/// either side.
const TILT_DEG: f64 = 16.0;

/// Pose that explains the images roughly.
pub(super) struct RoughPose {
    /// Displacement and rotation.
    pub(super) pose: Estimate,
    /// Pose by which the image of the reference camera was turned back; `None` if it was not.
    pub(super) turned_back: Option<Estimate>,
    /// Coarse image of the reference camera, turned back.
    pub(super) coarse: ZnccPlane,
}

impl Flow {
    /// Finds displacement and rotation roughly, from nothing.
    ///
    /// The displacement is searched in the image of the reference camera, which is turned back by
    /// one angle about z after another. Rotations about x and y change the image less, so that only
    /// large ones are tried, and last.
    ///
    /// # Errors
    /// [`FlowRefusal::Lost`] if no rotation explains the images, or the refusal at the first one
    /// that does.
    pub(super) fn rough_pose(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
        surface: Surface,
    ) -> Result<RoughPose, FlowRefusal> {
        let geometry = matcher.geometry;
        let turned = |rad| (rad != 0.0).then(|| about_axis(geometry, rad));
        let tilted = tilts(geometry, keyframe.matches).map(Some);
        let starts = angles_rad(TURNS).map(turned).chain(tilted);
        first_explained(starts, |start| {
            self.rough_pose_after(keyframe, matcher, surface, start)
        })
    }

    /// Finds displacement and rotation about z roughly since the pose `last`, which was measured
    /// against the same keyframe.
    ///
    /// # Errors
    /// As [`Flow::rough_pose`].
    pub(super) fn rough_pose_near(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
        surface: Surface,
        last: Estimate,
    ) -> Result<RoughPose, FlowRefusal> {
        let camera = camera_mm(matcher.geometry);
        let turned = |rad| Some(last.followed_by(about_z(rad), camera));
        first_explained(angles_rad(TURNS_SINCE_LAST).map(turned), |start| {
            self.rough_pose_after(keyframe, matcher, surface, start)
        })
    }

    /// Finds the pose that consists of a displacement and then the pose `turned`, if there is one.
    ///
    /// # Errors
    /// [`FlowRefusal::Lost`] if no displacement explains the images,
    /// [`FlowRefusal::AmbiguousMotion`] if several do.
    fn rough_pose_after(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
        surface: Surface,
        turned: Option<Estimate>,
    ) -> Result<RoughPose, FlowRefusal> {
        let geometry = matcher.geometry;
        let reference = geometry.reference;
        let level = self.temporal_level();
        let back = turned.map(|pose| {
            TurnedBack::new(geometry, surface, &pose).pyramid(matcher.now[reference], level)
        });
        let mut now = matcher.now.to_vec();
        if let Some(back) = &back {
            now[reference] = back;
        }
        let matcher = TemporalMatcher {
            now: &now,
            ..*matcher
        };
        let coarse = ZnccPlane::new(&now[reference].coarse()[level - 1]);
        let search = self.search(keyframe, &coarse);
        // On finer levels, the rotations between those that are tried take points too far away.
        let finest = self.refined_level();
        let moved_mm = self.rough_displacement(keyframe, &matcher, &search, finest)?;
        Ok(RoughPose {
            pose: turned
                .unwrap_or_else(|| about_axis(geometry, 0.0))
                .preceded_by(moved_mm),
            turned_back: turned,
            coarse,
        })
    }
}

/// Tries poses until one explains the images. The likeness of a refusal is that of the first one.
fn first_explained(
    starts: impl Iterator<Item = Option<Estimate>>,
    mut rough: impl FnMut(Option<Estimate>) -> Result<RoughPose, FlowRefusal>,
) -> Result<RoughPose, FlowRefusal> {
    let mut lost = None;
    for start in starts {
        match rough(start) {
            Err(refusal @ FlowRefusal::Lost { .. }) => lost = lost.or(Some(refusal)),
            found => return found,
        }
    }
    Err(lost.unwrap_or(FlowRefusal::Lost { zncc: 0.0 }))
}

/// Returns the angles 0, 1, -1, 2, -2 and so on, in steps of the search, rad.
fn angles_rad(turns: u32) -> impl Iterator<Item = f64> {
    (0..=2 * turns).map(|step| {
        let sign = if step % 2 == 1 { 1.0 } else { -1.0 };
        (sign * TURN_DEG * f64::from(step.div_ceil(2))).to_radians()
    })
}

/// Returns rotations about x and y, about the centroid of the points.
fn tilts(geometry: &RigGeometry, matches: &[StereoMatch]) -> impl Iterator<Item = Estimate> {
    let pivot_mm = centroid_mm(geometry, matches);
    let half = (0.5 * TILT_DEG).to_radians().tan();
    let axes = [
        [half, 0.0, 0.0],
        [-half, 0.0, 0.0],
        [0.0, half, 0.0],
        [0.0, -half, 0.0],
    ];
    (axes.into_iter()).map(move |omega| Estimate::exact(omega, pivot_mm, [0.0; 3]))
}

/// Returns the place of the reference camera, mm.
fn camera_mm(geometry: &RigGeometry) -> [f64; 3] {
    let [x, y] = geometry.rig.cameras[geometry.reference].offset_mm;
    [x, y, 0.0]
}

/// Returns the Cayley vector of a rotation about z.
fn about_z(radians: f64) -> [f64; 3] {
    [0.0, 0.0, (0.5 * radians).tan()]
}

/// Returns the rotation about the axis of the reference camera.
fn about_axis(geometry: &RigGeometry, radians: f64) -> Estimate {
    Estimate::exact(about_z(radians), camera_mm(geometry), [0.0; 3])
}
