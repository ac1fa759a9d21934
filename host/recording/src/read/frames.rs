//! Frame sets of a source: images of all cameras, matched by the stamps in their headers.

use super::image::{self, KINDS};
use super::survey::{Channels, Message, Survey};
use super::{Contents, Source};
use std::collections::VecDeque;
use std::path::Path;
use trinocular_rig::error::InputError;
use trinocular_vision::images::{FrameSet, Image};

/// Default tolerance between the stamps of a frame set, µs.
pub const TOLERANCE_US: u64 = 5_000;

/// Images of one camera that wait for those of the others. A camera that is behind by more counts
/// as missing.
const MOST_WAITING: usize = 16;

/// Largest memory for images that wait, bytes.
const MOST_BYTES: usize = 512 << 20;

/// Topic of each camera, in the rig's order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topics(Vec<String>);

fn is_image(kind: &str, encoding: &str) -> bool {
    KINDS.contains(&kind) && encoding == "cdr"
}

impl Topics {
    /// Finds the topic with the images of each camera: the one that `chosen` names for it, or the
    /// only one with the camera's name between two slashes.
    ///
    /// # Errors
    /// [`InputError`] with the topics that have images, if none or several fit a camera.
    pub fn find(
        path: &Path,
        survey: &Survey,
        names: &[String],
        chosen: &[(String, String)],
    ) -> Result<Self, InputError> {
        let images = survey.topics.iter();
        let images = images.filter(|(_, topic)| is_image(&topic.kind, &topic.encoding));
        let images: Vec<&str> = images.map(|(name, _)| name.as_str()).collect();
        let listed = || match images.as_slice() {
            [] => "no topic has images (sensor_msgs/Image or CompressedImage in CDR)".to_owned(),
            images => format!("topics with images: {}", images.join(", ")),
        };
        if let Some((camera, _)) = chosen.iter().find(|(camera, _)| !names.contains(camera)) {
            let reason = format!("--topic names the camera {camera:?}, which the rig has not");
            return Err(InputError::file(path, reason));
        }
        let of_camera = |name: &String| {
            if let Some((_, topic)) = chosen.iter().find(|(camera, _)| camera == name) {
                return match images.contains(&topic.as_str()) {
                    true => Ok(topic.clone()),
                    false => {
                        let reason = format!("has no images on {topic}; {}", listed());
                        Err(InputError::file(path, reason))
                    }
                };
            }
            let fits = |topic: &&&str| topic.split('/').any(|part| part == name);
            let fitting: Vec<&&str> = images.iter().filter(fits).collect();
            let raw = fitting.iter().find(|topic| topic.ends_with("/image_raw"));
            match (fitting.as_slice(), raw) {
                ([topic], _) => Ok((**topic).to_owned()),
                (_, Some(raw)) => Ok((**raw).to_string()),
                (fitting, None) => {
                    let count = if fitting.is_empty() {
                        "no"
                    } else {
                        "more than one"
                    };
                    let reason = format!(
                        "{count} topic has images of the camera {name:?}; name it with --topic \
                         {name}=/TOPIC; {}",
                        listed()
                    );
                    Err(InputError::file(path, reason))
                }
            }
        };
        let topics: Vec<String> = names.iter().map(of_camera).collect::<Result<_, _>>()?;
        for (index, topic) in topics.iter().enumerate() {
            if topics[..index].contains(topic) {
                let reason = format!("{topic} would be the images of two cameras");
                return Err(InputError::file(path, reason));
            }
        }
        Ok(Self(topics))
    }

    /// Returns the topic of each camera.
    pub fn names(&self) -> &[String] {
        &self.0
    }
}

/// Counts of images that belong to no frame set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Leftover {
    /// Images without partners within the tolerance.
    pub alone: usize,
    /// Images that came later than their frame set.
    pub late: usize,
}

/// Iterator over the frame sets of a source.
///
/// An image that cannot be read makes its frame set an error, and the iteration goes on.
pub struct FrameSets<'a> {
    source: &'a Source,
    contents: Contents<'a>,
    channels: Channels,
    topics: Topics,
    size_px: [u32; 2],
    tolerance_ns: u64,
    waiting: Vec<VecDeque<(u64, Result<Image, String>)>>,
    bytes: usize,
    /// Stamp of the last frame set, ns.
    last_ns: Option<u64>,
    leftover: Leftover,
    is_over: bool,
}

