//! Geometry of a rig: projections of a point into all cameras, and residuals of its matches.
//!
//! At one instant the normalised coordinates of a point at inverse depth `ρ` obey, for camera `k`
//! at `c_k`,
//!
//! ```text
//! ξ_k = α - ρ c_k        (both axes; α is the point's direction from the rig's origin)
//! ```
//!
//! Fitting `α` and `ρ` to the cameras leaves a residual in each. Its part along the camera's
//! baseline is a disagreement of disparities (the paper's constraint (3): for cameras in line, the
//! ratio of two disparities is that of the baselines, for every point). Its part across the
//! baseline is the paper's vertical test (2).

use trinocular_core::rig::Rig;
use trinocular_core::sums::centred;

/// Rig with the figures that matching needs.
#[derive(Clone, Debug)]
pub struct RigGeometry {
    /// Cameras and image size.
    pub rig: Rig,
    /// Index of the reference camera: the one nearest to the centroid of all. Corners are chosen in
    /// its image.
    pub reference: usize,
    /// Mean of all focal lengths, px.
    pub focal_px: f64,
    /// Largest distance of a camera from the reference camera, mm.
    pub longest_baseline_mm: f64,
    /// Positions of the cameras against their centroid, with the fit of a point.
    pub arms: centred::Geometry,
}

/// Point in space, as direction and inverse depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Direction from the centroid of the cameras, normalised.
    pub direction: [f64; 2],
    /// Inverse depth, 1/mm.
    pub inverse_depth: f64,
}

impl RigGeometry {
    /// Creates the geometry. Returns `None` unless two cameras are in different places.
    pub fn new(rig: &Rig) -> Option<Self> {
        let arms = centred::Geometry::new(rig).ok()?;
        let places = arms.arms_mm();
        let reference =
            (0..places.len()).min_by(|&a, &b| length(places[a]).total_cmp(&length(places[b])))?;
        let centre = places[reference];
        let longest_baseline_mm = (places.iter())
            .map(|arm| length([arm[0] - centre[0], arm[1] - centre[1]]))
            .fold(0.0, f64::max);
        Some(Self {
            rig: rig.clone(),
            reference,
            focal_px: rig.mean_focal_px(),
            longest_baseline_mm,
            arms,
        })
    }

    /// Returns the number of cameras.
    pub fn cameras(&self) -> usize {
        self.arms.cameras()
    }

    /// Converts a pixel of camera `k` to normalised coordinates, without lens distortion.
    pub fn normalise(&self, k: usize, pixel: [f64; 2]) -> [f64; 2] {
        self.rig.cameras[k].normalise(pixel)
    }

    /// Converts normalised coordinates to a pixel of camera `k`.
    pub fn pixel(&self, k: usize, normalised: [f64; 2]) -> [f64; 2] {
        self.rig.cameras[k].denormalise(normalised)
    }

    /// Transfers a point from normalised coordinates of the reference camera to a pixel of camera
    /// `k`.
    pub fn transfer(&self, k: usize, at: [f64; 2], inverse_depth: f64) -> [f64; 2] {
        let arms = self.arms.arms_mm();
        let (from, to) = (arms[self.reference], arms[k]);
        self.pixel(
            k,
            core::array::from_fn(|i| at[i] - inverse_depth * (to[i] - from[i])),
        )
    }

    /// Computes the affine warp between two cameras around `pixel`, at constant depth: the matrix
    /// that takes offsets in camera `k`'s image to offsets in the reference image.
    pub fn warp(&self, k: usize, pixel: [f64; 2], inverse_depth: f64) -> [[f32; 2]; 2] {
        let (from, to) = (&self.rig.cameras[self.reference], &self.rig.cameras[k]);
        if from.is_ideal() && to.is_ideal() {
            let ratio: [f64; 2] = core::array::from_fn(|i| from.focal_px[i] / to.focal_px[i]);
            return [[ratio[0] as f32, 0.0], [0.0, ratio[1] as f32]];
        }
        let moved = |dx: f64, dy: f64| {
            let at = self.normalise(self.reference, [pixel[0] + dx, pixel[1] + dy]);
            self.transfer(k, at, inverse_depth)
        };
        let (right, left, down, up) = (
            moved(4.0, 0.0),
            moved(-4.0, 0.0),
            moved(0.0, 4.0),
            moved(0.0, -4.0),
        );
        let [a, c] = [0, 1].map(|i| (right[i] - left[i]) / 8.0);
        let [b, d] = [0, 1].map(|i| (down[i] - up[i]) / 8.0);
        let determinant = a * d - b * c;
        [[d, -b], [-c, a]].map(|row| row.map(|value| (value / determinant) as f32))
    }

    /// Fits a point to one normalised position per camera, by least squares.
    pub fn fit(&self, normalised: &[[f64; 2]]) -> Ray {
        let (inverse_depth, direction) = self.arms.fit(normalised.iter().copied());
        Ray {
            direction,
            inverse_depth,
        }
    }

    /// Projects a point into camera `k`, normalised.
    pub fn project(&self, k: usize, ray: &Ray) -> [f64; 2] {
        core::array::from_fn(|i| ray.direction[i] - ray.inverse_depth * self.arms.arms_mm()[k][i])
    }

