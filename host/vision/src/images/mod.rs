//! Sources of images: folders of files, live cameras, and rendered scenes. Each source yields
//! [`FrameSet`]s: one image per camera, in the rig's order, with their capture time.
//!
//! # Example
//!
//! Two frame sets of a rendered poster that moves by 5 mm to the right:
//!
//! ```
//! use trinocular_core::rig::Rig;
//! use trinocular_vision::images::{Scene, SceneSettings, Texture};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let rig = Rig::paper();
//! let scene = Scene::new(&rig, &Texture::natural(1), SceneSettings::default())?;
//! let before = scene.render([0.0, 0.0, 0.0], 0, 1);
//! let now = scene.render([5.0, 0.0, 0.0], 33_333, 2);
//! assert_eq!(before.images.len(), rig.cameras.len());
//! assert_ne!(before.images, now.images);
//! # Ok(())
//! # }
//! ```

pub mod cameras;
pub mod decode;
pub mod exposure;
pub mod folder;
pub mod read_ahead;
pub mod rectangle;
pub mod render;
pub mod series;
mod spline;
pub mod texture;
mod tiff_directory;

pub use folder::Folder;
pub use render::{Exposure, Pose, Scene, SceneError, SceneSettings};
pub use texture::{Texture, TextureKind};

/// 8-bit grey image, rows from top to bottom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// `width * height` grey levels, row by row.
    pub grey: Vec<u8>,
}

impl Image {
    /// Returns the placeholder for a camera that gave no image.
    pub const fn missing() -> Self {
        Self {
            width: 0,
            height: 0,
            grey: Vec::new(),
        }
    }

    /// Returns true for the placeholder of [`Image::missing`].
    pub const fn is_missing(&self) -> bool {
        self.width == 0 && self.height == 0
    }
}

/// Images of all cameras at one instant.
#[derive(Clone, Debug)]
pub struct FrameSet {
    /// Capture time: when the shutters opened, µs on the source's own clock.
    pub time_us: u64,
    /// One image per camera, in the rig's order; [`Image::missing`] for a camera that gave none.
    pub images: Vec<Image>,
}
