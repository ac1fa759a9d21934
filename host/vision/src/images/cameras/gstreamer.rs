//! Cameras behind a GStreamer pipeline: everything that GStreamer reads. With the feature
//! `gstreamer`.
//!
//! A pipeline such as `v4l2src device=/dev/video0 ! image/jpeg ! jpegdec` ends without a sink. This
//! module adds the conversion to grey (8 bits, without dither), the rig's size and the sink. An
//! image's time is its running time on the pipeline's clock, which is the monotonic one: sources of
//! live images stamp their buffers so (GStreamer's manual, "Clocks and synchronization"). A pipeline
//! that is not live, such as one that reads a file, runs at the pace of its time stamps.
//!
//! The library is GStreamer 1.x (C, LGPL-2.1 or newer), by its bindings, which are safe: this crate
//! forbids `unsafe`.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::time::{Duration, Instant};

use gstreamer::prelude::*;
use gstreamer::{Bus, ClockTime, FormattedSegment, MessageView, Pipeline, SystemClock};
use gstreamer::{Element, Sample, State, StateChangeSuccess};
use gstreamer::{PadProbeData, PadProbeReturn, PadProbeType};
use gstreamer_app::AppSink;
use gstreamer_video::{VideoFrameExt as _, VideoFrameRef, VideoInfo};

use super::grey::Format;
use super::live::{Camera, CameraEvent};
use super::numbers::Numbers;
use super::stamp::{Clocks, Moments, Point, Source, Stamp};
use crate::images::Image;
use trinocular_rig::error::InputError;
use trinocular_rig::rig_file::capture::GSTREAMER;

/// Timeout for a pipeline to start.
const START: ClockTime = ClockTime::from_seconds(10);

/// Longest wait for an image before the next check for the end.
const WAIT: ClockTime = ClockTime::from_mseconds(100);

/// Number of waiting images above which the oldest is dropped: a camera must not lag behind the
/// others by more images than the [matching](super::matching::DEPTH) keeps.
const BACKLOG: u32 = 4;

/// Name of the sink that is added.
const SINK: &str = "trinocular-sink";

/// Receiver of the source of the time stamps: called at the first image and at each change.
pub type Notice = Box<dyn FnMut(Source) + Send>;

/// Pipeline that runs.
pub struct Gstreamer {
    path: PathBuf,
    pipeline: Pipeline,
    bus: Bus,
    sink: AppSink,
    size_px: [usize; 2],
    moments: Moments,
    numbers: Numbers,
    notice: Notice,
}

impl Gstreamer {
    /// Starts the pipeline of `name`, which is `gstreamer:` and the pipeline, with images of
    /// `size_px`.
    ///
    /// # Errors
    /// [`InputError`] if the pipeline is wrong, cannot start, or has no images of this size.
    pub fn open(name: &Path, size_px: [u32; 2], notice: Notice) -> Result<Self, InputError> {
        let refused = |reason: String| InputError::file(name, reason);
        gstreamer::init().map_err(|cause| refused(format!("GStreamer does not start: {cause}")))?;
        let pipeline = parse(name, size_px).map_err(&refused)?;
        let missing = || refused("GStreamer lost the sink of the pipeline".to_owned());
        let sink = pipeline.by_name(SINK).ok_or_else(missing)?;
        let sink: AppSink = sink.downcast().map_err(|_| missing())?;
        let bus = pipeline.bus().ok_or_else(missing)?;
        count_images(&sink).map_err(&refused)?;
        let clock = SystemClock::obtain();
        pipeline.use_clock(Some(&clock));
        let camera = Self {
            path: name.to_owned(),
            pipeline,
            bus,
            sink,
            size_px: size_px.map(|side| side as usize),
            moments: Moments::new(Clocks::read(|| {
                clock.time().map_or(Duration::ZERO, Duration::from)
            })),
            numbers: Numbers::default(),
            notice,
        };
        camera
            .start()
            .map_err(|trouble| refused(explained(trouble, size_px)))?;
        Ok(camera)
    }

    fn start(&self) -> Result<(), String> {
        let is_live = self.reach(State::Paused)? == StateChangeSuccess::NoPreroll;
        // Images of a file come as fast as they are read, unless the sink keeps their time.
        self.sink.set_property("sync", !is_live);
        self.sink.set_drop(is_live);
        self.reach(State::Playing).map(|_| ())
    }

    /// Waits until the pipeline is in a state.
    fn reach(&self, state: State) -> Result<StateChangeSuccess, String> {
        let changed = self
            .pipeline
            .set_state(state)
            .and_then(|success| match success {
                StateChangeSuccess::Async => self.pipeline.state(START).0,
                success => Ok(success),
            });
        match changed {
            Ok(StateChangeSuccess::Async) => {
                let seconds = START.seconds();
                Err(format!("the pipeline delivers no image within {seconds} s"))
            }
            Ok(success) => Ok(success),
            Err(_) => {
                let trouble = self.trouble();
                Err(trouble.unwrap_or("the pipeline does not start".to_owned()))
            }
        }
    }

