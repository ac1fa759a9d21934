//! Frame sets of a source: images of all cameras, matched by the stamps in their headers.

use super::image;
use super::stamps::Stamps;
use super::survey::{Channels, Message};
use super::topics::is_image;
use super::{Contents, Source};
use std::collections::VecDeque;
use trinocular_rig::error::InputError;
use trinocular_vision::images::decode::{Picture, bits_in_use, scale};
use trinocular_vision::images::exposure::{ExposureFault, MOST_SATURATED};
use trinocular_vision::images::{FrameSet, Image};

pub use super::topics::Topics;

/// Default tolerance between the stamps of a frame set, µs.
pub const TOLERANCE_US: u64 = 5_000;

/// Images of one camera that wait for those of the others. A camera that is behind by more counts
/// as missing.
const MOST_WAITING: usize = 16;

/// Largest memory for images that wait, bytes.
const MOST_BYTES: usize = 512 << 20;

/// Counts of images that belong to no frame set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Leftover {
    /// Images without partners within the tolerance.
    pub alone: usize,
    /// Images that came later than their frame set.
    pub late: usize,
    /// Images on a topic that had one of the same stamp.
    pub repeated: usize,
}

/// Returns the bytes of a picture in memory.
fn bytes(picture: &Picture) -> usize {
    match picture {
        Picture::Eight(image) => image.grey.len(),
        Picture::Sixteen { levels, .. } => size_of_val(levels.as_slice()),
    }
}

/// Iterator over the frame sets of a source.
///
/// An image that cannot be read makes its frame set an error, and the iteration goes on. Images of 16
/// bits are scaled by the most bits that a frame set has used so far, all of a frame set alike, as
/// those of a [`Folder`](trinocular_vision::images::Folder). A repeated message (same topic, same
/// stamp) is dropped.
pub struct FrameSets<'a> {
    source: &'a Source,
    contents: Contents<'a>,
    channels: Channels,
    topics: Topics,
    size_px: [u32; 2],
    tolerance_ns: u64,
    waiting: Vec<VecDeque<(u64, Result<Picture, String>)>>,
    bytes: usize,
    /// Stamp of the last frame set, ns.
    last_ns: Option<u64>,
    /// Stamp of each camera's last image that was taken, ns.
    taken_ns: Vec<Option<u64>>,
    stamps: Stamps,
    leftover: Leftover,
    /// Repeated images of each camera.
    repeated: Vec<usize>,
    /// Most bits in use so far.
    depth_bits: u32,
    /// The scale of 16-bit images, and saturation, not yet told.
    warnings: Vec<InputError>,
    is_over: bool,
}

impl<'a> FrameSets<'a> {
    /// Begins to read the frame sets. `size_px` (width, height) is the size that every image must
    /// have.
    pub fn new(source: &'a Source, topics: Topics, size_px: [u32; 2], tolerance_us: u64) -> Self {
        Self {
            contents: source.records(),
            channels: Channels::default(),
            waiting: topics.names().iter().map(|_| VecDeque::new()).collect(),
            taken_ns: vec![None; topics.names().len()],
            stamps: Stamps::new(topics.names().len()),
            repeated: vec![0; topics.names().len()],
            depth_bits: 0,
            warnings: Vec::new(),
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

    /// Returns the topics with repeated images, and how many each has so far.
    pub fn repeated(&self) -> impl Iterator<Item = (&str, usize)> {
        let topics = self.topics.names().iter().map(String::as_str);
        let counts = topics.zip(self.repeated.iter().copied());
        counts.filter(|(_, count)| *count > 0)
    }

    /// Describes stamps by which no order of the images is known: all alike, or running backwards.
    pub fn doubt(&self) -> Option<String> {
        self.stamps.doubt()
    }

    /// Takes the warnings since the last call: the scale of 16-bit images, once and whenever it
    /// grows, and saturation in the frame set that shows it.
    pub fn take_warnings(&mut self) -> Vec<InputError> {
        std::mem::take(&mut self.warnings)
    }

    /// Returns why the end of the source is missing.
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
            let camera = self.topics.names().iter().position(|known| known == topic);
            let (Some(camera), true) = (camera, is_image(kind, encoding)) else {
                continue;
            };
            let path = self.source.path();
            let stamp_ns = image::stamp_ns(&data).map_err(|fault| {
                InputError::file(path, format!("an image on {topic} is malformed: {fault}"))
            })?;
            self.stamps.take(camera, stamp_ns);
            let queue = &mut self.waiting[camera];
            let waits = queue.iter().any(|(other_ns, _)| *other_ns == stamp_ns);
            if waits || self.taken_ns[camera] == Some(stamp_ns) {
                self.leftover.repeated += 1;
                self.repeated[camera] += 1;
                continue;
            }
            if self.last_ns.is_some_and(|last_ns| stamp_ns <= last_ns) {
                self.leftover.late += 1;
                continue;
            }
            let image = match image::read_deep(kind, &data) {
                Ok(image) if image.size_px() == self.size_px => Ok(image),
                Ok(image) => {
                    let ([w, h], [width, height]) = (self.size_px, image.size_px());
                    Err(format!(
                        "an image on {topic} has {width} x {height} px, but the rig's images have \
                         {w} x {h} px"
                    ))
                }
                Err(fault) => Err(format!("an image on {topic}: {fault}")),
            };
            self.bytes += image.as_ref().map_or(0, bytes);
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
        let mut views = Vec::new();
        let mut fault = None;
        for (queue, taken_ns) in self.waiting.iter_mut().zip(&mut self.taken_ns) {
            let is_near = |head: &mut (u64, _)| head.0 - oldest_ns <= self.tolerance_ns;
            let view = queue.pop_front_if(is_near).and_then(|(stamp_ns, image)| {
                *taken_ns = Some(stamp_ns);
                match image {
                    Ok(view) => Some(view),
                    Err(reason) => {
                        fault.get_or_insert(reason);
                        None
                    }
                }
            });
            let view = view.unwrap_or_else(|| Picture::Eight(Image::missing()));
            self.bytes -= bytes(&view);
            views.push(view);
        }
        let images = self.scaled(views);
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

impl FrameSets<'_> {
    /// Scales the images of a frame set, all alike, and keeps warnings of scale and saturation.
    fn scaled(&mut self, views: Vec<Picture>) -> Vec<Image> {
        let is_deep = |view: &Picture| matches!(view, Picture::Sixteen { .. });
        let bits = bits_in_use(&views, self.depth_bits.max(8));
        if views.iter().any(is_deep) && bits > self.depth_bits {
            self.depth_bits = bits;
            let path = self.source.path();
            self.warnings.push(InputError::file(path, scale(bits)));
            for (topic, view) in self.topics.names().iter().zip(&views) {
                let share = view.saturated(bits);
                if share > MOST_SATURATED {
                    let fault = ExposureFault::Saturated(share);
                    let warning = InputError::file(path, format!("{topic}: {fault}"));
                    self.warnings.push(warning);
                }
            }
        }
        views.into_iter().map(|view| view.scaled(bits)).collect()
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
