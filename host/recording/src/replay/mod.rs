//! Replay of a recording: measurements and station run again, and are compared bit for bit.
//!
//! * Every frame set is measured anew, in the recorded order, and compared with its measurement.
//! * The sums of every measurement are compared with the frame that went to the station.
//! * An emulated station gets the recorded inputs at their instants. Its packets, segments and step
//!   edges are compared with those of the recorded twin. A station on a line has no such record,
//!   because the arrival of bytes at the board cannot be known.

mod difference;
mod measuring;
mod station;

pub use difference::{Comparison, Difference};

use crate::message::{Measurement, read_entry};
use crate::read::Source;
use crate::read::image;
use crate::read::survey::{Channels, Message};
use crate::topic::{ImageTopics, Topic};
use measuring::Measuring;
use station::StationReplay;
use trinocular_core::rig::Rig;
use trinocular_rig::error::InputError;
use trinocular_rig::pivot::Pivot;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::sums::Estimator;

/// Settings of a replay.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The rig of the recording.
    pub rig: Rig,
    /// Names of its cameras.
    pub names: Vec<String>,
    /// The station's estimator.
    pub estimator: Estimator,
    /// Pivot of a target whose rotation was estimated.
    pub pivot: Option<Pivot>,
    /// Regions of interest of the cameras.
    pub regions: Regions,
    /// Name that the recorded twin gave as its board; `None` for a station on a line.
    pub twin: Option<String>,
}

/// Result of a replay.
#[derive(Clone, Debug, Default)]
pub struct Replayed {
    /// Measurements that were compared.
    pub measurements: Comparison,
    /// Frames to the station that were compared with the measurements.
    pub frames: Comparison,
    /// Packets of the station.
    pub packets: Comparison,
    /// Segments of the station.
    pub segments: Comparison,
    /// Edges at the pins.
    pub edges: Comparison,
    /// Frame sets whose images are not in the file, and those that depend on them.
    pub not_measured: u64,
    /// Reason why the end is missing.
    pub cut: Option<InputError>,
}

impl Replayed {
    /// Returns all comparisons with their names.
    pub fn comparisons(&self) -> [(&'static str, &Comparison); 5] {
        [
            ("measurements", &self.measurements),
            ("frames", &self.frames),
            ("packets", &self.packets),
            ("segments", &self.segments),
            ("edges", &self.edges),
        ]
    }

    /// Returns the earliest difference.
    pub fn first_difference(&self) -> Option<&Difference> {
        let all = self.comparisons();
        let found = all.into_iter().filter_map(|(_, c)| c.first.as_ref());
        found.min_by_key(|difference| difference.at_us)
    }
}

/// Returns the station's input log and the records of its outputs, for a replay elsewhere: on the
/// emulated board, for instance. An edge message is left out, because the records have checksums.
///
/// # Errors
/// [`InputError`] if the file is damaged, or holds no outputs of a twin.
pub fn log(source: &Source) -> Result<(Vec<u8>, Vec<trinocular_core::replay::Record>), InputError> {
    let bad = |what: String| InputError::file(source.path(), what);
    let (mut log, mut outputs) = (Vec::new(), Vec::new());
    let mut channels = Channels::default();
    for record in source.records() {
        let (file, record) = record?;
        let Some(message) = channels.message(file, record) else {
            continue;
        };
        let is_input = message.topic == Topic::Input.name();
        if !is_input && message.topic != Topic::Output.name() {
            continue;
        }
        let mut entry =
            read_entry(&message.data).map_err(|fault| bad(format!("an entry: {fault}")))?;
        match is_input {
            true => log.extend_from_slice(entry),
            false => {
                let output = trinocular_core::replay::Record::read(&mut entry);
                outputs.push(output.ok_or_else(|| bad("an output is no record".to_owned()))?);
            }
        }
    }
    Ok((log, outputs))
}

/// Replays a recording of this program. Calls `progress` with the number of each frame set.
///
/// # Errors
/// [`InputError`] if the file is damaged, or the flow refuses the rig.
pub fn replay(
    source: &Source,
    settings: &Settings,
    mut progress: impl FnMut(u32),
) -> Result<Replayed, InputError> {
    let bad = |what: String| InputError::file(source.path(), what);
    let topics = ImageTopics::new(&settings.names);
    let mut measuring =
        Measuring::new(settings).map_err(|refusal| bad(format!("no measurement: {refusal}")))?;
    let mut station = match &settings.twin {
        Some(board) => Some(StationReplay::new(board).map_err(bad)?),
        None => None,
    };
    let mut channels = Channels::default();
    let mut records = source.records();
    for record in records.by_ref() {
        let (file, record) = record?;
        let Some(Message {
            topic: name,
            kind,
            sequence,
            data,
            ..
        }) = channels.message(file, record)
        else {
            continue;
        };
        let malformed = |fault| bad(format!("a message on {name} is malformed: {fault}"));
        if let Some(camera) = topics.camera(name) {
            let image = image::read(kind, &data);
            let image = image.map_err(|fault| bad(format!("an image on {name}: {fault}")))?;
            measuring.image(sequence, camera, image);
            continue;
        }
        let Some(topic) = Topic::ALL.into_iter().find(|topic| topic.name() == name) else {
            continue;
        };
        match topic {
            Topic::Measurement => {
                let recorded = Measurement::decode(&data).map_err(malformed)?;
                progress(recorded.frame);
                measuring.measure(&recorded);
            }
            Topic::Input => {
                let entry = read_entry(&data).map_err(malformed)?;
                let input = measuring.input(entry);
                let input = input.map_err(|fault| bad(format!("an input: {fault}")))?;
                if let (Some(station), Some((at, input))) = (&mut station, input) {
                    station.input(at, input).map_err(bad)?;
                }
            }
            Topic::Output | Topic::Edges => {
                let entry = read_entry(&data).map_err(malformed)?;
                if let Some(station) = &mut station {
                    station.output(topic, entry).map_err(bad)?;
                }
            }
            Topic::Displacement | Topic::Status | Topic::Events => {}
        }
    }
    let cut = records.cut().cloned();
    let mut replayed = Replayed {
        not_measured: measuring.not_measured,
        measurements: measuring.measurements,
        frames: measuring.frames,
        cut,
        ..Replayed::default()
    };
    if let Some(station) = station {
        [replayed.packets, replayed.segments, replayed.edges] = station.finish().map_err(bad)?;
    }
    Ok(replayed)
}
