//! Quarter turns about the cameras' axis, which keep the Cayley vector small.
//!
//! A half turn has no Cayley vector, and turns near it have a large one. A target on a rotation
//! table passes half turns about z. Turned about the axis of the mean camera by a multiple of 90°,
//! an [`Observation`] only exchanges `α` and `β` and their signs, without rounding, and its
//! covariance stays the same. The estimator therefore turns all points of the keyframe first by the
//! multiple that brings them nearest to where they are now, and estimates the rotation that is
//! left. This covers all rotations but half turns about an axis across z, after which the back of
//! the target is seen.

use super::{Observation, cayley};
use crate::sums::centred::Geometry;
use libm::{atan2, sqrt};
use nalgebra::{Matrix3, Vector3};

/// Rotation about z by a multiple of 90°, about the axis of the mean camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct QuarterTurn {
    /// Number of quarter turns, 0 to 3, from x to y.
    turns: u8,
    /// The axis: the mean of the cameras' positions, mm.
    centre_mm: [f64; 2],
}

impl QuarterTurn {
    /// Returns the multiple of 90° that brings the points of the keyframe nearest to where they are
    /// now, about `centre_mm`, the mean of the cameras' positions; 0 up to 90°, and for a target
    /// whose back is seen.
    ///
    /// The rotation is found roughly for this, by the singular values of the positions' covariance
    /// (Kabsch 1976).
    fn nearest(observations: &[Observation], centre_mm: [f64; 2]) -> Self {
        let count = observations.len() as f64;
        let mean = |place: fn(&Observation) -> Vector3<f64>| {
            observations.iter().map(place).sum::<Vector3<f64>>() / count
        };
        let [start, end] = [mean(Observation::start_mm), mean(Observation::end_mm)];
        let products = observations
            .iter()
            .map(|o| (o.end_mm() - end) * (o.start_mm() - start).transpose());
        let covariance: Matrix3<f64> = products.sum();
        if !covariance.iter().all(|value| value.is_finite()) {
            return Self::default();
        }
        let singular = covariance.svd(true, true);
        let (Some(u), Some(v)) = (singular.u, singular.v_t) else {
            return Self::default();
        };
        let mirror = Vector3::new(1.0, 1.0, (u * v).determinant());
        Self::nearest_to(&(u * Matrix3::from_diagonal(&mirror) * v), centre_mm)
    }

    /// Returns the same for the points of a rotation.
    pub(super) fn nearest_to(rotation: &Matrix3<f64>, centre_mm: [f64; 2]) -> Self {
        let is_front = rotation[(2, 2)] > 0.0;
        let along = rotation[(0, 0)] + rotation[(1, 1)];
        let across = rotation[(1, 0)] - rotation[(0, 1)];
        Self {
            turns: if is_front { turns(along, across) } else { 0 },
            centre_mm,
        }
    }

    /// Returns true for no turn.
    pub(super) fn is_none(self) -> bool {
        self.turns == 0
    }

    /// Turns a vector.
    pub(super) fn turned(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self.turns {
            0 => [x, y, z],
            1 => [-y, x, z],
            2 => [-x, -y, z],
            _ => [y, -x, z],
        }
    }

    /// Turns a place about the axis, mm.
    pub(super) fn place(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        // Without a turn nothing is rounded.
        if self.is_none() {
            return [x, y, z];
        }
        let [cx, cy] = self.centre_mm;
        let [x, y, z] = self.turned([x - cx, y - cy, z]);
        [x + cx, y + cy, z]
    }

    /// Turns the start of an observation. The misfits keep their sizes; what they have in common is
    /// compared in the turned axes.
    pub(super) fn start(self, observation: &Observation) -> Observation {
        let [dot, cross] = [observation.common_misfit, observation.cross_misfit];
        let [common_misfit, cross_misfit] = match self.turns {
            0 => [dot, cross],
            1 => [cross, -dot],
            2 => [-dot, -cross],
            _ => [-cross, dot],
        };
        Observation {
            start: self.turned(observation.start),
            common_misfit,
            cross_misfit,
            ..*observation
        }
    }

    /// Returns the rotation matrix.
    pub(super) fn matrix(self) -> Matrix3<f64> {
        let columns = [0, 1, 2].map(|i| {
            let mut unit = [0.0; 3];
            unit[i] = 1.0;
            Vector3::from(self.turned(unit))
        });
        Matrix3::from_columns(&columns)
    }

    /// Returns the rotation vector of this turn followed by the rotation `omega`, rad.
    pub(super) fn followed_by(self, omega: &Vector3<f64>) -> Vector3<f64> {
        let half = core::f64::consts::FRAC_1_SQRT_2;
        let (cosine, sine) = match self.turns {
            0 => return cayley::vector(omega),
            1 => (half, half),
            2 => (0.0, 1.0),
            _ => (half, -half),
        };
        // The product of the quaternions (1, ω) and (cosine, sine z).
        let z = Vector3::z() * sine;
        let real = cosine - omega.dot(&z);
        let vector = z + cosine * omega + omega.cross(&z);
        let (real, vector) = if real < 0.0 {
            (-real, -vector)
        } else {
            (real, vector)
        };
        let length = sqrt(vector.norm_squared());
        if length == 0.0 {
            return Vector3::zeros();
        }
        2.0 * atan2(length, real) / length * vector
    }
}

/// Returns the number of quarter turns nearest to the angle with the cosine `along` and the sine
/// `across`, both times any number.
fn turns(along: f64, across: f64) -> u8 {
    // Smaller rotations are estimated as they are.
    if along >= 0.0 {
        0
    } else if across.abs() < -along {
        2
    } else if across > 0.0 {
        1
    } else {
        3
    }
}

/// Observations whose points are turned at the keyframe.
#[derive(Clone, Copy)]
pub(super) struct Turned<'a> {
    pub(super) all: &'a [Observation],
    pub(super) first: QuarterTurn,
}

impl<'a> Turned<'a> {
    /// Turns the observations by the multiple of 90° after which the least rotation is left.
    pub(super) fn nearest(geometry: &Geometry, all: &'a [Observation]) -> Self {
        Self {
            all,
            first: QuarterTurn::nearest(all, geometry.centre_mm()),
        }
    }

    /// Returns the observations with their turned starts.
    pub(super) fn iter(&self) -> impl Iterator<Item = Observation> + '_ {
        self.all
            .iter()
            .map(|observation| self.first.start(observation))
    }
}
