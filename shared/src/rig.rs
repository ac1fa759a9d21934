//! Cameras as plain data, and the two projections that everything else uses.
//!
//! Image axes are the usual ones: x right, y down, z forward. Camera `k` sits at `(cx, cy, 0)` mm
//! and sees the point `(X, Y, Z)` mm at the *normalised* coordinates
//!
//! ```text
//! xi = (X - cx) / Z        eta = (Y - cy) / Z        (dimensionless)
//! px = fx * xi + ppx       py  = fy * eta + ppy      (pixels, after rotation and lens distortion)
//! ```
//!
//! Normalised coordinates divide each camera's own focal lengths out, so cameras with different
//! focal lengths need no common mean. They are along the rig's axes even for a rotated camera: a
//! rotation moves all points of a ray alike, at any depth, so the view of a rotated camera is that
//! of a virtual parallel camera at the same place. Everything behind [`Camera::normalise`] is
//! therefore about parallel cameras.

mod line;
mod rotation;

pub use line::HEIGHT_ERROR_LIMIT;
pub use rotation::Rotation;

/// Largest number of cameras in a rig.
pub const MAX_CAMERAS: usize = 8;

/// One camera of a rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Focal lengths along x and y, px.
    pub focal_px: [f64; 2],
    /// Principal point, px from the centre of the top left pixel.
    pub principal_px: [f64; 2],
    /// Position of the camera in the plane of the rig, mm right and mm down of the rig's origin.
    pub offset_mm: [f64; 2],
    /// Lens distortion, dimensionless: OpenCV's k1 k2 p1 p2 k3 (Brown's model).
    pub distortion: [f64; 5],
    /// Denominator of the radial distortion, dimensionless: OpenCV's k4 k5 k6 (rational model);
    /// zero for Brown's model.
    pub rational: [f64; 3],
    /// Rotation of the camera against the rig's axes: none in a rig that is parallel as built.
    pub rotation: Rotation,
}

impl Camera {
    /// Creates a camera without lens distortion, parallel to the rig.
    pub const fn ideal(focal_px: [f64; 2], principal_px: [f64; 2], offset_mm: [f64; 2]) -> Self {
        Self {
            focal_px,
            principal_px,
            offset_mm,
            distortion: [0.0; 5],
            rational: [0.0; 3],
            rotation: Rotation::NONE,
        }
    }

    /// Returns OpenCV's distortion coefficients: k1 k2 p1 p2 k3, and k4 k5 k6 of a rational model.
    pub fn coefficients(&self) -> heapless::Vec<f64, 8> {
        let rational = match self.is_rational() {
            true => &self.rational[..],
            false => &[],
        };
        self.distortion.iter().chain(rational).copied().collect()
    }

    /// Returns true if the lens follows the rational model.
    pub fn is_rational(&self) -> bool {
        self.rational != [0.0; 3]
    }

    /// Returns true if the lens bends no line.
    fn is_straight(&self) -> bool {
        self.distortion == [0.0; 5] && !self.is_rational()
    }

    /// Returns the factor of the radial distortion at the square of a radius, normalised; the
    /// denominator of the rational model is within.
    pub fn radial(&self, r2: f64) -> f64 {
        let [k1, k2, _, _, k3] = self.distortion;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        match self.is_rational() {
            true => radial / self.denominator(r2),
            false => radial,
        }
    }

    /// Returns the denominator of the rational model at the square of a radius, normalised; 1 for
    /// Brown's model.
    pub fn denominator(&self, r2: f64) -> f64 {
        let [k4, k5, k6] = self.rational;
        1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
    }

    /// Projects the point `(X, Y, Z)` mm into the image, px. `Z` must be positive.
    pub fn project(&self, point_mm: [f64; 3]) -> [f64; 2] {
        let [x, y, z] = point_mm;
        self.denormalise([(x - self.offset_mm[0]) / z, (y - self.offset_mm[1]) / z])
    }

    /// Returns true if the image is the normalised plane but for scale and shift: no rotation, no
    /// lens distortion.
    pub fn is_ideal(&self) -> bool {
        self.is_straight() && self.rotation.degrees() == [0.0; 3]
    }

    /// Converts normalised coordinates to image coordinates, px, through rotation and lens
    /// distortion.
    pub fn denormalise(&self, normalised: [f64; 2]) -> [f64; 2] {
        let seen = self.distort(self.rotation.turn(normalised));
        core::array::from_fn(|i| self.focal_px[i] * seen[i] + self.principal_px[i])
    }

