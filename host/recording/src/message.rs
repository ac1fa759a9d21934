//! Messages of a recording, and their CDR encoding.

use crate::cdr::{CdrFault, Reader, Writer};
use trinocular_client::diagnosis::explain;
use trinocular_core::frame::message::Status;
use trinocular_core::rig::Rig;
use trinocular_vision::flow::{self, CameraRefusal};
use trinocular_vision::images::Image;
use trinocular_vision::matching::Reject;
use trinocular_vision::sums::Sums;

/// Name of the coordinate system of images and displacements.
const CAMERAS: &str = "cameras";

/// Name of the coordinate system of the stage.
const STAGE: &str = "stage";

/// Writes a header with a time in µs.
fn header(writer: &mut Writer<'_>, stamp_us: u64, frame: &str) {
    // Times of more than 68 years wrap in ROS 2, too.
    writer.i32((stamp_us / 1_000_000) as i32);
    writer.u32((stamp_us % 1_000_000) as u32 * 1_000);
    writer.text(frame);
}

/// Reads a header; returns its stamp, ns.
///
/// # Errors
/// [`CdrFault`] if it is none.
pub fn read_header(reader: &mut Reader<'_>) -> Result<u64, CdrFault> {
    let seconds = u64::from(reader.i32()?.cast_unsigned());
    let nanoseconds = u64::from(reader.u32()?);
    reader.text()?;
    Ok(seconds * 1_000_000_000 + nanoseconds)
}

/// Encodes a grey image as `sensor_msgs/msg/Image`.
pub fn image(bytes: &mut Vec<u8>, stamp_us: u64, image: &Image) {
    let mut writer = Writer::new(bytes);
    header(&mut writer, stamp_us, CAMERAS);
    // Images have at most 48 million pixels.
    writer.u32(image.height as u32);
    writer.u32(image.width as u32);
    writer.text("mono8");
    writer.u8(0);
    writer.u32(image.width as u32);
    writer.block(&image.grey);
}

/// Encodes a PNG file as `sensor_msgs/msg/CompressedImage`.
pub fn png(bytes: &mut Vec<u8>, stamp_us: u64, file: &[u8]) {
    let mut writer = Writer::new(bytes);
    header(&mut writer, stamp_us, CAMERAS);
    writer.text("png");
    writer.block(file);
}

/// Encodes a displacement as `geometry_msgs/msg/PoseWithCovarianceStamped`, in metres.
pub fn pose(bytes: &mut Vec<u8>, measurement: &Measurement) {
    let mut writer = Writer::new(bytes);
    header(&mut writer, measurement.stamp_us, CAMERAS);
    for mm in measurement.displacement_mm {
        writer.f64(mm * 1e-3);
    }
    writer.f64_array(&[0.0, 0.0, 0.0, 1.0]);
    for row in 0..6 {
        for column in 0..6 {
            let mm2 = match row < 3 && column < 3 {
                true => measurement.covariance_mm2[3 * row + column],
                false => 0.0,
            };
            writer.f64(mm2 * 1e-6);
        }
    }
}

/// Result of one frame set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Outcome {
    /// The frame set became the keyframe.
    Keyframe,
    /// The frame set was measured; its answer is not known here.
    #[default]
    Measured,
    /// The station used the frame.
    Used,
    /// The images gave no frame.
    Refused,
    /// The station did not use the frame.
    Unused,
}

impl Outcome {
    const ALL: [Self; 5] = [
        Self::Keyframe,
        Self::Measured,
        Self::Used,
        Self::Refused,
        Self::Unused,
    ];

    /// Returns the word of the message.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Keyframe => "keyframe",
            Self::Measured => "measured",
            Self::Used => "used",
            Self::Refused => "refused",
            Self::Unused => "unused",
        }
    }
}

/// One frame set: its measurement in the images, and the station's answer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measurement {
    /// Capture time on the clock of the images' source, µs.
    pub stamp_us: u64,
    /// Number of the frame set.
    pub frame: u32,
    /// Capture time on the station's clock, µs.
    pub capture_us: u64,
    /// Capture time of the keyframe on the station's clock, µs.
    pub reference_us: u64,
    /// Result.
    pub outcome: Outcome,
    /// Reason of a refusal.
    pub reason: String,
    /// Displacement of the target since the keyframe, mm.
    pub displacement_mm: [f64; 3],
    /// Covariance of the displacement, mm², row by row.
    pub covariance_mm2: [f64; 9],
    /// Factor on the variance for correlated errors.
    pub variance_inflation: f64,
    /// Active cameras, from 0.
    pub cameras: Vec<u8>,
    /// Inliers: x and y in the keyframe, x and y now, per point and active camera.
    pub pixels: Vec<f64>,
    /// Number of points left out, by the name of the reason.
    pub rejects: Vec<(String, u32)>,
    /// Cameras left out, from 0, each with its reason.
    pub absent: Vec<(u8, String)>,
    /// Position of the stage after the answer, mm.
    pub stage_mm: [f64; 3],
    /// The station's own estimate, mm.
    pub station_mm: [f64; 3],
    /// Standard deviation of the station's estimate, mm.
    pub station_sigma_mm: [f64; 3],
    /// Time from the capture to the first step that it could change, µs.
    pub latency_us: u32,
}

