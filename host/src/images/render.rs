//! What the cameras see of a poster: rendered from the camera models alone, so that tests know the
//! truth.
//!
//! A ray leaves camera `k` at `C = (cx, cy, 0)` along `d = (xi, eta, 1)` and meets the poster's
//! plane through `O` with normal `n` where
//!
//! ```text
//! t = n . (O - C) / n . d        point = C + t d        (u, v) = in-plane coordinates of point - O
//! ```
//!
//! The grey level there comes from a copy of the poster blurred once, on the poster, by the lens
//! and by the pixel's own area as they are at the scene's depth. The blur is symmetric, so it moves
//! nothing; that it does not grow with depth or tilt is the renderer's one approximation, and is
//! why scenes are near their depth.

mod blur;

use std::thread;

use shared::rig::{Camera, Rig, Rotation};

use super::spline::{self, Surface};
use super::{FrameSet, Image, Texture};
use crate::random::Random;

/// How a poster hangs before the cameras and how the cameras take it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneSettings {
    /// Distance of the poster's origin from the cameras' plane at zero displacement, mm.
    pub depth_mm: f64,
    /// Rotation of the poster, rad: first about x (positive moves its lower half nearer), then
    /// about y (positive moves its right half nearer).
    pub tilt_rad: [f64; 2],
    /// Standard deviation of the lens's point spread, px.
    pub blur_px: f64,
    /// Standard deviation of the sensor's noise, grey levels.
    pub noise_grey: f64,
}

impl Default for SceneSettings {
    /// The paper's bench: 850 mm away, parallel to the cameras; a usual lens and sensor.
    fn default() -> Self {
        Self {
            depth_mm: 850.0,
            tilt_rad: [0.0, 0.0],
            blur_px: 0.7,
            noise_grey: 2.0,
        }
    }
}

/// Where the poster is, against where it hung at first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Displacement of its origin, mm: right, down, away as seen from the cameras.
    pub relative_mm: [f64; 3],
    /// How it is turned about its origin: axis times angle, degrees, right-handed about the
    /// cameras' axes.
    pub turned_deg: [f64; 3],
}

impl Pose {
    /// Displaced, not turned.
    pub fn at(relative_mm: [f64; 3]) -> Self {
        Self {
            relative_mm,
            ..Self::default()
        }
    }
}

/// What one camera does with one picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Where the poster is when the shutter opens and when it closes. It goes evenly from one to
    /// the other.
    pub poses: [Pose; 2],
    /// What the light is multiplied with, before the sensor's noise.
    pub gain: f64,
    /// What is added to it, grey levels.
    pub offset_grey: f64,
    /// Standard deviation of the sensor's noise, grey levels.
    pub noise_grey: f64,
}

impl Shot {
    /// Of a poster at rest, in the light it was drawn in.
    pub fn of(pose: Pose, noise_grey: f64) -> Self {
        Self {
            poses: [pose; 2],
            gain: 1.0,
            offset_grey: 0.0,
            noise_grey,
        }
    }
}

/// Instants whose pictures make one of a moving poster: a smear of 10 px is then even to a pixel.
const INSTANTS: u32 = 10;

/// Why a scene cannot be rendered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// Depth, blur or noise is not a number in its range.
    #[error("{name} is {value}, must be {range}")]
    OutOfRange {
        /// Field at fault.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        range: &'static str,
    },
    /// The texture has no texels, or not as many as its size says.
    #[error("texture of {width} x {height} texels has {texels}")]
    Texture {
        /// Columns it claims.
        width: usize,
        /// Rows it claims.
        height: usize,
        /// Texels it has.
        texels: usize,
    },
}

/// A poster before a rig, ready to be photographed.
#[derive(Clone, Debug)]
pub struct Scene {
    settings: SceneSettings,
    size_px: [usize; 2],
    eyes: Vec<Eye>,
    surface: Surface,
    texels_per_mm: f64,
    /// Texel coordinates of the middle of the texture, and of the poster's origin.
    middle_texel: [f64; 2],
    origin_texel: [f64; 2],
    /// Rows: the poster's u, v and normal in the cameras' axes.
    axes: [[f64; 3]; 3],
}

/// One camera and the rays of its pixels.
#[derive(Clone, Debug)]
struct Eye {
    offset_mm: [f64; 2],
    rays: Vec<[f64; 2]>,
}

