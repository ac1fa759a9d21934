//! The image of the reference camera, as if the target had not turned since the keyframe.

use super::predictor::Surface;
use crate::matching::geometry::RigGeometry;
use crate::matching::pyramid::FramePyramid;
use nalgebra::{Matrix3, RowVector3, Vector3};
use trinocular_core::estimate::pose::Estimate;

/// Places of an image turned back in the image as it is.
///
/// A pose moves the points of a plane by a homography of the image, without approximation. For a
/// rotation about the camera's axis it is the same for every plane.
#[derive(Clone, Copy)]
pub(super) struct TurnedBack<'a> {
    geometry: &'a RigGeometry,
    /// Normalised position before to that now.
    homography: Matrix3<f64>,
}

impl<'a> TurnedBack<'a> {
    /// Turns back what `pose` has done to the target's plane at the keyframe.
    ///
    /// A point on the plane at the normalised position `ξ` has the inverse depth `ρ = ν·ξ`, so that
    /// the camera at the arm `a` sees it at `(R + (R a + t - a) ν) ξ` after the pose `(R, t)`.
    pub(super) fn new(geometry: &'a RigGeometry, surface: Surface, pose: &Estimate) -> Self {
        let k = geometry.reference;
        let arm = geometry.arms.arms_mm()[k];
        let [x, y] = geometry.rig.cameras[k].offset_mm;
        // What the pose does to the point in the camera's place: R a + t - a.
        let moved = pose.displacement_of([x, y, 0.0]).displacement_mm;
        let rotation = pose.rotation();
        let rotation = Matrix3::from_fn(|i, j| rotation[i][j]);
        let inverse_depth = RowVector3::from(surface.inverse_depth_seen_from(arm));
        Self {
            geometry,
            homography: rotation + Vector3::from(moved) * inverse_depth,
        }
    }

    /// Returns the pixel of the image as it is that the image turned back shows at `pixel`.
    pub(super) fn pixel(&self, pixel: [f64; 2]) -> [f64; 2] {
        let k = self.geometry.reference;
        let [x, y] = self.geometry.normalise(k, pixel);
        let place = self.homography * Vector3::new(x, y, 1.0);
        self.geometry
            .pixel(k, [place.x / place.z, place.y / place.z])
    }

    /// Returns the pyramid turned back. Places that the image does not show are as its border.
    pub(super) fn pyramid(&self, pyramid: &FramePyramid) -> FramePyramid {
        let mut turned = pyramid.clone();
        // Displacements are not searched at full resolution.
        let planes = turned.coarse_mut().iter_mut().zip(pyramid.coarse());
        for (level, (plane, from)) in (1..).zip(planes) {
            let scale = f64::from(1u32 << level);
            for row in 0..from.height {
                for column in 0..from.width {
                    let pixel = [column as f64 * scale, row as f64 * scale];
                    let place = self.pixel(pixel).map(|p| (p / scale) as f32);
                    plane.grey[row * from.stride + column] = from.between(place);
                }
                let last = plane.grey[row * from.stride + from.width - 1];
                plane.grey[row * from.stride + from.width..(row + 1) * from.stride].fill(last);
            }
        }
        turned
    }
}
