//! A chessboard in front of a rig, drawn from the camera models alone.

use std::path::Path;

use trinocular_core::rig::{Camera, Rig, Rotation};
use trinocular_rig::random::Random;
use trinocular_vision::images::{Image, folder};

/// Side of a square of the board, mm.
pub const SQUARE_MM: f64 = 18.0;
/// Inner corners of the board, columns and rows.
pub const CORNERS: [usize; 2] = [9, 6];
/// Standard deviation of the image noise, grey levels.
const NOISE_GREY: f64 = 2.0;
/// Samples per pixel and axis.
const SAMPLES: usize = 2;

/// Returns three cameras that were meant to be parallel and are not. Their optical axes are level
/// on average.
pub fn crooked_rig() -> Rig {
    let camera = |focal_px, principal_px, x, degrees| Camera {
        focal_px,
        principal_px,
        offset_mm: [x, 0.0],
        distortion: [-0.12, 0.05, 4e-4, -6e-4, 0.0],
        rational: [0.0; 3],
        rotation: Rotation::from_degrees(degrees),
    };
    Rig {
        image_size_px: [480, 360],
        cameras: [
            camera([602.0, 600.0], [233.0, 184.0], -70.0, [1.0, -1.4, 1.2]),
            camera([597.0, 596.0], [246.0, 177.0], 0.0, [-0.4, 0.3, -1.6]),
            camera([605.0, 603.0], [241.0, 186.0], 68.0, [-0.6, 1.1, 0.9]),
        ]
        .into_iter()
        .collect(),
    }
}

/// Pose of the board: its middle, and its rotation about x, y and z.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    pub middle_mm: [f64; 3],
    pub turn_deg: [f64; 3],
}

impl Pose {
    /// Returns one of many different poses in front of the rig.
    pub fn number(index: u64) -> Self {
        let mut random = Random::new(index, 100);
        let mut within = |reach: f64| random.between(-reach, reach);
        Self {
            middle_mm: [within(25.0), within(60.0), 560.0 + within(60.0)],
            turn_deg: [within(32.0), within(32.0), within(25.0)],
        }
    }
}

/// The directions in which a camera's pixels look.
pub struct Eye {
    offset_mm: [f64; 2],
    size_px: [usize; 2],
    rays: Vec<[f64; 2]>,
}

impl Eye {
    pub fn new(camera: &Camera, size_px: [u32; 2]) -> Self {
        let [width, height] = size_px.map(|side| side as usize * SAMPLES);
        let place = |i: usize| (i as f64 + 0.5) / SAMPLES as f64 - 0.5;
        let rays =
            (0..width * height).map(|i| camera.normalise([place(i % width), place(i / width)]));
        Self {
            offset_mm: camera.offset_mm,
            size_px: size_px.map(|side| side as usize),
            rays: rays.collect(),
        }
    }

    /// Renders the board as the camera sees it.
    pub fn view(&self, pose: &Pose, seed: u64) -> Image {
        let mut random = Random::new(seed, 0);
        let [right, down, ahead] = axes(pose.turn_deg);
        let [cx, cy] = self.offset_mm;
        let way = [
            pose.middle_mm[0] - cx,
            pose.middle_mm[1] - cy,
            pose.middle_mm[2],
        ];
        let [width, height] = self.size_px;
        let mut sums = vec![0.0; width * height];
        for (i, &[x, y]) in self.rays.iter().enumerate() {
            let ray = [x, y, 1.0];
            let far = dot(ahead, way) / dot(ahead, ray);
            let u = far * dot(right, ray) - dot(right, way);
            let v = far * dot(down, ray) - dot(down, way);
            let (column, row) = (
                i % (width * SAMPLES) / SAMPLES,
                i / (width * SAMPLES) / SAMPLES,
            );
            sums[row * width + column] += grey(u, v);
        }
        let level = |sum: f64| {
            let grey = sum / (SAMPLES * SAMPLES) as f64 + NOISE_GREY * random.gaussian();
            grey.round().clamp(0.0, 255.0) as u8
        };
        Image {
            width,
            height,
            grey: sums.into_iter().map(level).collect(),
        }
    }
}

/// Returns the grey level of the board at an offset from its middle, mm: black outside the first
/// corner, a white border one square wide, then a desk. Every edge is as soft as a lens makes it.
fn grey(u: f64, v: f64) -> f64 {
    const SOFT_MM: f64 = 0.9;
    let sides = CORNERS.map(|n| n as f64 + 1.0);
    let place = [
        u / SQUARE_MM + sides[0] / 2.0,
        v / SQUARE_MM + sides[1] / 2.0,
    ];
    // `wave` alternates between -1 and 1 at whole numbers; `step` goes from 0 to 1 where a distance
    // becomes positive.
    let wave = |a: f64| {
        let sign = if a.round() % 2.0 == 0.0 { 1.0 } else { -1.0 };
        sign * ((a - a.round()) * SQUARE_MM / SOFT_MM).tanh()
    };
    let inside = |border: f64| {
        let step = |squares: f64| 0.5 + 0.5 * (squares * SQUARE_MM / SOFT_MM).tanh();
        let along = |i: usize| step(place[i] + border) * step(sides[i] + border - place[i]);
        along(0) * along(1)
    };
    let squares = 125.0 - 90.0 * wave(place[0]) * wave(place[1]);
    let paper = 215.0 + inside(0.0) * (squares - 215.0);
    90.0 + inside(1.0) * (paper - 90.0)
}

/// Returns the board's right, down and away directions along the rig's axes.
fn axes(turn_deg: [f64; 3]) -> [[f64; 3]; 3] {
    let rows = Rotation::from_degrees(turn_deg).rows();
    [0, 1, 2].map(|axis| rows.map(|row| row[axis]))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Writes images of the board at `count` instants by the cameras called `names` into `dir`.
pub fn photograph(dir: &Path, rig: &Rig, names: &[&str], count: u64) {
    for ((name, camera), number) in names.iter().zip(&rig.cameras).zip(0..) {
        let eye = Eye::new(camera, rig.image_size_px);
        std::fs::create_dir_all(dir.join(name)).expect("the folder can be made");
        for instant in 0..count {
            let view = eye.view(&Pose::number(instant), 1000 * number + instant);
            folder::write(&dir.join(name).join(format!("{instant:02}.png")), &view)
                .expect("written");
        }
    }
}
