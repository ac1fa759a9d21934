//! Rotation of the target in `estimate`: its options, and the estimate of points.

use std::io::{self, Write};

use clap::{Args, ValueEnum};
use serde::Serialize;
use trinocular_core::estimate::pose::{self, Estimate, Observation};
use trinocular_core::rig::Rig;
use trinocular_core::sums::centred::Geometry;
use trinocular_rig::pivot::Pivot;
use trinocular_rig::rig_file::RigFile;
use trinocular_vision::flow::Correspondence;

use super::Method;
use super::printer::Solution;
use crate::commands::failure::Failure;

/// Largest standard deviation of a rotation that is estimated unasked, degrees.
const MOST_SIGMA_DEG: f64 = 0.5;
/// 99.9 % quantile of χ² with three degrees of freedom: the limit of a significant rotation.
const SIGNIFICANT: f64 = 16.3;
/// Largest rotation of a target that counts as one that does not turn, degrees.
const MOST_TURN_DEG: f64 = 0.15;

/// Smallest angle that is printed, degrees.
const SHOWN_DEG: f64 = 1e-4;

/// Options about a target that turns.
#[derive(Clone, Copy, Debug, Args)]
pub struct PoseOptions {
    /// Estimate the rotation of the target, or refuse a target that turns
    ///
    /// Without this option the rig file's `rotation` counts. Without either, the rotation of a points CSV is estimated if the points determine it,
    /// unless --method is given; a turn then is a warning. Images whose target turns are refused,
    /// unless `estimate` is given: it measures turns of up to 12 degrees between two images.
    #[arg(long, value_enum)]
    rotation: Option<Rotation>,

    /// Point of the target whose displacement is printed: centroid, or its x, y, z mm at the
    /// reference instant, in the axes and from the origin of the rig file [default: centroid]
    ///
    /// The points of a target that turns move differently. centroid is the mean of all points at
    /// the reference instant.
    #[arg(long, value_name = "centroid|X,Y,Z", allow_hyphen_values = true)]
    pivot: Option<Pivot>,
}

/// Treatment of a target that turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Rotation {
    /// Refuse a target that turns by more than 0.15 degrees
    Refuse,
    /// Estimate the rotation vector with its standard deviation
    Estimate,
}

/// Rotation of the target about the axes of the cameras, as it is printed.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Turn {
    /// Rotation vector; none if the points do not determine it.
    pub rotation_deg: Option<[f64; 3]>,
    /// Standard deviation about each axis.
    pub rotation_sigma_deg: Option<[f64; 3]>,
    /// Point of the target at the reference instant whose displacement is stated.
    pub pivot_mm: Option<[f64; 3]>,
    /// True if noise imitates the rotation in less than one of 1,000 cases.
    #[serde(skip)]
    pub is_significant: bool,
}

impl Turn {
    /// Writes the rotation in a line of its own, if it is more than noise and four decimals show
    /// it.
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        let (Some(rotation), Some(sigma), Some(pivot)) =
            (self.rotation_deg, self.rotation_sigma_deg, self.pivot_mm)
        else {
            return Ok(());
        };
        if !self.is_significant || rotation.iter().all(|angle| angle.abs() < SHOWN_DEG) {
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
}

/// Use of the rotation of one set of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    /// Estimate it, or refuse.
    Demanded,
    /// Estimate it if the points determine it.
    Offered,
    /// Refuse a target that turns.
    Refused,
    /// Warn of a target that turns.
    Warned,
}

impl PoseOptions {
    /// Adds what the rig file says about a target that turns, for a method that knows a rotation.
    pub fn of_rig(self, rig: &RigFile, method: Option<Method>) -> Self {
        let knows_none = matches!(method, Some(Method::ClosedForm | Method::LeastSquares));
        match (self.rotation, rig.pivot) {
            (None, Some(_)) if knows_none => self,
            (None | Some(Rotation::Estimate), Some(pivot)) => Self {
                rotation: Some(Rotation::Estimate),
                pivot: self.pivot.or(Some(pivot)),
            },
            _ => self,
        }
    }

    /// Refuses options that contradict each other. `is_points` is true for a points file, whose
    /// rotation is estimated unasked; `method` is the one that was given.
    pub fn check(&self, method: Option<Method>, is_points: bool) -> Result<(), Failure> {
        let used = self.use_of(method);
        if self.rotation == Some(Rotation::Estimate)
            && let Some(method @ (Method::ClosedForm | Method::LeastSquares)) = method
        {
            return Err(Failure::Usage(format!(
                "--rotation estimate: {} knows no rotation; use --method midpoint",
                method.name()
            )));
        }
        let estimated = used == Use::Demanded || is_points && used == Use::Offered;
        if self.pivot.is_some() && !estimated {
            return Err(Failure::Usage(
                "--pivot: without a rotation all points of the target move alike; give \
                 --rotation estimate"
                    .to_owned(),
            ));
        }
        Ok(())
    }

