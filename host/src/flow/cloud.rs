//! Points as the flow would find them, without pictures: what tests of the judgement on points
//! start from.

use crate::matching::geometry::Geometry;
use crate::random::Random;
use shared::rig::Rig;
use shared::sums::View;

/// Points on a poster 850 mm before the paper's rig, seen twice.
pub struct Cloud {
    pub geometry: Geometry,
    /// Where the poster was met, mm.
    pub places: Vec<[f64; 3]>,
    /// Of the windows in the middle camera, px.
    pub centres_px: Vec<[f64; 2]>,
}

impl Cloud {
    /// Every 10 px over what all cameras see: windows overlap about fourfold.
    pub fn new() -> Self {
        let geometry = Geometry::new(&Rig::paper()).unwrap();
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

    /// The views when each point goes where `motion` of the camera's number and its place says, and
    /// is seen with errors `noise_px` of camera and point.
    pub fn views(
        &self,
        motion: impl Fn(usize, [f64; 3]) -> [f64; 3],
        mut noise_px: impl FnMut(usize, usize) -> [f64; 2],
    ) -> Vec<Vec<View>> {
        let views = self.places.iter().enumerate().map(|(i, place)| {
            let view = |(k, camera): (usize, &shared::rig::Camera)| {
                let (start, end) = (camera.project(*place), camera.project(motion(k, *place)));
                let noise = noise_px(k, i);
                View::from_pixels(camera, start, [end[0] + noise[0], end[1] + noise[1]])
            };
            self.geometry
                .rig
                .cameras
                .iter()
                .enumerate()
                .map(view)
                .collect()
        });
        views.collect()
    }
}

/// Noise that knows nothing of its neighbours.
pub fn independent(sigma_px: f64, seed: u64) -> impl FnMut(usize, usize) -> [f64; 2] {
    let mut random = Random::seeded(seed);
    move |_, _| [(); 2].map(|()| sigma_px * random.gaussian())
}