    /// Returns what the pipeline has reported as the reason of its end.
    fn trouble(&self) -> Option<String> {
        let message = self
            .bus
            .pop_filtered(&[gstreamer::MessageType::Error, gstreamer::MessageType::Eos])?;
        Some(match message.view() {
            MessageView::Error(error) => {
                let source = error.src().map(|source| source.name());
                let source = source.as_deref().unwrap_or("the pipeline").to_owned();
                let about = error
                    .debug()
                    .map(|text| format!(" ({})", text.replace('\n', " ")));
                format!("{source}: {}{}", error.error(), about.unwrap_or_default())
            }
            _ => "the pipeline has ended".to_owned(),
        })
    }

    /// Returns the image of a sample; `None` if it is damaged.
    fn image(&self, sample: &Sample) -> Option<Image> {
        let info = VideoInfo::from_caps(sample.caps()?).ok()?;
        let frame = VideoFrameRef::from_buffer_ref_readable(sample.buffer()?, &info).ok()?;
        let stride = usize::try_from(*frame.plane_stride().first()?).ok()?;
        let size = [frame.width(), frame.height()].map(|side| side as usize);
        let image = Format::Grey.to_grey(frame.plane_data(0).ok()?, size, stride);
        image.ok().filter(|_| size == self.size_px)
    }

    /// Returns the time of a sample on the pipeline's clock.
    fn stamp(&self, sample: &Sample) -> Stamp {
        let time = || {
            let pts = sample.buffer()?.pts()?;
            let segment: &FormattedSegment<ClockTime> = sample.segment()?.downcast_ref()?;
            let running = segment.to_running_time(pts)?;
            self.pipeline.base_time()?.checked_add(running)
        };
        time().map_or(Stamp::Unknown, |time| {
            Stamp::Monotonic(time.into(), Point::Start)
        })
    }
}

/// Makes the pipeline with its sink.
fn parse(name: &Path, [width, height]: [u32; 2]) -> Result<Pipeline, String> {
    let text = name.to_str().and_then(|name| name.strip_prefix(GSTREAMER));
    let text = text.unwrap_or_default().trim();
    if text.is_empty() {
        return Err(format!("no pipeline follows `{GSTREAMER}`"));
    }
    let whole = format!(
        "{text} ! videoconvert dither=none ! video/x-raw,format=GRAY8,width={width},height={height} \
         ! appsink name={SINK} max-buffers={BACKLOG} drop=true"
    );
    let element: Element = gstreamer::parse::launch(&whole).map_err(|cause| {
        let way_out = format!("try it with `gst-launch-1.0 {text} ! fakesink`");
        let trouble = format!("cannot make the pipeline: {cause}; {way_out}");
        explained(trouble, [width, height])
    })?;
    element
        .downcast()
        .map_err(|_| "this is no pipeline from a source to a sink".to_owned())
}

impl Camera for Gstreamer {
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    fn next_image(&mut self) -> Result<CameraEvent, InputError> {
        let ready = self.sink.try_pull_sample(ClockTime::ZERO);
        let was_awaited = ready.is_none();
        let Some(sample) = ready.or_else(|| self.sink.try_pull_sample(WAIT)) else {
            return match self.trouble() {
                Some(reason) => Err(InputError::file(&self.path, reason)),
                None => Ok(CameraEvent::Nothing),
            };
        };
        let arrived = Instant::now();
        let source = self.moments.source();
        let stamp = self.stamp(&sample);
        let moment = self.moments.of(stamp, arrived, was_awaited);
        if let Some(number) = number(&sample) {
            self.numbers.saw(number);
        }
        if let Some(now) = self.moments.source().filter(|now| source != Some(*now)) {
            (self.notice)(now);
        }
        Ok(match (self.image(&sample), moment) {
            (None, _) => CameraEvent::Damaged,
            (Some(_), None) => CameraEvent::Stale,
            (Some(image), Some(at)) => CameraEvent::Image(at, image),
        })
    }

    fn lost(&self) -> u64 {
        self.numbers.lost()
    }

    fn needs_release(&self) -> bool {
        true
    }
}

/// Numbers the images that reach the sink, from 1. Those that the sink drops are missing in the
/// numbers of the others.
fn count_images(sink: &AppSink) -> Result<(), String> {
    let pad = sink.static_pad("sink");
    let pad = pad.ok_or("GStreamer's sink has no pad")?;
    let count = AtomicU32::new(1);
    pad.add_probe(PadProbeType::BUFFER, move |_, probe| {
        if let Some(PadProbeData::Buffer(buffer)) = &mut probe.data {
            let number = count.fetch_add(1, Relaxed);
            buffer.make_mut().set_offset(number.into());
        }
        PadProbeReturn::Ok
    });
    Ok(())
}

/// Returns the number of an image.
fn number(sample: &Sample) -> Option<u32> {
    let number = sample.buffer()?.offset();
    u32::try_from(number).ok()
}

/// Adds the way out to GStreamer's message about images of another size or kind.
fn explained(trouble: String, [width, height]: [u32; 2]) -> String {
    let is_of_size = ["not-negotiated", "can't handle caps"];
    match is_of_size.iter().any(|words| trouble.contains(words)) {
        true => format!(
            "the pipeline has no images of {width} x {height} px, as the rig file says, or none \
             that can become grey: end it with `videoscale`, or calibrate the rig with its size; \
             {trouble}"
        ),
        false => trouble,
    }
}

impl Drop for Gstreamer {
    fn drop(&mut self) {
        // A pipeline that does not end is left to the end of the program.
        let _ = self.pipeline.set_state(State::Null);
    }
}
