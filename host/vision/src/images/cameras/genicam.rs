//! GenICam cameras: GigE Vision and USB3 Vision. With the feature `genicam`.
//!
//! The library is Aravis (a C library, LGPL-2.1 or newer), by its binding `aravis`, which is safe:
//! this crate forbids `unsafe`. Aravis assembles the packets in a thread of its own. An image with
//! a packet missing is handed over as such; its number is known unless its first packet is the one
//! that is missing. Aravis leaves the number of the buffer's previous image there, so each buffer is
//! marked before it is filled.

mod listing;
mod refusal;
mod settings;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant, SystemTime};

use aravis::glib::prelude::Cast as _;
use aravis::prelude::*;
use aravis::{Buffer, BufferPayloadType, BufferStatus, GvStreamPacketResend};

use super::block_ids::BlockIds;
use super::device_clock::DeviceClock;
use super::live::{Camera, CameraEvent};
use super::mono::Mono;
use super::stamp::{Doubt, Source};
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::Capture;

pub use listing::{Listed, list};
pub use refusal::Refusal;

/// Number of buffers: 0.27 s at 60 images per second.
const BUFFERS: usize = 16;

/// Number of waiting images above which the oldest is not used: a camera must not lag behind the
/// others by more images than the [matching](super::matching::DEPTH) keeps.
const BACKLOG: i32 = 4;

/// Longest wait for an image before the next check for the end, µs.
const WAIT_US: u64 = 100_000;

/// Number of a buffer whose image has none so far.
const NAMELESS: u64 = u64::MAX;

/// Receiver of the source of the time stamps: called at the first image and at each change.
pub type Notice = Box<dyn FnMut(Source) + Send>;

/// One wait for an image, with what the camera said about the image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shot {
    /// Result of the wait.
    pub event: CameraEvent,
    /// Number of the image, if it came.
    pub id: Option<u64>,
    /// Stamp by the camera's clock, ns; 0 if there is none.
    pub stamp_ns: u64,
}

/// Streaming camera.
pub struct Genicam {
    path: PathBuf,
    camera: aravis::Camera,
    stream: aravis::Stream,
    format: Mono,
    size_px: [usize; 2],
    clock: DeviceClock,
    ids: BlockIds,
    source: Option<Source>,
    is_gone: Arc<AtomicBool>,
    notice: Notice,
}

impl Genicam {
    /// Opens the camera `name` (`genicam:` and its serial number, its IP address, or `first`), sets
    /// it up, and starts it with images of `size_px`. Without a trigger it runs at `frames_per_s`,
    /// or at its own rate if that one is fixed.
    ///
    /// # Errors
    /// [`Refusal`] if there is no such camera, it is in use, or it refuses a setting.
    pub fn open(
        name: &Path,
        size_px: [u32; 2],
        frames_per_s: f64,
        capture: &Capture,
        notice: Notice,
    ) -> Result<Self, Refusal> {
        let camera = listing::open(name)?;
        let refused = |action: &str, cause: aravis::glib::Error| {
            Refusal::from(refusal::cannot(name, action, &cause))
        };
        let format = settings::apply(name, &camera, size_px, frames_per_s, capture)?;
        let payload = camera.payload();
        let payload = payload.map_err(|cause| refused("tell the size of its images", cause))?;
        let stream = camera.create_stream();
        let stream = stream.map_err(|cause| refused("open its stream", cause))?;
        if let (Some(false), Some(stream)) = (
            capture.packet_resend,
            stream.downcast_ref::<aravis::GvStream>(),
        ) {
            stream.set_packet_resend(GvStreamPacketResend::Never);
        }
        for _ in 0..BUFFERS {
            push(&stream, Buffer::new_allocate(payload as usize));
        }
        let is_gone = Arc::new(AtomicBool::new(false));
        if let Some(device) = camera.device() {
            let is_gone = Arc::clone(&is_gone);
            device.connect_control_lost(move |_| is_gone.store(true, Relaxed));
        }
        let started = camera.start_acquisition();
        started.map_err(|cause| refused("start", cause))?;
        Ok(Self {
            path: name.to_owned(),
            camera,
            stream,
            format,
            size_px: size_px.map(|side| side as usize),
            clock: DeviceClock::default(),
            ids: BlockIds::default(),
            source: None,
            is_gone,
            notice,
        })
    }

