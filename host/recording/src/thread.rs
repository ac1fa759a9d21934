//! The thread that writes a recording: entries of the queue become messages in chunks.

use crate::message::{self, Event, Measurement, changes};
use crate::png::png;
use crate::queue::Popped;
use crate::recorder::{Content, ImageForm, Settings, Tap, Timed};
use crate::regions;
use crate::schema::{self, Schema};
use crate::sink::Sink;
use crate::topic::{self, Topic};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, McapError, WriteOptions, Writer};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Write as _};
use std::time::{Duration, Instant as HostInstant};
use trinocular_client::twin::PORT;
use trinocular_core::frame::MAX_PACKET;
use trinocular_core::frame::encode::Bytes;
use trinocular_core::frame::message::{Report, Status};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::replay::{self, Entry, Record, Trace};
use trinocular_core::time::Instant;
use trinocular_rig::output::RECORDING_LIBRARY;
use trinocular_vision::images::Image;

/// Longest time that a message waits for its chunk to be written.
const FLUSH: Duration = Duration::from_millis(900);

/// Size at which a chunk is written, bytes.
const CHUNK: usize = 2 << 20;

/// Account of a written file.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ended {
    pub messages: u64,
    pub bytes: u64,
    pub processor: Option<Duration>,
}

/// Channel of a topic.
#[derive(Clone, Copy, Debug)]
struct Channel {
    id: u16,
    sequence: u32,
}

/// A file that has been begun: with its origin, its rig and its channels.
pub(crate) struct Opened {
    writer: Writer<Sink>,
    epoch_us: u64,
    form: ImageForm,
    cameras: Vec<Channel>,
    channels: BTreeMap<Topic, Channel>,
    /// Message that is being encoded.
    message: Vec<u8>,
    entry: Vec<u8>,
    trace: Trace,
    receiver: Receiver<Report>,
    last: Option<Status>,
    messages: u64,
    /// Bytes since the last chunk was written, and the instant of the first of them.
    waiting: usize,
    since: HostInstant,
}

fn failed(error: McapError) -> io::Error {
    match error {
        McapError::Io(cause) => cause,
        other => io::Error::other(other.to_string()),
    }
}

impl Opened {
    pub fn begin(sink: Sink, settings: &Settings) -> io::Result<Self> {
        let options = WriteOptions::new()
            .compression(None)
            .profile("ros2")
            .library(RECORDING_LIBRARY)
            // Chunks are ended here, so that each reaches the system whole within a second.
            .chunk_size(None)
            .disable_seeking(true);
        let writer = options.create(sink).map_err(failed)?;
        let mut opened = Self {
            writer,
            epoch_us: settings.epoch_us,
            form: settings.images,
            cameras: Vec::new(),
            channels: BTreeMap::new(),
            message: Vec::new(),
            entry: Vec::new(),
            trace: Trace::new(PORT),
            receiver: Receiver::default(),
            last: None,
            messages: 0,
            waiting: 0,
            since: HostInstant::now(),
        };
        opened.introduce(settings).map_err(failed)?;
        Ok(opened)
    }

    fn introduce(&mut self, settings: &Settings) -> Result<(), McapError> {
        let mut origin = settings.origin.clone();
        let (name, text) = topic::STAGE;
        origin.insert(name.to_owned(), text.to_owned());
        origin.extend(regions::entries(&settings.cameras, &settings.regions));
        self.writer.write_metadata(&Metadata {
            name: topic::ORIGIN.to_owned(),
            metadata: origin,
        })?;
        self.writer.attach(&Attachment {
            log_time: settings.epoch_us * 1_000,
            create_time: settings.epoch_us * 1_000,
            name: topic::RIG.to_owned(),
            media_type: "application/toml".to_owned(),
            data: Cow::Borrowed(settings.rig.as_bytes()),
        })?;
        for (name, file) in regions::masks(&settings.cameras, &settings.regions)? {
            self.writer.attach(&Attachment {
                log_time: settings.epoch_us * 1_000,
                create_time: settings.epoch_us * 1_000,
                name,
                media_type: "image/png".to_owned(),
                data: Cow::Owned(file),
            })?;
        }
        self.flush()?;
        // Schemas and channels stand in the chunk of the first messages: some libraries of ROS 2
        // (mcap before 1.3.1, and 1.4.0) do not read a file with a chunk without messages in the
        // order of time.
        for name in &settings.cameras {
            let channel = match settings.images {
                ImageForm::Raw => self.channel(&topic::image(name), &schema::IMAGE)?,
                ImageForm::Png => {
                    self.channel(&topic::compressed(name), &schema::COMPRESSED_IMAGE)?
                }
                ImageForm::None => break,
            };
            self.cameras.push(channel);
        }
        for topic in Topic::ALL {
            let channel = self.channel(topic.name(), topic.schema())?;
            self.channels.insert(topic, channel);
        }
        Ok(())
    }

