//! Where images come from: folders of files, live cameras, and rendered scenes. Each source yields
//! timestamped captures, one view per camera in the rig's order.

pub mod cameras;
pub mod decode;
pub mod folder;
pub mod render;
mod spline;
pub mod texture;

pub use folder::Folder;
pub use render::{Pose, Scene, SceneError, SceneSettings, Shot};
pub use texture::{Texture, TextureKind};

/// An 8-bit grey image, rows top to bottom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` grey levels, row by row.
    pub grey: Vec<u8>,
}

impl Image {
    /// What stands for the view of a camera that gave none.
    pub const fn missing() -> Self {
        Self {
            width: 0,
            height: 0,
            grey: Vec::new(),
        }
    }

    /// Whether there is no picture.
    pub const fn is_missing(&self) -> bool {
        self.width == 0 && self.height == 0
    }
}

/// The views of all cameras at one instant.
#[derive(Clone, Debug)]
pub struct FrameSet {
    /// When the shutters opened, microseconds on the source's own clock.
    pub time_us: u64,
    /// One image per camera, in the rig's order; [`Image::missing`] from a camera that gave none.
    pub images: Vec<Image>,
}
