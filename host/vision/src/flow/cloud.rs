//! Synthetic correspondences for tests: points as the flow would find them, without images.

use super::Correspondence;
use crate::matching::geometry::RigGeometry;
use trinocular_core::rig::{Camera, Rig};
use trinocular_rig::random::Random;

/// Points on a poster 850 mm in front of the paper's rig.
pub struct Cloud {
    pub geometry: RigGeometry,
    /// Places of the points at the keyframe, mm.
    pub places: Vec<[f64; 3]>,
    /// Window centres in the middle camera, px.
    pub centres_px: Vec<[f64; 2]>,
}

impl Cloud {
    /// Creates a point every 10 px of the common field of view: windows overlap about fourfold.
    pub fn new() -> Self {
        let geometry = RigGeometry::new(&Rig::paper()).unwrap();
        let camera = geometry.rig.cameras[1];
        let centres = (0..20 * 18).map(|i| {
            [
                60.0 + 10.0 * f64::from(i % 20),
                30.0 + 10.0 * f64::from(i / 20),
            ]
        });
        let centres_px: Vec<[f64; 2]> = centres.collect();
        let place = |px: &[f64; 2]| {
            let [x, y] = camera.normalise(*px);
            [850.0 * x, 850.0 * y, 850.0]
        };
        Self {
            places: centres_px.iter().map(place).collect(),
            geometry,
            centres_px,
        }
    }

    /// Returns correspondences of points that move by `motion` of camera index and place, with
    /// errors `noise_px` of camera and point.
    pub fn points(
        &self,
        motion: impl Fn(usize, [f64; 3]) -> [f64; 3],
        mut noise_px: impl FnMut(usize, usize) -> [f64; 2],
    ) -> Vec<Correspondence> {
        let rig = &self.geometry.rig;
        let points = self.places.iter().enumerate().map(|(i, place)| {
            let seen = |(k, camera): (usize, &Camera)| {
                let (start, end) = (camera.project(*place), camera.project(motion(k, *place)));
                let noise = noise_px(k, i);
                [start, [end[0] + noise[0], end[1] + noise[1]]]
            };
            let pixels = rig.cameras.iter().enumerate().map(seen);
            Correspondence::from_pixels(rig, pixels.collect())
        });
        points.collect()
    }
}

/// Returns noise that is independent between points and cameras.
pub fn independent(sigma_px: f64, seed: u64) -> impl FnMut(usize, usize) -> [f64; 2] {
    let mut random = Random::seeded(seed);
    move |_, _| [(); 2].map(|()| sigma_px * random.gaussian())
}
