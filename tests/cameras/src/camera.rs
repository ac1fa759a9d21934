//! One video device, as its driver would behave.
//!
//! All cameras expose at the same instants, multiples of the period on the monotonic clock, as with
//! one trigger. The first image is shown until [`LEAD`] periods after the start of the first
//! camera. The other images then follow in order, and the last one stays.

use std::collections::VecDeque;
use std::fs::File;
use std::io::Write as _;
use std::os::unix::fs::FileExt as _;
use std::sync::OnceLock;

use crate::plan::{self, Plan};
use crate::wire::{self, Buffer, Errno, FormatDescription, PixelFormat, RequestBuffers};

/// Periods before the second image is shown.
const LEAD: u64 = 15;

/// Formats: luminance, and luminance followed by colours. The colours are left out because the
/// program never reads them.
const GREY: [u8; 4] = *b"GREY";
const YU12: [u8; 4] = *b"YU12";

/// Instant at which the second image is shown, in periods.
static BEGIN: OnceLock<u64> = OnceLock::new();

/// An exposed image that waits to be fetched.
struct Done {
    buffer: u32,
    number: u64,
    stamp_us: u64,
    is_spoilt: bool,
    is_cut: bool,
}

/// A camera and its driver.
pub struct Camera {
    plan: Plan,
    pictures: Vec<u8>,
    memory: File,
    log: File,
    buffers: u32,
    queued: VecDeque<u32>,
    done: VecDeque<Done>,
    /// Period number of its image 0; `None` while the camera does not stream.
    first: Option<u64>,
    /// Number of the next image to be exposed.
    next: u64,
    is_gone: bool,
    /// Pixel format of its images.
    fourcc: [u8; 4],
}

impl Camera {
    /// Opens the device `name` if it exists. `memory` will hold its buffers.
    pub fn open(name: &str, memory: File) -> Option<Self> {
        let (plan, pictures, log) = plan::read(name)?;
        Some(Self {
            plan,
            pictures,
            memory,
            log: File::create(log).ok()?,
            buffers: 0,
            queued: VecDeque::new(),
            done: VecDeque::new(),
            first: None,
            next: 0,
            is_gone: false,
            fourcc: GREY,
        })
    }

    /// Returns the bytes of an image.
    fn picture_bytes(&self) -> u64 {
        self.plan.size.iter().map(|side| u64::from(*side)).product()
    }

    /// Returns the distance of two buffers in bytes: whole pages.
    fn buffer_bytes(&self) -> u64 {
        self.picture_bytes().next_multiple_of(65_536)
    }

    fn present(&self) -> Result<(), Errno> {
        match self.is_gone {
            true => Err(libc::ENODEV),
            false => Ok(()),
        }
    }

    fn is_of(kind: u32) -> Result<(), Errno> {
        match kind {
            wire::CAPTURE => Ok(()),
            _ => Err(libc::EINVAL),
        }
    }

    /// Exposes the images that have become due.
    fn run(&mut self, now_us: u64) {
        let Some(first) = self.first.filter(|_| !self.plan.silent) else {
            return;
        };
        loop {
            let number = self.next;
            let moment = first + number;
            let stamp_us = moment * self.plan.period_us;
            // A hash of the image number scatters the arrivals.
            let scatter = number
                .wrapping_mul(0x9E37_79B9_7F4A_7C15)
                .wrapping_add(self.pictures.len() as u64)
                >> 40;
            let late_us = self.plan.readout_us + scatter % (self.plan.jitter_us + 1);
            if stamp_us + late_us > now_us || self.is_gone {
                return;
            }
            self.next += 1;
            self.is_gone = self.plan.unplug == Some(number);
            if self.is_gone || self.plan.lose.contains(&number) {
                continue;
            }
            let Some(buffer) = self.queued.pop_front() else {
                // Without a free buffer the image is lost, as with a real driver.
                continue;
            };
            let bytes = self.picture_bytes() as usize;
            let shown = moment.saturating_sub(*BEGIN.get().unwrap_or(&moment)) as usize;
            let last = self.pictures.len() / bytes - 1;
            let picture = &self.pictures[shown.min(last) * bytes..][..bytes];
            let black = vec![0; bytes];
            let picture = match number < self.plan.dark {
                true => &black,
                false => picture,
            };
            let written = self
                .memory
                .write_all_at(picture, u64::from(buffer) * self.buffer_bytes());
            let is_spoilt = self.plan.spoil.contains(&number) || written.is_err();
            let is_cut = self.plan.cut.contains(&number);
            self.done.push_back(Done {
                buffer,
                number,
                stamp_us,
                is_spoilt,
                is_cut,
            });
        }
    }

    /// Returns the events that `poll` reports for the device.
    pub fn poll(&mut self, now_us: u64) -> i16 {
        self.run(now_us);
        match (self.is_gone || self.first.is_none(), self.done.is_empty()) {
            (true, _) => libc::POLLERR | libc::POLLHUP,
            (false, true) => 0,
            (false, false) => libc::POLLIN,
        }
    }

