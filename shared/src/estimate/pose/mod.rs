//! The pose estimator: displacement and rotation of a rigid target, in closed form.
//!
//! A target that turns by the angle `θ < 180°` about the unit vector `n` has the Cayley vector `ω =
//! tan(θ/2) n`. With `p0` and `p1` the positions of one of its points before and after, `p̄` their
//! mean, and `m` any fixed point, its motion is *linear* in `(s, ω)`, without approximation:
//!
//! ```text
//! p1 - p0 = s + 2 ω × (p̄ - m)
//! ```
//!
//! `s` is the displacement of the point of the target whose mean of both instants is `m`. For `ω =
//! 0` this is the model of [`super::midpoint`], of which this estimator is the extension.
//!
//! A camera of the rig measures directions and inverse depth, not positions. [`Observation`]
//! reduces the views of a point to `a = (α, β, ρ) = (X/Z, Y/Z, 1/Z)` about the mean camera, at
//! either instant, and loses nothing. Multiplied by `ρ0 ρ1` the model becomes bilinear in `a0` and
//! `a1`, so that the share of the noise in the sums is known exactly and can be removed.
//!
//! # Passes
//!
//! 1. The sums with the weights of a target that does not turn; the noise's share removed.
//! 2. The same with the weights that noise has in the equation of each point, given the result of
//!    the first pass. They matter because a rotation mixes the noise of depth, some ten times that
//!    of x and y, into all three axes.
//!
//! There are no start values and no iterations. [`plain`], [`noise_removed`] and [`reweighted`]
//! are the stages; [`solve`] is the last with noise taken from the observations themselves.
//!
//! # Rotations of half a turn
//!
//! A half turn has no Cayley vector. If the image has turned by more than 90°, all points of the
//! keyframe are turned about the cameras' axis first, by a multiple of 90° ([`QuarterTurn`]), and
//! the rotation that is left is estimated. Rotations about z may therefore be of any size (tests
//! `turn_about_z_is_exact_at_any_angle` and `pose_reaches_bound_after_90_to_180_degrees`).
//!
//! # Accuracy
//!
//! Without noise the error is that of rounding at any rotation below 180° (test
//! `pose_is_exact_at_any_rotation`: below 1e-9 mm and 1e-11 rad at up to 170°). With independent
//! noise the standard deviation is at most 1.06 times the Cramér-Rao bound, and the bias at most
//! 10 µm and 20 mdeg (test `pose_reaches_bound`: 50 to 200 points, 0.02 to 0.1 px, 0 to 20°).
//!
//! # Sources
//!
//! Cayley's transform of rotations; motion from disparity images by Demirdjian and Darrell (2001);
//! removal of the noise's share as in errors-in-variables regression (Fuller 1987).

mod cayley;
mod equation;
mod estimate;
mod noise;
mod normal;
mod observation;
mod parts;
mod quarter_turn;

pub use estimate::{Estimate, PivotDisplacement};
pub use noise::Noise;
pub use observation::Observation;
pub use parts::{Parts, Point};
pub use quarter_turn::QuarterTurn;

use crate::sums::centred::Geometry;
use equation::{Equation, Weight};
use nalgebra::Vector3;
use normal::{Normal, Solution};
use quarter_turn::Turned;

/// Smallest number of points that determine a rotation.
pub const LEAST_POINTS: usize = 3;

/// Smallest mean squared distance of the points from their centroid over the squared distance of
/// the centroid: points within 0.1 mrad of each other do not determine a rotation.
const MIN_SPREAD: f64 = 1e-8;

/// Reason for which the estimator gives no pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Fewer than three points.
    TooFewPoints,
    /// The points do not determine a rotation: they are in one place, on one line, turned by 180°
    /// about an axis across z, or as close to one of these as their noise.
    Degenerate,
    /// A number is not finite.
    OutOfRange,
}

