//! Survey of a source: its topics, where it came from, and the rig that it holds.

use super::Source;
use super::records::Record;
use crate::regions;
use crate::topic::{self, Topic};
use std::collections::{BTreeMap, HashMap};
use trinocular_core::rig::MAX_CAMERAS;
use trinocular_rig::error::InputError;

/// Most topics that are remembered; a robot has some hundred.
const MOST_TOPICS: usize = 10_000;

/// Longest rig file, mask, and message with a camera's calibration, bytes.
const LONGEST: usize = 4 << 20;

/// One topic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TopicSurvey {
    /// Type of its messages, without `msg`: `sensor_msgs/Image`.
    pub kind: String,
    /// Encoding of its messages.
    pub encoding: String,
    /// Number of messages.
    pub count: u64,
    /// Instants of the first and of the last message, ns.
    pub span_ns: [u64; 2],
    /// The first message of a topic with a camera's calibration.
    pub first: Option<Vec<u8>>,
}

impl TopicSurvey {
    /// Returns the mean time between two messages, µs.
    pub fn period_us(&self) -> u64 {
        let [first, last] = self.span_ns;
        last.saturating_sub(first) / 1_000 / self.count.saturating_sub(1).max(1)
    }
}

/// Topics and other parts of a source.
#[derive(Clone, Debug, Default)]
pub struct Survey {
    /// Topics by name.
    pub topics: BTreeMap<String, TopicSurvey>,
    /// Origin of a recording of this program.
    pub origin: Option<BTreeMap<String, String>>,
    /// Counts at the end of a recording of this program; `None` after a crash or a full disk.
    pub end: Option<BTreeMap<String, String>>,
    /// Text of the rig file within the source.
    pub rig: Option<String>,
    /// Files of the masks within a recording of this program, by name.
    pub masks: BTreeMap<String, Vec<u8>>,
    /// Reason why the end is missing: a file was cut off, or its run did not end it.
    pub cut: Option<InputError>,
}

/// Returns the type of a message without the middle part that ROS 2 has and ROS 1 has not.
fn short(name: &str) -> String {
    name.replace("/msg/", "/")
}

/// Type of the messages with a camera's calibration.
pub const CAMERA_INFO: &str = "sensor_msgs/CameraInfo";

/// Channels of a source: topic and type by file and number.
#[derive(Debug, Default)]
pub struct Channels {
    schemas: HashMap<(usize, u16), String>,
    channels: HashMap<(usize, u16), (String, String, String)>,
}

/// Message with what its channel says of it.
#[derive(Debug)]
pub struct Message<'a> {
    /// Topic.
    pub topic: &'a str,
    /// Type, such as `sensor_msgs/Image`.
    pub kind: &'a str,
    /// Encoding, such as `cdr`.
    pub encoding: &'a str,
    /// Sequence number.
    pub sequence: u32,
    /// Instant of recording, ns.
    pub log_time: u64,
    /// Encoded message.
    pub data: Vec<u8>,
}

impl Channels {
    /// Takes in a schema or a channel. Other records change nothing.
    pub fn take(&mut self, file: usize, record: &Record) {
        match record {
            Record::Schema { id, name, .. } if name.len() <= 1_000 => {
                self.schemas.insert((file, *id), short(name));
            }
            Record::Channel {
                id,
                schema,
                topic,
                encoding,
            } => {
                let kind = self.schemas.get(&(file, *schema)).cloned();
                let channel = (topic.clone(), kind.unwrap_or_default(), encoding.clone());
                self.channels.insert((file, *id), channel);
            }
            _ => {}
        }
    }

    /// Takes in a record; returns it as a message if it is one on a known channel.
    pub fn message(&mut self, file: usize, record: Record) -> Option<Message<'_>> {
        self.take(file, &record);
        let Record::Message {
            channel,
            sequence,
            log_time,
            data,
        } = record
        else {
            return None;
        };
        let (topic, kind, encoding) = self.get(file, channel)?;
        Some(Message {
            topic,
            kind,
            encoding,
            sequence,
            log_time,
            data,
        })
    }

    /// Returns topic, type and encoding of a channel.
    pub fn get(&self, file: usize, id: u16) -> Option<(&str, &str, &str)> {
        let (topic, kind, encoding) = self.channels.get(&(file, id))?;
        Some((topic, kind, encoding))
    }
}

impl Survey {
    /// Returns why a recording of this program holds no images; `None` for other files.
    pub fn imageless(&self) -> Option<String> {
        self.origin.as_ref()?;
        let has_measurements = self.topics.contains_key(Topic::Measurement.name());
        match (&self.cut, has_measurements) {
            (Some(cut), false) => Some(format!("holds no images: it {}", cut.reason)),
            (None, false) => Some("holds no images: none were followed in its run".to_owned()),
            (_, true) => Some(
                "was recorded without images (with --record-images none, or of simulate --points): \
                 replay, report and export --csv read it; record the run again with images"
                    .to_owned(),
            ),
        }
    }

    /// Reads the source once.
    ///
    /// # Errors
    /// [`InputError`] if a file is damaged or no MCAP file. A file that is cut off is read up to
    /// there.
    pub fn of(source: &Source) -> Result<Self, InputError> {
        let mut survey = Self::default();
        let mut channels = Channels::default();
        let mut records = source.records();
        for record in records.by_ref() {
            let (file, record) = record?;
            channels.take(file, &record);
            match record {
                Record::Message {
                    channel,
                    data,
                    log_time,
                    ..
                } => {
                    let Some((name, kind, encoding)) = channels.get(file, channel) else {
                        let reason = format!("has a message on channel {channel}, which is none");
                        return Err(InputError::file(source.path(), reason));
                    };
                    if !survey.topics.contains_key(name) && survey.topics.len() >= MOST_TOPICS {
                        continue;
                    }
                    let topic = survey.topics.entry(name.to_owned()).or_default();
                    topic.count += 1;
                    topic.span_ns[1] = log_time;
                    if topic.count == 1 {
                        topic.span_ns[0] = log_time;
                        topic.kind = kind.to_owned();
                        topic.encoding = encoding.to_owned();
                        topic.first =
                            (kind == CAMERA_INFO && data.len() <= LONGEST).then_some(data);
                    }
                }
                Record::Metadata { name, texts } => {
                    let part = match name.as_str() {
                        topic::ORIGIN => &mut survey.origin,
                        topic::END => &mut survey.end,
                        _ => continue,
                    };
                    *part = Some(texts.into_iter().collect());
                }
                Record::Attachment { name, data }
                    if name == topic::RIG && data.len() <= LONGEST =>
                {
                    survey.rig = String::from_utf8(data).ok();
                }
                Record::Attachment { name, data }
                    if regions::is_mask(&name)
                        && data.len() <= LONGEST
                        && survey.masks.len() < MAX_CAMERAS =>
                {
                    survey.masks.insert(name, data);
                }
                _ => {}
            }
        }
        survey.cut = records.cut().cloned();
        Ok(survey)
    }
}
