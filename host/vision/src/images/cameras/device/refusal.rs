//! Errors of a device, each with a way out.

use std::io;
use std::path::Path;

use rustix::io::Errno;

use crate::images::cameras::grey::Format;
use trinocular_rig::error::InputError;

/// Returns the error of a device that cannot be opened or is in use.
pub fn cannot_open(path: &Path, cause: &io::Error) -> InputError {
    let advice = match cause.kind() {
        io::ErrorKind::NotFound => {
            "no such camera: plug it in; `ls /dev/video*` shows the cameras there are, `v4l2-ctl \
             --list-devices` which is which"
        }
        io::ErrorKind::PermissionDenied => {
            "may not be used: join the group that owns it (`sudo usermod -aG video $USER`, then \
             log in anew)"
        }
        io::ErrorKind::ResourceBusy => "in use: close the other program that shows its images",
        _ => {
            return InputError::file(
                path,
                format!("no V4L2 camera: {cause}; `v4l2-ctl --list-devices` shows those there are"),
            );
        }
    };
    InputError::file(path, advice)
}

/// Returns the error of a camera that does not start.
pub fn cannot_start(path: &Path, cause: &io::Error) -> InputError {
    match cause.kind() {
        // Two programs may open a camera, but only one may set it up.
        io::ErrorKind::ResourceBusy => cannot_open(path, cause),
        io::ErrorKind::StorageFull => {
            let reason = "its USB line is full: put the cameras on USB controllers of their own, \
                          or lower --fps";
            InputError::file(path, reason)
        }
        _ => InputError::io(path, "start", cause),
    }
}

/// Returns the error of a camera that has stopped streaming.
pub fn lost(path: &Path, cause: &io::Error) -> InputError {
    match Errno::from_io_error(cause) {
        Some(Errno::NODEV) => {
            InputError::file(path, "was unplugged: plug it in again, and start anew")
        }
        _ => InputError::io(path, "take an image", cause),
    }
}

/// Returns the error of a camera without a supported format.
pub fn no_format(path: &Path, offered: &[[u8; 4]]) -> InputError {
    let list = |names: Vec<String>| names.join(" ");
    let known = list(Format::ALL.map(|format| name(format.fourcc())).to_vec());
    let reason = match offered {
        [] => "captures no video: many cameras have a second device for data about the images, \
               take the first"
            .to_owned(),
        offered => format!(
            "none of its formats is known here: it has {}, known are {known}",
            list(offered.iter().copied().map(name).collect())
        ),
    };
    InputError::file(path, reason)
}

/// Returns the error of a camera without images of the rig's size.
pub fn no_size(path: &Path, wanted_px: [u32; 2], nearest_px: [u32; 2]) -> InputError {
    let ([width, height], [nearest_width, nearest_height]) = (wanted_px, nearest_px);
    let reason = format!(
        "has no images of {width} x {height} px, as the rig file says; the nearest are \
         {nearest_width} x {nearest_height}: calibrate the rig with images of \
         a size the camera has (`v4l2-ctl -d {} --list-formats-ext` lists them)",
        path.display()
    );
    InputError::file(path, reason)
}

/// Returns the error of a camera that gives another format than the one that was set.
pub fn other_format(path: &Path, wanted: [u8; 4], given: [u8; 4]) -> InputError {
    InputError::file(path, format!("gives {} for {}", name(given), name(wanted)))
}

fn name(fourcc: [u8; 4]) -> String {
    fourcc.escape_ascii().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refusals_name_device_and_way_out() {
        let device = Path::new("/dev/video0");
        let denied = cannot_open(device, &io::ErrorKind::PermissionDenied.into());
        assert!(denied.reason.contains("group"), "{denied}");
        let busy = cannot_open(device, &io::ErrorKind::ResourceBusy.into());
        assert!(busy.reason.contains("other program"), "{busy}");
        assert_eq!(
            cannot_start(device, &io::ErrorKind::ResourceBusy.into()),
            busy
        );
        let full = cannot_start(device, &Errno::NOSPC.into());
        assert!(full.reason.contains("USB"), "{full}");
        let unplugged = lost(device, &Errno::NODEV.into());
        assert!(
            unplugged.to_string().starts_with("/dev/video0: was unplug"),
            "{unplugged}"
        );
        let other = lost(device, &Errno::IO.into());
        assert!(other.reason.starts_with("cannot take an image"), "{other}");
        let size = no_size(device, [640, 480], [320, 240]).reason;
        assert!(size.contains("640 x 480") && size.contains("320 x 240"));
    }

    #[test]
    fn unknown_formats_are_listed() {
        let device = Path::new("/dev/video0");
        let text = no_format(device, &[*b"H264", *b"BA81"]).reason;
        assert!(text.contains("it has H264 BA81, known are GREY YUYV"));
        assert!(no_format(device, &[]).reason.contains("take the first"));
        let other = other_format(device, *b"GREY", *b"Y8\0 ").reason;
        assert_eq!(other, "gives Y8\\x00  for GREY");
    }
}
