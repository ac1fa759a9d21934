//! The bilinear equation of one point, its noise and its weight.
//!
//! With `u = (α, β, 1)` at either instant, the model times `ρ0 ρ1` is
//!
//! ```text
//! B = P s + ω × Q        P = ρ0 ρ1      Q = ρ0 u1 + ρ1 u0 - 2 P m      B = ρ0 u1 - ρ1 u0
//! ```
//!
//! Note the two means: `Q / 2 P` is the mean of the two *positions* about `m`, weighted by depth,
//! not that of the two directions. The coefficients are `Z = [P I, -[Q]×, B]`, three rows of seven.
//! Their derivatives by the six numbers of an observation are
//!
//! | by | P' | Q' | B' |
//! |---|---|---|---|
//! | `α0`, `β0` | 0 | `ρ1 e` | `-ρ1 e` |
//! | `ρ0` | `ρ1` | `u1 - 2 ρ1 m` | `u1` |
//! | `α1`, `β1` | 0 | `ρ0 e` | `ρ0 e` |
//! | `ρ1` | `ρ0` | `u0 - 2 ρ0 m` | `-u0` |

use super::Observation;
use super::normal::Solution;
use crate::sums::centred::Geometry;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// Coefficients of an equation: by `s`, by `ω`, and the right-hand side.
pub(super) type Coefficients = SMatrix<f64, 3, 7>;

/// Equation of one point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Equation {
    pub coefficients: Coefficients,
}

/// Derivatives of the coefficients by six independent noises of equal variance.
pub(super) type Derivatives = [Coefficients; 6];

impl Equation {
    /// Creates the equation of a point about the pivot `middle`.
    pub fn new(observation: &Observation, middle: &Vector3<f64>) -> Self {
        let ([u0, u1], [rho0, rho1]) = split(observation);
        let product = rho0 * rho1;
        let lever = rho0 * u1 + rho1 * u0 - 2.0 * product * middle;
        Self {
            coefficients: assemble(product, lever, rho0 * u1 - rho1 * u0),
        }
    }

    /// Returns `B - P s - ω × Q`.
    pub fn residual(&self, solution: &Solution) -> Vector3<f64> {
        apply(&self.coefficients, solution)
    }
}

/// Computes the derivatives of the coefficients by independent noises of the variance that the
/// scale of the noise states; `factor` is the Cholesky factor of the two instants' covariance.
pub(super) fn noise(
    geometry: &Geometry,
    observation: &Observation,
    middle: &Vector3<f64>,
    factor: &[[f64; 2]; 2],
) -> Derivatives {
    let ([u0, u1], [rho0, rho1]) = split(observation);
    let across = libm::sqrt(1.0 / geometry.cameras() as f64);
    let along = libm::sqrt(1.0 / geometry.arms_squared_mm2());
    let lateral = |axis: usize, rho: f64, sign: f64| {
        let unit = Vector3::ith(axis, across * rho);
        assemble(0.0, unit, sign * unit)
    };
    let depth = |rho: f64, u: Vector3<f64>, sign: f64| {
        along * assemble(rho, u - 2.0 * rho * middle, sign * u)
    };
    let start = [
        lateral(0, rho1, -1.0),
        lateral(1, rho1, -1.0),
        depth(rho1, u1, 1.0),
    ];
    let end = [
        lateral(0, rho0, 1.0),
        lateral(1, rho0, 1.0),
        depth(rho0, u0, -1.0),
    ];
    core::array::from_fn(|j| match j % 2 {
        0 => factor[0][0] * start[j / 2] + factor[1][0] * end[j / 2],
        _ => factor[1][1] * end[j / 2],
    })
}

/// Weight of an equation: the inverse of the covariance of its residual, in units of the noise's
/// scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weight(pub Matrix3<f64>);

impl Weight {
    /// Weight of an equation that does not count.
    pub const ZERO: Self = Self(Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0));

    /// Returns the weight if the target does not turn and the noise is independent: `½ G' diag(K,
    /// K, S) G`, where `G` converts the residual to `(α, β, ρ)`.
    pub fn still(geometry: &Geometry, observation: &Observation) -> Self {
        let mean = |i: usize| 0.5 * (observation.start[i] + observation.end[i]);
        let [alpha, beta, rho] = [mean(0), mean(1), mean(2)];
        let convert = Matrix3::new(
            1.0 / rho,
            0.0,
            -alpha / rho,
            0.0,
            1.0 / rho,
            -beta / rho,
            0.0,
            0.0,
            -1.0,
        );
        let count = geometry.cameras() as f64;
        let precision = Vector3::new(count, count, geometry.arms_squared_mm2());
        Self(0.5 * convert.transpose() * Matrix3::from_diagonal(&precision) * convert)
    }

    /// Returns the weight that the noise leaves to an equation at a solution; `None` if noise in
    /// some direction does not show in it.
    pub fn of_noise(derivatives: &Derivatives, solution: &Solution) -> Option<Self> {
        let covariance: Matrix3<f64> = derivatives
            .iter()
            .map(|derivative| {
                let effect = apply(derivative, solution);
                effect * effect.transpose()
            })
            .sum();
        Some(Self(covariance.cholesky()?.inverse()))
    }
}

fn split(observation: &Observation) -> ([Vector3<f64>; 2], [f64; 2]) {
    let [alpha0, beta0, rho0] = observation.start;
    let [alpha1, beta1, rho1] = observation.end;
    let directions = [
        Vector3::new(alpha0, beta0, 1.0),
        Vector3::new(alpha1, beta1, 1.0),
    ];
    (directions, [rho0, rho1])
}

/// Returns `[P I, -[Q]×, B]`.
fn assemble(p: f64, q: Vector3<f64>, b: Vector3<f64>) -> Coefficients {
    let mut all = Coefficients::zeros();
    all.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(p);
    all.fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(-q.cross_matrix()));
    all.fixed_view_mut::<3, 1>(0, 6).copy_from(&b);
    all
}

/// Returns the right-hand side minus the left of the equation with these coefficients.
fn apply(coefficients: &Coefficients, solution: &Solution) -> Vector3<f64> {
    let left = coefficients.fixed_view::<3, 6>(0, 0) * solution.theta;
    coefficients.fixed_view::<3, 1>(0, 6) - left
}
