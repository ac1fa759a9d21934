//! Reading of a recording as a story.

use super::{HandEye, Provenance, Story};
use std::borrow::Cow;
use std::collections::BTreeMap;
use trinocular_core::frame::message::{Command, MATRIX_BITS, Packet};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::replay::{Entry, Log};
use trinocular_core::rig::MAX_CAMERAS;
use trinocular_core::safety::Inputs;
use trinocular_recording::cdr::{CdrFault, Reader};
use trinocular_recording::message::{Event, Measurement, read_entry, read_header};
use trinocular_recording::read::image;
use trinocular_recording::read::survey::{Channels, Message, Survey};
use trinocular_recording::read::{Source, calibration};
use trinocular_recording::topic::{ImageTopics, STAGE, Topic};
use trinocular_rig::error::InputError;
use trinocular_vision::images::Image;

/// A recording, read.
#[derive(Clone, Debug, Default)]
pub struct Reading {
    /// The run.
    pub story: Story,
    /// Where it came from.
    pub provenance: Provenance,
    /// Reason why the end is missing, as after a crash or a full disk.
    pub cut: Option<InputError>,
    /// Number of frame sets and of other messages that the recorder had no room for.
    pub dropped: [u64; 2],
}

/// Reads a recording of this program, whose survey has been made.
///
/// # Errors
/// [`InputError`] if the file is damaged, or a message is malformed.
pub fn read(source: &Source, survey: &Survey) -> Result<Reading, InputError> {
    let origin = survey.origin.clone().unwrap_or_default();
    let names: Vec<String> = match origin.get("cameras") {
        Some(names) => names.split(',').map(str::to_owned).collect(),
        None => match calibration::rig(source, survey)? {
            Some((rig, _)) => rig.names,
            None => Vec::new(),
        },
    };
    if names.len() > MAX_CAMERAS {
        let reason = format!("names {} cameras, more than {MAX_CAMERAS}", names.len());
        return Err(InputError::file(source.path(), reason));
    }
    let mut reader = RunReader {
        story: Story::new(&names, HandEye::default()),
        topics: ImageTopics::new(&names),
        images: BTreeMap::new(),
        commands: Receiver::default(),
        was_open: false,
        offset_us: i64::MAX,
        is_at_capture: origin.get(STAGE.0).is_some_and(|text| text == STAGE.1),
    };
    let mut channels = Channels::default();
    let mut records = source.records();
    for record in records.by_ref() {
        let (file, record) = record?;
        if let Some(message) = channels.message(file, record) {
            let name = message.topic;
            reader.message(message).map_err(|fault| {
                let reason = format!("a message on {name} is malformed: {fault}");
                InputError::file(source.path(), reason)
            })?;
        }
    }
    let count = |name: &str| {
        let text = survey.end.as_ref().and_then(|end| end.get(name));
        text.and_then(|text| text.parse().ok()).unwrap_or(0)
    };
    Ok(Reading {
        story: reader.finish(),
        provenance: Provenance {
            origin,
            rig: survey.rig.clone(),
        },
        cut: records.cut().cloned(),
        dropped: [count("frame_sets_dropped"), count("messages_dropped")],
    })
}

struct RunReader {
    story: Story,
    topics: ImageTopics,
    /// Message with the latest image of each camera, and its type.
    images: BTreeMap<usize, (String, Vec<u8>)>,
    commands: Receiver<Packet>,
    /// True while a switch is open, as the recording said last.
    was_open: bool,
    /// Least delay of a status report: the recording's clock minus the station's, µs.
    offset_us: i64,
    /// True if the measurements have the stage's position at the capture, not after the answer.
    is_at_capture: bool,
}

