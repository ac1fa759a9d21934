//! Where images come from: folders of files, live cameras, and rendered scenes. Each source yields timestamped
//! captures, one view per camera in the rig's order.

pub mod cameras;
pub mod folder;
pub mod render;
mod spline;
pub mod texture;

pub use folder::Folder;
pub use render::{Scene, SceneError, SceneSettings};
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

/// The views of all cameras at one instant.
#[derive(Clone, Debug)]
pub struct Capture {
    /// When the shutters opened, microseconds on the source's own clock.
    pub time_us: u64,
    /// One image per camera, in the rig's order.
    pub views: Vec<Image>,
}
