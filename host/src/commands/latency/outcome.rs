//! Delays that were measured: table, JSON and warnings.

use super::observed::Observed;
use crate::commands::failure::Failure;
use crate::commands::warnings;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use trinocular::report::{Cell, Table};
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::hand_eye::latency::{Latency, apart_ms};

/// Least difference of two delays that is worth a warning, ms, and as a multiple of sigma.
const NOTED_MS: f64 = 0.5;
const NOTED_SIGMA: f64 = 3.0;

/// Least distance of two exposures that is worth a warning, ms, and as a share of the period.
const APART_MS: f64 = 1.0;
const APART_SHARE: f64 = 0.1;

/// Delay of one camera.
struct Row {
    name: String,
    latency: Latency,
    /// Delay in the rig file, ms.
    file_ms: Option<f64>,
    /// Distance of the camera's exposures from those of the first camera, ms.
    apart_ms: Option<f64>,
}

impl Row {
    /// Returns the delay in the rig file if the measured one differs from it.
    fn changed_from_ms(&self) -> Option<f64> {
        let Latency {
            delay_ms, sigma_ms, ..
        } = self.latency;
        let least_ms = NOTED_MS.max(NOTED_SIGMA * sigma_ms);
        self.file_ms
            .filter(|file_ms| (delay_ms - file_ms).abs() > least_ms)
    }
}

/// Delays of all cameras.
pub struct Outcome {
    rows: Vec<Row>,
    clock_ms: f64,
}

impl Outcome {
    /// Fits the delays.
    pub fn of(observed: &Observed, rig: &RigFile) -> Result<Self, Failure> {
        let latencies = observed.latencies()?;
        let exposed_s = |camera: usize| -> Vec<f64> {
            let delay_s = 1e-3 * latencies[camera].delay_ms;
            let stamps = observed.stamps_s(camera).iter();
            stamps.map(|stamp_s| stamp_s - delay_s).collect()
        };
        let row = |camera: usize| Row {
            name: rig.names[camera].clone(),
            latency: latencies[camera],
            file_ms: rig.capture.get(camera).and_then(|it| it.delay_ms),
            apart_ms: match camera {
                0 => None,
                _ => apart_ms(&exposed_s(0), &exposed_s(camera)),
            },
        };
        Ok(Self {
            rows: (0..latencies.len()).map(row).collect(),
            clock_ms: observed.clock_ms(),
        })
    }

    /// Returns the delay of each camera, ms.
    pub fn delays_ms(&self) -> impl Iterator<Item = (&str, f64)> {
        let rows = self.rows.iter();
        rows.map(|row| (row.name.as_str(), row.latency.delay_ms))
    }

    /// Warns of delays that are not the rig file's, and of cameras that are not exposed together.
    /// `period_ms` is the time between two images.
    pub fn warn(&self, period_ms: f64) {
        for row in &self.rows {
            let Latency {
                delay_ms,
                passes,
                left_out,
                ..
            } = row.latency;
            if let Some(file_ms) = row.changed_from_ms() {
                warnings::raise(format!(
                    "`{}` has a delay of {delay_ms:.2} ms, but the rig file says {file_ms:.2} ms: \
                     the camera's settings or its driver have changed; write the new one by --out",
                    row.name
                ));
            }
            if left_out > 0 {
                warnings::raise(format!(
                    "`{}`: {left_out} of {} passes left out, because they disagree with the \
                     others, have too few images, or the station's clock jumped",
                    row.name,
                    passes + left_out
                ));
            }
        }
        let Some((first, others)) = self.rows.split_first() else {
            return;
        };
        let too_far_ms = APART_MS.max(APART_SHARE * period_ms);
        for row in others {
            if let Some(apart_ms) = row.apart_ms.filter(|apart_ms| *apart_ms > too_far_ms) {
                warnings::raise(format!(
                    "`{}` is exposed up to {apart_ms:.1} ms before or after `{}`: trigger the \
                     cameras together, or the images of a moving target do not fit together",
                    row.name, first.name
                ));
            }
        }
    }

    /// Returns the largest difference between two cameras' delays, ms, if it is certain and the rig
    /// file does not have these delays.
    fn difference_ms(&self) -> Option<f64> {
        let is_known = |row: &Row| row.file_ms.is_some() && row.changed_from_ms().is_none();
        if self.rows.iter().all(is_known) {
            return None;
        }
        let delays = || self.rows.iter().map(|row| row.latency.delay_ms);
        let least_ms = delays().fold(f64::INFINITY, f64::min);
        let greatest_ms = delays().fold(f64::NEG_INFINITY, f64::max);
        let sigmas = self.rows.iter().map(|row| row.latency.own_sigma_ms);
        let sigma_ms = f64::sqrt(2.0) * sigmas.fold(0.0, f64::max);
        let difference_ms = greatest_ms - least_ms;
        (difference_ms > NOTED_MS.max(NOTED_SIGMA * sigma_ms)).then_some(difference_ms)
    }

    /// Returns the JSON object.
    pub fn json(&self) -> Value {
        let row = |row: &Row| {
            let mut object = json!(row.latency);
            object["name"] = json!(row.name);
            object["file_ms"] = json!(row.file_ms);
            object["changed"] = json!(row.changed_from_ms().is_some());
            object["apart_ms"] = json!(row.apart_ms);
            object
        };
        let cameras: Vec<Value> = self.rows.iter().map(row).collect();
        json!({"cameras": cameras, "clock_ms": self.clock_ms})
    }

    /// Prints the table. `written` is the file that has the delays now.
    pub fn print(&self, written: Option<&Path>, out: &mut impl Write) -> Result<(), Failure> {
        let mut table = Table::new(
            "Delay from the middle of the exposure to the time stamp, ms",
            [
                "camera",
                "delay",
                "sigma",
                "rig file",
                "exposed apart",
                "images",
                "scatter px",
            ],
        );
        let or_dash = |ms: Option<f64>| match ms {
            Some(ms) => Cell::text(format!("{ms:.2}")),
            None => Cell::text("-"),
        };
        for row in &self.rows {
            let Latency {
                delay_ms,
                sigma_ms,
                images,
                scatter_px,
                ..
            } = row.latency;
            table = table.row([
                Cell::text(&row.name),
                Cell::text(format!("{delay_ms:.3}")),
                Cell::text(format!("{sigma_ms:.3}")),
                or_dash(row.file_ms),
                or_dash(row.apart_ms),
                Cell::text(images.to_string()),
                Cell::text(format!("{scatter_px:.4}")),
            ]);
        }
        writeln!(out, "{}", table.to_text())?;
        if let Some(difference_ms) = self.difference_ms() {
            writeln!(
                out,
                "The delays differ by {difference_ms:.2} ms: one --delay for all cameras would put \
                 images of\ndifferent instants together. With `delay_ms` in the rig file (--out) \
                 each has its own."
            )?;
        }
        if let Some(path) = written {
            writeln!(out, "Delays written to {}.", path.display())?;
        }
        Ok(())
    }
}
