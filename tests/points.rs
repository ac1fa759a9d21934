//! Random point sets seen by a rig before and after a displacement, with optional pixel noise.

use trinocular_core::rig::{Camera, Rig};
use trinocular_core::sums::View;
use trinocular_core::sums::centred::CentredSums;
use trinocular_core::sums::pair::PairSums;
use trinocular_rig::random::Random;

/// Returns a rig of ideal cameras with one focal length and the principal point at the origin.
pub fn ideal_rig(focal_px: f64, offsets_mm: &[[f64; 2]]) -> Rig {
    let camera = |offset: &[f64; 2]| Camera::ideal([focal_px; 2], [0.0; 2], *offset);
    Rig {
        image_size_px: [320, 240],
        cameras: offsets_mm.iter().map(camera).collect(),
    }
}

/// A cloud of points in front of a rig, and its motion.
#[derive(Clone, Debug)]
pub struct Cloud {
    /// Depth of the nearest and of the farthest point, mm.
    pub depth_mm: [f64; 2],
    /// Largest direction from the axis, per axis: |X/Z|, |Y/Z|.
    pub field: [f64; 2],
    /// Number of points.
    pub points: usize,
    /// Displacement, mm.
    pub displacement_mm: [f64; 3],
    /// Standard deviation of each pixel coordinate, px.
    pub noise_px: f64,
}

impl Cloud {
    /// Returns the normalised image positions of every point in every camera.
    pub fn views(&self, rig: &Rig, random: &mut Random) -> Vec<Vec<View>> {
        (0..self.points).map(|_| self.point(rig, random)).collect()
    }

    fn point(&self, rig: &Rig, random: &mut Random) -> Vec<View> {
        let z = random.between(self.depth_mm[0], self.depth_mm[1]);
        let x = z * random.between(-self.field[0], self.field[0]);
        let y = z * random.between(-self.field[1], self.field[1]);
        let start = [x, y, z];
        let end = std::array::from_fn(|i| start[i] + self.displacement_mm[i]);
        let mut seen = |camera: &Camera, point: [f64; 3]| {
            let pixel = camera.project(point);
            if self.noise_px == 0.0 {
                return pixel;
            }
            pixel.map(|p| p + self.noise_px * random.gaussian())
        };
        rig.cameras
            .iter()
            .map(|camera| View::from_pixels(camera, seen(camera, start), seen(camera, end)))
            .collect()
    }
}

/// Returns the midpoint's sums over `views`.
pub fn centred(rig: &Rig, views: &[Vec<View>]) -> CentredSums {
    let mut sums = CentredSums::new(rig).expect("a rig of two cameras or more");
    for point in views {
        assert!(sums.add(point), "every point is in front of the cameras");
    }
    sums
}

/// Returns the paper's sums over `views`.
pub fn pairs(rig: &Rig, views: &[Vec<View>]) -> PairSums {
    let mut sums = PairSums::new(rig).expect("three cameras in a line");
    for point in views {
        sums.add([point[0], point[1], point[2]]);
    }
    sums
}
