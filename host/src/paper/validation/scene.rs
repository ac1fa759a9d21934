//! Random points that all three cameras see, before and after a move.

use serde::Serialize;
use trinocular_core::rig::{Camera, Rig};
use trinocular_core::sums::View;
use trinocular_rig::random::Random;

/// Seed of all sets; the number of the set is the stream.
pub(super) const SEED: u64 = 0x7461_626c_6573_3132;

/// Smallest and largest depth of the points at the keyframe, mm. The paper does not print it; this
/// range gives its tables.
pub const DEPTH_MM: [f64; 2] = [780.0, 1010.0];

/// Columns and rows of every camera's image, px.
pub const IMAGE_PX: [u32; 2] = [320, 240];

/// Returns a rig of three equal cameras with images of 320 by 240 px and focal length `focal_px`,
/// the outer ones `h1_mm` to the left and `h2_mm` to the right of the middle one.
pub fn rig(focal_px: f64, h1_mm: f64, h2_mm: f64) -> Rig {
    let centre = IMAGE_PX.map(|side| 0.5 * (f64::from(side) - 1.0));
    let camera = |x| Camera::ideal([focal_px; 2], centre, [x, 0.0]);
    Rig {
        image_size_px: IMAGE_PX,
        cameras: [-h1_mm, 0.0, h2_mm].into_iter().map(camera).collect(),
    }
}

/// Returns the rig of the paper's section 3: f = 530 px, h1 = 90 mm, h2 = 70 mm.
pub fn section_3_rig() -> Rig {
    rig(530.0, 90.0, 70.0)
}

/// Draws one point, mm: depth uniform over [`DEPTH_MM`], X and Y uniform over the view common to
/// all cameras at that depth both before and after the move.
pub(super) fn point(rig: &Rig, move_mm: [f64; 3], random: &mut Random) -> [f64; 3] {
    let depth = random.between(DEPTH_MM[0], DEPTH_MM[1]);
    let mut at = [0.0, 0.0, depth];
    for axis in 0..2 {
        // The part of the line at this depth that is in view of all cameras at both instants.
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for camera in &rig.cameras {
            for (shift, depth) in [(0.0, depth), (move_mm[axis], depth + move_mm[2])] {
                let edge = |pixel: f64| {
                    let slope = (pixel - camera.principal_px[axis]) / camera.focal_px[axis];
                    slope * depth + camera.offset_mm[axis] - shift
                };
                low = low.max(edge(0.0));
                high = high.min(edge(f64::from(rig.image_size_px[axis]) - 1.0));
            }
        }
        at[axis] = random.between(low, high);
    }
    at
}

/// Returns the three cameras' views of a point that moves, without noise. A rig with fewer cameras
/// leaves views empty.
pub(super) fn views(rig: &Rig, at: [f64; 3], move_mm: [f64; 3]) -> [View; 3] {
    let after: [f64; 3] = std::array::from_fn(|axis| at[axis] + move_mm[axis]);
    let mut views = [View::default(); 3];
    for (view, camera) in views.iter_mut().zip(&rig.cameras) {
        *view = View::from_pixels(camera, camera.project(at), camera.project(after));
    }
    views
}

/// One random set of points, as in the paper's Figs. 3 and 4.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sample {
    /// The points in the camera frame, mm.
    pub points_mm: Vec<[f64; 3]>,
    /// Their images in the left, the middle and the right camera, px from the centre of the top
    /// left pixel.
    pub images_px: [Vec<[f64; 2]>; 3],
}

impl Sample {
    /// Draws 50 points in view of the rig of section 3.
    pub fn draw() -> Self {
        let rig = section_3_rig();
        let mut random = Random::new(SEED, 0);
        let points_mm: Vec<[f64; 3]> = (0..50)
            .map(|_| point(&rig, [0.0; 3], &mut random))
            .collect();
        let images_px = std::array::from_fn(|k| {
            let camera = rig.cameras.get(k);
            let seen = points_mm.iter().filter_map(|at| Some(camera?.project(*at)));
            seen.collect()
        });
        Self {
            points_mm,
            images_px,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_stay_in_every_view() {
        let rig = section_3_rig();
        let mut random = Random::new(3, 0);
        for move_mm in [[20.0, 20.0, 20.0], [-30.0, 15.0, -40.0], [0.0; 3]] {
            for _ in 0..2000 {
                let at = point(&rig, move_mm, &mut random);
                let after = std::array::from_fn(|axis| at[axis] + move_mm[axis]);
                for [x, y] in rig
                    .cameras
                    .iter()
                    .flat_map(|c| [c.project(at), c.project(after)])
                {
                    assert!((-1e-9..=319.0 + 1e-9).contains(&x), "{x}");
                    assert!((-1e-9..=239.0 + 1e-9).contains(&y), "{y}");
                }
            }
        }
    }

    #[test]
    fn sample_is_not_planar() {
        let points = Sample::draw().points_mm;
        let depths = || points.iter().map(|point| point[2]);
        assert_eq!(points.len(), 50);
        assert!(depths().fold(f64::MAX, f64::min) < 800.0);
        assert!(depths().fold(f64::MIN, f64::max) > 990.0);
        assert!(depths().all(|depth| (DEPTH_MM[0]..=DEPTH_MM[1]).contains(&depth)));
    }
}
