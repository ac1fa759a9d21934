//! Rows of `estimate`: as text, JSON objects or CSV.

use super::measurer::Label;
use super::pose::write_turn;
use super::{EstimateOptions, Method};
use crate::commands::csv_rows::{self, Column};
use crate::commands::failure::Failure;
use serde::Serialize;
use std::io::Write;
use trinocular_rig::notice;
use trinocular_vision::estimation::{Solution, Turn, counted};

/// One displacement, as it is printed.
#[derive(Debug, Serialize)]
struct Displacement {
    frame: usize,
    #[serde(flatten)]
    label: Label,
    displacement_mm: [f64; 3],
    sigma_mm: Option<[f64; 3]>,
    covariance_mm2: Option<[[f64; 3]; 3]>,
    #[serde(flatten)]
    turn: Option<Turn>,
    points: usize,
    rejected: usize,
    method: Method,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
}

/// A frame without an estimate, as it is printed.
#[derive(Debug, Serialize)]
struct Refused {
    frame: usize,
    #[serde(flatten)]
    label: Label,
    refused: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
}

/// Columns of `--csv`.
const COLUMNS: [&[Column]; 4] = [
    &[("frame", "/frame")],
    &csv_rows::DISPLACEMENT,
    &csv_rows::TURN,
    &[
        ("points", "/points"),
        ("rejected", "/rejected"),
        ("method", "/method"),
        ("refused", "/refused"),
        ("warnings", "/warnings"),
        ("target", "/target"),
        ("against", "/against"),
    ],
];

/// Prints frames as they come and counts them.
pub(super) struct Printer<'a, W> {
    pub options: &'a EstimateOptions,
    pub method: Method,
    pub out: &'a mut W,
    /// Rows so far.
    pub rows: usize,
    pub refused: usize,
    /// True for a points file, whose warnings name their line.
    pub is_points: bool,
    /// Warnings about the next displacement, which are printed with it.
    pub warnings: Vec<String>,
    /// Exposure warnings of the next row, which are already printed, once per camera and kind.
    pub exposure: Vec<String>,
    /// Names of the cameras that take no part in the next displacement.
    pub absent: Vec<String>,
    /// Number of rows per frame.
    pub targets: usize,
    /// Target of the next row.
    pub label: Label,
}

impl<W: Write> Printer<'_, W> {
    /// Prints the next frame from its solution and the numbers of its points and of the rejected.
    pub fn solution(
        &mut self,
        solution: Result<Solution, String>,
        count: usize,
        rejected: usize,
    ) -> Result<(), Failure> {
        match counted(solution, count, rejected) {
            Ok((solution, rejected)) => {
                let frame = self.frame();
                for warning in &self.warnings {
                    match self.is_points {
                        true => notice!("warning: {warning}"),
                        false => notice!("frame {frame}: {warning}"),
                    }
                }
                let warnings = self.take_warnings();
                self.displacement(&Displacement {
                    frame,
                    label: self.label.clone(),
                    displacement_mm: solution.displacement_mm,
                    sigma_mm: solution.sigma_mm,
                    covariance_mm2: solution.covariance_mm2,
                    points: solution.points,
                    rejected,
                    method: self.method,
                    turn: solution.turn,
                    warnings,
                })
            }
            Err(mut reason) => {
                for warning in self.take_warnings() {
                    reason = format!("{reason}; {warning}");
                }
                self.refusal(reason)
            }
        }
    }

    /// Returns the number of the frame of the next row.
    fn frame(&self) -> usize {
        1 + self.rows / self.targets.max(1)
    }

    /// Returns the words for the target of the row, after two spaces; empty if the view is one
    /// target.
    fn target(&self) -> String {
        match (&self.label.target, &self.label.against) {
            (None, _) => String::new(),
            (Some(target), None) => format!("  {target}"),
            (Some(target), Some(against)) => format!("  {target} against {against}"),
        }
    }

    /// Takes all warnings about the next row.
    fn take_warnings(&mut self) -> Vec<String> {
        let mut all = std::mem::take(&mut self.exposure);
        all.append(&mut self.warnings);
        all
    }

    fn displacement(&mut self, line: &Displacement) -> Result<(), Failure> {
        self.rows += 1;
        if self.options.json || self.options.csv {
            return self.object(line);
        }
        if self.rows - self.refused == 1 {
            writeln!(
                self.out,
                "frame        x mm        y mm        z mm \
                 sigma x mm sigma y mm sigma z mm  points rejected"
            )?;
        }
        write!(self.out, "{:>5}", line.frame)?;
        for component in line.displacement_mm {
            // Adding zero to what is left after rounding turns -0 into 0.
            let rounded = (component * 1e4).round() / 1e4 + 0.0;
            write!(self.out, " {rounded:>11.4}")?;
        }
        for axis in 0..3 {
            match line.sigma_mm {
                Some(sigma) => write!(self.out, " {:>10.4}", sigma[axis])?,
                None => write!(self.out, " {:>10}", "-")?,
            }
        }
        write!(self.out, " {:>7} {:>8}", line.points, line.rejected)?;
        let target = self.target();
        match std::mem::take(&mut self.absent) {
            names if names.is_empty() => writeln!(self.out, "{target}")?,
            names => writeln!(self.out, "{target}  without {}", names.join(" and "))?,
        }
        if let Some(turn) = &line.turn {
            write_turn(turn, self.out)?;
        }
        Ok(())
    }

    pub fn refusal(&mut self, reason: String) -> Result<(), Failure> {
        let frame = self.frame();
        self.rows += 1;
        self.refused += 1;
        let warnings = self.take_warnings();
        if self.options.json || self.options.csv {
            return self.object(&Refused {
                frame,
                label: self.label.clone(),
                refused: reason,
                warnings,
            });
        }
        writeln!(self.out, "{frame:>5}{} refused: {reason}", self.target())?;
        Ok(())
    }

    fn object(&mut self, line: &impl Serialize) -> Result<(), Failure> {
        if self.options.json {
            return Ok(crate::commands::json::line(self.out, line)?);
        }
        if self.rows == 1 {
            csv_rows::header(self.out, &COLUMNS)?;
        }
        let object = serde_json::to_value(line).map_err(std::io::Error::from)?;
        Ok(csv_rows::row(self.out, &COLUMNS, object)?)
    }

    pub fn finish(self) -> Result<(), Failure> {
        self.out.flush()?;
        if self.refused == 0 {
            return Ok(());
        }
        Err(Failure::Refused {
            file: self.options.input.clone(),
            refused: self.refused,
            frames: self.rows,
        })
    }
}
