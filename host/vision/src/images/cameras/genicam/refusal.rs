//! Errors of a GenICam camera, each with a way out.

use std::path::Path;

use aravis::glib;
use trinocular_rig::error::InputError;

/// Reason why a camera was not started.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The camera is missing, in use, or does not work.
    Camera(InputError),
    /// The camera does not take the value of a field of the rig file.
    Setting {
        /// Name of the field.
        field: &'static str,
        /// Reason, with the camera's range.
        reason: String,
    },
}

impl From<InputError> for Refusal {
    fn from(error: InputError) -> Self {
        Self::Camera(error)
    }
}

/// Returns the refusal of a field's value.
pub fn setting(field: &'static str, reason: impl Into<String>) -> Refusal {
    let reason = reason.into();
    Refusal::Setting { field, reason }
}

/// Returns the error of a camera that cannot do something.
pub fn cannot(name: &Path, action: &str, cause: &glib::Error) -> InputError {
    InputError::file(name, format!("cannot {action}: {}", cause.message()))
}

/// Returns the error of a camera that another program controls.
pub fn in_use(name: &Path) -> InputError {
    InputError::file(
        name,
        "in use: close the other program that has the camera; after a crash it is free within \
         seconds",
    )
}

/// Returns the error of a camera that is not there; `serials` are those that are.
pub fn not_found(name: &Path, serials: &[String]) -> InputError {
    let there = match serials {
        [] => "none was found".to_owned(),
        _ => format!("found: {}", serials.join(", ")),
    };
    InputError::file(
        name,
        format!(
            "no such GenICam camera: {there}; `trinocular cameras` lists them, and a firewall may \
             keep the answers of GigE cameras away"
        ),
    )
}

/// Returns the error of a camera that has stopped answering.
pub fn lost(name: &Path) -> InputError {
    InputError::file(
        name,
        "does not answer any more: it was unplugged or its network is down; plug it in again, and \
         start anew",
    )
}

/// Returns the error of a camera without images of the rig's size.
pub fn no_size(name: &Path, [width, height]: [u32; 2], largest: [i32; 2]) -> InputError {
    let [largest_width, largest_height] = largest;
    let reason = format!(
        "has no images of {width} x {height} px, as the rig file says; its largest are \
         {largest_width} x {largest_height}: calibrate the rig with images of a size the camera has"
    );
    InputError::file(name, reason)
}

/// Returns the error of a camera without a known pixel format.
pub fn no_format(name: &Path, offered: &[String], known: &[&str]) -> InputError {
    let (offered, known) = (offered.join(" "), known.join(" "));
    let reason = format!("none of its formats is known here: it has {offered}, known are {known}");
    InputError::file(name, reason)
}
