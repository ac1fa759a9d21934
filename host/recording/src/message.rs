//! Messages of a recording, and their CDR encoding.

mod last_pose;
mod transforms;

pub use transforms::transforms;

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

/// Encodes displacement and rotation as `geometry_msgs/msg/PoseWithCovarianceStamped`, in metres and
/// rad. Without an estimate of the rotation it is none, with a covariance of zero.
pub fn pose(bytes: &mut Vec<u8>, measurement: &Measurement) {
    let mut writer = Writer::new(bytes);
    header(&mut writer, measurement.stamp_us, CAMERAS);
    for mm in measurement.displacement_mm {
        writer.f64(mm * 1e-3);
    }
    let turn = measurement.turn.unwrap_or_default();
    writer.f64_array(&quaternion(turn.rotation_deg));
    for row in 0..6 {
        for column in 0..6 {
            writer.f64(match (row < 3, column < 3) {
                (true, true) => measurement.covariance_mm2[3 * row + column] * 1e-6,
                (false, false) if row == column => {
                    turn.rotation_sigma_deg[row - 3].to_radians().powi(2)
                }
                _ => 0.0,
            });
        }
    }
}

/// Returns the unit quaternion of a rotation vector: x, y, z, w.
fn quaternion(rotation_deg: [f64; 3]) -> [f64; 4] {
    let [x, y, z] = rotation_deg.map(f64::to_radians);
    let half = 0.5 * (x * x + y * y + z * z).sqrt();
    let scale = if half > 0.0 {
        0.5 * half.sin() / half
    } else {
        0.5
    };
    [scale * x, scale * y, scale * z, half.cos()]
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
///
/// ```
/// use trinocular_recording::message::{Measurement, Outcome};
///
/// let measurement = Measurement {
///     outcome: Outcome::Used,
///     displacement_mm: [0.1, -0.2, 1.5],
///     ..Measurement::default()
/// };
/// let mut bytes = Vec::new();
/// measurement.encode(&mut bytes);
/// assert_eq!(Measurement::decode(&bytes)?, measurement);
/// # Ok::<(), trinocular_recording::cdr::CdrFault>(())
/// ```
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
    /// Displacement of the target since the keyframe, mm; in the message of a keyframe that of the
    /// last pose before the recording ([`Measurement::last_pose`]).
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
    /// Position of the stage at the capture, mm.
    pub stage_mm: [f64; 3],
    /// The station's own estimate, mm.
    pub station_mm: [f64; 3],
    /// Standard deviation of the station's estimate, mm.
    pub station_sigma_mm: [f64; 3],
    /// Time from the capture to the first step that it could change, µs.
    pub latency_us: u32,
    /// Rotation of the target since the keyframe, if it was estimated; in the message of a keyframe
    /// that of the last pose before the recording.
    pub turn: Option<Turn>,
}

/// Rotation of the target, whose displacement is that of its pivot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Turn {
    /// Rotation vector about the cameras' axes, degrees.
    pub rotation_deg: [f64; 3],
    /// Standard deviation about each axis, degrees.
    pub rotation_sigma_deg: [f64; 3],
    /// Point of the target at the keyframe whose displacement is stated, mm.
    pub pivot_mm: [f64; 3],
}

impl Turn {
    /// Writes each vector as a sequence; without a rotation they are empty.
    fn encode(turn: Option<&Self>, writer: &mut Writer<'_>) {
        let vectors = turn.map(|turn| [turn.rotation_deg, turn.rotation_sigma_deg, turn.pivot_mm]);
        for i in 0..3 {
            writer.f64s(vectors.as_ref().map_or(&[], |vectors| &vectors[i]));
        }
    }

    /// Reads a rotation. Recordings of earlier versions end before it.
    fn decode(reader: &mut Reader<'_>) -> Result<Option<Self>, CdrFault> {
        if reader.is_at_end() {
            return Ok(None);
        }
        let mut vector = || -> Result<Option<[f64; 3]>, CdrFault> {
            Ok(reader.f64s()?.as_slice().try_into().ok())
        };
        let vectors = [vector()?, vector()?, vector()?];
        let [Some(rotation_deg), Some(rotation_sigma_deg), Some(pivot_mm)] = vectors else {
            return Ok(None);
        };
        Ok(Some(Self {
            rotation_deg,
            rotation_sigma_deg,
            pivot_mm,
        }))
    }
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
        self.turn = measured.turn.map(|turn| Turn {
            rotation_deg: turn.rotation_deg,
            rotation_sigma_deg: turn.rotation_sigma_deg,
            pivot_mm: turn.pivot_mm,
        });
        if let Some(turn) = &measured.turn {
            let covariance = turn.covariance_mm2.as_flattened();
            self.covariance_mm2.copy_from_slice(covariance);
            return;
        }
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
        Turn::encode(self.turn.as_ref(), &mut writer);
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
        message.turn = Turn::decode(&mut reader)?;
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
        let rotation = |of: &Self| {
            of.turn
                .map_or(Vec::new(), |turn| turn.rotation_deg.to_vec())
        };
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
            ("rotation_deg", rotation(self), rotation(replayed)),
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
