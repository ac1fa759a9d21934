//! Estimates of displacement and rotation from points or images, by the rules of the command
//! `estimate`.
//!
//! Points determine a rotation or they do not; where they do, it is estimated, unless a caller
//! refuses rotations or chooses a method. A [`Rule`] holds the choice for points and images; a
//! [`Choice`] of the caller, completed by the rig file, makes it.
//!
//! ```
//! use std::path::Path;
//! use trinocular_rig::rig_file::RigFile;
//! use trinocular_vision::estimation::Rule;
//! use trinocular_vision::points::parse;
//!
//! let rig = RigFile::paper();
//! let places = [[-60.0, -40.0, 900.0], [55.0, -35.0, 940.0], [5.0, 60.0, 880.0]];
//! let mut text = "id,camera,x0,y0,x1,y1\n".to_owned();
//! for (id, [x, y, z]) in places.into_iter().enumerate() {
//!     for (name, camera) in rig.names.iter().zip(&rig.rig.cameras) {
//!         let [a, b] = [[x, y, z], [x + 1.0, y, z]].map(|place| camera.project(place));
//!         text += &format!("{id},{name},{},{},{},{}\n", a[0], a[1], b[0], b[1]);
//!     }
//! }
//! let points = parse(Path::new("points.csv"), text.as_bytes(), &rig)?;
//! let mut warnings = Vec::new();
//! let solution = Rule::default().of_points(&rig.rig, &points, &mut warnings)?;
//! assert!((solution.displacement_mm[0] - 1.0).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod choice;
mod posed_points;

pub use choice::{Choice, Contradiction};
pub use trinocular_rig::pivot::Rotation;

use crate::flow::offered::{is_determined, is_significant};
use crate::flow::{
    CameraRefusal, Correspondence, FilteredFrameSet, Flow, FlowRefusal, Measurement, Offered,
    PoseMeasurement,
};
use crate::images::FrameSet;
use crate::points::Points;
use crate::sums::Sums;
use posed_points::PosedPoints;
use serde::Serialize;
use trinocular_core::estimate::Refusal;
use trinocular_core::estimate::pose::Estimate;
use trinocular_core::rig::Rig;
use trinocular_rig::pivot::Pivot;

/// Largest rotation of a target that counts as one that does not turn, degrees.
const MOST_TURN_DEG: f64 = 0.15;

/// The three estimators.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// The paper's eq. 9; needs exactly the cameras left, middle and right, nearly in line.
    ClosedForm,
    /// The paper's eq. 7; needs the same cameras as the closed form.
    LeastSquares,
    /// Exact for finite displacements and with its standard deviation; any 2 to 8 cameras.
    #[default]
    Midpoint,
}

impl Method {
    /// Returns the name of the method.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ClosedForm => "closed-form",
            Self::LeastSquares => "least-squares",
            Self::Midpoint => "midpoint",
        }
    }
}

impl std::fmt::Display for Method {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Rotation of the target about the axes of the cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Turn {
    /// Rotation vector, degrees; `None` if the points do not determine it.
    pub rotation_deg: Option<[f64; 3]>,
    /// Standard deviation about each axis, degrees.
    pub rotation_sigma_deg: Option<[f64; 3]>,
    /// Point of the target at the reference instant whose displacement is stated, mm.
    pub pivot_mm: Option<[f64; 3]>,
    /// True if noise imitates the rotation in less than one of 1,000 cases.
    #[serde(skip)]
    pub is_significant: bool,
}

/// Result of an estimator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Displacement of the target, or of its pivot if the rotation is estimated, mm.
    pub displacement_mm: [f64; 3],
    /// Standard deviation of each axis, mm, if the method gives it.
    pub sigma_mm: Option<[f64; 3]>,
    /// Covariance of the displacement, mm², if the method gives it.
    pub covariance_mm2: Option<[[f64; 3]; 3]>,
    /// Number of points used.
    pub points: usize,
    /// Rotation, if it was to be estimated.
    pub turn: Option<Turn>,
}

