//! Homographies: maps of a plane onto an image.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Fits the homography that maps `from` to `to` by the direct linear transform, with both sides
/// normalised to mean 0 and mean square 2 (R. Hartley, *In Defense of the Eight-Point Algorithm*,
/// 1997). Returns `None` for fewer than four points or points in line.
pub fn fit(from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    if from.len() != to.len() || from.len() < 4 {
        return None;
    }
    let (a, b) = (normalising(from)?, normalising(to)?);
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (p, q) in from.iter().zip(to) {
        let [x, y] = apply(&a, *p);
        let [u, v] = apply(&b, *q);
        let rows = [
            [x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y, -u],
            [0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y, -v],
        ];
        for row in rows {
            let row = SVector::<f64, 9>::from(row);
            normal += row * row.transpose();
        }
    }
    let eigen = normal.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    // With two free directions the solution is not unique.
    let free = eigen
        .eigenvalues
        .iter()
        .filter(|e| **e < 1e-10 * eigen.eigenvalues.max());
    if free.count() > 1 {
        return None;
    }
    let h = eigen.eigenvectors.column(least);
    let h = Matrix3::from_fn(|i, j| h[3 * i + j]);
    let h = b.try_inverse()? * h * a;
    h.iter().all(|e| e.is_finite()).then_some(h)
}

/// Maps a point by the homography.
pub fn apply(h: &Matrix3<f64>, [x, y]: [f64; 2]) -> [f64; 2] {
    let p = h * Vector3::new(x, y, 1.0);
    [p.x / p.z, p.y / p.z]
}

fn normalising(points: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    let count = points.len() as f64;
    let mean = [0, 1].map(|i| points.iter().map(|p| p[i]).sum::<f64>() / count);
    let spread = points
        .iter()
        .map(|p| (p[0] - mean[0]).powi(2) + (p[1] - mean[1]).powi(2))
        .sum::<f64>();
    let scale = (2.0 * count / spread).sqrt();
    let shift = |i: usize| -scale * mean[i];
    scale
        .is_finite()
        .then(|| Matrix3::new(scale, 0.0, shift(0), 0.0, scale, shift(1), 0.0, 0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_points_give_the_map() {
        let truth = Matrix3::new(1.1, 0.2, 300.0, -0.1, 0.9, 200.0, 1e-3, -5e-4, 1.0);
        let from: Vec<[f64; 2]> = (0..12)
            .map(|i| [f64::from(i % 4) * 25.0, f64::from(i / 4) * 25.0])
            .collect();
        let to: Vec<[f64; 2]> = from.iter().map(|p| apply(&truth, *p)).collect();
        let found = fit(&from, &to).unwrap();
        assert!((found / found[(2, 2)] - truth).abs().max() < 1e-9);
    }

    #[test]
    fn degenerate_points_are_refused() {
        let line: Vec<[f64; 2]> = (0..6).map(|i| [f64::from(i), 2.0 * f64::from(i)]).collect();
        assert!(fit(&line, &line).is_none());
        assert!(fit(&line[..3], &line[..3]).is_none());
        let same = [[1.0, 1.0]; 5];
        assert!(fit(&same, &same).is_none());
    }
}
