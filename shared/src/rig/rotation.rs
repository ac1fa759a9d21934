//! Rotation of a camera against the rig's axes.

use libm::{cos, sin, sqrt};

/// Rotation as a vector: its axis times its angle, right-handed about x (right), y (down), z
/// (forward).
///
/// This is OpenCV's convention, Rodrigues's formula: with the axis `a` and the angle `θ`, a
/// direction `d` along the rig's axes is `R d` along the camera's axes,
///
/// ```text
/// R = cos θ I + (1 - cos θ) a aᵀ + sin θ [a]×
/// ```
///
/// For the degree or two of a rig that was meant to be parallel, the three components are simply
/// the angles about x, y and z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotation {
    /// *Invariant:* `rows` is the matrix of this vector.
    degrees: [f64; 3],
    rows: [[f64; 3]; 3],
}

impl Rotation {
    /// No rotation: a camera parallel to the rig.
    pub const NONE: Self = Self {
        degrees: [0.0; 3],
        rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    };

    /// Creates a rotation from axis times angle, degrees.
    pub fn from_degrees(degrees: [f64; 3]) -> Self {
        let [x, y, z] = degrees.map(f64::to_radians);
        let angle = sqrt(x * x + y * y + z * z);
        if !(angle > 0.0) {
            return Self {
                degrees,
                ..Self::NONE
            };
        }
        let axis = [x / angle, y / angle, z / angle];
        let (sine, cosine) = (sin(angle), cos(angle));
        let [a, b, c] = axis.map(|component| sine * component);
        let cross = [[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]];
        let rows = core::array::from_fn(|i| {
            core::array::from_fn(|j| {
                let diagonal = if i == j { cosine } else { 0.0 };
                diagonal + (1.0 - cosine) * axis[i] * axis[j] + cross[i][j]
            })
        });
        Self { degrees, rows }
    }

    /// Returns axis times angle, degrees.
    pub const fn degrees(&self) -> [f64; 3] {
        self.degrees
    }

    /// Returns the matrix `R`, row by row.
    pub const fn rows(&self) -> [[f64; 3]; 3] {
        self.rows
    }

    /// Converts normalised coordinates along the rig's axes to normalised coordinates along the
    /// camera's axes. The point must lie in front of both the real camera and the virtual one
    /// parallel to the rig.
    pub fn turn(&self, at: [f64; 2]) -> [f64; 2] {
        self.project(at, |i, j| self.rows[i][j])
    }

    /// Inverts [`Rotation::turn`]: rectification.
    pub fn rectify(&self, at: [f64; 2]) -> [f64; 2] {
        self.project(at, |i, j| self.rows[j][i])
    }

    fn project(&self, [x, y]: [f64; 2], element: impl Fn(usize, usize) -> f64) -> [f64; 2] {
        // Parallel cameras, the usual case, must come out bit for bit.
        if self.degrees == [0.0; 3] {
            return [x, y];
        }
        let [a, b, c] = [0, 1, 2].map(|i| element(i, 0) * x + element(i, 1) * y + element(i, 2));
        [a / c, b / c]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotation_signs_follow_the_axes() {
        // A point straight ahead of the rig appears on the right of a camera that is rotated to the
        // left.
        let tan = 0.035_f64.tan();
        let seen = Rotation::from_degrees([0.0, 0.035_f64.to_degrees(), 0.0]).turn([0.0; 2]);
        assert!((seen[0] - tan).abs() < 1e-15 && seen[1] == 0.0, "{seen:?}");
        let seen = Rotation::from_degrees([0.035_f64.to_degrees(), 0.0, 0.0]).turn([0.0; 2]);
        assert!((seen[1] + tan).abs() < 1e-15 && seen[0] == 0.0, "{seen:?}");
        let seen = Rotation::from_degrees([0.0, 0.0, 90.0]).turn([0.2, 0.0]);
        assert!(
            seen[0].abs() < 1e-15 && (seen[1] - 0.2).abs() < 1e-15,
            "{seen:?}"
        );
    }

    #[test]
    fn rectify_inverts_turn() {
        let rotation = Rotation::from_degrees([1.7, -2.3, 12.0]);
        for at in [[0.0, 0.0], [0.4, -0.3], [-0.5, 0.2]] {
            let back = rotation.rectify(rotation.turn(at));
            assert!((back[0] - at[0]).hypot(back[1] - at[1]) < 1e-15, "{back:?}");
        }
        let rows = rotation.rows();
        for i in 0..3 {
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| rows[i][k] * rows[j][k]).sum();
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((product - expected).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn no_rotation_changes_no_bit() {
        let at = [0.1 + 0.2, -1.0 / 3.0];
        assert_eq!(Rotation::NONE.turn(at), at);
        assert_eq!(Rotation::from_degrees([0.0; 3]).rectify(at), at);
    }
}
