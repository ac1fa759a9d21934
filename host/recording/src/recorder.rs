//! The recorder: takes in what a run is given and does, and writes it on a thread of its own.
//!
//! ```text
//! loop, heartbeat -> Tap -> queue, bounded by bytes -> thread -> chunks on the disk
//! ```
//!
//! *Invariant:* a run never waits for the disk in real time. In virtual time, which nothing else
//! waits for, it does, so that nothing is lost.

use crate::message::Measurement;
use crate::queue::{Pace, Queue};
use crate::sink::Sink;
use crate::thread::{self, Ended, Opened};
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use trinocular_client::observer::StationObserver;
use trinocular_core::safety::Inputs;
use trinocular_core::steps::Segment;
use trinocular_core::time::Instant;
use trinocular_rig::error::InputError;
use trinocular_rig::notice;
use trinocular_rig::output::Output;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::images::{FrameSet, Image};

/// Form of the images in a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImageForm {
    /// Uncompressed.
    #[default]
    Raw,
    /// PNG files: smaller, as the noise allows, for half a millisecond of a core per image of
    /// 320 x 240.
    Png,
    /// Left out. Such a recording replays the station, not the measurements.
    None,
}

/// Settings of a recording.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Form of the images.
    pub images: ImageForm,
    /// Behaviour if the disk is too slow.
    pub pace: Pace,
    /// Names of the cameras, in the rig's order.
    pub cameras: Vec<String>,
    /// Instant of the log's time zero, µs since 1970; zero for virtual time.
    pub epoch_us: u64,
    /// Text of the rig file.
    pub rig: String,
    /// Regions of interest, in the order of the cameras.
    pub regions: Regions,
    /// Origin of the run: program, version, commit, command line, seed and the like, by name.
    pub origin: BTreeMap<String, String>,
}

/// One thing to write.
#[derive(Debug)]
pub(crate) enum Content {
    Images(u64, u32, Vec<Image>),
    Measurement(Box<Measurement>),
    ToStation(Vec<u8>),
    FromStation(Vec<u8>),
    Segment(Segment, Vec<u32>),
    Switches(Inputs),
    Event(&'static str, String),
    /// Time has passed up to here, and the run ended.
    End,
}

/// One thing to write, with its instant, µs of the log's clock.
#[derive(Debug)]
pub(crate) struct Timed {
    pub at_us: u64,
    pub content: Content,
}

/// Numbers of what did not fit the queue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropped {
    /// Frame sets of which no image is in the file.
    pub frame_sets: u64,
    /// Other messages.
    pub messages: u64,
}

/// Taps of a run: observers that copy what passes into the queue. Cheap to share.
#[derive(Debug)]
pub struct Tap {
    queue: Queue<Timed>,
    has_images: bool,
    /// Latest instant of the log's clock, µs.
    now_us: AtomicU64,
    frame: AtomicU32,
    frame_sets_dropped: AtomicU64,
    messages_dropped: AtomicU64,
    has_failed: AtomicBool,
}

impl Tap {
    /// Returns true if the file could not be written further: the recording has ended.
    pub fn has_failed(&self) -> bool {
        self.has_failed.load(Ordering::Relaxed)
    }

