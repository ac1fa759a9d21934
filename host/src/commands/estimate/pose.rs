//! Rotation of the target in `estimate`: its options, and its line of text.

use std::io::{self, Write};

use clap::{Args, ValueEnum};
use trinocular_rig::pivot::PivotChoice;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::estimation::{self, Choice, Rule, Turn};

use super::Method;
use crate::commands::failure::Failure;
use crate::commands::turning;

/// Smallest angle that is printed, degrees.
const SHOWN_DEG: f64 = 1e-4;

/// Options about a target that turns.
#[derive(Clone, Copy, Debug, Args)]
pub struct PoseOptions {
    /// Estimate the rotation of the target, or refuse a target that turns
    ///
    /// Without this option the rig file's `rotation` counts. Without either, the rotation is
    /// estimated if the points determine it. --method alone estimates none, unless it is midpoint
    /// and the rig file has a pivot other than the centroid: a turn is then a warning in a points
    /// CSV, and images whose target turns are refused. Images show turns of up to 20 degrees
    /// from one frame set to another, and larger ones that grow from row to row.
    #[arg(long, value_enum)]
    rotation: Option<Rotation>,

    /// Point of the target whose displacement is printed: centroid, spot, or its x, y, z mm at the
    /// reference instant, in the axes and from the origin of the rig file [default: the rig
    /// file's `pivot`, or centroid]
    ///
    /// The points of a target that turns move differently. centroid is the mean of all points at
    /// the reference instant, spot the point that the ray of the rig file's `[laser]` meets then.
    #[arg(long, value_name = "centroid|spot|X,Y,Z", allow_hyphen_values = true)]
    pivot: Option<PivotChoice>,
}

/// Treatment of a target that turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Rotation {
    /// Refuse a target that turns by more than 0.15 degrees
    Refuse,
    /// Estimate the rotation vector with its standard deviation
    Estimate,
}

impl From<Rotation> for estimation::Rotation {
    fn from(rotation: Rotation) -> Self {
        match rotation {
            Rotation::Refuse => Self::Refuse,
            Rotation::Estimate => Self::Estimate,
        }
    }
}

/// Writes a rotation in a line of its own, if it is more than noise and four decimals show it.
pub fn write_turn(turn: &Turn, out: &mut impl Write) -> io::Result<()> {
    let (Some(rotation), Some(sigma), Some(pivot)) =
        (turn.rotation_deg, turn.rotation_sigma_deg, turn.pivot_mm)
    else {
        return Ok(());
    };
    if !turn.is_significant || rotation.iter().all(|angle| angle.abs() < SHOWN_DEG) {
        return Ok(());
    }
    // Adding zero to what is left after rounding turns -0 into 0.
    let [a, b, c] = rotation.map(|angle| (angle * 1e4).round() / 1e4 + 0.0);
    let [d, e, f] = sigma;
    let [x, y, z] = pivot.map(|mm| (mm * 1e3).round() / 1e3 + 0.0);
    writeln!(
        out,
        "      turned by {a:.4} {b:.4} {c:.4} deg, sigma {d:.4} {e:.4} {f:.4} deg; the \
         displacement is that of the point at {x:.3} {y:.3} {z:.3} mm"
    )
}

impl PoseOptions {
    /// Returns the rule of the estimate with the method that was given: what no option says is as
    /// the rig file says.
    ///
    /// # Errors
    /// [`Failure::Usage`] for options that contradict each other.
    pub fn rule(&self, rig: &RigFile, method: Option<Method>) -> Result<Rule, Failure> {
        let choice = Choice {
            method: method.map(Method::estimator),
            rotation: self.rotation.map(Into::into),
            pivot: turning::pivot(self.pivot, rig)?,
        };
        let rule = choice.rule(rig);
        rule.map_err(|contradiction| Failure::Usage(contradiction.to_string()))
    }
}