impl RunReader {
    fn message(&mut self, message: Message<'_>) -> Result<(), CdrFault> {
        let log_us = message.log_time / 1_000;
        let is = |topic: Topic| topic.is_of(&message);
        if let Some(camera) = self.topics.camera(message.topic) {
            let kind = message.kind.to_owned();
            self.images.insert(camera, (kind, message.data));
        } else if is(Topic::Measurement) {
            let measurement = Measurement::decode(&message.data)?;
            let images = std::mem::take(&mut self.images);
            let cameras = self.topics.cameras();
            self.story.turn(&measurement, log_us, || {
                let decoded = (0..cameras).map(|camera| decode(images.get(&camera)));
                Some(Cow::Owned(decoded.collect()))
            });
        } else if is(Topic::Status) {
            let stamp_us = read_header(&mut Reader::new(&message.data)?)? / 1_000;
            let delay_us = log_us.wrapping_sub(stamp_us).cast_signed();
            self.offset_us = self.offset_us.min(delay_us);
        } else if is(Topic::Events) {
            let event = Event::decode(&message.data)?;
            // Switches are read from the station's inputs, which have no words of a program.
            if event.kind != "switches" {
                self.story.event(log_us, &event.kind, event.text);
            }
        } else if is(Topic::Input) {
            self.input(log_us, read_entry(&message.data)?);
        }
        Ok(())
    }

    fn input(&mut self, log_us: u64, entry: &[u8]) {
        match Log::new(entry).entry() {
            Ok(Some((_, Entry::Bytes(mut bytes)))) => {
                while let Some(packet) = self.commands.next(&mut bytes) {
                    if let Ok(Packet {
                        command: Command::Config(config),
                        ..
                    }) = packet
                    {
                        let unit = f64::from(1u32 << MATRIX_BITS);
                        self.story.hand_eye = HandEye {
                            mounting: config.mounting,
                            matrix: config.matrix.map(|row| row.map(|q| f64::from(q) / unit)),
                        };
                    }
                }
            }
            Ok(Some((_, Entry::Switches(inputs)))) => {
                let open = switches(&inputs);
                if self.was_open || !open.is_empty() {
                    let text = match open.is_empty() {
                        true => "all switches closed".to_owned(),
                        false => open.join(", "),
                    };
                    self.story.event(log_us, "switches", text);
                }
                self.was_open = !open.is_empty();
            }
            _ => {}
        }
    }

    /// Returns the story with all instants on the station's clock.
    fn finish(mut self) -> Story {
        if self.offset_us != i64::MAX {
            let station = |log_us: u64| log_us.wrapping_sub(self.offset_us.cast_unsigned());
            for turn in &mut self.story.turns {
                turn.stage_us = station(turn.stage_us);
            }
            for event in &mut self.story.events {
                event.at_us = station(event.at_us);
            }
        }
        if self.is_at_capture {
            self.story.place_stage_at_captures();
        }
        self.story
    }
}

/// Decodes a recorded image; one that cannot be read has no picture.
fn decode(message: Option<&(String, Vec<u8>)>) -> Image {
    let decoded = message.and_then(|(kind, data)| image::read(kind, data).ok());
    decoded.unwrap_or_else(Image::missing)
}

/// Returns the inputs that stop a stage, in words.
fn switches(inputs: &Inputs) -> Vec<String> {
    let mut open = Vec::new();
    for (axis, ends) in ["X", "Y", "Z"].iter().zip(inputs.limits) {
        for (end, is_tripped) in ["negative", "positive"].iter().zip(ends) {
            if is_tripped {
                open.push(format!("{end} limit switch of {axis} tripped"));
            }
        }
    }
    if inputs.emergency_stop {
        open.push("emergency stop open".to_owned());
    }
    if inputs.driver_fault {
        open.push("a driver reports a fault".to_owned());
    }
    open
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn open_switches_are_named() {
        let mut inputs = Inputs::default();
        assert!(switches(&inputs).is_empty());
        inputs.limits[2][0] = true;
        inputs.emergency_stop = true;
        let expected = ["negative limit switch of Z tripped", "emergency stop open"];
        assert_eq!(switches(&inputs), expected);
    }
}
