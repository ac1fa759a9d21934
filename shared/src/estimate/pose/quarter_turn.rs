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
use libm::{atan2, sqrt};
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Least tangent of the angle in the image from which points are turned first: 60°. Smaller
/// rotations are estimated as they are.
const LEAST_TANGENT: f64 = 1.732;

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
    /// now, as `centre_mm`, the mean of the cameras' positions, sees them; 0 up to 60°, and for a
    /// target whose back is seen.
    pub(super) fn nearest(observations: &[Observation], centre_mm: [f64; 2]) -> Self {
        let count = observations.len() as f64;
        let mean = |place: fn(&Observation) -> [f64; 3]| {
            let sum = observations
                .iter()
                .map(place)
                .fold([0.0; 2], |sum, at| [sum[0] + at[0], sum[1] + at[1]]);
            sum.map(|sum| sum / count)
        };
        let (start, end) = (mean(|o| o.start), mean(|o| o.end));
        // Σ b a', of which a rotation in the image leaves along and across.
        let (mut along, mut across) = (0.0, 0.0);
        let mut product = [[0.0; 2]; 2];
        for o in observations {
            let a = [0, 1].map(|i| o.start[i] - start[i]);
            let b = [0, 1].map(|i| o.end[i] - end[i]);
            along += a[0] * b[0] + a[1] * b[1];
            across += a[0] * b[1] - a[1] * b[0];
            for (row, b) in product.iter_mut().zip(b) {
                row[0] += b * a[0];
                row[1] += b * a[1];
            }
        }
        // A mirrored image: another turn about z brings the back no nearer to the front.
        let is_front = product[0][0] * product[1][1] > product[0][1] * product[1][0];
        let [along, across] = if is_front {
            [along, across]
        } else {
            [1.0, 0.0]
        };
        Self {
            turns: turns(along, across),
            centre_mm,
        }
    }

    /// Returns the same for the points of a rotation.
    pub(super) fn nearest_to(rotation: &Rotation3<f64>, centre_mm: [f64; 2]) -> Self {
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
    if across.abs() < LEAST_TANGENT * along {
        0
    } else if across.abs() < -along {
        2
    } else if across > 0.0 {
        1
    } else if across < 0.0 {
        3
    } else {
        0
    }
}

/// Observations whose points are turned at the keyframe.
#[derive(Clone, Copy)]
pub(super) struct Turned<'a> {
    pub(super) all: &'a [Observation],
    pub(super) first: QuarterTurn,
}

impl Turned<'_> {
    /// Returns the observations with their turned starts.
    pub(super) fn iter(&self) -> impl Iterator<Item = Observation> + '_ {
        self.all
            .iter()
            .map(|observation| self.first.start(observation))
    }
}
