//! Cameras by the name `gstreamer:PIPELINE`.

use crate::commands::failure::Failure;
use std::path::Path;
use trinocular_rig::rig_file::capture::GSTREAMER;
use trinocular_vision::images::cameras::live::Camera;

/// Returns true if the device is a GStreamer pipeline.
pub fn is_one(device: &Path) -> bool {
    let name = device.to_str();
    name.is_some_and(|name| name.starts_with(GSTREAMER))
}

/// Starts a pipeline; returns it with its format.
#[cfg(feature = "gstreamer")]
pub fn open(
    device: &Path,
    name: &str,
    size_px: [u32; 2],
) -> Result<(Box<dyn Camera>, String), Failure> {
    use trinocular_vision::images::cameras::gstreamer::Gstreamer;

    let notice = Box::new(super::tell_source(name, device));
    let camera = Gstreamer::open(device, size_px, notice)?;
    Ok((Box::new(camera), "converted to grey".to_owned()))
}

#[cfg(not(feature = "gstreamer"))]
pub fn open(device: &Path, _: &str, _: [u32; 2]) -> Result<(Box<dyn Camera>, String), Failure> {
    let reason = "this program was built without GStreamer: install it (Debian: \
                  libgstreamer1.0-dev libgstreamer-plugins-base1.0-dev) and build it with `cargo \
                  build --release --features trinocular/gstreamer`";
    Err(trinocular_rig::error::InputError::file(device, reason).into())
}
