//! V4L2 cameras. Linux only, with the feature `camera`.
//!
//! The library is `v4l`. It passes on the driver's data of each image (time, number and flags),
//! which `linuxvideo` and (except the time) `rscam` hide, and it waits with a time limit, which
//! `rscam` cannot. It needs libclang at build time; no C library is linked.
//!
//! Three faults of the library are avoided. Its `query_caps` panics on a card whose name was cut
//! within a character, so it is not called. Its `next` returns the previous image's buffer to the
//! driver, and after a timeout would do so twice, so this module waits before it calls `next`.
//! There is no previous image at first, so the first image of each camera is taken out and not
//! used; many cameras spoil it anyway. Its `drop` panics if a connected camera cannot be stopped;
//! that could happen only in the camera's own thread or before any motion.

mod listing;
mod refusal;

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::event::PollFlags;
use rustix::time::{ClockId, clock_gettime};
use v4l::buffer::{Flags, Metadata, Type};
use v4l::io::mmap::Stream;
use v4l::io::traits::{CaptureStream, Stream as _};
use v4l::video::Capture;
use v4l::video::capture::Parameters;
use v4l::{Device, Fraction};

use super::grey::Format;
use super::live::{Camera, CameraEvent};
use super::numbers::Numbers;
use super::stamp::{Clocks, Moments, Point, Source, Stamp};
use trinocular_rig::error::InputError;

pub use listing::{Listed, list};

/// Number of buffers that are requested: this program holds one, the driver fills the others.
const BUFFERS: u32 = 5;

/// Largest number of buffers that a driver has (V4L2's `VIDEO_MAX_FRAME`).
const MOST_BUFFERS: usize = 32;

/// Longest wait for an image before the next check for the end, ms.
const WAIT_MS: i32 = 100;

/// Receiver of the source of the time stamps: called at the first image and at each change.
pub type Notice = Box<dyn FnMut(Source) + Send>;

/// Streaming camera.
pub struct V4l2 {
    path: PathBuf,
    stream: Stream<'static>,
    format: Format,
    size_px: [usize; 2],
    stride: usize,
    has_first: bool,
    moments: Moments,
    numbers: Numbers,
    notice: Notice,
}

impl V4l2 {
    /// Opens the camera at `path`, such as `/dev/video0`, and starts it, with images of `size_px`
    /// in the best supported format that has this size. The camera is set to `frames_per_s`;
    /// cameras with a fixed rate keep it.
    ///
    /// # Errors
    /// [`InputError`] if there is no such camera, it may not be used, or it has no images of this
    /// size.
    pub fn open(
        path: &Path,
        size_px: [u32; 2],
        frames_per_s: f64,
        notice: Notice,
    ) -> Result<Self, InputError> {
        let device = Device::with_path(path).map_err(|cause| refusal::cannot_open(path, &cause))?;
        let refused = |cause: io::Error| refusal::cannot_start(path, &cause);
        let (format, stride) = set_format(path, &device, size_px)?;
        let interval = Fraction::new(1000, (frames_per_s * 1000.0).round() as u32);
        // A camera without this rate is used at its own rate, because the images carry their times.
        let _ = device.set_params(&Parameters::new(interval));
        Ok(Self {
            path: path.to_owned(),
            stream: start(&device).map_err(refused)?,
            format,
            size_px: size_px.map(|side| side as usize),
            stride,
            has_first: false,
            moments: Moments::new(Clocks::read(monotonic)),
            numbers: Numbers::default(),
            notice,
        })
    }

    /// Returns the pixel format.
    pub fn format(&self) -> Format {
        self.format
    }

    /// Returns true if an image is ready, or if the camera will deliver no more images.
    fn is_ready_within(&self, wait_ms: i32) -> io::Result<bool> {
        match self
            .stream
            .handle()
            .poll(PollFlags::IN.bits().cast_signed(), wait_ms)
        {
            // Interrupted by a signal, such as Ctrl-C.
            Err(cause) if cause.kind() == io::ErrorKind::Interrupted => Ok(false),
            ready => Ok(ready? > 0),
        }
    }
}

impl Camera for V4l2 {
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    fn next_image(&mut self) -> Result<CameraEvent, InputError> {
        let path = self.path.clone();
        let lost = |cause| refusal::lost(&path, &cause);
        let was_awaited = !self.is_ready_within(0).map_err(lost)?;
        if was_awaited && !self.is_ready_within(WAIT_MS).map_err(lost)? {
            return Ok(CameraEvent::Nothing);
        }
        if !self.has_first {
            self.stream.dequeue().map_err(lost)?;
            self.has_first = true;
            return Ok(CameraEvent::Nothing);
        }
        let (buffer, about) = self.stream.next().map_err(lost)?;
        let arrived = Instant::now();
        let source = self.moments.source();
        let moment = self.moments.of(stamp(about), arrived, was_awaited);
        self.numbers.saw(about.sequence);
        let bytes = buffer.get(..about.bytesused as usize).unwrap_or(buffer);
        let shot = match self.format.to_grey(bytes, self.size_px, self.stride) {
            _ if about.flags.contains(Flags::ERROR) => CameraEvent::Damaged,
            Err(_) => CameraEvent::Damaged,
            Ok(image) => moment.map_or(CameraEvent::Stale, |at| CameraEvent::Image(at, image)),
        };
        if let Some(now) = self.moments.source().filter(|now| source != Some(*now)) {
            (self.notice)(now);
        }
        Ok(shot)
    }

