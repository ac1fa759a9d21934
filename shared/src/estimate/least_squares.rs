//! The paper's least squares (its eq. 7): `A x = d`, solved as `x = (A'A)^-1 A'd`.
//!
//! ```text
//!     | a1  0  a2 |        | d1 |
//! A = | 0  a1  a3 |    d = | d2 |
//!     | b1  0  b2 |        | d3 |
//!     | 0  b1  b3 |        | d4 |
//! ```
//!
//! in normalised coordinates, where the paper's focal length is 1. This estimator serves the
//! comparison with the other two; the station does not run it. It shares the closed form's bias at
//! finite displacements.

use super::Refusal;
use crate::sums::pair::PairSums;
use nalgebra::{Matrix3, Matrix4x3, Vector4};

/// Computes the target's displacement since the keyframe, mm.
///
/// # Errors
/// [`Refusal::TooFewPoints`] without points, [`Refusal::OutOfRange`] if a sum is not finite,
/// [`Refusal::Degenerate`] if `A'A` is singular to working precision (its determinant is the
/// paper's eq. 8).
///
/// # Example
/// ```
/// use trinocular_core::estimate::{closed_form, least_squares};
/// use trinocular_core::sums::pair::PairSums;
///
/// // The sums of one point on the axis at 900 mm, cameras at ±60 mm, displaced by (9, 0, 0) mm.
/// let mut sums = PairSums::new(&trinocular_core::rig::Rig::paper())?;
/// (sums.points, sums.a1, sums.b1) = (1, 60.0 / 900.0, 60.0 / 900.0);
/// (sums.a2, sums.b2) = (-0.5 * sums.a1.powi(2), 0.5 * sums.b1.powi(2));
/// (sums.d1, sums.d3) = (60.0 * 0.01, 60.0 * 0.01);
/// let [x, y, z] = least_squares::solve(&sums)?;
/// assert!((x - 9.0).abs() < 1e-6 && y.abs() < 1e-6 && z.abs() < 1e-4);
/// assert!((closed_form::solve(&sums)?[0] - x).abs() < 1e-6);
/// # Ok::<(), trinocular_core::estimate::Refusal>(())
/// ```
pub fn solve(sums: &PairSums) -> Result<[f64; 3], Refusal> {
    if sums.points == 0 {
        return Err(Refusal::TooFewPoints);
    }
    let matrix = matrix(sums);
    let right = Vector4::new(sums.d1, sums.d2, sums.d3, sums.d4);
    if !matrix.iter().chain(right.iter()).all(|s| s.is_finite()) {
        return Err(Refusal::OutOfRange);
    }
    let normal: Matrix3<f64> = matrix.transpose() * matrix;
    let size = normal.norm();
    if !(normal.determinant() > 1e-12 * size * size * size) {
        return Err(Refusal::Degenerate);
    }
    let solution = normal
        .cholesky()
        .ok_or(Refusal::Degenerate)?
        .solve(&(matrix.transpose() * right));
    Ok([solution[0], solution[1], solution[2]])
}

/// Returns the paper's matrix `A`, with `f = 1`.
pub fn matrix(sums: &PairSums) -> Matrix4x3<f64> {
    Matrix4x3::new(
        sums.a1, 0.0, sums.a2, //
        0.0, sums.a1, sums.a3, //
        sums.b1, 0.0, sums.b2, //
        0.0, sums.b1, sums.b3,
    )
}