    /// Describes one of the device's formats.
    pub fn describe(&self, of: &mut FormatDescription) -> Result<(), Errno> {
        Self::is_of(of.kind)?;
        of.fourcc = match (of.index, self.plan.grey_of) {
            (0, _) => GREY,
            (1, Some(_)) => YU12,
            _ => return Err(libc::EINVAL),
        };
        Ok(())
    }

    /// Returns the present format.
    pub fn format(&self, format: &mut PixelFormat) -> Result<(), Errno> {
        Self::is_of(format.kind)?;
        let grey_size = self.plan.grey_of.filter(|_| self.fourcc == GREY);
        [format.width, format.height] = grey_size.unwrap_or(self.plan.size);
        format.fourcc = self.fourcc;
        format.field = 1;
        format.bytes_per_line = format.width;
        format.size = self.picture_bytes() as u32;
        Ok(())
    }

    /// Sets one of the device's formats. The size stays the only one of that format, whatever the
    /// request.
    pub fn set_format(&mut self, format: &mut PixelFormat) -> Result<(), Errno> {
        self.fourcc = match format.fourcc == YU12 && self.plan.grey_of.is_some() {
            true => YU12,
            false => GREY,
        };
        self.format(format)
    }

    /// Allocates buffers, or frees them if the count is 0.
    pub fn allocate(&mut self, request: &mut RequestBuffers) -> Result<(), Errno> {
        self.present()?;
        Self::is_of(request.kind)?;
        if request.memory != wire::MAPPED {
            return Err(libc::EINVAL);
        }
        // A driver may allocate fewer buffers than requested.
        self.buffers = request.count.min(4);
        request.count = self.buffers;
        let bytes = u64::from(self.buffers) * self.buffer_bytes();
        // The memory of buffers that are still mapped stays.
        if bytes > 0 && self.memory.set_len(bytes).is_err() {
            return Err(libc::ENOMEM);
        }
        Ok(())
    }

    /// Returns the place of a buffer in memory.
    pub fn query(&self, buffer: &mut Buffer) -> Result<(), Errno> {
        self.present()?;
        Self::is_of(buffer.kind)?;
        if buffer.index >= self.buffers {
            return Err(libc::EINVAL);
        }
        buffer.length = self.picture_bytes() as u32;
        buffer.offset = u64::from(buffer.index) * self.buffer_bytes();
        Ok(())
    }

    /// Gives a buffer to the driver to be filled. Fails if the driver already has it.
    pub fn queue(&mut self, buffer: &mut Buffer, now_us: u64) -> Result<(), Errno> {
        self.run(now_us);
        self.present()?;
        Self::is_of(buffer.kind)?;
        let is_here = self.queued.contains(&buffer.index)
            || self.done.iter().any(|done| done.buffer == buffer.index);
        if buffer.index >= self.buffers || is_here {
            return Err(libc::EINVAL);
        }
        self.queued.push_back(buffer.index);
        Ok(())
    }

    /// Hands over the oldest image.
    pub fn dequeue(&mut self, buffer: &mut Buffer, now_us: u64) -> Result<(), Errno> {
        self.run(now_us);
        self.present()?;
        Self::is_of(buffer.kind)?;
        if self.first.is_none() {
            return Err(libc::EINVAL);
        }
        let done = self.done.pop_front().ok_or(libc::EAGAIN)?;
        let bytes = self.picture_bytes() as u32;
        let clock = if self.plan.foreign_clock {
            0
        } else {
            wire::MONOTONIC
        };
        let point = if self.plan.at_start {
            wire::AT_START
        } else {
            0
        };
        let state = if done.is_spoilt { wire::SPOILT } else { 0 };
        buffer.index = done.buffer;
        buffer.flags = clock | point | state;
        buffer.bytes_used = if done.is_cut { bytes / 2 } else { bytes };
        buffer.sequence = done.number as u32;
        buffer.seconds = (done.stamp_us / 1_000_000) as i64;
        buffer.micros = (done.stamp_us % 1_000_000) as i64;
        buffer.length = bytes;
        writeln!(
            self.log,
            "{} {}",
            done.number,
            u8::from(done.is_spoilt || done.is_cut)
        )
        .map_err(|_| libc::EIO)
    }

    /// Starts streaming.
    pub fn start(&mut self, now_us: u64) -> Result<(), Errno> {
        self.present()?;
        if let Some(errno) = self.plan.start_error {
            return Err(errno);
        }
        let now = now_us / self.plan.period_us;
        BEGIN.get_or_init(|| now + LEAD);
        self.first = Some(now + 1);
        self.next = 0;
        Ok(())
    }

    /// Stops streaming and takes all buffers from the driver.
    pub fn stop(&mut self) -> Result<(), Errno> {
        self.present()?;
        self.first = None;
        self.queued.clear();
        self.done.clear();
        Ok(())
    }
}
