//! GenICam cameras by the name `genicam:SERIAL`, set up as the rig file says.

use crate::commands::failure::Failure;
use std::path::Path;
use trinocular_rig::rig_file::{Capture, RigFile, capture};
use trinocular_vision::images::cameras::live::Camera;

/// Returns true if the device is a GenICam camera.
pub fn is_one(device: &Path) -> bool {
    device
        .to_str()
        .is_some_and(|name| name.starts_with(capture::GENICAM))
}

/// Refuses settings that only a GenICam camera has for another device.
pub fn refuse_settings(capture: &Capture, name: &str, rig_path: &Path) -> Result<(), Failure> {
    match capture.genicam_field() {
        None => Ok(()),
        Some(field) => {
            let reason = "only GenICam cameras (genicam:SERIAL) have this setting";
            Err(fault(rig_path, name, field, reason))
        }
    }
}

/// Returns the error of a field of a camera, with its line in the rig file.
pub fn fault(rig_path: &Path, name: &str, field: &str, reason: &str) -> Failure {
    match RigFile::read_with_text(rig_path) {
        Ok((_, text)) => capture::fault(rig_path, &text, name, field, reason).into(),
        Err(error) => error.into(),
    }
}

/// Opens a GenICam camera; returns it with its format.
#[cfg(feature = "genicam")]
pub fn open(
    fps: f64,
    device: &Path,
    name: &str,
    (capture, rig_path): (&Capture, &Path),
    size_px: [u32; 2],
) -> Result<(Box<dyn Camera>, String), Failure> {
    use trinocular_vision::images::cameras::genicam::{Genicam, Refusal};

    let notice = Box::new(super::tell_source(name, device));
    let camera = Genicam::open(device, size_px, fps, capture, notice);
    let camera = camera.map_err(|refusal| match refusal {
        Refusal::Camera(error) => error.into(),
        Refusal::Setting { field, reason } => fault(rig_path, name, field, &reason),
    })?;
    let format = camera.format().name().to_owned();
    Ok((Box::new(camera), format))
}

#[cfg(not(feature = "genicam"))]
pub fn open(
    _: f64,
    device: &Path,
    _: &str,
    _: (&Capture, &Path),
    _: [u32; 2],
) -> Result<(Box<dyn Camera>, String), Failure> {
    let reason = "this program was built without GenICam cameras: install Aravis (Debian: \
                  libaravis-dev libusb-1.0-0-dev) and build it with `cargo build --release \
                  --features trinocular/genicam`";
    Err(trinocular_rig::error::InputError::file(device, reason).into())
}