impl Eye {
    fn new(camera: &Camera, [width, height]: [usize; 2]) -> Self {
        let ray = |i: usize| camera.normalise([(i % width) as f64, (i / width) as f64]);
        Self {
            offset_mm: camera.offset_mm,
            rays: (0..width * height).map(ray).collect(),
        }
    }
}

impl Scene {
    /// Hangs `texture` before `rig`. Blurs the texture and finds the ray of every pixel, once.
    pub fn new(rig: &Rig, texture: &Texture, settings: SceneSettings) -> Result<Self, SceneError> {
        check(texture, &settings)?;
        let texels_per_mm = texture.mm_per_texel.recip();
        let texels_per_px = settings.depth_mm / rig.mean_focal_px() * texels_per_mm;
        // A pixel gathers light over its square, of variance 1/12; the spline adds its own share of
        // blur.
        let variance = (settings.blur_px.powi(2) + 1.0 / 12.0) * texels_per_px.powi(2);
        let sigma = (variance - spline::VARIANCE).max(0.0).sqrt();
        let blurred = blur::gaussian(texture.width, texture.height, &texture.grey, sigma);
        let size_px = rig.image_size_px.map(|s| s as usize);
        let middle_texel = [texture.width, texture.height].map(|n| (n as f64 - 1.0) / 2.0);
        Ok(Self {
            settings,
            size_px,
            eyes: rig.cameras.iter().map(|c| Eye::new(c, size_px)).collect(),
            surface: Surface::new(texture.width, texture.height, &blurred),
            texels_per_mm,
            middle_texel,
            origin_texel: middle_texel,
            axes: axes(settings.tilt_rad),
        })
    }

    /// What it was made with.
    pub fn settings(&self) -> &SceneSettings {
        &self.settings
    }

    /// Moves the poster within its plane until this point of it, mm from the middle of the texture,
    /// is its origin.
    pub fn look_at(&mut self, poster_mm: [f64; 2]) {
        let middle = self.middle_texel;
        self.origin_texel = [0, 1].map(|i| middle[i] + poster_mm[i] * self.texels_per_mm);
    }

    /// The poster's point `(u, v)` mm from its origin in the cameras' axes, mm, when displaced by
    /// `relative_mm`.
    pub fn point_mm(&self, poster_mm: [f64; 2], relative_mm: [f64; 3]) -> [f64; 3] {
        let origin = self.origin_mm(relative_mm);
        std::array::from_fn(|i| {
            origin[i] + poster_mm[0] * self.axes[0][i] + poster_mm[1] * self.axes[1][i]
        })
    }

