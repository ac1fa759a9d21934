//! Rough search of a pose: a displacement in images that are turned about z.

use crate::flow::keyframe::ActiveKeyframe;
use crate::flow::temporal::TemporalMatcher;
use crate::flow::{Flow, FlowRefusal};
use crate::matching::geometry::RigGeometry;
use crate::matching::pyramid::FramePyramid;
use crate::matching::zncc::ZnccPlane;
use trinocular_core::estimate::pose::Estimate;

/// Step of the angles about z that are tried, degrees: the search tolerates half of it.
const TURN_DEG: f64 = 2.0;
/// Number of steps in either direction.
const TURNS: u32 = 10;

/// Pose that explains the images roughly.
pub(super) struct RoughPose {
    /// Displacement, and rotation about the axis of the reference camera.
    pub(super) pose: Estimate,
    /// Angle by which the image of the reference camera was turned back, rad.
    pub(super) turn_rad: f64,
    /// Coarse image of the reference camera, turned back.
    pub(super) coarse: ZnccPlane,
}

impl Flow {
    /// Finds displacement and rotation about z roughly.
    ///
    /// The displacement is searched in the image of the reference camera, which is turned back by
    /// one angle after another. Rotations about x and y change the image less, so that the search
    /// needs no prior for them.
    ///
    /// # Errors
    /// [`FlowRefusal::Lost`] if no angle explains the images, or the refusal at the first angle
    /// that does.
    pub(super) fn rough_pose(
        &self,
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
    ) -> Result<RoughPose, FlowRefusal> {
        let geometry = matcher.geometry;
        let level = self.temporal_level();
        let reference = geometry.reference;
        let mut lost = FlowRefusal::Lost { zncc: 0.0 };
        for step in 0..=2 * TURNS {
            // 0, 1, -1, 2, -2 ...
            let sign = if step % 2 == 1 { 1.0 } else { -1.0 };
            let turn_rad = (sign * TURN_DEG * f64::from(step.div_ceil(2))).to_radians();
            let turned;
            let mut now = matcher.now.to_vec();
            if step > 0 {
                turned = turned_back(geometry, matcher.now[reference], turn_rad);
                now[reference] = &turned;
            }
            let matcher = TemporalMatcher {
                now: &now,
                ..*matcher
            };
            let coarse = ZnccPlane::new(&now[reference].coarse()[level - 1]);
            let search = self.search(keyframe, &coarse);
            match self.rough_displacement(keyframe, &matcher, &search) {
                Ok(moved) => {
                    return Ok(RoughPose {
                        pose: about_axis(geometry, turn_rad, moved),
                        turn_rad,
                        coarse,
                    });
                }
                Err(FlowRefusal::Lost { zncc }) if step == 0 => lost = FlowRefusal::Lost { zncc },
                Err(FlowRefusal::Lost { .. }) => {}
                Err(refusal) => return Err(refusal),
            }
        }
        Err(lost)
    }
}

/// Returns the pose of a displacement that is then turned about the axis of the reference camera.
fn about_axis(geometry: &RigGeometry, radians: f64, moved_mm: [f64; 3]) -> Estimate {
    let [x, y] = geometry.rig.cameras[geometry.reference].offset_mm;
    let pivot = [x - moved_mm[0], y - moved_mm[1], -moved_mm[2]];
    Estimate::exact([0.0, 0.0, (0.5 * radians).tan()], pivot, moved_mm)
}

/// Returns the pixel of the reference camera that the image turned back by `radians` shows at
/// `pixel`.
pub(super) fn turned_pixel(geometry: &RigGeometry, pixel: [f64; 2], radians: f64) -> [f64; 2] {
    let (sine, cosine) = radians.sin_cos();
    let k = geometry.reference;
    let [x, y] = geometry.normalise(k, pixel);
    geometry.pixel(k, [cosine * x - sine * y, sine * x + cosine * y])
}

/// Returns the pyramid of the reference camera, turned back about its axis. Places that the image
/// does not show are as its border.
fn turned_back(geometry: &RigGeometry, pyramid: &FramePyramid, radians: f64) -> FramePyramid {
    let mut turned = pyramid.clone();
    // Displacements are not searched at full resolution.
    let planes = turned.coarse_mut().iter_mut().zip(pyramid.coarse());
    for (level, (plane, from)) in (1..).zip(planes) {
        let scale = f64::from(1u32 << level);
        for row in 0..from.height {
            for column in 0..from.width {
                let pixel = [column as f64 * scale, row as f64 * scale];
                let place = turned_pixel(geometry, pixel, radians).map(|p| (p / scale) as f32);
                plane.grey[row * from.stride + column] = from.between(place);
            }
            let last = plane.grey[row * from.stride + from.width - 1];
            plane.grey[row * from.stride + from.width..(row + 1) * from.stride].fill(last);
        }
    }
    turned
}
