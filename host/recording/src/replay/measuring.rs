//! Measurements again, from the recorded images.

use super::Settings;
use super::difference::{Comparison, Difference, first_field};
use crate::message::{Measurement, Outcome};
use std::collections::BTreeMap;
use trinocular_core::frame::message::{Command, Frame, Packet, Sums};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::replay::{Entry, Log, LogFault};
use trinocular_core::rig::Rig;
use trinocular_core::time::Instant;
use trinocular_vision::flow::{Flow, FlowRefusal, FlowSettings};
use trinocular_vision::images::{FrameSet, Image};
use trinocular_vision::measure::{MeasureRefusal, measure};
use trinocular_vision::sums::Estimator;

/// Frames that wait for their measurement or their packet. Older ones were lost on the way.
const MOST_WAITING: usize = 1_000;

/// The measurements of a replay.
pub(super) struct Measuring {
    flow: Flow,
    rig: Rig,
    estimator: Estimator,
    cameras: usize,
    /// Images of the next frame set, with its number.
    images: (u32, Vec<Image>),
    /// True while the flow has lived through the same frame sets as the recorded one.
    is_whole: bool,
    receiver: Receiver<Packet>,
    /// Frames by capture time: as measured here, and as recorded on their way to the station.
    measured: BTreeMap<u64, Frame>,
    sent: BTreeMap<u64, Frame>,
    pub measurements: Comparison,
    pub frames: Comparison,
    /// Measurements that cannot be compared.
    pub not_measured: u64,
}

impl Measuring {
    pub fn new(settings: &Settings) -> Result<Self, FlowRefusal> {
        let mut flow = Flow::new(&settings.rig, FlowSettings::default())?;
        flow.set_pivot(settings.pivot);
        flow.set_regions(settings.regions.clone());
        Ok(Self {
            flow,
            rig: settings.rig.clone(),
            estimator: settings.estimator,
            cameras: settings.names.len(),
            images: (0, Vec::new()),
            is_whole: false,
            receiver: Receiver::default(),
            measured: BTreeMap::new(),
            sent: BTreeMap::new(),
            measurements: Comparison::default(),
            frames: Comparison::default(),
            not_measured: 0,
        })
    }

    /// Takes in an image of frame set `number`.
    pub fn image(&mut self, number: u32, camera: usize, image: Image) {
        let (present, images) = &mut self.images;
        if *present != number || images.is_empty() {
            *present = number;
            *images = vec![Image::missing(); self.cameras];
        }
        if let Some(place) = images.get_mut(camera) {
            *place = image;
        }
    }

    /// Measures the frame set of a recorded measurement, and compares.
    pub fn measure(&mut self, recorded: &Measurement) {
        let (number, images) = std::mem::take(&mut self.images);
        let is_there = !images.is_empty() && number == recorded.frame;
        let set = FrameSet {
            time_us: recorded.stamp_us,
            images,
        };
        let is_keyframe = recorded.outcome == Outcome::Keyframe;
        // A keyframe begins anew; all else depends on the frame sets before it.
        self.is_whole = is_there && (is_keyframe || self.is_whole);
        if !self.is_whole {
            self.not_measured += 1;
            return;
        }
        let mut replayed = Measurement {
            reason: recorded.reason.clone(),
            ..Measurement::default()
        };
        if is_keyframe {
            if let Err(refusal) = self.flow.set_keyframe(&set) {
                replayed.reason = refusal.to_string();
            }
            // A recording that begins in the middle of a run.
            self.flow.set_last_pose(recorded.last_pose());
            replayed.set_last_pose(recorded.last_pose());
        } else {
            match self.sums(&set, &mut replayed) {
                Err(refusal) => replayed.reason = refusal.to_string(),
                Ok(_) if recorded.outcome == Outcome::Refused => replayed.reason.clear(),
                Ok(sums) => {
                    let frame = Frame {
                        capture: Instant::from_micros(recorded.capture_us),
                        reference: Instant::from_micros(recorded.reference_us),
                        sums,
                    };
                    self.measured.insert(recorded.capture_us, frame);
                    self.pair(recorded.capture_us);
                }
            }
        }
        let difference = recorded.difference(&replayed);
        let difference = difference.map(|(field, recorded_value, replayed)| Difference {
            at_us: recorded.capture_us,
            message: format!("measurement of frame set {}", recorded.frame),
            field,
            recorded: recorded_value,
            replayed,
        });
        self.measurements.count(difference);
    }

    fn sums(&mut self, set: &FrameSet, into: &mut Measurement) -> Result<Sums, MeasureRefusal> {
        let (measured, sums) = measure(&mut self.flow, &self.rig, set)?;
        let sums = sums.frame(self.estimator)?;
        into.measured(&self.rig, &measured);
        Ok(sums)
    }

    /// Takes in an entry of the station's input log, and returns its content.
    ///
    /// # Errors
    /// [`LogFault`] if the bytes are no entry.
    pub fn input<'a>(&mut self, entry: &'a [u8]) -> Result<Option<(Instant, Entry<'a>)>, LogFault> {
        let entry = Log::new(entry).entry()?;
        if let Some((_, Entry::Bytes(mut bytes))) = entry {
            while let Some(packet) = self.receiver.next(&mut bytes) {
                let Ok(Packet {
                    command: Command::Frame(frame),
                    ..
                }) = packet
                else {
                    continue;
                };
                self.sent.insert(frame.capture.micros(), frame);
                self.pair(frame.capture.micros());
            }
        }
        Ok(entry)
    }

    /// Compares the frame of this capture time, once both sides have it.
    fn pair(&mut self, capture_us: u64) {
        let is_paired = self.sent.contains_key(&capture_us);
        if is_paired
            && let Some(measured) = self.measured.remove(&capture_us)
            && let Some(sent) = self.sent.remove(&capture_us)
        {
            let difference = first_field(&sent, &measured);
            let difference = difference.map(|(field, recorded, replayed)| Difference {
                at_us: capture_us,
                message: "frame to the station".to_owned(),
                field,
                recorded,
                replayed,
            });
            self.frames.count(difference);
        }
        for waiting in [&mut self.measured, &mut self.sent] {
            if waiting.len() > MOST_WAITING {
                waiting.pop_first();
            }
        }
    }
}
