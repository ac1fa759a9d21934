//! Exports of a recording: its measurements as a table, in CSV or Parquet.

mod csv;
mod parquet;

pub use csv::csv;

use crate::message::{Measurement, Outcome, Turn};
use crate::read::Source;
use crate::read::survey::Channels;
use crate::topic::Topic;
use std::collections::BTreeMap;
use trinocular_rig::error::InputError;

/// Columns of the table and their contents.
///
/// A cell that a frame set does not have is empty.
const COLUMNS: [(&str, Cells); 26] = [
    ("frame", Cells::Whole(|row| i64::from(row.frame))),
    ("capture_us", Cells::Whole(|row| signed(row.capture_us))),
    ("stamp_us", Cells::Whole(|row| signed(row.stamp_us))),
    ("outcome", Cells::Text(|row| row.outcome.name())),
    (
        "x_mm",
        Cells::Number(|row| row.displacement_mm.map(|mm| mm[0])),
    ),
    (
        "y_mm",
        Cells::Number(|row| row.displacement_mm.map(|mm| mm[1])),
    ),
    (
        "z_mm",
        Cells::Number(|row| row.displacement_mm.map(|mm| mm[2])),
    ),
    ("sigma_x_mm", Cells::Number(|row| row.sigma_mm[0])),
    ("sigma_y_mm", Cells::Number(|row| row.sigma_mm[1])),
    ("sigma_z_mm", Cells::Number(|row| row.sigma_mm[2])),
    ("points", Cells::Whole(|row| signed(row.points as u64))),
    ("rejected", Cells::Whole(|row| signed(row.rejected))),
    ("stage_x_mm", Cells::Number(|row| Some(row.stage_mm[0]))),
    ("stage_y_mm", Cells::Number(|row| Some(row.stage_mm[1]))),
    ("stage_z_mm", Cells::Number(|row| Some(row.stage_mm[2]))),
    ("latency_us", Cells::Whole(|row| i64::from(row.latency_us))),
    ("reason", Cells::Quoted(|row| &row.reason)),
    ("rotation_x_deg", Cells::Number(|row| row.rotation_deg(0))),
    ("rotation_y_deg", Cells::Number(|row| row.rotation_deg(1))),
    ("rotation_z_deg", Cells::Number(|row| row.rotation_deg(2))),
    (
        "rotation_sigma_x_deg",
        Cells::Number(|row| row.rotation_sigma_deg(0)),
    ),
    (
        "rotation_sigma_y_deg",
        Cells::Number(|row| row.rotation_sigma_deg(1)),
    ),
    (
        "rotation_sigma_z_deg",
        Cells::Number(|row| row.rotation_sigma_deg(2)),
    ),
    ("pivot_x_mm", Cells::Number(|row| row.pivot_mm(0))),
    ("pivot_y_mm", Cells::Number(|row| row.pivot_mm(1))),
    ("pivot_z_mm", Cells::Number(|row| row.pivot_mm(2))),
];

/// Contents of a column.
enum Cells {
    Whole(fn(&Row) -> i64),
    Number(fn(&Row) -> Option<f64>),
    /// Words without a comma.
    Text(fn(&Row) -> &str),
    Quoted(fn(&Row) -> &str),
}

/// Values of a column, one per row.
#[derive(Clone, Debug, PartialEq)]
pub enum Column {
    /// Whole numbers.
    Whole(Vec<i64>),
    /// Numbers; `None` for an empty cell.
    Number(Vec<Option<f64>>),
    /// Text.
    Text(Vec<String>),
}

/// Returns the columns of the table, each with its name, as `export` writes them.
pub fn columns(rows: &[Row]) -> Vec<(&'static str, Column)> {
    let values = |cells: &Cells| match cells {
        Cells::Whole(of) => Column::Whole(rows.iter().map(of).collect()),
        Cells::Number(of) => Column::Number(rows.iter().map(of).collect()),
        Cells::Text(of) | Cells::Quoted(of) => {
            Column::Text(rows.iter().map(|row| of(row).to_owned()).collect())
        }
    };
    let columns = COLUMNS.iter();
    columns
        .map(|(name, cells)| (*name, values(cells)))
        .collect()
}