    /// Converts image coordinates, px, to normalised coordinates, and removes lens distortion and
    /// rotation.
    ///
    /// The distortion has no closed inverse. The fixed-point iteration of OpenCV's
    /// `undistortPoints` runs until it moves less than 1e-13, at most 50 times. The result is
    /// exact, to rounding, for cameras without distortion.
    pub fn normalise(&self, pixel: [f64; 2]) -> [f64; 2] {
        let seen: [f64; 2] =
            core::array::from_fn(|i| (pixel[i] - self.principal_px[i]) / self.focal_px[i]);
        if self.is_straight() {
            return self.rotation.rectify(seen);
        }
        let mut guess = seen;
        for _ in 0..50 {
            let bent = self.distort(guess);
            let step = [seen[0] - bent[0], seen[1] - bent[1]];
            guess = [guess[0] + step[0], guess[1] + step[1]];
            if step[0].abs() + step[1].abs() < 1e-13 {
                break;
            }
        }
        self.rotation.rectify(guess)
    }

    /// Applies the lens model: radial k1 k2 k3 over k4 k5 k6, tangential p1 p2.
    fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [_, _, p1, p2, _] = self.distortion;
        let r2 = x * x + y * y;
        let radial = self.radial(r2);
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    }
}

/// Cameras in one plane, parallel or rectified by their rotations, in the order of their views.
///
/// ```
/// use trinocular_core::rig::Rig;
///
/// let rig = Rig::paper();
/// let point_mm = [20.0, -10.0, 890.0];
/// let pixels: Vec<_> = rig.cameras.iter().map(|c| c.project(point_mm)).collect();
/// // The point is farther right in the image of a camera farther left.
/// assert!(pixels[0][0] > pixels[1][0] && pixels[1][0] > pixels[2][0]);
///
/// let [x, y] = rig.cameras[1].normalise(pixels[1]);
/// assert!((x * 890.0 - 20.0).abs() < 1e-9 && (y * 890.0 + 10.0).abs() < 1e-9);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Width and height of every camera's image, px.
    pub image_size_px: [u32; 2],
    /// Cameras of the rig. The paper's two estimators need exactly left, middle, right, in this
    /// order.
    pub cameras: heapless::Vec<Camera, MAX_CAMERAS>,
}

impl Rig {
    /// Returns the paper's rig: the cameras of its Table 3, 70 mm left and 68 mm right of the
    /// middle one, 320 x 240 px.
    pub fn paper() -> Self {
        let cameras = [
            Camera::ideal([533.16, 529.12], [154.43, 123.00], [-70.0, 0.0]),
            Camera::ideal([538.14, 534.18], [170.59, 111.18], [0.0, 0.0]),
            Camera::ideal([534.55, 530.76], [160.48, 117.76], [68.0, 0.0]),
        ];
        Self {
            image_size_px: [320, 240],
            cameras: cameras.into_iter().collect(),
        }
    }

    /// Returns the mean of all focal lengths, px, which converts normalised noise to pixels.
    pub fn mean_focal_px(&self) -> f64 {
        let sum: f64 = self
            .cameras
            .iter()
            .map(|c| c.focal_px[0] + c.focal_px[1])
            .sum();
        sum / (2.0 * self.cameras.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels of OpenCV 5.0.0's `projectPoints` with the same numbers.
    #[test]
    fn rational_lens_matches_opencv() {
        let camera = Camera {
            distortion: [0.5, -2.6, 0.001, -0.0004, 1.5],
            rational: [0.38, -2.4, 1.4],
            ..Camera::ideal([533.0, 534.0], [320.0, 240.0], [0.0, 0.0])
        };
        for (point_mm, expected) in [
            (
                [120.0, -90.0, 700.0],
                [411.78567898823235, 171.04875071200496],
            ),
            ([-300.0, 200.0, 600.0], [46.56383841917847, 422.7741944559]),
        ] {
            let pixel = camera.project(point_mm);
            assert!(
                (pixel[0] - expected[0]).hypot(pixel[1] - expected[1]) < 1e-9,
                "{pixel:?}"
            );
            let back = camera.normalise(pixel);
            let [x, y, z] = point_mm;
            assert!((back[0] - x / z).hypot(back[1] - y / z) < 1e-12, "{back:?}");
        }
        assert!(!camera.is_ideal());
        assert_eq!(camera.coefficients().len(), 8);
        assert_eq!(
            Camera::ideal([1.0; 2], [0.0; 2], [0.0; 2])
                .coefficients()
                .len(),
            5
        );
    }
}