    /// Returns the largest residual along a camera's baseline, px: the paper's constraint (3), by
    /// which the disparities of one point must agree.
    pub fn disparity_disagreement_px(&self, views: &[[f64; 2]]) -> f64 {
        self.worst_residual_px(views, |residual, unit| {
            residual[0] * unit[0] + residual[1] * unit[1]
        })
    }

    /// Returns the largest residual across a camera's baseline, px: the paper's vertical test (2),
    /// by which a point must lie on its epipolar lines.
    pub fn vertical_offset_px(&self, views: &[[f64; 2]]) -> f64 {
        self.worst_residual_px(views, |residual, unit| {
            residual[1] * unit[0] - residual[0] * unit[1]
        })
    }

    fn worst_residual_px(
        &self,
        views: &[[f64; 2]],
        part: impl Fn([f64; 2], [f64; 2]) -> f64,
    ) -> f64 {
        let ray = self.fit(views);
        let arms = self.arms.arms_mm();
        let longest = arms.iter().map(|a| length(*a)).fold(0.0, f64::max);
        let across = arms.iter().find(|a| length(**a) == longest);
        let main = across.map_or([1.0, 0.0], |a| a.map(|c| c / longest));
        (0..views.len())
            .map(|k| {
                let expected = self.project(k, &ray);
                let residual = core::array::from_fn(|i| views[k][i] - expected[i]);
                // A camera in the middle has no baseline of its own.
                let unit = if length(arms[k]) < 0.1 * longest {
                    main
                } else {
                    arms[k].map(|c| c / length(arms[k]))
                };
                self.focal_px * part(residual, unit).abs()
            })
            .fold(0.0, f64::max)
    }
}

fn length([x, y]: [f64; 2]) -> f64 {
    (x * x + y * y).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_core::rig::Camera;

    fn views(geometry: &RigGeometry, point: [f64; 3]) -> Vec<[f64; 2]> {
        (0..geometry.cameras())
            .map(|k| geometry.normalise(k, geometry.rig.cameras[k].project(point)))
            .collect()
    }

    #[test]
    fn true_point_passes_with_depth() {
        let geometry = RigGeometry::new(&Rig::paper()).unwrap();
        assert_eq!(geometry.reference, 1);
        let views = views(&geometry, [30.0, -40.0, 850.0]);
        assert!((1.0 / geometry.fit(&views).inverse_depth - 850.0).abs() < 1e-6);
        assert!(geometry.disparity_disagreement_px(&views) < 1e-9);
        assert!(geometry.vertical_offset_px(&views) < 1e-9);
    }

    #[test]
    fn wrong_match_fails_its_test() {
        let geometry = RigGeometry::new(&Rig::paper()).unwrap();
        let true_views = views(&geometry, [30.0, -40.0, 850.0]);
        // Of 3 px along x in one outer view, the fit absorbs most; half a pixel is left.
        let mut along = true_views.clone();
        along[0][0] += 3.0 / geometry.focal_px;
        assert!(geometry.disparity_disagreement_px(&along) > 0.5);
        assert!(geometry.vertical_offset_px(&along) < 1e-9);
        let mut across = true_views;
        across[2][1] += 1.5 / geometry.focal_px;
        assert!(geometry.vertical_offset_px(&across) > 0.5);
    }

    #[test]
    fn constraint_equals_the_papers() {
        // (x_mi - x_li)(x_rj - x_mj) = (x_ri - x_mi)(x_mj - x_lj) for two points that pass.
        let geometry = RigGeometry::new(&Rig::paper()).unwrap();
        let [i, j] = [[30.0, -40.0, 850.0], [-50.0, 20.0, 930.0]].map(|p| views(&geometry, p));
        let left = (i[1][0] - i[0][0]) * (j[2][0] - j[1][0]);
        let right = (i[2][0] - i[1][0]) * (j[1][0] - j[0][0]);
        assert!((left - right).abs() < 1e-12);
    }

    #[test]
    fn warp_follows_focal_lengths_and_lens() {
        let mut rig = Rig::paper();
        let geometry = RigGeometry::new(&rig).unwrap();
        let plain = geometry.warp(0, [200.0, 60.0], 1.0 / 850.0);
        assert!((f64::from(plain[0][0]) - 538.14 / 533.16).abs() < 1e-6 && plain[0][1] == 0.0);
        rig.cameras[0].distortion = [-0.2, 0.0, 0.0, 0.0, 0.0];
        rig.cameras[1].distortion = [-0.2, 0.0, 0.0, 0.0, 0.0];
        let bent = RigGeometry::new(&rig)
            .unwrap()
            .warp(0, [200.0, 60.0], 1.0 / 850.0);
        assert!(bent[0][1] != 0.0 && (bent[0][0] - plain[0][0]).abs() < 0.05);
    }

    #[test]
    fn rig_without_baseline_is_refused() {
        let one = Camera::ideal([500.0; 2], [160.0, 120.0], [0.0; 2]);
        for count in 0..3 {
            let rig = Rig {
                image_size_px: [320, 240],
                cameras: (0..count).map(|_| one).collect(),
            };
            assert!(RigGeometry::new(&rig).is_none());
        }
    }
}
