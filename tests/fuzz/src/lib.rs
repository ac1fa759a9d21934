//! Parts of the fuzz targets. `tests/fuzz/run` builds and runs them.

pub mod command;
pub mod edit;
pub mod law;
pub mod life;
pub mod picture;
pub mod stack;
