//! Rotations by their Cayley vector `ω = tan(θ/2) n`.
//!
//! With `Ω = [ω]×` and `n = |ω|²`, without trigonometry:
//!
//! ```text
//! (I - Ω)^-1 = (I + Ω + ω ω') / (1 + n)
//! R = (I - Ω)^-1 (I + Ω) = ((1 - n) I + 2 Ω + 2 ω ω') / (1 + n)
//! ```

use libm::{atan, sqrt};
use nalgebra::{Matrix3, Vector3};

/// Returns `(I - Ω)^-1`.
pub(super) fn half_inverse(omega: &Vector3<f64>) -> Matrix3<f64> {
    let all = Matrix3::identity() + omega.cross_matrix() + omega * omega.transpose();
    all / (1.0 + omega.norm_squared())
}

/// Returns the rotation matrix.
pub(super) fn matrix(omega: &Vector3<f64>) -> Matrix3<f64> {
    half_inverse(omega) * (Matrix3::identity() + omega.cross_matrix())
}

/// Returns the rotation vector: axis times angle, rad.
pub(super) fn vector(omega: &Vector3<f64>) -> Vector3<f64> {
    let length = sqrt(omega.norm_squared());
    // The limit of 2 atan(x)/x at 0.
    let factor = if length > 0.0 {
        2.0 * atan(length) / length
    } else {
        2.0
    };
    factor * omega
}

/// Returns the derivative by `ω` of the small rotation after the estimated one, rad:
///
/// ```text
/// 2 (I + Ω) / (1 + n)
/// ```
pub(super) fn derivative(omega: &Vector3<f64>) -> Matrix3<f64> {
    2.0 / (1.0 + omega.norm_squared()) * (Matrix3::identity() + omega.cross_matrix())
}
