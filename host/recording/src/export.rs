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
        let Measurement {
            frame,
            capture_us,
            stamp_us,
            ..
        } = measurement;
        let outcome = measurement.outcome.name();
        let _ = write!(self.text, "{frame},{capture_us},{stamp_us},{outcome}");
        let cameras = measurement.cameras.len();
        let is_measured = cameras > 0 && measurement.outcome != Outcome::Keyframe;
        for mm in measurement.displacement_mm {
            self.number(is_measured.then_some(mm));
        }
        for axis in 0..3 {
            let variance = measurement.covariance_mm2[4 * axis];
            self.number((is_measured && variance > 0.0).then_some(variance.sqrt()));
        }
        let points = measurement.pixels.len() / (4 * cameras.max(1));
        let rejected: u64 = measurement.rejects.iter().map(|(_, n)| u64::from(*n)).sum();
        let _ = write!(self.text, ",{points},{rejected}");
        for mm in measurement.stage_mm {
            self.number(Some(mm));
        }
        let reason = measurement.reason.replace('"', "\"\"");
        let _ = writeln!(self.text, ",{},\"{reason}\"", measurement.latency_us);
    }

    fn number(&mut self, number: Option<f64>) {
        self.text.push(',');
        if let Some(number) = number {
            let _ = write!(self.text, "{number}");
        }
    }
}