    fn channel(&mut self, topic: &str, schema: &Schema) -> Result<Channel, McapError> {
        let text = schema.text();
        let schema = self
            .writer
            .add_schema(schema.name, "ros2msg", text.as_bytes())?;
        // ROS 2 looks for the key, also without profiles.
        let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
        let id = self.writer.add_channel(schema, topic, "cdr", &metadata)?;
        Ok(Channel { id, sequence: 0 })
    }

    /// Writes the encoded message.
    fn put(&mut self, at_us: u64, channel: Channel) -> Result<(), McapError> {
        let log_time = self.epoch_us.saturating_add(at_us).saturating_mul(1_000);
        if self.waiting == 0 {
            self.since = HostInstant::now();
        }
        self.waiting += self.message.len() + 32;
        self.messages += 1;
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.sequence,
            log_time,
            publish_time: log_time,
        };
        self.writer.write_to_known_channel(&header, &self.message)?;
        match self.waiting >= CHUNK {
            true => self.flush(),
            false => Ok(()),
        }
    }

    /// Writes the encoded message on `topic`, with the next sequence number.
    fn send(&mut self, at_us: u64, topic: Topic) -> Result<(), McapError> {
        let Some(channel) = self.channels.get_mut(&topic) else {
            return Ok(());
        };
        let taken = *channel;
        channel.sequence = channel.sequence.wrapping_add(1);
        self.put(at_us, taken)
    }

    /// Writes `self.entry` on `topic`.
    fn send_entry(&mut self, at_us: u64, topic: Topic) -> Result<(), McapError> {
        message::entry(&mut self.message, &self.entry);
        self.send(at_us, topic)
    }

    fn flush(&mut self) -> Result<(), McapError> {
        self.waiting = 0;
        self.writer.flush()
    }

    /// Returns the time until the chunk is due.
    fn patience(&self) -> Duration {
        match self.waiting {
            0 => FLUSH,
            _ => FLUSH.saturating_sub(self.since.elapsed()),
        }
    }

    fn write(&mut self, timed: Timed) -> Result<(), McapError> {
        let at_us = timed.at_us;
        let at = Instant::from_micros(at_us);
        match timed.content {
            Content::Images(stamp_us, frame, images) => {
                self.images(at_us, stamp_us, frame, &images)
            }
            Content::Measurement(measurement) => self.measurement(at_us, &measurement),
            Content::ToStation(bytes) => self.input(at, Entry::Bytes(&bytes)),
            Content::Switches(inputs) => {
                self.input(at, Entry::Switches(inputs))?;
                self.event(at_us, "switches", format!("{inputs:?}"))
            }
            Content::End => self.input(at, Entry::Wait),
            Content::FromStation(bytes) => {
                for part in bytes.chunks(MAX_PACKET) {
                    let part = Bytes::from_slice(part).unwrap_or_default();
                    self.output(at, &Record::Sent(at, part))?;
                }
                let mut rest = &bytes[..];
                while let Some(report) = self.receiver.next(&mut rest) {
                    if let Ok(Report::Status(status)) = report {
                        self.status(at_us, &status)?;
                    }
                }
                Ok(())
            }
            Content::Segment(segment, words) => {
                let mut edges = Vec::new();
                let digest = self.trace.digest(&segment, &words, |edge| edges.push(edge));
                self.output(at, &Record::Digest(at, digest))?;
                if edges.is_empty() {
                    return Ok(());
                }
                self.entry.clear();
                self.entry.extend(at_us.to_le_bytes());
                for edge in edges {
                    self.entry.extend(edge.word.to_le_bytes());
                    self.entry.extend(edge.pins.to_le_bytes());
                }
                self.send_entry(at_us, Topic::Edges)
            }
            Content::Event(kind, text) => self.event(at_us, kind, text),
        }
    }

    fn input(&mut self, at: Instant, input: Entry<'_>) -> Result<(), McapError> {
        let mut entry = std::mem::take(&mut self.entry);
        entry.clear();
        replay::Writer(|part: &[u8]| entry.extend_from_slice(part)).entry(at, input);
        self.entry = entry;
        self.send_entry(at.micros(), Topic::Input)
    }

    fn output(&mut self, at: Instant, record: &Record) -> Result<(), McapError> {
        self.entry.clear();
        record.write(|part| self.entry.extend_from_slice(part));
        self.send_entry(at.micros(), Topic::Output)
    }

    fn images(
        &mut self,
        at_us: u64,
        stamp_us: u64,
        frame: u32,
        images: &[Image],
    ) -> Result<(), McapError> {
        for (index, image) in images.iter().enumerate() {
            let Some(&channel) = self.cameras.get(index) else {
                break;
            };
            // A camera without an image has no message.
            if image.is_missing() {
                continue;
            }
            match self.form {
                ImageForm::Png => message::png(&mut self.message, stamp_us, &png(image)?),
                ImageForm::Raw | ImageForm::None => {
                    message::image(&mut self.message, stamp_us, image);
                }
            }
            self.put(
                at_us,
                Channel {
                    sequence: frame,
                    ..channel
                },
            )?;
        }
        Ok(())
    }

    fn measurement(&mut self, at_us: u64, measurement: &Measurement) -> Result<(), McapError> {
        measurement.encode(&mut self.message);
        self.send(at_us, Topic::Measurement)?;
        if measurement.cameras.is_empty() {
            return Ok(());
        }
        message::pose(&mut self.message, measurement);
        self.send(at_us, Topic::Displacement)
    }

    fn status(&mut self, at_us: u64, status: &Status) -> Result<(), McapError> {
        message::status(&mut self.message, status);
        self.send(at_us, Topic::Status)?;
        let last = self.last.replace(*status);
        for (kind, text) in last.iter().flat_map(|last| changes(last, status)) {
            self.event(at_us, kind, text)?;
        }
        Ok(())
    }

    fn event(&mut self, at_us: u64, kind: &str, text: String) -> Result<(), McapError> {
        let kind = kind.to_owned();
        let event = Event { at_us, kind, text };
        event.encode(&mut self.message);
        self.send(at_us, Topic::Events)
    }

    fn end(&mut self, tap: &Tap) -> Result<(), McapError> {
        let dropped = tap.dropped();
        let counts = [
            ("frame_sets_dropped", dropped.frame_sets),
            ("messages_dropped", dropped.messages),
            ("messages", self.messages),
        ];
        let counts = counts.map(|(name, count)| (name.to_owned(), count.to_string()));
        self.writer.write_metadata(&Metadata {
            name: topic::END.to_owned(),
            metadata: BTreeMap::from(counts),
        })?;
        self.writer.finish().map(drop)
    }
}

