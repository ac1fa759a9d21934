//! Least squares of small motions: what a displacement leaves of the flow, explained by a correction
//! of the displacement alone, or by a rotation, too.
//!
//! A target that rotates by the small angle `ω` about a centre displaces the point at `p` from it by
//! `ω × p`. The midpoint model holds for each point's own displacement, so the residual that a pure
//! displacement leaves in camera `k` is
//!
//! ```text
//! r_k = g ((δ + ω × p)_xy - ξ_k (δ + ω × p)_z)
//! ```
//!
//! with a correction `δ` of the displacement: linear in six unknowns.

use super::Correspondence;
use crate::matching::geometry::RigGeometry;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Normal equations of `(δ, ω)` for some points. `ω` is in units of `1/size_mm` radians.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinearMotion {
    normal: Matrix6<f64>,
    right: Vector6<f64>,
    /// Sum of the squared residuals without any correction, normalised.
    pub(super) squares: f64,
    /// Number of residuals: two per point and camera.
    pub(super) residuals: usize,
}

/// Equations of every point, about their common centroid.
pub(super) struct PointMotions {
    /// Equations of each point, in the order of the points; empty for one that is not in front of
    /// the cameras.
    pub(super) points: Vec<LinearMotion>,
    /// Root mean square distance of the points from their centroid, mm.
    pub(super) size_mm: f64,
    /// Harmonic mean of the points' depths, mm.
    pub(super) depth_mm: f64,
}

/// Correction of the displacement, mm, its covariance for residuals of unit variance, and the sum
/// of the squared residuals that it leaves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Displaced {
    pub(super) correction_mm: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
    pub(super) squares: f64,
}

/// Correction of the displacement, mm, with a rotation, their covariance for residuals of unit
/// variance, and the sum of the squared residuals that both leave.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rotated {
    pub(super) motion: Vector6<f64>,
    pub(super) covariance: Matrix6<f64>,
    pub(super) squares: f64,
}

impl LinearMotion {
    /// Equations of no points.
    pub(super) fn none() -> Self {
        Self {
            normal: Matrix6::zeros(),
            right: Vector6::zeros(),
            squares: 0.0,
            residuals: 0,
        }
    }

    /// Adds the equations of other points.
    pub(super) fn add(&mut self, other: &Self) {
        self.normal += other.normal;
        self.right += other.right;
        self.squares += other.squares;
        self.residuals += other.residuals;
    }

    /// Solves for the correction alone; `None` if the points do not determine it.
    pub(super) fn displaced(&self) -> Option<Displaced> {
        let normal: Matrix3<f64> = self.normal.fixed_view::<3, 3>(0, 0).into();
        let right: Vector3<f64> = self.right.fixed_rows::<3>(0).into();
        let covariance = normal.try_inverse()?;
        let correction_mm = covariance * right;
        Some(Displaced {
            correction_mm,
            covariance,
            squares: (self.squares - correction_mm.dot(&right)).max(0.0),
        })
    }

    /// Solves for correction and rotation; `None` if the points do not determine them.
    pub(super) fn rotated(&self) -> Option<Rotated> {
        let covariance = self.normal.try_inverse()?;
        let motion = covariance * self.right;
        Some(Rotated {
            motion,
            covariance,
            squares: (self.squares - motion.dot(&self.right)).max(0.0),
        })
    }
}

impl PointMotions {
    /// Computes the equations of `inliers` against `displacement_mm`.
    pub(super) fn of(
        geometry: &RigGeometry,
        inliers: &[Correspondence],
        displacement_mm: [f64; 3],
    ) -> Self {
        let arms = geometry.arms.arms_mm();
        // Place of every point in space, mm, from its middle position in the first camera.
        let points: Vec<_> = (inliers.iter())
            .map(|inlier| {
                let fit = geometry.arms.point(&inlier.views)?;
                let z = 1.0 / fit.inverse_depth;
                let (at, arm) = (*fit.middles.first()?, arms.first()?);
                let place = Vector3::new(at[0] * z + arm[0], at[1] * z + arm[1], z);
                Some((fit, place, &inlier.views))
            })
            .collect();
        let seen = || points.iter().flatten();
        let count = seen().count().max(1) as f64;
        let centroid = seen().map(|p| p.1).sum::<Vector3<f64>>() / count;
        // Scale of the angles: their columns become as large as those of the displacement.
        let squares = seen().map(|p| (p.1 - centroid).norm_squared());
        let size_mm = (squares.sum::<f64>() / count).sqrt();
        let depth_mm = count / seen().map(|p| p.0.inverse_depth).sum::<f64>();
        let equations = points.iter().map(|point| {
            let mut equations = LinearMotion::none();
            let Some((fit, place, views)) = point else {
                return equations;
            };
            let p = (place - centroid) / size_mm;
            let cross = [[0.0, p.z, -p.y], [-p.z, 0.0, p.x], [p.y, -p.x, 0.0]];
            for (k, view) in views.iter().enumerate() {
                let (seen, expected) = (view.flow(), fit.flow(k, displacement_mm));
                for axis in 0..2 {
                    let mut row = [0.0; 6];
                    row[axis] = 1.0;
                    row[2] = -fit.middles[k][axis];
                    for i in 0..3 {
                        row[3 + i] = cross[axis][i] - fit.middles[k][axis] * cross[2][i];
                    }
                    let row = Vector6::from(row) * fit.inverse_depth;
                    let residual = seen[axis] - expected[axis];
                    equations.normal += row * row.transpose();
                    equations.right += row * residual;
                    equations.squares += residual * residual;
                    equations.residuals += 1;
                }
            }
            equations
        });
        Self {
            points: equations.collect(),
            size_mm,
            depth_mm,
        }
    }

    /// Sums the equations of all points.
    pub(super) fn all(&self) -> LinearMotion {
        let mut all = LinearMotion::none();
        self.points.iter().for_each(|point| all.add(point));
        all
    }
}
