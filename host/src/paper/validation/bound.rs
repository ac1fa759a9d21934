//! The Cramér-Rao bound: the least variance of any unbiased estimator.
//!
//! The cameras see `N` points with unknown positions `P_i` before and `P_i + T` after the move;
//! every pixel coordinate carries independent noise of standard deviation `s`. Unknown are all
//! `P_i` and `T`: `3N + 3` numbers. With `J` the derivative of one point's pixels in all cameras by
//! its position,
//!
//! ```text
//! A_i = Σ J'J  before the move      B_i = Σ J'J  after the move      (3 x 3 each)
//! ```
//!
//! the Fisher information of `(P_i, T)` is `1/s²` times `[[A_i + B_i, B_i], [B_i, B_i]]`, because
//! both `P_i` and `T` act on the pixels after the move in the same way. The points are nuisance
//! parameters; the Schur complement removes each exactly:
//!
//! ```text
//! B_i - B_i (A_i + B_i)^-1 B_i = (A_i^-1 + B_i^-1)^-1
//! ```
//!
//! (the variances of two positions add up in their difference). The bound is
//! `s² (Σ_i (A_i^-1 + B_i^-1)^-1)^-1`.

use nalgebra::{Matrix2x3, Matrix3};
use trinocular_core::rig::{Camera, Rig};

/// Returns the least variance of each component of the displacement, mm², for points at `points_mm`
/// that move by `move_mm`, with noise of `noise_px` in every pixel coordinate. Assumes cameras
/// without lens distortion. Returns `None` if the points do not determine the displacement.
pub fn variance_mm2(
    rig: &Rig,
    points_mm: &[[f64; 3]],
    move_mm: [f64; 3],
    noise_px: f64,
) -> Option<[f64; 3]> {
    let mut information = Matrix3::zeros();
    for at in points_mm {
        let after = std::array::from_fn(|axis| at[axis] + move_mm[axis]);
        let before = position_information(rig, *at).try_inverse()?;
        let after = position_information(rig, after).try_inverse()?;
        information += (before + after).try_inverse()?;
    }
    let variance = information.try_inverse()? * (noise_px * noise_px);
    Some([0, 1, 2].map(|axis| variance[(axis, axis)]))
}

/// Returns `Σ J'J` over the cameras, px²/mm².
pub(crate) fn position_information(rig: &Rig, at: [f64; 3]) -> Matrix3<f64> {
    let cameras = rig.cameras.iter();
    cameras.fold(Matrix3::zeros(), |sum, camera| {
        let j = jacobian(camera, at);
        sum + j.transpose() * j
    })
}

/// Returns the derivative of a pixel by the point's position, px/mm.
fn jacobian(camera: &Camera, [x, y, z]: [f64; 3]) -> Matrix2x3<f64> {
    let [fx, fy] = camera.focal_px.map(|focal| focal / z);
    let [cx, cy] = camera.offset_mm;
    Matrix2x3::new(fx, 0.0, -fx * (x - cx) / z, 0.0, fy, -fy * (y - cy) / z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SMatrix;

    /// Computes the bound by brute force: finite differences of all 36 pixel coordinates by all 12
    /// unknowns, and one large inverse.
    #[test]
    fn bound_matches_full_inverse() {
        let rig = Rig::paper();
        let points = [
            [-40.0, 30.0, 800.0],
            [55.0, -20.0, 900.0],
            [10.0, 60.0, 990.0],
        ];
        let move_mm = [15.0, -7.0, 20.0];
        let pixels = |unknown: &[f64; 12]| {
            let mut pixels = SMatrix::<f64, 36, 1>::zeros();
            let mut at = 0;
            for point in unknown[..9].chunks(3) {
                for instant in [0.0, 1.0] {
                    for camera in &rig.cameras {
                        let now = std::array::from_fn(|i| point[i] + instant * unknown[9 + i]);
                        for value in camera.project(now) {
                            pixels[at] = value;
                            at += 1;
                        }
                    }
                }
            }
            assert_eq!(at, 36);
            pixels
        };
        let mut truth = [0.0; 12];
        truth[..9].copy_from_slice(points.as_flattened());
        truth[9..].copy_from_slice(&move_mm);
        let mut jacobian = SMatrix::<f64, 36, 12>::zeros();
        for j in 0..12 {
            let step = 1e-3;
            let moved = |by: f64| {
                let mut unknown = truth;
                unknown[j] += by;
                pixels(&unknown)
            };
            jacobian.set_column(j, &((moved(step) - moved(-step)) / (2.0 * step)));
        }
        let covariance = (jacobian.transpose() * jacobian).try_inverse().unwrap();
        let bound = variance_mm2(&rig, &points, move_mm, 1.0).unwrap();
        for axis in 0..3 {
            let full = covariance[(9 + axis, 9 + axis)];
            assert!(
                (bound[axis] / full - 1.0).abs() < 1e-6,
                "{axis}: {} {full}",
                bound[axis]
            );
        }
    }

    #[test]
    fn bound_scales_with_noise() {
        let rig = Rig::paper();
        let points = [[-40.0, 30.0, 800.0], [55.0, -20.0, 900.0]];
        let once = variance_mm2(&rig, &points, [1.0; 3], 0.1).unwrap();
        let twice = variance_mm2(&rig, &points, [1.0; 3], 0.2).unwrap();
        for axis in 0..3 {
            assert!((twice[axis] / once[axis] - 4.0).abs() < 1e-9);
        }
        assert_eq!(variance_mm2(&rig, &[], [1.0; 3], 0.1), None);
    }
}