    fn use_of(&self, method: Option<Method>) -> Use {
        match (self.rotation, method) {
            (Some(Rotation::Estimate), _) => Use::Demanded,
            (Some(Rotation::Refuse), _) => Use::Refused,
            (None, None) => Use::Offered,
            (None, Some(_)) => Use::Warned,
        }
    }

    /// Estimates the displacement of points with their rotation, or checks that they do not turn,
    /// and adds to `warnings`. `alone` estimates the displacement alone. `is_doubtful` tells that
    /// some points contradict the others, so that a turn may be theirs.
    pub fn solve(
        &self,
        method: Option<Method>,
        (rig, points): (&Rig, &[Correspondence]),
        is_doubtful: bool,
        warnings: &mut Vec<String>,
        alone: impl FnOnce() -> Result<Solution, String>,
    ) -> Result<Solution, String> {
        let seen = estimate(rig, points);
        let used = self.use_of(method);
        match (used, seen) {
            (Use::Demanded, Ok((pose, count))) => Ok(self.solution(&pose, pose.centroid_mm, count)),
            (Use::Demanded, Err(refusal)) => {
                Err(format!("{refusal}; without a rotation: --rotation refuse"))
            }
            (Use::Offered, seen) => {
                let reason = match seen {
                    Ok((pose, count)) if is_determined(&pose) => {
                        return Ok(self.solution(&pose, pose.centroid_mm, count));
                    }
                    Ok((pose, _)) => {
                        let sigma = pose.rotation_sigma_deg();
                        let largest = sigma.into_iter().fold(0.0, f64::max);
                        format!("its standard deviation would be {largest:.1} degrees")
                    }
                    Err(refusal) => refusal.to_string(),
                };
                let solution = alone()?;
                // Doubtful rows have warnings of their own, and are a likely cause.
                if !is_doubtful {
                    warnings.push(format!(
                        "the displacement is that of a target that does not turn: no rotation is \
                         estimated ({reason})"
                    ));
                }
                Ok(Solution {
                    turn: Some(Turn::default()),
                    ..solution
                })
            }
            (Use::Refused | Use::Warned, Ok((pose, _))) if is_turned(&pose) => {
                let angle = angle_deg(&pose);
                let reason = format!("the target turns by {angle:.2} degrees");
                if used == Use::Refused {
                    return Err(format!("{reason}; to measure it: --rotation estimate"));
                }
                warnings.push(format!(
                    "{reason}, and this estimate holds for targets that do not turn; use \
                     --rotation estimate"
                ));
                alone()
            }
            (Use::Refused | Use::Warned, _) => alone(),
        }
    }

    /// Returns true if the rotation of images is to be measured.
    pub fn is_demanded(&self) -> bool {
        self.rotation == Some(Rotation::Estimate)
    }

    /// Returns a pose as it is printed. `centroid_mm` is the mean of the points at the reference
    /// instant.
    pub fn solution(&self, pose: &Estimate, centroid_mm: [f64; 3], points: usize) -> Solution {
        let pivot_mm = self.pivot.unwrap_or_default().place_mm(centroid_mm);
        let moved = pose.displacement_of(pivot_mm);
        Solution {
            displacement_mm: moved.displacement_mm,
            sigma_mm: Some(moved.sigma_mm()),
            covariance_mm2: Some(moved.covariance_mm2),
            points,
            turn: Some(Turn {
                rotation_deg: Some(pose.rotation_deg()),
                rotation_sigma_deg: Some(pose.rotation_sigma_deg()),
                pivot_mm: Some(pivot_mm),
                is_significant: is_significant(pose),
            }),
        }
    }
}

/// Estimates the pose of the points that are in front of the cameras; returns their number, too.
fn estimate(rig: &Rig, points: &[Correspondence]) -> Result<(Estimate, usize), pose::Refusal> {
    let geometry = Geometry::new(rig).map_err(|_| pose::Refusal::Degenerate)?;
    let observed = points.iter();
    let observed = observed.filter_map(|point| Observation::new(&geometry, &point.views));
    let observed: Vec<Observation> = observed.collect();
    Ok((pose::solve(&geometry, &observed)?, observed.len()))
}

fn is_significant(pose: &Estimate) -> bool {
    // Without noise any rotation is.
    pose.rotation_chi_squared()
        .is_none_or(|chi| chi > SIGNIFICANT)
}

fn is_determined(pose: &Estimate) -> bool {
    let sigma = pose.rotation_sigma_deg();
    sigma.iter().all(|sigma| *sigma <= MOST_SIGMA_DEG) || is_significant(pose)
}

fn is_turned(pose: &Estimate) -> bool {
    is_significant(pose) && angle_deg(pose) > MOST_TURN_DEG
}

fn angle_deg(pose: &Estimate) -> f64 {
    pose.rotation_deg()
        .iter()
        .map(|d| d * d)
        .sum::<f64>()
        .sqrt()
}
