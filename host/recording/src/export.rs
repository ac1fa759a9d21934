//! Exports of a recording: its measurements as a table.

use crate::message::{Measurement, Outcome};
use crate::read::Source;
use crate::read::records::Record;
use crate::read::survey::Channels;
use crate::topic::Topic;
use std::fmt::Write as _;
use trinocular_rig::error::InputError;

/// Columns of the table.
const COLUMNS: &str = "frame,capture_us,stamp_us,outcome,x_mm,y_mm,z_mm,\
    sigma_x_mm,sigma_y_mm,sigma_z_mm,points,rejected,stage_x_mm,stage_y_mm,stage_z_mm,\
    latency_us,reason\n";

/// Table of measurements.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Text of the CSV file.
    pub text: String,
    /// Number of rows.
    pub rows: usize,
    /// Place at which the file was cut off.
    pub cut: Option<InputError>,
}

/// Returns the measurements of a recording of this program as CSV, one row per frame set.
///
/// # Errors
/// [`InputError`] if the file is damaged or holds no measurements.
pub fn csv(source: &Source) -> Result<Table, InputError> {
    let mut table = Table {
        text: COLUMNS.to_owned(),
        ..Table::default()
    };
    let mut channels = Channels::default();
    let mut records = source.records();
    for record in records.by_ref() {
        let (file, record) = record?;
        channels.take(file, &record);
        let Record::Message { channel, data, .. } = record else {
            continue;
        };
        let is_measurement = |(name, kind, _)| {
            name == Topic::Measurement.name() && kind == "trinocular_msgs/Measurement"
        };
        if channels.get(file, channel).is_some_and(is_measurement) {
            let measurement = Measurement::decode(&data).map_err(|fault| {
                InputError::file(
                    source.path(),
                    format!("a measurement is malformed: {fault}"),
                )
            })?;
            table.row(&measurement);
        }
    }
    table.cut = records.cut().cloned();
    match table.rows {
        0 => {
            let reason = "holds no measurements; only recordings of this program do";
            Err(InputError::file(source.path(), reason))
        }
        _ => Ok(table),
    }
}

impl Table {
    fn row(&mut self, measurement: &Measurement) {
        self.rows += 1;
        Row::of(measurement).write(&mut self.text);
    }
}

/// One frame set, as a row of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Number of the frame set.
    pub frame: u32,
    /// Capture time on the station's clock, µs.
    pub capture_us: u64,
    /// Capture time on the clock of the images' source, µs.
    pub stamp_us: u64,
    /// Result.
    pub outcome: Outcome,
    /// Displacement of the target since the keyframe, mm; `None` without a measurement.
    pub displacement_mm: Option<[f64; 3]>,
    /// Standard deviation of each axis, mm; `None` without a variance.
    pub sigma_mm: [Option<f64>; 3],
    /// Number of inliers.
    pub points: usize,
    /// Number of points left out.
    pub rejected: u64,
    /// Position of the stage after the answer, mm.
    pub stage_mm: [f64; 3],
    /// Time from the capture to the first step that it could change, µs.
    pub latency_us: u32,
    /// Reason of a refusal.
    pub reason: String,
}

impl Row {
    /// Returns the row of a measurement.
    pub fn of(measurement: &Measurement) -> Self {
        let cameras = measurement.cameras.len();
        let is_measured = cameras > 0 && measurement.outcome != Outcome::Keyframe;
        Self {
            frame: measurement.frame,
            capture_us: measurement.capture_us,
            stamp_us: measurement.stamp_us,
            outcome: measurement.outcome,
            displacement_mm: is_measured.then_some(measurement.displacement_mm),
            sigma_mm: std::array::from_fn(|axis| {
                let variance = measurement.covariance_mm2[4 * axis];
                (is_measured && variance > 0.0).then_some(variance.sqrt())
            }),
            points: measurement.pixels.len() / (4 * cameras.max(1)),
            rejected: measurement.rejects.iter().map(|(_, n)| u64::from(*n)).sum(),
            stage_mm: measurement.stage_mm,
            latency_us: measurement.latency_us,
            reason: measurement.reason.clone(),
        }
    }

    fn write(&self, text: &mut String) {
        let (frame, capture_us, stamp_us) = (self.frame, self.capture_us, self.stamp_us);
        let outcome = self.outcome.name();
        let _ = write!(text, "{frame},{capture_us},{stamp_us},{outcome}");
        for axis in 0..3 {
            number(text, self.displacement_mm.map(|mm| mm[axis]));
        }
        self.sigma_mm.iter().for_each(|mm| number(text, *mm));
        let _ = write!(text, ",{},{}", self.points, self.rejected);
        self.stage_mm.iter().for_each(|mm| number(text, Some(*mm)));
        let reason = self.reason.replace('"', "\"\"");
        let _ = writeln!(text, ",{},\"{reason}\"", self.latency_us);
    }
}

/// Returns the table of these rows as CSV.
pub fn table<'a>(rows: impl IntoIterator<Item = &'a Row>) -> String {
    let mut text = COLUMNS.to_owned();
    rows.into_iter().for_each(|row| row.write(&mut text));
    text
}

fn number(text: &mut String, number: Option<f64>) {
    text.push(',');
    if let Some(number) = number {
        let _ = write!(text, "{number}");
    }
}
