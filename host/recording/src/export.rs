//! Exports of a recording: its measurements as a table, in CSV or Parquet.

mod csv;
mod parquet;

use crate::message::{Measurement, Outcome};
use crate::read::Source;
use crate::read::records::Record;
use crate::read::survey::Channels;
use crate::topic::Topic;
use trinocular_rig::error::InputError;

/// Columns of the table and their contents.
///
/// A cell that a frame set does not have is empty.
const COLUMNS: [(&str, Cells); 17] = [
    ("frame", Cells::Whole(|m| i64::from(m.frame))),
    ("capture_us", Cells::Whole(|m| signed(m.capture_us))),
    ("stamp_us", Cells::Whole(|m| signed(m.stamp_us))),
    ("outcome", Cells::Text(|m| m.outcome.name())),
    ("x_mm", Cells::Number(|m| displacement_mm(m, 0))),
    ("y_mm", Cells::Number(|m| displacement_mm(m, 1))),
    ("z_mm", Cells::Number(|m| displacement_mm(m, 2))),
    ("sigma_x_mm", Cells::Number(|m| sigma_mm(m, 0))),
    ("sigma_y_mm", Cells::Number(|m| sigma_mm(m, 1))),
    ("sigma_z_mm", Cells::Number(|m| sigma_mm(m, 2))),
    ("points", Cells::Whole(points)),
    ("rejected", Cells::Whole(rejected)),
    ("stage_x_mm", Cells::Number(|m| Some(m.stage_mm[0]))),
    ("stage_y_mm", Cells::Number(|m| Some(m.stage_mm[1]))),
    ("stage_z_mm", Cells::Number(|m| Some(m.stage_mm[2]))),
    ("latency_us", Cells::Whole(|m| i64::from(m.latency_us))),
    ("reason", Cells::Quoted(|m| &m.reason)),
];

/// Contents of a column.
enum Cells {
    Whole(fn(&Measurement) -> i64),
    Number(fn(&Measurement) -> Option<f64>),
    /// Words without a comma.
    Text(fn(&Measurement) -> &str),
    Quoted(fn(&Measurement) -> &str),
}

fn signed(us: u64) -> i64 {
    i64::try_from(us).unwrap_or(i64::MAX)
}

fn is_measured(measurement: &Measurement) -> bool {
    !measurement.cameras.is_empty() && measurement.outcome != Outcome::Keyframe
}

fn displacement_mm(measurement: &Measurement, axis: usize) -> Option<f64> {
    is_measured(measurement).then_some(measurement.displacement_mm[axis])
}

fn sigma_mm(measurement: &Measurement, axis: usize) -> Option<f64> {
    let variance = measurement.covariance_mm2[4 * axis];
    (is_measured(measurement) && variance > 0.0).then_some(variance.sqrt())
}

fn points(measurement: &Measurement) -> i64 {
    (measurement.pixels.len() / (4 * measurement.cameras.len().max(1))) as i64
}

fn rejected(measurement: &Measurement) -> i64 {
    measurement.rejects.iter().map(|(_, n)| i64::from(*n)).sum()
}

/// Measurements of a recording: one row per frame set.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Measurements, one for each row.
    pub rows: Vec<Measurement>,
    /// Place at which the file was cut off.
    pub cut: Option<InputError>,
}

impl Table {
    /// Reads the measurements of a recording of this program.
    ///
    /// # Errors
    /// [`InputError`] if the file is damaged or holds no measurements.
    pub fn read(source: &Source) -> Result<Self, InputError> {
        let mut rows = Vec::new();
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
                rows.push(Measurement::decode(&data).map_err(|fault| {
                    let reason = format!("a measurement is malformed: {fault}");
                    InputError::file(source.path(), reason)
                })?);
            }
        }
        let cut = records.cut().cloned();
        match rows.is_empty() {
            true => {
                let reason = "holds no measurements; only recordings of this program do";
                Err(InputError::file(source.path(), reason))
            }
            false => Ok(Self { rows, cut }),
        }
    }
}