impl core::fmt::Display for Refusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::TooFewPoints => "too few points: a rotation takes at least 3",
            Self::Degenerate => {
                "the points do not determine a rotation (on one line, in one place, or too noisy)"
            }
            Self::OutOfRange => "a number is not finite or out of range",
        })
    }
}

impl core::error::Error for Refusal {}

/// Estimates the pose with all stages; the noise is that of the observations' misfit.
///
/// # Errors
/// [`Refusal`], if the points do not determine a rotation.
///
/// # Example
/// ```
/// use trinocular_core::estimate::pose::{self, Observation};
/// use trinocular_core::rig::Rig;
/// use trinocular_core::sums::{View, centred::Geometry};
///
/// // A quarter turn about z, through (0, 0, 900) mm, without any displacement of that point.
/// let rig = Rig::paper();
/// let geometry = Geometry::new(&rig)?;
/// let turned = |[x, y, z]: [f64; 3]| [-y, x, z];
/// let points = [[-60.0, -40.0, 900.0], [55.0, -35.0, 940.0], [5.0, 60.0, 880.0]];
/// let observations: Vec<Observation> = (points.iter())
///     .filter_map(|at| {
///         let views = rig.cameras.iter().map(|camera| {
///             let end = camera.project(turned(*at));
///             View::from_pixels(camera, camera.project(*at), end)
///         });
///         Observation::new(&geometry, &views.collect::<Vec<_>>())
///     })
///     .collect();
/// let pose = pose::solve(&geometry, &observations).expect("three points off one line");
/// let [x, y, z] = pose.rotation_deg();
/// assert!(x.abs() < 1e-6 && y.abs() < 1e-6 && (z - 90.0).abs() < 1e-6);
/// let [x, y, z] = pose.displacement_of([0.0, 0.0, 900.0]).displacement_mm;
/// assert!(x.abs() < 1e-6 && y.abs() < 1e-6 && z.abs() < 1e-6);
/// # Ok::<(), trinocular_core::estimate::Refusal>(())
/// ```
pub fn solve(geometry: &Geometry, observations: &[Observation]) -> Result<Estimate, Refusal> {
    let turned = Turned::nearest(geometry, observations);
    let noise = Noise::of_turned(geometry, &turned);
    second_stage(geometry, &turned, &noise)
}

/// Estimates the pose with the weights of a target that does not turn, and leaves the noise's share
/// in, which biases it towards no rotation. The fastest stage, for the search of a consensus.
///
/// # Errors
/// [`Refusal`], if the points do not determine a rotation.
pub fn plain(geometry: &Geometry, observations: &[Observation]) -> Result<Estimate, Refusal> {
    let turned = Turned::nearest(geometry, observations);
    let (scale, _) = Noise::of_turned(geometry, &turned).factor();
    first_stage(geometry, &turned, None, scale)
}

/// Estimates the pose with the weights of a target that does not turn and removes the noise's
/// share: the first pass.
///
/// # Errors
/// [`Refusal`], if the points do not determine a rotation.
pub fn noise_removed(
    geometry: &Geometry,
    observations: &[Observation],
    noise: &Noise,
) -> Result<Estimate, Refusal> {
    let (scale, _) = noise.factor();
    let turned = Turned::nearest(geometry, observations);
    first_stage(geometry, &turned, Some(noise), scale)
}

/// Estimates the pose by both passes.
///
/// # Errors
/// [`Refusal`], if the points do not determine a rotation.
pub fn reweighted(
    geometry: &Geometry,
    observations: &[Observation],
    noise: &Noise,
) -> Result<Estimate, Refusal> {
    let turned = Turned::nearest(geometry, observations);
    second_stage(geometry, &turned, noise)
}

