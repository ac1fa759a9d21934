//! Matching of image windows: pyramids, corners and their places in other images.

pub mod corner;
mod epipolar;
pub mod geometry;
pub mod lucas_kanade;
pub mod pyramid;
pub mod stereo;
pub mod zncc;
