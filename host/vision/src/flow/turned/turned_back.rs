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

    /// Returns the pyramid turned back, up to `level`. Places that the image does not show are as
    /// its border.
    pub(super) fn pyramid(&self, pyramid: &FramePyramid, level: usize) -> FramePyramid {
        let mut turned = pyramid.clone();
        let size = self.geometry.rig.image_size_px;
        let nodes = Nodes::of(self, size.map(|side| side as usize));
        // Displacements are not searched at full resolution.
        let planes = turned.coarse_mut().iter_mut().zip(pyramid.coarse());
        for (level, (plane, from)) in (1..=level).zip(planes) {
            let scale = (1 << level) as f32;
            let mut places = vec![[0.0; 2]; from.width];
            for row in 0..from.height {
                nodes.places(row << level, 1 << level, &mut places);
                let out = &mut plane.grey[row * from.stride..][..from.stride];
                let (inside, beyond) = out.split_at_mut(from.width);
                for (grey, [x, y]) in inside.iter_mut().zip(&places) {
                    *grey = from.between([x / scale, y / scale]);
                }
                beyond.fill(inside[inside.len() - 1]);
            }
        }
        turned
    }
}

/// Distance of two nodes, px: places between them are off by less than half a pixel, at tilts of
/// up to 40 degrees.
const NODE_PX: usize = 16;

/// Places of a grid of pixels of the image turned back, px. Between them the places are linear. The
/// last nodes are the last pixels: a lens is known within the image only.
struct Nodes {
    columns: usize,
    last: [usize; 2],
    places: Vec<[f32; 2]>,
}

impl Nodes {
    fn of(turned_back: &TurnedBack<'_>, size_px: [usize; 2]) -> Self {
        let last = size_px.map(|side| side.saturating_sub(1));
        let [columns, rows] = last.map(|last| last / NODE_PX + 2);
        let node = |index: usize| {
            let node = [index % columns, index / columns];
            let pixel = [0, 1].map(|axis| (node[axis] * NODE_PX).min(last[axis]) as f64);
            turned_back.pixel(pixel).map(|place| place as f32)
        };
        Self {
            columns,
            last,
            places: (0..columns * rows).map(node).collect(),
        }
    }

    /// Fills `places` with the places of every `step`-th pixel of a row of the image.
    fn places(&self, row: usize, step: usize, places: &mut [[f32; 2]]) {
        // Share of the way from the node before a pixel to the one behind it.
        let share = |pixel: usize, last: usize| {
            let way = (last - pixel / NODE_PX * NODE_PX).clamp(1, NODE_PX);
            (pixel % NODE_PX) as f32 / way as f32
        };
        let between = |a: [f32; 2], b: [f32; 2], t: f32| [0, 1].map(|i| a[i] + t * (b[i] - a[i]));
        let above = &self.places[row / NODE_PX * self.columns..][..2 * self.columns];
        let (above, below) = above.split_at(self.columns);
        let down = share(row, self.last[1]);
        for (index, place) in places.iter_mut().enumerate() {
            let column = index * step;
            let node = column / NODE_PX;
            let at = |n: usize| between(above[n], below[n], down);
            *place = between(at(node), at(node + 1), share(column, self.last[0]));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_core::rig::Rig;

    #[test]
    fn places_between_nodes_are_near_the_exact_ones() {
        let mut rig = Rig::paper();
        let k = RigGeometry::new(&rig).unwrap().reference;
        let lens = [-0.2, 0.05, 1e-3, -1e-3, 0.0];
        for (distortion, size_px) in [([0.0; 5], [320, 240]), (lens, [313, 225])] {
            rig.cameras[k].distortion = distortion;
            rig.image_size_px = size_px.map(|side| side as u32);
            let geometry = RigGeometry::new(&rig).unwrap();
            for axis in 0..3 {
                let mut omega = [0.0; 3];
                omega[axis] = 20.0_f64.to_radians().tan();
                let pose = Estimate::exact(omega, [0.0, 0.0, 850.0], [0.0; 3]);
                let surface = Surface::frontal(1.0 / 850.0);
                let turned_back = TurnedBack::new(&geometry, surface, &pose);
                let nodes = Nodes::of(&turned_back, size_px);
                let mut places = vec![[0.0; 2]; size_px[0]];
                for row in (0..size_px[1]).step_by(7) {
                    nodes.places(row, 1, &mut places);
                    for (column, place) in places.iter().enumerate() {
                        let exact = turned_back.pixel([column as f64, row as f64]);
                        let off = [0, 1].map(|i| (f64::from(place[i]) - exact[i]).abs());
                        assert!(off.iter().all(|px| *px < 0.5), "{column} {row}: {off:?}");
                    }
                }
            }
        }
    }
}
