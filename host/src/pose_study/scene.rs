//! Targets 850 mm in front of the paper's rig, and their motion.

use nalgebra::{Rotation3, Vector3};
use trinocular_core::rig::{Camera, Rig};
use trinocular_core::sums::View;
use trinocular_rig::random::Random;

/// Focal length of all cameras, px.
pub const FOCAL_PX: f64 = 530.0;
/// Positions of the cameras along x, mm.
const CAMERAS_MM: [f64; 3] = [-70.0, 0.0, 68.0];
/// Middle of the targets at the keyframe, mm.
pub const PIVOT_MM: [f64; 3] = [0.0, 0.0, 850.0];
/// Displacement of the middle, mm.
pub const MOVED_MM: [f64; 3] = [12.0, -8.0, 10.0];

/// Shape of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Name in the table.
    pub name: &'static str,
    /// Width, height and depth, mm.
    pub size_mm: [f64; 3],
}

/// The targets of the study: flat, deep, and as large as the picture.
pub const TARGETS: [Target; 3] = [
    Target {
        name: "poster",
        size_mm: [200.0, 150.0, 0.0],
    },
    Target {
        name: "relief",
        size_mm: [200.0, 150.0, 200.0],
    },
    Target {
        name: "wide",
        size_mm: [340.0, 250.0, 500.0],
    },
];

/// Returns the rig of the study.
pub fn rig() -> Rig {
    let camera = |x: &f64| Camera::ideal([FOCAL_PX; 2], [159.5, 119.5], [*x, 0.0]);
    Rig {
        image_size_px: [320, 240],
        cameras: CAMERAS_MM.iter().map(camera).collect(),
    }
}

/// Motion of a rigid target about [`PIVOT_MM`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Rotation.
    pub rotation: Rotation3<f64>,
    /// Displacement of the pivot, mm.
    pub moved_mm: Vector3<f64>,
}

impl Motion {
    /// Creates a rotation by `degrees` about a slanted axis, with the displacement [`MOVED_MM`].
    pub fn slanted(degrees: f64) -> Self {
        let axis = Vector3::new(1.0, 1.0, 1.0).normalize();
        Self {
            rotation: Rotation3::new(axis * degrees.to_radians()),
            moved_mm: MOVED_MM.into(),
        }
    }

    /// Returns where a point goes, mm.
    pub fn apply(&self, at: [f64; 3]) -> [f64; 3] {
        let pivot = Vector3::from(PIVOT_MM);
        (pivot + self.moved_mm + self.rotation * (Vector3::from(at) - pivot)).into()
    }
}

/// Returns random points of the target, mm.
pub fn points(target: &Target, count: usize, random: &mut Random) -> Vec<[f64; 3]> {
    let mut point =
        || std::array::from_fn(|i| PIVOT_MM[i] + target.size_mm[i] * random.between(-0.5, 0.5));
    (0..count).map(|_| point()).collect()
}

/// Returns the views of a point that moves, with noise of `noise_px` in every coordinate.
pub fn views(
    rig: &Rig,
    motion: &Motion,
    at: [f64; 3],
    noise_px: f64,
    random: &mut Random,
) -> Vec<View> {
    let mut seen = |camera: &Camera, at: [f64; 3]| {
        camera
            .project(at)
            .map(|px| px + noise_px * random.gaussian())
    };
    let cameras = rig.cameras.iter();
    cameras
        .map(|camera| {
            let (start, end) = (seen(camera, at), seen(camera, motion.apply(at)));
            View::from_pixels(camera, start, end)
        })
        .collect()
}
