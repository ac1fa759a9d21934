//! Options of the rendered scene, shared by the commands that use the simulator.

use super::failure::Failure;
use clap::Args;
use trinocular_core::rig::Rig;
use trinocular_vision::images::{Scene, SceneError, SceneSettings, Texture, TextureKind};

/// Options of the poster and of its rendered images.
#[derive(Clone, Debug, Args)]
pub struct SceneOptions {
    /// Texture of the poster: natural, notes (on a plain wall), blobs, bricks or grid (the last two
    /// repeat, and are refused)
    #[arg(long, default_value_t = TextureKind::Natural)]
    pub texture: TextureKind,

    /// Seed of poster and noise: the same seed gives the same run
    #[arg(long, default_value_t = 1)]
    pub seed: u64,

    /// Distance of the poster, mm; the measurement does not use it
    #[arg(long, value_name = "MM", default_value_t = SceneSettings::default().depth_mm)]
    depth: f64,

    /// Standard deviation of the sensors' noise, grey levels of 0 to 255
    #[arg(long, value_name = "GREY", default_value_t = SceneSettings::default().noise_grey)]
    noise: f64,

    /// Tilt of the poster about x and y, degrees
    #[arg(
        long,
        value_name = "DEG",
        num_args = 2,
        default_values_t = [0.0, 0.0],
        allow_negative_numbers = true
    )]
    tilt: Vec<f64>,
}

impl SceneOptions {
    /// Returns the settings of the renderer, which checks the values.
    pub fn settings(&self) -> SceneSettings {
        let tilt = |i: usize| self.tilt.get(i).copied().unwrap_or(0.0).to_radians();
        SceneSettings {
            depth_mm: self.depth,
            tilt_rad: [tilt(0), tilt(1)],
            noise_grey: self.noise,
            ..SceneSettings::default()
        }
    }
}

impl SceneOptions {
    /// Renders the poster before the cameras of a rig.
    pub fn scene(&self, rig: &Rig) -> Result<Scene, Failure> {
        let texture = Texture::of_kind(self.texture, self.seed);
        let scene = Scene::new(rig, &texture, self.settings());
        scene.map_err(|error| Failure::Usage(reason(&error)))
    }
}

/// Returns the reason with the names of the options.
pub fn reason(error: &SceneError) -> String {
    let SceneError::OutOfRange { name, value, range } = error else {
        return error.to_string();
    };
    match *name {
        "depth_mm" => format!("--depth is {value} mm, must be {range}"),
        "noise_grey" => format!("--noise is {value} grey levels, must be {range}"),
        "tilt_rad[0]" | "tilt_rad[1]" => {
            let degrees = value.to_degrees();
            format!("--tilt is {degrees:.1} degrees, must be -68.7 to 68.7")
        }
        _ => error.to_string(),
    }
}