impl Measurement {
    /// Takes over what was measured in the images of `rig`'s cameras.
    pub fn measured(&mut self, rig: &Rig, measured: &flow::Measurement) {
        self.displacement_mm = measured.displacement_mm;
        self.variance_inflation = measured.variance_inflation.factor;
        // A rig has at most eight cameras.
        self.cameras = measured
            .cameras
            .iter()
            .map(|camera| *camera as u8)
            .collect();
        let points = measured.correspondences.iter();
        let pixels = points.flat_map(|point| point.pixels.as_flattened().as_flattened());
        self.pixels = pixels.copied().collect();
        let count = |reject| (format!("{reject:?}"), measured.rejected.of(reject) as u32);
        self.rejects = Reject::ALL.map(count).into();
        self.absent = absent(&measured.refused_cameras);
        let midpoint = Sums::of(rig, measured).map(|sums| sums.estimates().midpoint);
        if let Ok(Ok(estimate)) = midpoint {
            let covariance = estimate.covariance_mm2.as_flattened();
            self.covariance_mm2.copy_from_slice(covariance);
        }
    }

    /// Encodes the message.
    pub fn encode(&self, bytes: &mut Vec<u8>) {
        let mut writer = Writer::new(bytes);
        header(&mut writer, self.stamp_us, CAMERAS);
        writer.u32(self.frame);
        writer.u64(self.capture_us);
        writer.u64(self.reference_us);
        writer.text(self.outcome.name());
        writer.text(&self.reason);
        writer.f64_array(&self.displacement_mm);
        writer.f64_array(&self.covariance_mm2);
        writer.f64(self.variance_inflation);
        writer.block(&self.cameras);
        writer.f64s(&self.pixels);
        writer.length(self.rejects.len());
        self.rejects.iter().for_each(|(name, _)| writer.text(name));
        writer.length(self.rejects.len());
        self.rejects
            .iter()
            .for_each(|(_, count)| writer.u32(*count));
        writer.length(self.absent.len());
        self.absent
            .iter()
            .for_each(|(camera, _)| writer.u8(*camera));
        writer.length(self.absent.len());
        self.absent
            .iter()
            .for_each(|(_, reason)| writer.text(reason));
        writer.f64_array(&self.stage_mm);
        writer.f64_array(&self.station_mm);
        writer.f64_array(&self.station_sigma_mm);
        writer.u32(self.latency_us);
    }

    /// Decodes the message.
    ///
    /// # Errors
    /// [`CdrFault`] if the bytes are none.
    pub fn decode(bytes: &[u8]) -> Result<Self, CdrFault> {
        let mut reader = Reader::new(bytes)?;
        let stamp_us = read_header(&mut reader)? / 1_000;
        let (frame, capture_us) = (reader.u32()?, reader.u64()?);
        let reference_us = reader.u64()?;
        let outcome = reader.text()?;
        let outcome = Outcome::ALL.into_iter().find(|o| o.name() == outcome);
        let mut message = Self {
            stamp_us,
            frame,
            capture_us,
            reference_us,
            outcome: outcome.ok_or(CdrFault::Text)?,
            reason: reader.text()?.to_owned(),
            displacement_mm: reader.array()?,
            covariance_mm2: reader.array()?,
            variance_inflation: reader.f64()?,
            cameras: reader.block()?.to_vec(),
            pixels: reader.f64s()?,
            ..Self::default()
        };
        let (names, counts) = (reader.texts()?, reader.sequence(Reader::u32)?);
        message.rejects = names.into_iter().zip(counts).collect();
        let (cameras, reasons) = (reader.block()?, reader.texts()?);
        message.absent = cameras.iter().copied().zip(reasons).collect();
        message.stage_mm = reader.array()?;
        message.station_mm = reader.array()?;
        message.station_sigma_mm = reader.array()?;
        message.latency_us = reader.u32()?;
        Ok(message)
    }