impl Solution {
    /// Refuses numbers that are not finite.
    fn finite(self) -> Result<Self, String> {
        let turn = self.turn.unwrap_or_default();
        let lists = [
            Some(self.displacement_mm),
            self.sigma_mm,
            turn.rotation_deg,
            turn.rotation_sigma_deg,
        ];
        let mut numbers = lists.iter().flatten().flatten();
        match numbers.all(|number| number.is_finite()) {
            true => Ok(self),
            false => Err(Refusal::OutOfRange.to_string()),
        }
    }
}

/// Measurement of one frame set.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Solution, or the estimator's refusal.
    pub solution: Result<Solution, String>,
    /// Inliers.
    pub correspondences: Vec<Correspondence>,
    /// Active cameras, as indices into the rig's cameras.
    pub cameras: Vec<usize>,
    /// Number of points left out.
    pub rejected: usize,
    /// Refused cameras, as indices into the rig's cameras, with the reasons.
    pub refused_cameras: Vec<(usize, CameraRefusal)>,
    /// Pose with its covariance, if the rotation was estimated.
    pub pose: Option<Estimate>,
}

impl Measured {
    /// Returns the solution with its numbers of points used and rejected.
    ///
    /// # Errors
    /// The refusal in words, with the numbers of points.
    pub fn counted(&self) -> Result<(Solution, usize), String> {
        counted(
            self.solution.clone(),
            self.correspondences.len(),
            self.rejected,
        )
    }
}

/// Returns a solution of `count` points with the number of points rejected in all.
///
/// # Errors
/// The refusal in words, with the numbers of points.
pub fn counted(
    solution: Result<Solution, String>,
    count: usize,
    rejected: usize,
) -> Result<(Solution, usize), String> {
    match solution.and_then(Solution::finite) {
        Ok(solution) => Ok((solution, rejected + count - solution.points)),
        Err(reason) => Err(format!("{reason} ({count} points, {rejected} rejected)")),
    }
}

/// Choice of the estimate: method, treatment of rotations, and pivot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rule {
    /// Method; `None` for the midpoint with the rotation if points determine it.
    pub method: Option<Method>,
    /// Treatment of a target that turns. `None` without a method estimates the rotation if the
    /// points determine it, or if the pivot needs it. `None` with a method estimates none: matched
    /// points that turn get a warning, and images that show a turn are refused.
    pub rotation: Option<Rotation>,
    /// Point of the target whose displacement is stated.
    pub pivot: Pivot,
}

/// Use of the rotation of one measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// Estimate it, or refuse.
    Demanded,
    /// Estimate it if the points determine it.
    Offered,
    /// Refuse a target that turns.
    Refused,
    /// Warn of a target that turns.
    Warned,
}

impl Rule {
    /// Returns the use of the rotation.
    pub const fn rotation_use(&self) -> Use {
        match (self.rotation, self.method) {
            (Some(Rotation::Estimate), _) => Use::Demanded,
            (Some(Rotation::Refuse), _) => Use::Refused,
            // Without a rotation, only the centroid's displacement is known.
            (None, None) if matches!(self.pivot, Pivot::Centroid) => Use::Offered,
            (None, None) => Use::Demanded,
            (None, Some(_)) => Use::Warned,
        }
    }

    /// Returns the pivot if the rotation is estimated, as [`Flow::set_pivot`] takes it.
    pub const fn estimated_pivot(&self) -> Option<Pivot> {
        match self.rotation_use() {
            Use::Demanded | Use::Offered => Some(self.pivot),
            Use::Refused | Use::Warned => None,
        }
    }