    fn push(&self, at_us: u64, content: Content) {
        let (size, is_image) = match &content {
            Content::Images(_, _, images) => {
                (images.iter().map(|image| image.grey.len()).sum(), true)
            }
            Content::Measurement(measurement) => (8 * measurement.pixels.len() + 1_000, false),
            Content::ToStation(bytes) | Content::FromStation(bytes) => (bytes.len(), false),
            Content::Segment(_, words) => (4 * words.len(), false),
            Content::Event(_, text) => (text.len(), false),
            Content::Switches(_) | Content::End => (0, false),
        };
        if !self.queue.push(Timed { at_us, content }, size, is_image) {
            let count = match is_image {
                true => &self.frame_sets_dropped,
                false => &self.messages_dropped,
            };
            count.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Sets the log's clock to `at_us`, up to which time has passed.
    pub fn reach(&self, at_us: u64) {
        self.pass(at_us);
    }

    fn pass(&self, at_us: u64) -> u64 {
        self.now_us.fetch_max(at_us, Ordering::Relaxed).max(at_us)
    }

    /// Records a frame set and its measurement, whose `frame` is set to the next number.
    pub fn frame_set(&self, images: Option<&FrameSet>, mut measurement: Measurement) {
        let at_us = self.now_us.load(Ordering::Relaxed);
        measurement.frame = self.frame.fetch_add(1, Ordering::Relaxed);
        if let (true, Some(set)) = (self.has_images, images) {
            let (stamp_us, frame) = (measurement.stamp_us, measurement.frame);
            self.push(at_us, Content::Images(stamp_us, frame, set.images.clone()));
        }
        self.push(at_us, Content::Measurement(Box::new(measurement)));
    }

    /// Records an event.
    pub fn event(&self, kind: &'static str, text: String) {
        let at_us = self.now_us.load(Ordering::Relaxed);
        self.push(at_us, Content::Event(kind, text));
    }

    /// Records that the run ended at `at_us` of the log's clock, up to which time has passed.
    pub fn end(&self, at_us: u64) {
        let at_us = self.pass(at_us);
        self.push(at_us, Content::End);
    }

    /// Returns the numbers of what did not fit the queue so far.
    pub fn dropped(&self) -> Dropped {
        Dropped {
            frame_sets: self.frame_sets_dropped.load(Ordering::Relaxed),
            messages: self.messages_dropped.load(Ordering::Relaxed),
        }
    }

    pub(crate) fn queue(&self) -> &Queue<Timed> {
        &self.queue
    }

    pub(crate) fn add_dropped(&self, messages: usize) {
        let messages = messages as u64;
        self.messages_dropped.fetch_add(messages, Ordering::Relaxed);
    }
}

impl StationObserver for Tap {
    fn sent(&self, at_us: u64, bytes: &[u8]) {
        self.pass(at_us);
        self.push(at_us, Content::ToStation(bytes.to_vec()));
    }

    fn received(&self, at_us: u64, bytes: &[u8]) {
        self.pass(at_us);
        self.push(at_us, Content::FromStation(bytes.to_vec()));
    }

    fn segment(&self, at: Instant, segment: &Segment, words: &[u32]) {
        self.pass(at.micros());
        self.push(at.micros(), Content::Segment(*segment, words.to_vec()));
    }

    fn switches(&self, at: Instant, inputs: &Inputs) {
        self.pass(at.micros());
        self.push(at.micros(), Content::Switches(*inputs));
    }

    fn line_lost(&self, at_us: u64, reason: &str) {
        self.pass(at_us);
        self.push(at_us, Content::Event("line", format!("lost: {reason}")));
    }
}

/// Account of a finished recording.
#[derive(Clone, Copy, Debug, Default)]
pub struct Account {
    /// Messages in the file.
    pub messages: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// Messages that the full queue had no room for.
    pub dropped: Dropped,
    /// Processor time of the thread that wrote the file, where the system tells it.
    pub processor: Option<Duration>,
}

/// Recording under way. Dropping it ends the file as [`Recorder::finish`] does.
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    tap: Arc<Tap>,
    thread: Option<JoinHandle<Result<Ended, io::Error>>>,
}

impl Recorder {
    /// Begins a recording in the file of `output`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn start(output: Output, settings: Settings) -> Result<Self, InputError> {
        let path = output.path().to_owned();
        Self::start_in(output.stream()?, path, settings)
    }

    /// Begins a recording in a new, empty file, which errors name `path`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn start_in(file: File, path: PathBuf, settings: Settings) -> Result<Self, InputError> {
        let unwritten = |cause: io::Error| InputError::io(&path, "write", &cause);
        let sink = Sink::new(file).map_err(unwritten)?;
        let tap = Arc::new(Tap {
            queue: Queue::new(settings.pace),
            has_images: settings.images != ImageForm::None,
            now_us: AtomicU64::new(0),
            frame: AtomicU32::new(0),
            frame_sets_dropped: AtomicU64::new(0),
            messages_dropped: AtomicU64::new(0),
            has_failed: AtomicBool::new(false),
        });
        let opened = Opened::begin(sink, &settings).map_err(unwritten)?;
        let taken = Arc::clone(&tap);
        let named = path.clone();
        let run = move || {
            let outcome = thread::run(&taken, opened);
            if let Err(cause) = &outcome {
                taken.add_dropped(taken.queue().abandon());
                taken.has_failed.store(true, Ordering::Relaxed);
                let error = InputError::io(&named, "write", cause);
                notice!("warning: {error}; the recording ends here, the run goes on");
            }
            outcome
        };
        let thread = std::thread::Builder::new().name("recorder".to_owned());
        Ok(Self {
            thread: Some(thread.spawn(run).map_err(unwritten)?),
            path,
            tap,
        })
    }

    /// Returns the taps of the run.
    pub fn tap(&self) -> Arc<Tap> {
        Arc::clone(&self.tap)
    }

    /// Ends the recording and waits for the file.
    ///
    /// # Errors
    /// The error that ended the recording early, or if the file is not in its place any more.
    pub fn finish(mut self) -> Result<Account, InputError> {
        let ended = self.join();
        let ended = ended.map_err(|cause| InputError::io(&self.path, "write", &cause))?;
        if !self.path.exists() {
            let reason = "was removed or renamed while it was written";
            return Err(InputError::file(&self.path, reason));
        }
        Ok(Account {
            messages: ended.messages,
            bytes: ended.bytes,
            dropped: self.tap.dropped(),
            processor: ended.processor,
        })
    }

    fn join(&mut self) -> io::Result<Ended> {
        self.tap.queue.close();
        let Some(thread) = self.thread.take() else {
            return Ok(Ended::default());
        };
        let panicked = |_| Err(io::Error::other("the recorder's thread panicked"));
        thread.join().unwrap_or_else(panicked)
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        let _ = self.join();
    }
}
