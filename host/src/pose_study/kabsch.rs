//! Rotation and displacement by the alignment of triangulated points (Kabsch 1976, Horn 1987,
//! Umeyama 1991): least squares of the distances in space.
//!
//! All directions count alike, although the depth of a triangulated point is some ten times less
//! certain than its place across.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// Returns the rotation and the translation of `p1 = R p0 + t` with the least sum of squared
/// distances; `None` without points, or if the numbers of points differ.
pub fn align(
    before: &[Vector3<f64>],
    after: &[Vector3<f64>],
) -> Option<(Rotation3<f64>, Vector3<f64>)> {
    if before.is_empty() || before.len() != after.len() {
        return None;
    }
    let mean = |points: &[Vector3<f64>]| {
        let sum: Vector3<f64> = points.iter().sum();
        sum / points.len() as f64
    };
    let (from, to) = (mean(before), mean(after));
    let pairs = before.iter().zip(after);
    let spread: Matrix3<f64> = pairs
        .map(|(p0, p1)| (p1 - to) * (p0 - from).transpose())
        .sum();
    let svd = spread.try_svd(true, true, 1e-15, 100)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    // A reflection is turned back in the direction of least spread.
    let handed = Vector3::new(1.0, 1.0, (u * v_t).determinant().signum());
    let rotation = Rotation3::from_matrix_unchecked(u * Matrix3::from_diagonal(&handed) * v_t);
    Some((rotation, to - rotation * from))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_points_give_their_motion() {
        let turn = Rotation3::new(Vector3::new(0.3, -0.8, 1.1));
        let moved = Vector3::new(4.0, -90.0, 12.0);
        // The last set is flat.
        for depth in [100.0, 0.0] {
            let before = [
                [0.0, 0.0, 0.0],
                [70.0, 5.0, 0.1],
                [10.0, 60.0, 1.0],
                [-30.0, 20.0, 0.5],
            ]
            .map(|[x, y, z]| Vector3::new(x, y, z * depth));
            let after = before.map(|at| turn * at + moved);
            let (found, shift) = align(&before, &after).expect("four points");
            assert!((found.matrix() - turn.matrix()).norm() < 1e-12);
            assert!((shift - moved).norm() < 1e-10);
        }
        assert_eq!(align(&[], &[]), None);
    }
}