/// Solves both passes, and states the covariance.
fn second_stage(
    geometry: &Geometry,
    observations: &Turned<'_>,
    noise: &Noise,
) -> Result<Estimate, Refusal> {
    let middle = middle(observations)?;
    let first = first_pass(geometry, observations, Some(noise), &middle)?;
    let (scale, factor) = noise.factor();
    let weigh = |observation: &Observation| {
        let derivatives = equation::noise(geometry, observation, &middle, &factor);
        let weight = Weight::of_noise(&derivatives, &first)?;
        Some((weight, derivatives))
    };
    let mut normal = Normal::default();
    for observation in observations.iter() {
        let equation = Equation::new(&observation, &middle);
        let (weight, derivatives) = weigh(&observation).ok_or(Refusal::Degenerate)?;
        normal.add(&equation, &weight, Some(&derivatives));
    }
    let solution = normal.solve(scale)?;
    let weigh =
        |observation: &Observation| weigh(observation).map_or(Weight::ZERO, |(weight, _)| weight);
    Ok(finish(
        geometry,
        observations,
        scale,
        &middle,
        &solution,
        weigh,
    ))
}

/// Solves the sums of the first pass, and states the covariance for noise of this scale.
fn first_stage(
    geometry: &Geometry,
    observations: &Turned<'_>,
    removed: Option<&Noise>,
    scale: f64,
) -> Result<Estimate, Refusal> {
    let middle = middle(observations)?;
    let solution = first_pass(geometry, observations, removed, &middle)?;
    let weigh = |observation: &Observation| Weight::still(geometry, observation);
    Ok(finish(
        geometry,
        observations,
        scale,
        &middle,
        &solution,
        weigh,
    ))
}

/// Solves the sums of the first pass. Leaves the noise's share in if no noise is `removed`.
fn first_pass(
    geometry: &Geometry,
    observations: &Turned<'_>,
    removed: Option<&Noise>,
    middle: &Vector3<f64>,
) -> Result<Solution, Refusal> {
    let factored = removed.map(Noise::factor);
    let mut normal = Normal::default();
    for observation in observations.iter() {
        let equation = Equation::new(&observation, middle);
        let derivatives =
            factored.map(|(_, factor)| equation::noise(geometry, &observation, middle, &factor));
        let weight = Weight::still(geometry, &observation);
        normal.add(&equation, &weight, derivatives.as_ref());
    }
    normal.solve(factored.map_or(0.0, |(scale, _)| scale))
}

/// Returns the mean of all points of both instants about the mean camera, mm: the pivot for which
/// displacement and rotation depend least on each other.
fn middle(observations: &Turned<'_>) -> Result<Vector3<f64>, Refusal> {
    if observations.all.len() < LEAST_POINTS {
        return Err(Refusal::TooFewPoints);
    }
    let count = observations.all.len() as f64;
    let at = |observation: Observation| 0.5 * (observation.start_mm() + observation.end_mm());
    let sum: Vector3<f64> = observations.iter().map(at).sum();
    let middle = sum / count;
    let squares = observations.iter().map(|o| (at(o) - middle).norm_squared());
    let spread = squares.sum::<f64>() / count / middle.norm_squared();
    if !spread.is_finite() {
        return Err(Refusal::OutOfRange);
    }
    if spread < MIN_SPREAD {
        return Err(Refusal::Degenerate);
    }
    Ok(middle)
}

/// Adds the covariance to a solution: its scale is that of the noise and of the residuals.
fn finish(
    geometry: &Geometry,
    observations: &Turned<'_>,
    scale: f64,
    middle: &Vector3<f64>,
    solution: &Solution,
    weigh: impl Fn(&Observation) -> Weight,
) -> Estimate {
    let squares = observations.iter().map(|observation| {
        let residual = Equation::new(&observation, middle).residual(solution);
        residual.dot(&(weigh(&observation).0 * residual))
    });
    let count = observations.all.len();
    let variance = noise::variance(geometry, scale, squares.sum(), count);
    let starts = observations.all.iter().map(Observation::start_mm);
    let start_mm = starts.sum::<Vector3<f64>>() / count as f64;
    let first = observations.first;
    Estimate::new(geometry, (first, start_mm), middle, solution, variance)
}