impl<'a> FrameSets<'a> {
    /// Begins to read the frame sets. `size_px` (width, height) is the size that every image must
    /// have.
    pub fn new(source: &'a Source, topics: Topics, size_px: [u32; 2], tolerance_us: u64) -> Self {
        Self {
            contents: source.records(),
            channels: Channels::default(),
            waiting: topics.0.iter().map(|_| VecDeque::new()).collect(),
            topics,
            source,
            size_px,
            tolerance_ns: tolerance_us.saturating_mul(1_000),
            bytes: 0,
            last_ns: None,
            leftover: Leftover::default(),
            is_over: false,
        }
    }

    /// Returns the counts of images without a frame set so far.
    pub fn leftover(&self) -> Leftover {
        self.leftover
    }

    /// Returns the place at which a file was cut off.
    pub fn cut(&self) -> Option<&InputError> {
        self.contents.cut()
    }

    /// Reads on to the next image. Returns false at the end.
    fn read_on(&mut self) -> Result<bool, InputError> {
        for record in self.contents.by_ref() {
            let (file, record) = record?;
            let Some(Message {
                topic,
                kind,
                encoding,
                data,
                ..
            }) = self.channels.message(file, record)
            else {
                continue;
            };
            let camera = self.topics.0.iter().position(|known| known == topic);
            let (Some(camera), true) = (camera, is_image(kind, encoding)) else {
                continue;
            };
            let path = self.source.path();
            let stamp_ns = image::stamp_ns(&data).map_err(|fault| {
                InputError::file(path, format!("an image on {topic} is malformed: {fault}"))
            })?;
            if self.last_ns.is_some_and(|last_ns| stamp_ns <= last_ns) {
                self.leftover.late += 1;
                continue;
            }
            let image = match image::read(kind, &data) {
                Ok(image) if [image.width as u32, image.height as u32] == self.size_px => Ok(image),
                Ok(image) => {
                    let [w, h] = self.size_px;
                    Err(format!(
                        "an image on {topic} has {} x {} px, but the rig's images have {w} x {h} px",
                        image.width, image.height
                    ))
                }
                Err(fault) => Err(format!("an image on {topic}: {fault}")),
            };
            self.bytes += image.as_ref().map_or(0, |image| image.grey.len());
            let queue = &mut self.waiting[camera];
            // Bags keep the order of arrival, which may differ from that of the stamps.
            let place = queue.partition_point(|(before, _)| *before <= stamp_ns);
            queue.insert(place, (stamp_ns, image));
            return Ok(true);
        }
        Ok(false)
    }

    /// Returns true if the oldest frame set can be taken.
    fn is_complete(&self) -> bool {
        let has_all = self.waiting.iter().all(|queue| !queue.is_empty());
        let is_long = |queue: &VecDeque<_>| queue.len() >= MOST_WAITING;
        has_all || self.bytes > MOST_BYTES || self.waiting.iter().any(is_long)
    }

    /// Takes the oldest images within the tolerance; `None` if only one camera has one.
    fn take(&mut self) -> Option<Result<FrameSet, InputError>> {
        let heads = self.waiting.iter().filter_map(|queue| queue.front());
        let oldest_ns = heads.map(|(stamp_ns, _)| *stamp_ns).min()?;
        let mut images = Vec::new();
        let mut fault = None;
        for queue in &mut self.waiting {
            let is_near = |head: &mut (u64, _)| head.0 - oldest_ns <= self.tolerance_ns;
            let image = match queue.pop_front_if(is_near) {
                Some((_, Ok(image))) => image,
                Some((_, Err(reason))) => {
                    fault.get_or_insert(reason);
                    Image::missing()
                }
                None => Image::missing(),
            };
            self.bytes -= image.grey.len();
            images.push(image);
        }
        let there = images.iter().filter(|image| !image.is_missing()).count();
        self.last_ns = Some(oldest_ns);
        let time_us = oldest_ns / 1_000;
        match fault {
            Some(reason) => Some(Err(InputError::file(self.source.path(), reason))),
            None if there < 2.min(images.len()) => {
                self.leftover.alone += there;
                None
            }
            None => Some(Ok(FrameSet { time_us, images })),
        }
    }
}

impl Iterator for FrameSets<'_> {
    type Item = Result<FrameSet, InputError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            while !self.is_over && !self.is_complete() {
                match self.read_on() {
                    Ok(true) => {}
                    Ok(false) => self.is_over = true,
                    Err(error) => {
                        self.is_over = true;
                        self.waiting.iter_mut().for_each(VecDeque::clear);
                        return Some(Err(error));
                    }
                }
            }
            if self.waiting.iter().all(VecDeque::is_empty) {
                return None;
            }
            if let Some(taken) = self.take() {
                return Some(taken);
            }
        }
    }
}