    fn lost(&self) -> u64 {
        self.numbers.lost()
    }
}

/// Sets the best supported format of the device with images of `size_px`, and returns the distance
/// between its rows.
///
/// Many USB cameras have their large images only as JPEG, so a format may exist, but not in this
/// size.
fn set_format(
    path: &Path,
    device: &Device,
    size_px @ [width, height]: [u32; 2],
) -> Result<(Format, usize), InputError> {
    let mut sizes = Vec::new();
    let mut other = None;
    for format in known(path, device)? {
        let wanted = v4l::Format::new(width, height, v4l::FourCC::new(&format.fourcc()));
        let got = device.set_format(&wanted);
        let got = got.map_err(|cause| refusal::cannot_start(path, &cause))?;
        if got.fourcc != wanted.fourcc {
            other = Some(refusal::other_format(
                path,
                format.fourcc(),
                got.fourcc.repr,
            ));
        } else if [got.width, got.height] != size_px {
            sizes.push([got.width, got.height]);
        } else {
            return Ok((format, got.stride as usize));
        }
    }
    let nearest = sizes
        .into_iter()
        .min_by_key(|[w, h]| w.abs_diff(width) + h.abs_diff(height));
    Err(match (nearest, other) {
        (None, Some(refusal)) => refusal,
        (nearest, _) => refusal::no_size(path, size_px, nearest.unwrap_or_default()),
    })
}

/// Returns the device's supported formats, best first; at least one.
fn known(path: &Path, device: &Device) -> Result<Vec<Format>, InputError> {
    let offered = device.enum_formats().unwrap_or_default();
    let offered: Vec<[u8; 4]> = offered.iter().map(|format| format.fourcc.repr).collect();
    let known = Format::ALL.into_iter();
    let known: Vec<Format> = known
        .filter(|format| offered.contains(&format.fourcc()))
        .collect();
    if !known.is_empty() {
        return Ok(known);
    }
    Err(match device.format() {
        // Every V4L2 device answers this request, if only with an error.
        Err(cause) if offered.is_empty() && cause.kind() != io::ErrorKind::InvalidInput => {
            refusal::cannot_open(path, &cause)
        }
        _ => refusal::no_format(path, &offered),
    })
}

/// Gives the driver all buffers that it made, and starts it.
fn start(device: &Device) -> io::Result<Stream<'static>> {
    let mut stream = Stream::with_buffers(device, Type::VideoCapture, BUFFERS)?;
    for index in 0..MOST_BUFFERS {
        match stream.queue(index) {
            Err(cause) if index > 0 && cause.kind() == io::ErrorKind::InvalidInput => break,
            queued => queued?,
        }
    }
    stream.start()?;
    Ok(stream)
}

fn monotonic() -> Duration {
    let now = clock_gettime(ClockId::Monotonic);
    Duration::try_from(now).unwrap_or_default()
}

fn stamp(about: &Metadata) -> Stamp {
    let is_monotonic = about.flags & Flags::TIMESTAMP_MASK == Flags::TIMESTAMP_MONOTONIC;
    let point = match about.flags & Flags::TSTAMP_SRC_MASK == Flags::TSTAMP_SRC_SOE {
        true => Point::Start,
        false => Point::End,
    };
    let (Ok(seconds), Ok(micros), true) = (
        u64::try_from(about.timestamp.sec),
        u64::try_from(about.timestamp.usec),
        is_monotonic,
    ) else {
        return Stamp::Unknown;
    };
    let time = Duration::from_secs(seconds).saturating_add(Duration::from_micros(micros));
    Stamp::Monotonic(time, point)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(path: &Path) -> String {
        match V4l2::open(path, [320, 240], 30.0, Box::new(|_| ())) {
            Err(error) => error.to_string(),
            Ok(_) => panic!("{} is a camera", path.display()),
        }
    }

    #[test]
    fn other_devices_are_refused() {
        let text = refusal(Path::new("/dev/video-of-nobody"));
        assert!(
            text.starts_with("/dev/video-of-nobody: no such camera: plug it in"),
            "{text}"
        );
        let text = refusal(Path::new("/dev/null"));
        assert!(text.starts_with("/dev/null: no V4L2 camera"), "{text}");
    }

    #[test]
    fn stamps_follow_their_flags() {
        let of = |flags, sec, usec| {
            stamp(&Metadata {
                flags,
                timestamp: v4l::Timestamp::new(sec, usec),
                ..Metadata::default()
            })
        };
        let time = Duration::new(12, 345_678_000);
        let end = Flags::TIMESTAMP_MONOTONIC | Flags::TSTAMP_SRC_EOF | Flags::DONE;
        assert_eq!(of(end, 12, 345_678), Stamp::Monotonic(time, Point::End));
        let start = Flags::TIMESTAMP_MONOTONIC | Flags::TSTAMP_SRC_SOE;
        assert_eq!(of(start, 12, 345_678), Stamp::Monotonic(time, Point::Start));
        for flags in [Flags::TIMESTAMP_UNKNOWN, Flags::TIMESTAMP_COPY] {
            assert_eq!(of(flags, 12, 345_678), Stamp::Unknown);
        }
        assert_eq!(of(end, -1, 0), Stamp::Unknown);
    }
}