    /// The views of all cameras when the poster is displaced by `relative_mm` (right, down, away)
    /// as seen from the cameras. Noise depends on `seed` and the camera alone. Pixels that do not
    /// see the poster are black.
    pub fn render(&self, relative_mm: [f64; 3], time_us: u64, seed: u64) -> FrameSet {
        let shot = Shot::of(Pose::at(relative_mm), self.settings.noise_grey);
        let views = thread::scope(|scope| {
            let view = |(index, eye)| {
                let random = Random::new(seed, index as u64);
                scope.spawn(move || self.expose(eye, &shot, random))
            };
            let working: Vec<_> = self.eyes.iter().enumerate().map(view).collect();
            let join = |worker: thread::ScopedJoinHandle<'_, Image>| match worker.join() {
                Ok(image) => image,
                Err(panic) => std::panic::resume_unwind(panic),
            };
            working.into_iter().map(join).collect()
        });
        FrameSet {
            time_us,
            images: views,
        }
    }

    /// The views of all cameras, each with its own shot; [`Scene::render`] with everything that can
    /// be varied.
    pub fn shoot(&self, shots: &[Shot], time_us: u64, seed: u64) -> FrameSet {
        let eyes = self.eyes.iter().zip(shots).enumerate();
        let view = |(index, (eye, shot)): (usize, (&Eye, &Shot))| {
            self.expose(eye, shot, Random::new(seed, index as u64))
        };
        FrameSet {
            time_us,
            images: eyes.map(view).collect(),
        }
    }

    fn expose(&self, eye: &Eye, shot: &Shot, mut random: Random) -> Image {
        let seen = |level: Option<f64>| match level {
            // The cast clamps to 0..=255.
            Some(grey) if shot.noise_grey > 0.0 => {
                let lit = shot.gain * grey + shot.offset_grey;
                (lit + shot.noise_grey * random.gaussian()).round() as u8
            }
            Some(grey) => (shot.gain * grey + shot.offset_grey).round() as u8,
            None => 0,
        };
        let [open, close] = shot.poses;
        let grey = if open == close {
            self.levels(eye, open).map(seen).collect()
        } else {
            self.smeared(eye, open, close)
                .into_iter()
                .map(seen)
                .collect()
        };
        Image {
            width: self.size_px[0],
            height: self.size_px[1],
            grey,
        }
    }

    /// The mean of the levels at instants evenly spread over an exposure.
    fn smeared(&self, eye: &Eye, open: Pose, close: Pose) -> Vec<Option<f64>> {
        let mut sums = vec![Some(0.0); eye.rays.len()];
        for instant in 0..INSTANTS {
            let share = (f64::from(instant) + 0.5) / f64::from(INSTANTS);
            let between =
                |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] + share * (b[i] - a[i]));
            let pose = Pose {
                relative_mm: between(open.relative_mm, close.relative_mm),
                turned_deg: between(open.turned_deg, close.turned_deg),
            };
            for (sum, level) in sums.iter_mut().zip(self.levels(eye, pose)) {
                *sum = sum.zip(level).map(|(a, b)| a + b / f64::from(INSTANTS));
            }
        }
        sums
    }

    /// The exact grey level of every pixel, or none where it does not see the poster.
    fn levels(&self, eye: &Eye, pose: Pose) -> impl Iterator<Item = Option<f64>> {
        let turn = Rotation::from_degrees(pose.turned_deg).rows();
        let axes = (self.axes).map(|axis| turn.map(|row| dot(row, axis)));
        let [u, v, normal] = axes;
        let origin = self.origin_mm(pose.relative_mm);
        // From the camera to the poster's origin, along the poster's own axes.
        let [cx, cy] = eye.offset_mm;
        let way = [origin[0] - cx, origin[1] - cy, origin[2]];
        let [way_u, way_v, distance] = axes.map(|axis| dot(axis, way));
        eye.rays.iter().map(move |&[x, y]| {
            let ray = [x, y, 1.0];
            let along = distance / dot(normal, ray);
            if !(along > 0.0 && along.is_finite()) {
                return None;
            }
            let column = self.texel(0, along * dot(u, ray) - way_u);
            let row = self.texel(1, along * dot(v, ray) - way_v);
            Some(f64::from(self.surface.at(column, row)))
        })
    }

    fn texel(&self, axis: usize, poster_mm: f64) -> f64 {
        poster_mm * self.texels_per_mm + self.origin_texel[axis]
    }

    fn origin_mm(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        [x, y, self.settings.depth_mm + z]
    }
}

fn check(texture: &Texture, settings: &SceneSettings) -> Result<(), SceneError> {
    let (width, height, texels) = (texture.width, texture.height, texture.grey.len());
    if texels == 0 || width.checked_mul(height) != Some(texels) {
        return Err(SceneError::Texture {
            width,
            height,
            texels,
        });
    }
    let tilt = settings.tilt_rad;
    for (name, value, low, high, range) in [
        ("depth_mm", settings.depth_mm, 1.0, 1e5, "1 to 100000"),
        ("tilt_rad[0]", tilt[0], -1.2, 1.2, "-1.2 to 1.2"),
        ("tilt_rad[1]", tilt[1], -1.2, 1.2, "-1.2 to 1.2"),
        ("blur_px", settings.blur_px, 0.0, 20.0, "0 to 20"),
        ("noise_grey", settings.noise_grey, 0.0, 128.0, "0 to 128"),
        (
            "mm_per_texel",
            texture.mm_per_texel,
            1e-3,
            1e3,
            "0.001 to 1000",
        ),
    ] {
        if !(low..=high).contains(&value) {
            return Err(SceneError::OutOfRange { name, value, range });
        }
    }
    Ok(())
}

/// Images of the unit vectors under the rotation about x, then about y: the poster's right, down
/// and away.
fn axes([about_x, about_y]: [f64; 2]) -> [[f64; 3]; 3] {
    let ((sx, cx), (sy, cy)) = (about_x.sin_cos(), about_y.sin_cos());
    [
        [cy, 0.0, -sy],
        [-sx * sy, cx, -sx * cy],
        [cx * sy, sx, cx * cy],
    ]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests;