/// Writes the entries of the queue until it is closed.
///
/// # Errors
/// The first write that failed; the file then ends with its last whole chunk.
pub(crate) fn run(tap: &Tap, mut opened: Opened) -> io::Result<Ended> {
    let outcome = write_all(tap, &mut opened);
    let messages = opened.messages;
    let mut sink = opened.writer.into_inner();
    let flushed = sink.flush();
    match outcome.and(flushed.map_err(McapError::Io)) {
        Ok(()) => Ok(Ended {
            messages,
            bytes: sink.written(),
            processor: processor(),
        }),
        Err(error) => {
            sink.rescue();
            Err(failed(error))
        }
    }
}

fn write_all(tap: &Tap, opened: &mut Opened) -> Result<(), McapError> {
    let mut dropped = tap.dropped();
    loop {
        match tap.queue().pop(opened.patience()) {
            Popped::Entry(timed) => {
                let at_us = timed.at_us;
                opened.write(timed)?;
                let now = tap.dropped();
                if now != dropped {
                    let frame_sets = now.frame_sets - dropped.frame_sets;
                    let messages = now.messages - dropped.messages;
                    let text = format!("dropped: {frame_sets} frame sets, {messages} messages");
                    opened.event(at_us, "recording", text)?;
                    dropped = now;
                }
            }
            Popped::Nothing => {}
            Popped::Closed => return opened.end(tap),
        }
        if opened.waiting > 0 && opened.since.elapsed() >= FLUSH {
            opened.flush()?;
        }
    }
}

/// Returns the processor time of the calling thread.
#[cfg(unix)]
fn processor() -> Option<Duration> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Some(Duration::new(time.tv_sec as u64, time.tv_nsec as u32))
}

#[cfg(not(unix))]
fn processor() -> Option<Duration> {
    None
}
