//! Weighted sums over all points, the removal of the noise's share, and their solution.

use super::Refusal;
use super::equation::{Coefficients, Derivatives, Equation, Weight};
use libm::sqrt;
use nalgebra::{SMatrix, SVector};

/// Smallest eigenvalue of the matrix scaled to unit diagonal. Points off one line by 1 in 100,000
/// of its length reach it.
const MIN_EIGENVALUE: f64 = 1e-10;

/// Largest share of noise in the information about any direction. Half of the standard deviation of
/// the points across a line may be noise; beyond, a narrow target looks like a line.
const MAX_NOISE_SHARE: f64 = 0.25;

type Matrix6 = SMatrix<f64, 6, 6>;
type Matrix7 = SMatrix<f64, 7, 7>;
pub(super) type Vector6 = SVector<f64, 6>;

/// Sums `Z' W Z` over all points, and the expectation of what noise adds to them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Normal {
    /// `Σ Z' W Z`.
    sums: Matrix7,
    /// `Σ_points Σ_j Z_j' W Z_j` with the derivatives `Z_j`, per unit of the noise's variance.
    noise: Matrix7,
}

/// Solution `(s, ω)` with the inverse of its matrix.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solution {
    /// `(s, ω)`: mm, and dimensionless.
    pub theta: Vector6,
    /// Covariance of `theta` per unit of the noise's variance.
    pub inverse: Matrix6,
}

impl Normal {
    /// Adds one point.
    pub fn add(&mut self, equation: &Equation, weight: &Weight, noise: Option<&Derivatives>) {
        let square = |z: &Coefficients| z.transpose() * (weight.0 * z);
        self.sums += square(&equation.coefficients);
        for derivative in noise.into_iter().flatten() {
            self.noise += square(derivative);
        }
    }

    /// Adds the sums of other points.
    pub fn join(&mut self, other: &Self) {
        self.sums += other.sums;
        self.noise += other.noise;
    }

    /// Solves for `(s, ω)` and removes the share of noise with the variance `scale`.
    ///
    /// The rest is always definite, because at most a quarter of the information in any direction
    /// is removed.
    pub fn solve(&self, scale: f64) -> Result<Solution, Refusal> {
        let matrix: Matrix6 = self.sums.fixed_view::<6, 6>(0, 0).into();
        let right: Vector6 = self.sums.fixed_view::<6, 1>(0, 6).into();
        if !self.sums.iter().chain(&self.noise).all(|n| n.is_finite()) {
            return Err(Refusal::OutOfRange);
        }
        // Jacobi's scaling to unit diagonal, because mm and angles differ by orders of magnitude.
        let diagonal = matrix.diagonal();
        if diagonal.iter().any(|d| !(*d > 0.0)) {
            return Err(Refusal::Degenerate);
        }
        let units = Matrix6::from_diagonal(&diagonal.map(|d| 1.0 / sqrt(d)));
        let scaled = units * matrix * units;
        if !(scaled.symmetric_eigenvalues().min() > MIN_EIGENVALUE) {
            return Err(Refusal::Degenerate);
        }
        let cholesky = scaled.cholesky().ok_or(Refusal::Degenerate)?;
        // The largest share of noise in any direction: the largest eigenvalue of L^-1 N L^-T.
        let noise: Matrix6 = self.noise.fixed_view::<6, 6>(0, 0).into();
        let half = cholesky
            .l()
            .solve_lower_triangular(&(units * noise * units))
            .ok_or(Refusal::Degenerate)?;
        let whitened = cholesky
            .l()
            .solve_lower_triangular(&half.transpose())
            .ok_or(Refusal::Degenerate)?;
        let share = scale * whitened.symmetric_eigenvalues().max();
        if share > MAX_NOISE_SHARE {
            return Err(Refusal::Degenerate);
        }
        let noise_right: Vector6 = self.noise.fixed_view::<6, 1>(0, 6).into();
        let rest = scaled - scale * (units * noise * units);
        let rest = rest.cholesky().ok_or(Refusal::Degenerate)?;
        let theta = units * rest.solve(&(units * (right - scale * noise_right)));
        Ok(Solution {
            theta,
            inverse: units * rest.inverse() * units,
        })
    }
}
