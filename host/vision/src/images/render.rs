//! Renderer of posters as the cameras of a rig see them, so that tests know the true motion.
//!
//! A ray leaves camera `k` at `C = (cx, cy, 0)` along `d = (xi, eta, 1)` and meets the poster's
//! plane through `O` with normal `n` where
//!
//! ```text
//! t = n . (O - C) / n . d        point = C + t d        (u, v) = in-plane coordinates of point - O
//! ```
//!
//! The grey level there comes from a copy of the poster that is blurred once, on the poster, by the
//! lens and by the pixel's own area as they are at the scene's depth. The blur is symmetric, so it
//! shifts nothing. It does not grow with depth or tilt, which is the renderer's one approximation:
//! scenes must stay near their depth.

mod blur;

use std::thread;

use trinocular_core::rig::{Camera, Rig, Rotation};

use super::spline::{self, Surface};
use super::{FrameSet, Image, Texture};
use trinocular_rig::random::Random;

/// Placement of a poster in front of the cameras, with blur and noise of the cameras.
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
    /// Returns the paper's bench: 850 mm away, parallel to the cameras; a usual lens and sensor.
    fn default() -> Self {
        Self {
            depth_mm: 850.0,
            tilt_rad: [0.0, 0.0],
            blur_px: 0.7,
            noise_grey: 2.0,
        }
    }
}

/// Pose of the poster, relative to its first one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Displacement of its origin, mm: right, down, away as seen from the cameras.
    pub relative_mm: [f64; 3],
    /// Rotation about its origin: axis times angle, degrees, right-handed about the cameras'
    /// axes.
    pub turned_deg: [f64; 3],
}

impl Pose {
    /// Creates the pose of a displaced poster that is not rotated.
    pub fn at(relative_mm: [f64; 3]) -> Self {
        Self {
            relative_mm,
            ..Self::default()
        }
    }
}

/// Exposure of one image by one camera: motion, light and noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Poses of the poster when the shutter opens and when it closes. It moves evenly between
    /// them.
    pub poses: [Pose; 2],
    /// Factor of the light, before the sensor's noise.
    pub gain: f64,
    /// Offset of the light, grey levels.
    pub offset_grey: f64,
    /// Standard deviation of the sensor's noise, grey levels.
    pub noise_grey: f64,
}

impl Exposure {
    /// Creates the exposure of a poster at rest in unchanged light.
    pub fn of(pose: Pose, noise_grey: f64) -> Self {
        Self {
            poses: [pose; 2],
            gain: 1.0,
            offset_grey: 0.0,
            noise_grey,
        }
    }
}

/// Number of instants that are averaged for a moving poster: a smear of 10 px is then even to a
/// pixel.
const INSTANTS: u32 = 10;

/// Reason why a scene cannot be rendered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// Depth, blur or noise is out of its range.
    #[error("{name} is {value}, must be {range}")]
    OutOfRange {
        /// Name of the field.
        name: &'static str,
        /// Value of the field.
        value: f64,
        /// Range of the field.
        range: &'static str,
    },
    /// The texture has no texels, or not as many as its size says.
    #[error("texture of {width} x {height} texels has {texels}")]
    Texture {
        /// Columns stated.
        width: usize,
        /// Rows stated.
        height: usize,
        /// Texels found.
        texels: usize,
    },
}

/// Poster in front of a rig, ready to render.
#[derive(Clone, Debug)]
pub struct Scene {
    settings: SceneSettings,
    size_px: [usize; 2],
    cameras: Vec<RayTable>,
    surface: Surface,
    texels_per_mm: f64,
    /// Texel coordinates of the middle of the texture, and of the poster's origin.
    middle_texel: [f64; 2],
    origin_texel: [f64; 2],
    /// Axes in rows: the poster's u, v and normal in the cameras' axes.
    axes: [[f64; 3]; 3],
}

/// Camera with the rays of its pixels.
#[derive(Clone, Debug)]
struct RayTable {
    offset_mm: [f64; 2],
    rays: Vec<[f64; 2]>,
}

impl RayTable {
    fn new(camera: &Camera, [width, height]: [usize; 2]) -> Self {
        let ray = |i: usize| camera.normalise([(i % width) as f64, (i / width) as f64]);
        Self {
            offset_mm: camera.offset_mm,
            rays: (0..width * height).map(ray).collect(),
        }
    }
}

