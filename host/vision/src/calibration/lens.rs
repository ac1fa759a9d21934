//! Lens: the nine parameters of one camera, and the derivatives of a pixel by them.

use nalgebra::{Matrix2x3, SMatrix, Vector3};
use trinocular_core::rig::{Camera, Rotation};

/// Number of lens parameters.
pub const PARAMETERS: usize = 9;

/// Names of the lens parameters, in their order.
pub const NAMES: [&str; PARAMETERS] = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"];

/// Lens: focal lengths and principal point in px, then Brown's (1971) distortion coefficients in
/// OpenCV's form, in the order of [`NAMES`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens(pub [f64; PARAMETERS]);

/// Projection of a point, with derivatives.
pub struct Projection {
    /// Pixel of the point.
    pub pixel: [f64; 2],
    /// Derivatives of the pixel by the lens parameters.
    pub by_lens: SMatrix<f64, 2, PARAMETERS>,
    /// Derivatives of the pixel by the point along the camera's axes, px/mm.
    pub by_point: Matrix2x3<f64>,
}

impl Lens {
    /// Returns a camera with this lens at the rig's origin, without rotation.
    pub fn camera(&self) -> Camera {
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = self.0;
        Camera {
            focal_px: [fx, fy],
            principal_px: [cx, cy],
            offset_mm: [0.0; 2],
            distortion: [k1, k2, p1, p2, k3],
            rational: [0.0; 3],
            rotation: Rotation::NONE,
        }
    }

    /// Returns the lens of a camera, without the denominator of a rational model.
    pub fn of(camera: &Camera) -> Self {
        let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.principal_px);
        let [k1, k2, p1, p2, k3] = camera.distortion;
        Self([fx, fy, cx, cy, k1, k2, p1, p2, k3])
    }

    /// Projects a point given in the camera's axes. Returns `None` unless it is in front of the
    /// camera.
    pub fn project(&self, point_mm: Vector3<f64>) -> Option<Projection> {
        if !(point_mm.z > 0.0) {
            return None;
        }
        let [fx, fy, _, _, k1, k2, p1, p2, k3] = self.0;
        let depth = point_mm.z;
        let (x, y) = (point_mm.x / depth, point_mm.y / depth);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        // Derivative by the square of the radius.
        let bend = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let seen = [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ];
        let xx = radial + 2.0 * x * x * bend + 2.0 * p1 * y + 6.0 * p2 * x;
        let yy = radial + 2.0 * y * y * bend + 6.0 * p1 * y + 2.0 * p2 * x;
        let xy = 2.0 * x * y * bend + 2.0 * p1 * x + 2.0 * p2 * y;
        let camera = self.camera();
        let [r4, r6] = [r2 * r2, r2 * r2 * r2];
        #[rustfmt::skip]
        let by_lens = SMatrix::from_row_slice(&[
            seen[0], 0.0, 1.0, 0.0,
            fx * x * r2, fx * x * r4, fx * 2.0 * x * y, fx * (r2 + 2.0 * x * x), fx * x * r6,
            0.0, seen[1], 0.0, 1.0,
            fy * y * r2, fy * y * r4, fy * (r2 + 2.0 * y * y), fy * 2.0 * x * y, fy * y * r6,
        ]);
        Some(Projection {
            pixel: [0, 1].map(|i| camera.focal_px[i] * seen[i] + camera.principal_px[i]),
            by_lens,
            by_point: Matrix2x3::new(
                fx * xx / depth,
                fx * xy / depth,
                -fx * (xx * x + xy * y) / depth,
                fy * xy / depth,
                fy * yy / depth,
                -fy * (xy * x + yy * y) / depth,
            ),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: Lens = Lens([533.0, 529.0, 160.0, 118.0, -0.28, 0.05, 1e-3, -2e-3, 0.11]);

    #[test]
    fn lens_projects_as_camera() {
        let point = [120.0, -90.0, 700.0];
        let seen = LENS.camera().project(point);
        let projection = LENS.project(Vector3::from(point)).unwrap();
        assert!((0..2).all(|i| (seen[i] - projection.pixel[i]).abs() < 1e-10));
        assert_eq!(Lens::of(&LENS.camera()), LENS);
        assert!(LENS.project(Vector3::new(1.0, 1.0, 0.0)).is_none());
    }

    #[test]
    fn derivatives_match_differences() {
        let point = Vector3::new(120.0, -90.0, 700.0);
        let at = LENS.project(point).unwrap();
        let check = |low: [f64; 2], high: [f64; 2], step: f64, column: [f64; 2]| {
            for i in 0..2 {
                let slope = (high[i] - low[i]) / (2.0 * step);
                assert!(
                    (slope - column[i]).abs() < 1e-5 * (1.0 + slope.abs()),
                    "{slope} {column:?}"
                );
            }
        };
        for k in 0..PARAMETERS {
            let step = if k < 4 { 1e-3 } else { 1e-5 };
            let pixel = |step: f64| {
                let mut lens = LENS;
                lens.0[k] += step;
                lens.project(point).unwrap().pixel
            };
            check(
                pixel(-step),
                pixel(step),
                step,
                [at.by_lens[(0, k)], at.by_lens[(1, k)]],
            );
        }
        for k in 0..3 {
            let pixel = |step: f64| {
                let mut moved = point;
                moved[k] += step;
                LENS.project(moved).unwrap().pixel
            };
            check(
                pixel(-1e-3),
                pixel(1e-3),
                1e-3,
                [at.by_point[(0, k)], at.by_point[(1, k)]],
            );
        }
    }
}