    /// Returns the first field that differs in a replay, with both values. Only what the images
    /// alone decide is compared.
    pub fn difference(&self, replayed: &Self) -> Option<(String, String, String)> {
        let texts = [
            ("reason", &self.reason, &replayed.reason),
            (
                "cameras",
                &format!("{:?}", self.cameras),
                &format!("{:?}", replayed.cameras),
            ),
            (
                "absent",
                &format!("{:?}", self.absent),
                &format!("{:?}", replayed.absent),
            ),
            (
                "rejects",
                &format!("{:?}", self.rejects),
                &format!("{:?}", replayed.rejects),
            ),
        ];
        for (field, a, b) in texts {
            if a != b {
                return Some((field.to_owned(), a.clone(), b.clone()));
            }
        }
        let inflation = |of: &Self| [of.variance_inflation].to_vec();
        let numbers = [
            (
                "displacement_mm",
                self.displacement_mm.to_vec(),
                replayed.displacement_mm.to_vec(),
            ),
            (
                "covariance_mm2",
                self.covariance_mm2.to_vec(),
                replayed.covariance_mm2.to_vec(),
            ),
            ("variance_inflation", inflation(self), inflation(replayed)),
            ("pixels", self.pixels.clone(), replayed.pixels.clone()),
        ];
        for (field, a, b) in numbers {
            if a.len() != b.len() {
                let count = |values: Vec<f64>| format!("{} numbers", values.len());
                return Some((field.to_owned(), count(a), count(b)));
            }
            let differ = |i: &usize| a[*i].to_bits() != b[*i].to_bits();
            if let Some(i) = (0..a.len()).find(differ) {
                let text = |value: f64| format!("{value:e}");
                return Some((format!("{field}[{i}]"), text(a[i]), text(b[i])));
            }
        }
        None
    }
}

/// Converts cameras that were left out to the form of the message.
pub fn absent(refused: &[(usize, CameraRefusal)]) -> Vec<(u8, String)> {
    let one = |(camera, reason): &(usize, CameraRefusal)| (*camera as u8, reason.to_string());
    refused.iter().map(one).collect()
}

/// Encodes a status report as `trinocular_msgs/msg/Status`.
pub fn status(bytes: &mut Vec<u8>, status: &Status) {
    let mut writer = Writer::new(bytes);
    header(&mut writer, status.time.micros(), STAGE);
    writer.text(&format!("{:?}", status.state));
    let fault = status.fault.map(|fault| format!("{fault:?}"));
    writer.text(&fault.unwrap_or_default());
    writer.text(&format!("{:?}", status.trust));
    writer.text(&format!("{:?}", status.sight));
    writer.i32_array(&status.position_steps);
    writer.i32_array(&status.target_steps);
    writer.u32(status.frames_used);
    writer.u32(status.frames_refused);
    let drops = status.drops;
    let dropped = [drops.duplicate, drops.stale, drops.overflow].map(u32::from);
    writer.u32(dropped.iter().sum::<u32>() + drops.rejects.total());
    writer.u32(u32::from(status.seen_ms));
    writer.u8(u8::from(status.motors));
}

/// Event of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// Instant on the recording's clock, µs.
    pub at_us: u64,
    /// Kind: state, fault, sight, switches, line or recording.
    pub kind: String,
    /// The event in words.
    pub text: String,
}

impl Event {
    /// Encodes the message.
    pub fn encode(&self, bytes: &mut Vec<u8>) {
        let mut writer = Writer::new(bytes);
        header(&mut writer, self.at_us, STAGE);
        writer.text(&self.kind);
        writer.text(&self.text);
    }

    /// Decodes the message.
    ///
    /// # Errors
    /// [`CdrFault`] if the bytes are none.
    pub fn decode(bytes: &[u8]) -> Result<Self, CdrFault> {
        let mut reader = Reader::new(bytes)?;
        Ok(Self {
            at_us: read_header(&mut reader)? / 1_000,
            kind: reader.text()?.to_owned(),
            text: reader.text()?.to_owned(),
        })
    }
}

/// Encodes bytes of the station's replay as `trinocular_msgs/msg/Entry`.
pub fn entry(bytes: &mut Vec<u8>, data: &[u8]) {
    Writer::new(bytes).block(data);
}

/// Decodes bytes of the station's replay.
///
/// # Errors
/// [`CdrFault`] if the bytes are none.
pub fn read_entry(bytes: &[u8]) -> Result<&[u8], CdrFault> {
    Reader::new(bytes)?.block()
}

/// Returns the events between two statuses of the station, as kind and text: changes of its state
/// and sight, and a new fault.
pub fn changes(last: &Status, status: &Status) -> Vec<(&'static str, String)> {
    let mut changes = Vec::new();
    if last.state != status.state {
        let text = format!("{:?}, was {:?}", status.state, last.state);
        changes.push(("state", text));
    }
    if last.sight != status.sight {
        let text = format!("{:?}, was {:?}", status.sight, last.sight);
        changes.push(("sight", text));
    }
    if let Some(fault) = status.fault.filter(|fault| last.fault != Some(*fault)) {
        let text = format!("fault {}: {}", fault.number(), explain(fault));
        changes.push(("fault", text));
    }
    changes
}

#[cfg(test)]
mod tests;
