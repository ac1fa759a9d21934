//! Random targets that a rig sees before and after a rotation and a displacement.

use nalgebra::{Rotation3, Vector3};
use trinocular_core::estimate::pose::Observation;
use trinocular_core::rig::Rig;
use trinocular_core::sums::View;
use trinocular_core::sums::centred::Geometry;
use trinocular_rig::random::Random;
use trinocular_tests::points::ideal_rig;

/// Focal length, px.
pub const FOCAL_PX: f64 = 530.0;
/// Positions of the cameras of the paper's rig, mm.
pub const LINE: [[f64; 2]; 3] = [[-70.0, 0.0], [0.0, 0.0], [68.0, 0.0]];
/// Centre of the targets, mm.
pub const PIVOT_MM: [f64; 3] = [10.0, -5.0, 850.0];

/// Shape of a target: half its width, height and depth, mm.
pub const POSTER: [f64; 3] = [100.0, 75.0, 0.0];
/// A target as deep as it is wide.
pub const RELIEF: [f64; 3] = [100.0, 75.0, 100.0];

/// A rig, the target's points at the keyframe, and their motion about [`PIVOT_MM`].
pub struct Scene {
    pub rig: Rig,
    pub geometry: Geometry,
    pub points_mm: Vec<[f64; 3]>,
    pub displacement_mm: [f64; 3],
    pub rotation_rad: [f64; 3],
}

impl Scene {
    pub fn new(
        cameras_mm: &[[f64; 2]],
        shape_mm: [f64; 3],
        count: usize,
        random: &mut Random,
    ) -> Self {
        let mut point =
            || std::array::from_fn(|i| PIVOT_MM[i] + shape_mm[i] * random.between(-1.0, 1.0));
        let points_mm = (0..count).map(|_| point()).collect();
        let rig = ideal_rig(FOCAL_PX, cameras_mm);
        Self {
            geometry: Geometry::new(&rig).expect("a rig of two cameras or more"),
            rig,
            points_mm,
            displacement_mm: [0.0; 3],
            rotation_rad: [0.0; 3],
        }
    }

    pub fn moved(mut self, displacement_mm: [f64; 3], axis: [f64; 3], degrees: f64) -> Self {
        self.displacement_mm = displacement_mm;
        let axis = Vector3::from(axis).normalize();
        self.rotation_rad = (axis * degrees.to_radians()).into();
        self
    }

    pub fn rotation(&self) -> Rotation3<f64> {
        Rotation3::new(self.rotation_rad.into())
    }

    /// Returns where a point of the target goes, mm.
    pub fn after(&self, at: [f64; 3]) -> [f64; 3] {
        let pivot = Vector3::from(PIVOT_MM);
        let turned = self.rotation() * (Vector3::from(at) - pivot);
        (pivot + Vector3::from(self.displacement_mm) + turned).into()
    }

    /// Returns the views of all points; `noise` gives the errors, px, of one camera's four numbers.
    pub fn views(&self, mut noise: impl FnMut() -> [f64; 4]) -> Vec<Vec<View>> {
        let mut view = |camera: &trinocular_core::rig::Camera, at: [f64; 3]| {
            let [x0, y0] = camera.project(at);
            let [x1, y1] = camera.project(self.after(at));
            let off = noise();
            View::from_pixels(
                camera,
                [x0 + off[0], y0 + off[1]],
                [x1 + off[2], y1 + off[3]],
            )
        };
        let points = self.points_mm.iter();
        points
            .map(|at| {
                self.rig
                    .cameras
                    .iter()
                    .map(|camera| view(camera, *at))
                    .collect()
            })
            .collect()
    }

    pub fn observe(&self, noise: impl FnMut() -> [f64; 4]) -> Vec<Observation> {
        let views = self.views(noise);
        let points = views.iter();
        points
            .map(|views| Observation::new(&self.geometry, views).expect("a point in front"))
            .collect()
    }

    /// Observations with independent noise of `sigma_px` in every coordinate.
    pub fn noisy(&self, sigma_px: f64, random: &mut Random) -> Vec<Observation> {
        self.observe(|| std::array::from_fn(|_| sigma_px * random.gaussian()))
    }

    pub fn exact(&self) -> Vec<Observation> {
        self.observe(|| [0.0; 4])
    }
}