    /// Estimates the displacement of points with their rotation, or checks that they do not turn,
    /// and adds to `warnings`.
    ///
    /// # Errors
    /// The refusal in words.
    pub fn of_points(
        &self,
        rig: &Rig,
        points: &Points,
        warnings: &mut Vec<String>,
    ) -> Result<Solution, String> {
        let alone = || {
            let sums = Sums::new(rig, &points.correspondences).map(|mut sums| {
                sums.centred.overlap *= points.variance_inflation;
                sums
            });
            let solution = sums.and_then(|sums| estimate(self.method.unwrap_or_default(), &sums));
            solution.map_err(|refusal| refusal.to_string())
        };
        // The pose takes its noise from the points' misfit, which needs no inflation.
        let seen = PosedPoints::of(rig, &points.correspondences);
        let turned = |posed: &PosedPoints| {
            let pivot_mm = posed
                .place_mm(self.pivot)
                .map_err(|missed| missed.to_string())?;
            Ok(solution(&posed.pose, pivot_mm, posed.observed.len()))
        };
        let used = self.rotation_use();
        match (used, seen) {
            (Use::Demanded, Ok(posed)) => turned(&posed),
            (Use::Demanded, Err(refusal)) => {
                Err(format!("{refusal}; without a rotation: --rotation refuse"))
            }
            (Use::Offered, seen) => {
                let reason = match seen {
                    Ok(posed) if is_determined(&posed.pose) => return turned(&posed),
                    Ok(posed) => {
                        let sigma = posed.pose.rotation_sigma_deg();
                        let largest = sigma.into_iter().fold(0.0, f64::max);
                        format!("its standard deviation would be {largest:.1} degrees")
                    }
                    Err(refusal) => refusal.to_string(),
                };
                let solution = alone()?;
                // Doubtful rows have warnings of their own, and are a likely cause.
                if points.doubts.is_empty() {
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
            (Use::Refused | Use::Warned, Ok(posed)) if is_turned(&posed.pose) => {
                let angle = angle_deg(&posed.pose);
                let unless = match points.doubts.is_empty() {
                    true => "",
                    false => ", unless the rows that do not fit the others are wrong",
                };
                let reason = format!("the target turns by {angle:.2} degrees{unless}");
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

    /// Measures a frame set against the keyframe of `flow`, with the rotation of the target unless
    /// a method or [`Rotation::Refuse`] is given. `rig` is the rig of `flow`.
    ///
    /// # Errors
    /// The refusal of the flow in words.
    pub fn of_images(
        &self,
        flow: &mut Flow,
        rig: &Rig,
        frame_set: &FrameSet,
    ) -> Result<Measured, String> {
        let seen = flow.measure_with(frame_set, &mut (), |flow, filtered, _| {
            self.seen(flow, filtered)
        });
        self.measured(flow, rig, seen)
    }

    /// Does the same as [`Rule::of_images`] with a frame set that is already filtered.
    ///
    /// # Errors
    /// The refusal of the flow in words.
    pub fn of_filtered(
        &self,
        flow: &mut Flow,
        rig: &Rig,
        filtered: &FilteredFrameSet,
    ) -> Result<Measured, String> {
        let seen = self.seen(flow, filtered);
        self.measured(flow, rig, seen)
    }

    fn seen(&self, flow: &mut Flow, filtered: &FilteredFrameSet) -> Result<Offered, FlowRefusal> {
        match self.rotation_use() {
            Use::Offered => flow.measure_filtered_offered(filtered),
            Use::Demanded => {
                // A laser that misses needs no measurement to be reported.
                flow.keyframe_pivot_mm(self.pivot)?;
                let seen = flow.measure_filtered_pose(filtered)?;
                Ok(Offered::Pose(Box::new(seen)))
            }
            Use::Refused | Use::Warned => {
                let seen = flow.measure_filtered(filtered, &mut ())?;
                Ok(Offered::Displacement(Box::new(seen)))
            }
        }
    }

    fn measured(
        &self,
        flow: &Flow,
        rig: &Rig,
        seen: Result<Offered, FlowRefusal>,
    ) -> Result<Measured, String> {
        let refused = |refusal: FlowRefusal| refusal.to_string();
        match seen.map_err(refused)? {
            Offered::Pose(seen) => {
                let pivot_mm = flow.keyframe_pivot_mm(self.pivot).map_err(refused)?;
                Ok(of_pose(*seen, pivot_mm))
            }
            Offered::Displacement(seen) => Ok(self.of_displacement(rig, *seen)),
        }
    }

    fn of_displacement(&self, rig: &Rig, seen: Measurement) -> Measured {
        let method = self.method.unwrap_or_default();
        let solution = Sums::of(rig, &seen).and_then(|sums| estimate(method, &sums));
        let turn = (self.rotation_use() == Use::Offered).then(Turn::default);
        let solution = solution.map(|solution| Solution { turn, ..solution });
        Measured {
            solution: solution.map_err(|refusal| refusal.to_string()),
            correspondences: seen.correspondences,
            cameras: seen.cameras,
            rejected: seen.rejected.total(),
            refused_cameras: seen.refused_cameras,
            pose: None,
        }
    }
}

fn of_pose(seen: PoseMeasurement, pivot_mm: [f64; 3]) -> Measured {
    let count = seen.correspondences.len();
    Measured {
        solution: Ok(solution(&seen.pose, pivot_mm, count)),
        correspondences: seen.correspondences,
        cameras: seen.cameras,
        rejected: seen.rejected.total(),
        refused_cameras: seen.refused_cameras,
        pose: Some(seen.pose),
    }
}

/// Returns the solution of a pose: the displacement of the target's point at `pivot_mm`.
fn solution(pose: &Estimate, pivot_mm: [f64; 3], points: usize) -> Solution {
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

fn estimate(method: Method, sums: &Sums) -> Result<Solution, Refusal> {
    let estimates = sums.estimates();
    let (displacement_mm, midpoint) = match method {
        Method::Midpoint => {
            let midpoint = estimates.midpoint?;
            (midpoint.displacement_mm, Some(midpoint))
        }
        Method::ClosedForm => (estimates.closed_form?, None),
        Method::LeastSquares => (estimates.least_squares?, None),
    };
    Ok(Solution {
        displacement_mm,
        sigma_mm: midpoint.as_ref().map(|estimate| estimate.sigma_mm()),
        covariance_mm2: midpoint.map(|estimate| estimate.covariance_mm2),
        points: sums.centred.points as usize,
        turn: None,
    })
}

fn is_turned(pose: &Estimate) -> bool {
    is_significant(pose) && angle_deg(pose) > MOST_TURN_DEG
}

fn angle_deg(pose: &Estimate) -> f64 {
    let squares = pose.rotation_deg().map(|degrees| degrees * degrees);
    squares.iter().sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOLUTION: Solution = Solution {
        displacement_mm: [1.0, 2.0, 3.0],
        sigma_mm: None,
        covariance_mm2: None,
        points: 8,
        turn: None,
    };

    #[test]
    fn points_beyond_those_used_are_rejected() {
        assert_eq!(counted(Ok(SOLUTION), 10, 5), Ok((SOLUTION, 7)));
    }

    #[test]
    fn infinite_solution_is_refused_with_counts() {
        let infinite = Solution {
            sigma_mm: Some([0.1, f64::INFINITY, 0.1]),
            ..SOLUTION
        };
        let reason = counted(Ok(infinite), 10, 5).unwrap_err();
        assert!(reason.ends_with("(10 points, 5 rejected)"), "{reason}");
        let reason = counted(Err("lost".to_owned()), 0, 2).unwrap_err();
        assert_eq!(reason, "lost (0 points, 2 rejected)");
    }

    #[test]
    fn rotation_use_follows_both_options() {
        let of = |rotation, method| {
            let rule = Rule {
                method,
                rotation,
                pivot: Pivot::Centroid,
            };
            rule.rotation_use()
        };
        let midpoint = Some(Method::Midpoint);
        assert_eq!(of(None, None), Use::Offered);
        assert_eq!(of(None, midpoint), Use::Warned);
        assert_eq!(of(Some(Rotation::Refuse), midpoint), Use::Refused);
        assert_eq!(of(Some(Rotation::Estimate), None), Use::Demanded);
    }
}
