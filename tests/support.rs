//! Modules that the tests in this folder share.

pub mod binary;
pub mod chase;
pub mod emulator;
pub mod far_end;
pub mod points;
pub mod replaying;
