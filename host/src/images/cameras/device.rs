//! A V4L2 camera. Linux only, with the feature `camera`.
//!
//! The driver notes when it finished a picture, but `linuxvideo` 0.3 does not hand that on. So a picture's moment is when a thread that waited for it got
//! it: later by the time the scheduler takes, tens of microseconds on a computer that is not overloaded. A picture that was there before anybody
//! waited is [stale](Shot::Stale). What lies between the exposure and the moment (read-out, transfer) is the same for every picture of a camera; the caller
//! subtracts it.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use linuxvideo::format::{PixFormat, PixelFormat};
use linuxvideo::stream::ReadStream;
use linuxvideo::{BufType, Device, Fract};

use super::grey::Format;
use super::live::{Camera, Shot};
use crate::error::InputError;

/// A camera that streams.
pub struct V4l2 {
    path: PathBuf,
    stream: ReadStream,
    format: Format,
    size_px: [usize; 2],
    stride: usize,
}

impl V4l2 {
    /// Opens the camera at `path`, `/dev/video0` for one, with images of `size_px` in the best of its formats that is known here, and starts it.
    /// `frames_per_s` is asked for; some cameras have one rate only, and keep it.
    ///
    /// # Errors
    /// If there is no such camera, it may not be used, or it has no images of this size.
    pub fn open(path: &Path, size_px: [u32; 2], frames_per_s: f64) -> Result<Self, InputError> {
        let device = Device::open(path).map_err(|cause| cannot_open(path, &cause))?;
        let offered: Vec<[u8; 4]> = device
            .formats(BufType::VIDEO_CAPTURE)
            .filter_map(|format| Some(format.ok()?.pixel_format().as_fourcc()))
            .collect();
        let mut known = Format::ALL.into_iter();
        let Some(format) = known.find(|f| offered.contains(&f.fourcc())) else {
            return Err(InputError::file(path, no_format(&offered)));
        };
        // Two programs may open a camera, but only one may set it up.
        let refused = |cause: io::Error| match cause.kind() {
            io::ErrorKind::ResourceBusy => cannot_open(path, &cause),
            _ => InputError::io(path, "start", &cause),
        };
        let [width, height] = size_px;
        let wanted = PixFormat::new(width, height, PixelFormat::from_fourcc(format.fourcc()));
        let capture = device.video_capture(wanted).map_err(refused)?;
        let got = capture.format();
        if [got.width(), got.height()] != size_px {
            let reason = format!(
                "has no images of {width} x {height} px, as the rig file says; the nearest are {} x {}: calibrate the rig with images of a size the camera \
                 has (`v4l2-ctl -d {} --list-formats-ext` lists them)",
                got.width(),
                got.height(),
                path.display()
            );
            return Err(InputError::file(path, reason));
        }
        if got.pixel_format().as_fourcc() != format.fourcc() {
            let reason = format!("gives {} for {}", got.pixel_format(), name(format.fourcc()));
            return Err(InputError::file(path, reason));
        }
        let stride = got.bytes_per_line() as usize;
        let interval = Fract::new(1000, (frames_per_s * 1000.0).round() as u32);
        // A rate that cannot be had is no reason not to look: the pictures bring their own times.
        let _ = capture.set_frame_interval(interval);
        Ok(Self {
            path: path.to_owned(),
            stream: capture.into_stream().map_err(refused)?,
            format,
            size_px: size_px.map(|side| side as usize),
            stride,
        })
    }

    /// How its pixels come.
    pub fn format(&self) -> Format {
        self.format
    }
}

impl Camera for V4l2 {
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    fn shoot(&mut self) -> Result<Shot, InputError> {
        let Self {
            path,
            stream,
            format,
            size_px,
            stride,
        } = self;
        let lost = |cause| InputError::io(path, "take a picture", &cause);
        let is_fresh = stream.will_block().map_err(lost)?;
        let shot = stream.dequeue(|bytes| {
            let at = Instant::now();
            Ok(match format.to_grey(&bytes, *size_px, *stride) {
                _ if bytes.is_error() => Shot::Damaged,
                Ok(_) if !is_fresh => Shot::Stale,
                Ok(image) => Shot::Picture(at, image),
                Err(_) => Shot::Damaged,
            })
        });
        shot.map_err(lost)
    }
}

fn cannot_open(path: &Path, cause: &io::Error) -> InputError {
    let advice = match cause.kind() {
        io::ErrorKind::NotFound => {
            "no such camera: plug it in; `ls /dev/video*` shows the cameras there are, `v4l2-ctl --list-devices` which is which"
        }
        io::ErrorKind::PermissionDenied => {
            "may not be used: join the group that owns it (`sudo usermod -aG video $USER`, then log in anew)"
        }
        io::ErrorKind::ResourceBusy => "in use: close the other program that shows its pictures",
        _ => {
            return InputError::file(
                path,
                format!("no V4L2 camera: {cause}; `v4l2-ctl --list-devices` shows those there are"),
            );
        }
    };
    InputError::file(path, advice)
}

fn no_format(offered: &[[u8; 4]]) -> String {
    let list = |names: Vec<String>| names.join(" ");
    let known = list(Format::ALL.map(|format| name(format.fourcc())).to_vec());
    match offered {
        [] => "captures no video: many cameras have a second device for data about the pictures, take the first".to_owned(),
        offered => format!(
            "none of its formats is known here: it has {}, known are {known}",
            list(offered.iter().copied().map(name).collect())
        ),
    }
}

fn name(fourcc: [u8; 4]) -> String {
    fourcc.escape_ascii().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(path: &Path) -> String {
        match V4l2::open(path, [320, 240], 30.0) {
            Err(error) => error.to_string(),
            Ok(_) => panic!("{} is a camera", path.display()),
        }
    }

    #[test]
    fn what_is_no_camera_is_refused_by_name_with_what_to_do() {
        let text = refusal(Path::new("/dev/video-of-nobody"));
        assert!(
            text.starts_with("/dev/video-of-nobody: no such camera: plug it in"),
            "{text}"
        );
        let text = refusal(Path::new("/dev/null"));
        assert!(text.starts_with("/dev/null: no V4L2 camera"), "{text}");
        let denied = cannot_open(
            Path::new("/dev/video0"),
            &io::ErrorKind::PermissionDenied.into(),
        );
        assert!(denied.reason.contains("group"), "{denied}");
        let busy = cannot_open(
            Path::new("/dev/video0"),
            &io::ErrorKind::ResourceBusy.into(),
        );
        assert!(busy.reason.contains("other program"), "{busy}");
    }

    #[test]
    fn unknown_formats_are_listed() {
        assert!(no_format(&[*b"H264", *b"BA81"]).contains("it has H264 BA81, known are GREY YUYV"));
        assert!(no_format(&[]).contains("take the first"));
    }
}