impl Scene {
    /// Places `texture` in front of `rig`. Blurs the texture and computes the ray of every pixel,
    /// once.
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
            cameras: rig
                .cameras
                .iter()
                .map(|c| RayTable::new(c, size_px))
                .collect(),
            surface: Surface::new(texture.width, texture.height, &blurred),
            texels_per_mm,
            middle_texel,
            origin_texel: middle_texel,
            axes: axes(settings.tilt_rad),
        })
    }

    /// Returns the number of cameras.
    pub fn cameras(&self) -> usize {
        self.cameras.len()
    }

    /// Returns the settings of the scene.
    pub fn settings(&self) -> &SceneSettings {
        &self.settings
    }

    /// Moves the poster within its plane so that this point, mm from the middle of the texture,
    /// becomes its origin.
    pub fn look_at(&mut self, poster_mm: [f64; 2]) {
        let middle = self.middle_texel;
        self.origin_texel = [0, 1].map(|i| middle[i] + poster_mm[i] * self.texels_per_mm);
    }

    /// Converts the poster's point `(u, v)`, mm from its origin, to the cameras' axes, mm, for a
    /// poster displaced by `relative_mm`.
    pub fn point_mm(&self, poster_mm: [f64; 2], relative_mm: [f64; 3]) -> [f64; 3] {
        let origin = self.origin_mm(relative_mm);
        std::array::from_fn(|i| {
            origin[i] + poster_mm[0] * self.axes[0][i] + poster_mm[1] * self.axes[1][i]
        })
    }

    /// Renders the images of all cameras for a poster displaced by `relative_mm` (right, down, away
    /// as seen from the cameras). Noise depends only on `seed` and the camera. Pixels that do not
    /// see the poster are black.
    pub fn render(&self, relative_mm: [f64; 3], time_us: u64, seed: u64) -> FrameSet {
        let exposure = Exposure::of(Pose::at(relative_mm), self.settings.noise_grey);
        let views = thread::scope(|scope| {
            let view = |(index, camera)| {
                let random = Random::new(seed, index as u64);
                scope.spawn(move || self.expose(camera, &exposure, random))
            };
            let working: Vec<_> = self.cameras.iter().enumerate().map(view).collect();
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

    /// Renders the images of all cameras, each with its own exposure. See [`Scene::render`].
    pub fn render_exposures(&self, exposures: &[Exposure], time_us: u64, seed: u64) -> FrameSet {
        let cameras = self.cameras.iter().zip(exposures).enumerate();
        let view = |(index, (camera, exposure)): (usize, (&RayTable, &Exposure))| {
            self.expose(camera, exposure, Random::new(seed, index as u64))
        };
        FrameSet {
            time_us,
            images: cameras.map(view).collect(),
        }
    }

    fn expose(&self, camera: &RayTable, exposure: &Exposure, mut random: Random) -> Image {
        let seen = |level: Option<f64>| match level {
            // The cast clamps to 0..=255.
            Some(grey) if exposure.noise_grey > 0.0 => {
                let lit = exposure.gain * grey + exposure.offset_grey;
                (lit + exposure.noise_grey * random.gaussian()).round() as u8
            }
            Some(grey) => (exposure.gain * grey + exposure.offset_grey).round() as u8,
            None => 0,
        };
        let [open, close] = exposure.poses;
        let grey = if open == close {
            self.levels(camera, open).map(seen).collect()
        } else {
            self.smeared(camera, open, close)
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

    /// Averages the grey levels at instants evenly spread over an exposure.
    fn smeared(&self, camera: &RayTable, open: Pose, close: Pose) -> Vec<Option<f64>> {
        let mut sums = vec![Some(0.0); camera.rays.len()];
        for instant in 0..INSTANTS {
            let share = (f64::from(instant) + 0.5) / f64::from(INSTANTS);
            let between =
                |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] + share * (b[i] - a[i]));
            let pose = Pose {
                relative_mm: between(open.relative_mm, close.relative_mm),
                turned_deg: between(open.turned_deg, close.turned_deg),
            };
            for (sum, level) in sums.iter_mut().zip(self.levels(camera, pose)) {
                *sum = sum.zip(level).map(|(a, b)| a + b / f64::from(INSTANTS));
            }
        }
        sums
    }

    /// Computes the exact grey level of every pixel, or none for a pixel that does not see the
    /// poster.
    fn levels(&self, camera: &RayTable, pose: Pose) -> impl Iterator<Item = Option<f64>> {
        let turn = Rotation::from_degrees(pose.turned_deg).rows();
        let axes = (self.axes).map(|axis| turn.map(|row| dot(row, axis)));
        let [u, v, normal] = axes;
        let origin = self.origin_mm(pose.relative_mm);
        // From the camera to the poster's origin, along the poster's own axes.
        let [cx, cy] = camera.offset_mm;
        let way = [origin[0] - cx, origin[1] - cy, origin[2]];
        let [way_u, way_v, distance] = axes.map(|axis| dot(axis, way));
        camera.rays.iter().map(move |&[x, y]| {
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

/// Returns the images of the unit vectors under the rotation about x, then about y: the poster's
/// right, down and away.
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