fn signed(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
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
    /// Position of the stage at the capture, mm.
    pub stage_mm: [f64; 3],
    /// Time from the capture to the first step that it could change, µs.
    pub latency_us: u32,
    /// Reason of a refusal.
    pub reason: String,
    /// Rotation of the target since the keyframe, and the pivot whose displacement is stated;
    /// `None` if no rotation was estimated.
    pub turn: Option<Turn>,
}

impl Row {
    fn rotation_deg(&self, axis: usize) -> Option<f64> {
        self.turn.map(|turn| turn.rotation_deg[axis])
    }

    fn rotation_sigma_deg(&self, axis: usize) -> Option<f64> {
        self.turn.map(|turn| turn.rotation_sigma_deg[axis])
    }

    fn pivot_mm(&self, axis: usize) -> Option<f64> {
        self.turn.map(|turn| turn.pivot_mm[axis])
    }

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
            turn: measurement.turn.filter(|_| is_measured),
        }
    }
}

/// Measurements of a recording: one row per frame set.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Rows, in the order of the recording.
    pub rows: Vec<Row>,
    /// Reason why the end is missing.
    pub cut: Option<InputError>,
}

impl Table {
    /// Reads the measurements of a recording of this program.
    ///
    /// # Errors
    /// [`InputError`] if the file is damaged or holds no measurements.
    pub fn read(source: &Source) -> Result<Self, InputError> {
        let mut rows = Vec::new();
        let mut seen = BTreeMap::new();
        let mut channels = Channels::default();
        let mut records = source.records();
        for record in records.by_ref() {
            let (file, record) = record?;
            let Some(message) = channels.message(file, record) else {
                continue;
            };
            if let Some(topic) = Topic::ALL.into_iter().find(|topic| topic.is_of(&message)) {
                *seen.entry(topic).or_default() += 1;
            }
            if Topic::Measurement.is_of(&message) {
                let measurement = Measurement::decode(&message.data).map_err(|fault| {
                    let reason = format!("a measurement is malformed: {fault}");
                    InputError::file(source.path(), reason)
                })?;
                rows.push(Row::of(&measurement));
            }
        }
        let cut = records.cut().cloned();
        match rows.is_empty() {
            true => Err(without_rows(source, &seen, cut.as_ref())),
            false => Ok(Self { rows, cut }),
        }
    }
}

/// Returns the error for a file without measurements: its content, and the parts that are missing.
/// `seen` counts the messages of this program by topic.
fn without_rows(
    source: &Source,
    seen: &BTreeMap<Topic, u64>,
    cut: Option<&InputError>,
) -> InputError {
    let counts = seen.iter();
    let counts = counts.map(|(topic, count)| format!("{count} on {}", topic.name()));
    let counts: Vec<String> = counts.collect();
    let reason = match (counts.is_empty(), cut) {
        (true, None) => "holds no measurements; only recordings of this program do".to_owned(),
        (true, Some(cut)) => format!(
            "holds no measurement and no other message: it {}",
            cut.reason
        ),
        (false, cut) => {
            let why = match cut {
                Some(_) => "it was cut off before its first frame set",
                None => "no images were followed while it was recorded",
            };
            let counts = counts.join(", ");
            format!("holds messages ({counts}), but no measurement on /measurement: {why}")
        }
    };
    InputError::file(source.path(), reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_agree_with_csv() {
        let measured = Measurement {
            frame: 3,
            cameras: vec![0, 1],
            displacement_mm: [1.5, -2.0, 0.25],
            pixels: vec![0.0; 8],
            outcome: Outcome::Used,
            ..Measurement::default()
        };
        let refused = Measurement {
            reason: "lost, \"far\" away".to_owned(),
            ..Measurement::default()
        };
        let rows = [Row::of(&measured), Row::of(&refused)];
        let columns = columns(&rows);
        let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        assert_eq!(csv(&rows).lines().next(), Some(names.join(",").as_str()));
        let of = |name: &str| columns.iter().find(|(known, _)| *known == name).unwrap();
        assert_eq!(of("frame").1, Column::Whole(vec![3, 0]));
        assert_eq!(of("x_mm").1, Column::Number(vec![Some(1.5), None]));
        assert_eq!(of("points").1, Column::Whole(vec![1, 0]));
        let reasons = vec![String::new(), "lost, \"far\" away".to_owned()];
        assert_eq!(of("reason").1, Column::Text(reasons));
    }
}