    /// Returns the pixel format.
    pub const fn format(&self) -> Mono {
        self.format
    }

    /// Waits for the next image, as [`Camera::next_image`] does.
    ///
    /// # Errors
    /// [`InputError`] if the camera will deliver no more images.
    pub fn next_shot(&mut self) -> Result<Shot, InputError> {
        let Some(buffer) = self.stream.timeout_pop_buffer(WAIT_US) else {
            return match self.is_gone.load(Relaxed) {
                true => Err(refusal::lost(&self.path)),
                false => Ok(Shot {
                    event: CameraEvent::Nothing,
                    id: None,
                    stamp_ns: 0,
                }),
            };
        };
        let arrived = arrival(&buffer);
        let id = Some(buffer.frame_id()).filter(|id| *id != NAMELESS);
        let stamp_ns = buffer.timestamp();
        let event = match buffer.status() {
            // The status may be that of the buffer's previous image if no packet was understood.
            BufferStatus::Success if id.is_none() => CameraEvent::Damaged,
            BufferStatus::Success if self.stream.n_buffers().1 > BACKLOG => CameraEvent::Stale,
            BufferStatus::Success => self.image(&buffer, arrived),
            BufferStatus::MissingPackets | BufferStatus::Timeout => CameraEvent::Incomplete,
            BufferStatus::Cleared | BufferStatus::Aborted | BufferStatus::Filling => {
                CameraEvent::Nothing
            }
            _ => CameraEvent::Damaged,
        };
        if event != CameraEvent::Nothing {
            self.ids.saw(id);
        }
        push(&self.stream, buffer);
        Ok(Shot {
            event,
            id,
            stamp_ns,
        })
    }

    fn image(&mut self, buffer: &Buffer, arrived: Instant) -> CameraEvent {
        let has_image = matches!(
            buffer.payload_type(),
            BufferPayloadType::Image | BufferPayloadType::ExtendedChunkData
        );
        if !has_image {
            return CameraEvent::Damaged;
        }
        let size = [buffer.image_width(), buffer.image_height()];
        let size = size.map(|side| usize::try_from(side).unwrap_or(0));
        let gap = usize::try_from(buffer.image_padding().0).unwrap_or(0);
        let image = self.format.to_grey(&buffer.image_data(), self.size_px, gap);
        let at = self.instant(buffer.timestamp(), arrived);
        match image {
            Ok(image) if size == self.size_px => {
                at.map_or(CameraEvent::Stale, |at| CameraEvent::Image(at, image))
            }
            _ => CameraEvent::Damaged,
        }
    }

    /// Returns the capture time of an image, if it is known. A camera that stamps no images has their
    /// arrivals.
    fn instant(&mut self, stamp_ns: u64, arrived: Instant) -> Option<Instant> {
        let (at, source) = match stamp_ns {
            0 => (Some(arrived), Source::Arrival(Doubt::NoStamps)),
            _ => (self.clock.instant(stamp_ns, arrived), Source::Device),
        };
        if self.source.replace(source) != Some(source) {
            (self.notice)(source);
        }
        at
    }
}

impl Camera for Genicam {
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    fn next_image(&mut self) -> Result<CameraEvent, InputError> {
        self.next_shot().map(|shot| shot.event)
    }

    fn lost(&self) -> u64 {
        self.ids.lost()
    }

    fn needs_release(&self) -> bool {
        true
    }
}

impl Drop for Genicam {
    fn drop(&mut self) {
        // A camera that is gone cannot be stopped.
        let _ = self.camera.stop_acquisition();
    }
}

/// Gives a buffer to the stream to be filled.
fn push(stream: &aravis::Stream, buffer: Buffer) {
    buffer.set_frame_id(NAMELESS);
    buffer.set_timestamp(0);
    buffer.set_system_timestamp(0);
    stream.push_buffer(buffer);
}

/// Returns the instant at which an image's first packet came. The library notes it by the system's
/// clock, which may be set at any time, so both clocks are read here.
fn arrival(buffer: &Buffer) -> Instant {
    let (now, system) = (Instant::now(), SystemTime::now());
    let came = SystemTime::UNIX_EPOCH + Duration::from_nanos(buffer.system_timestamp());
    let age = system.duration_since(came).unwrap_or_default();
    match buffer.system_timestamp() {
        0 => now,
        _ => now.checked_sub(age).unwrap_or(now),
    }
}
