//! Tolerance of the paper's estimators for cameras that are not on one line.
//!
//! The paper's pairs share their image rows: the paper assumes `y_l = y_m` where it gathers `Vz` in
//! the y rows (`a3`, `b3`). Let the left camera be `δ_l` mm lower than the middle one. Then `y_l =
//! y_m - δ_l/Z`, and with the exact flow `vy = (Vy - y Vz)/Z` of each camera
//!
//! ```text
//! d2 = a1 Vy + (a3 + Δa) Vz      Δa = -½ Σ (x_l + x_m) δ_l/Z      |Δa| / a1 <= τ |δ_l| / h1
//! ```
//!
//! since `a1 = h1 Σ 1/Z`; `τ` is the greatest `|x|` in the images. The same holds for the right
//! pair with `b1`, `h2` and `δ_r`. The closed form solves `Vx` and `Vz` without y, and its `Vy` is
//! a mean of both rows with the weights `a1²/n` and `b1²/n`, so
//!
//! ```text
//! |error of Vy| <= κ |Vz|        κ = τ max(|δ_l|/h1, |δ_r|/h2)
//! ```
//!
//! Least squares has this error of `Vy`, too. Its y rows also contradict each other: the share `ρ²
//! / (1 + ρ²)` of `Vz` is lost, `ρ <= 4 κ Z / (h1 + h2)`. Under the limit that is at most 0.8 % at
//! a metre with the paper's rig, when the mean of all points lies at the edge of the image; it
//! falls with the square of the distance from the middle.

use super::{Camera, Rig};

/// Greatest error of `Vy` that unequal heights may cause, as a share of `Vz`.
///
/// It is a seventh of what the same estimators lose of `Vz` itself in a move of 20 mm at 900 mm. In
/// the paper's rig a camera may be 0.64 mm higher than the middle one.
pub const HEIGHT_ERROR_LIMIT: f64 = 0.003;

impl Rig {
    /// Returns the largest error of `Vy`, as a share of `Vz`, that unequal heights of the cameras
    /// cause in the paper's estimators: `κ` of the module documentation.
    ///
    /// Returns `None` unless there are exactly three cameras, from left to right.
    pub fn height_error(&self) -> Option<f64> {
        let [left, middle, right] = self.cameras.as_slice() else {
            return None;
        };
        let h1 = middle.offset_mm[0] - left.offset_mm[0];
        let h2 = right.offset_mm[0] - middle.offset_mm[0];
        if !(h1 > 0.0 && h2 > 0.0) {
            return None;
        }
        let slope = |outer: &Camera, h: f64| (outer.offset_mm[1] - middle.offset_mm[1]).abs() / h;
        let slopes = [slope(left, h1), slope(right, h2)];
        let widest = self.cameras.iter().map(|camera| self.widest(camera));
        let widest = widest.fold(0.0, f64::max);
        // `max` ignores NaN, so check the numbers first.
        let are_numbers = slopes.iter().all(|slope| slope.is_finite());
        are_numbers.then(|| widest * slopes[0].max(slopes[1]))
    }

    /// Returns true if the paper's two estimators may be used: left, middle and right camera, near
    /// enough to one line.
    pub fn is_in_line(&self) -> bool {
        self.height_error()
            .is_some_and(|error| error <= HEIGHT_ERROR_LIMIT)
    }

    /// Returns the greatest `|x|` that the camera sees. It lies at a corner or in the middle of a
    /// side, for any lens distortion.
    fn widest(&self, camera: &Camera) -> f64 {
        let [width, height] = self.image_size_px.map(|side| f64::from(side) - 1.0);
        let columns = [0.0, 0.5, 1.0].map(|share| share * width);
        let rows = [0.0, 0.5, 1.0].map(|share| share * height);
        let seen = columns
            .iter()
            .flat_map(|x| rows.iter().map(|y| camera.normalise([*x, *y])[0].abs()));
        seen.fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::estimate::{closed_form, least_squares};
    use crate::sums::View;
    use crate::sums::pair::PairSums;
    use std::vec::Vec;

    /// Returns the paper's rig with other heights, mm.
    fn raised(heights_mm: [f64; 3]) -> Rig {
        let mut rig = Rig::paper();
        for (camera, height) in rig.cameras.iter_mut().zip(heights_mm) {
            camera.offset_mm[1] = height;
        }
        rig
    }

    /// Returns the estimates of a small move by closed form and least squares, from points around
    /// `at`, normalised. The bias of the estimators themselves is negligible for a move this small.
    fn estimates(rig: &Rig, at: [f64; 2], depth_mm: f64) -> [[f64; 3]; 2] {
        let mut sums = PairSums::new(rig).unwrap();
        for i in 0..25 {
            let spread = |n: i32| 0.01 * f64::from(n - 2);
            let depth = depth_mm * (1.0 + 0.1 * spread(i % 3));
            let point = [
                (at[0] + spread(i % 5)) * depth,
                (at[1] + spread(i / 5)) * depth,
                depth,
            ];
            let moved = [point[0], point[1], depth + MOVE_MM];
            let views: Vec<View> = (rig.cameras.iter())
                .map(|camera| {
                    View::from_pixels(camera, camera.project(point), camera.project(moved))
                })
                .collect();
            sums.add([views[0], views[1], views[2]]);
        }
        [
            closed_form::solve(&sums).unwrap(),
            least_squares::solve(&sums).unwrap(),
        ]
    }

    const MOVE_MM: f64 = 0.01;

    /// Returns the effect of the heights as shares of the move: the greatest change of Y, then what
    /// each estimator loses of Z.
    fn effect(heights_mm: [f64; 3], at: [f64; 2], depth_mm: f64) -> (f64, [f64; 2]) {
        let level = estimates(&Rig::paper(), at, depth_mm);
        let raised = estimates(&raised(heights_mm), at, depth_mm);
        let change = |method: usize, axis: usize| {
            ((raised[method][axis] - level[method][axis]) / MOVE_MM).abs()
        };
        (change(0, 1).max(change(1, 1)), [change(0, 2), change(1, 2)])
    }

    #[test]
    fn height_error_stays_below_its_bound() {
        // The paper's images end at 0.31 on the farther side, the middle camera's at 0.317.
        let mut worst: f64 = 0.0;
        for heights_mm in [
            [0.6, 0.0, 0.0],
            [0.0, 0.0, -0.6],
            [0.6, 0.0, 0.6],
            [-0.6, 0.0, 0.6],
        ] {
            let rig = raised(heights_mm);
            let bound = rig.height_error().unwrap();
            assert!(bound <= HEIGHT_ERROR_LIMIT && rig.is_in_line(), "{bound}");
            for x in [-0.27, -0.1, 0.0, 0.2, 0.27] {
                for y in [-0.15, 0.0, 0.2] {
                    let (lateral, [closed_form, least_squares]) =
                        effect(heights_mm, [x, y], 1000.0);
                    worst = worst.max(lateral);
                    assert!(lateral <= bound, "{heights_mm:?} {x} {y}: {lateral}");
                    assert!(closed_form < 1e-5, "{heights_mm:?} {x}: {closed_form}");
                    assert!(least_squares < 0.008, "{heights_mm:?} {x}: {least_squares}");
                }
            }
        }
        // The bound is tight.
        assert!(worst > 0.7 * HEIGHT_ERROR_LIMIT, "{worst}");
    }

    #[test]
    fn height_limit_is_exact() {
        let most = |k: usize| {
            let (mut low, mut high) = (0.0, 10.0);
            for _ in 0..60 {
                let mut heights = [0.0; 3];
                heights[k] = 0.5 * (low + high);
                if raised(heights).is_in_line() {
                    low = heights[k];
                } else {
                    high = heights[k];
                }
            }
            low
        };
        // τ is the middle camera's 170.59 px over 538.14.
        let tau = 170.59 / 538.14;
        assert!((most(0) - 0.003 * 70.0 / tau).abs() < 1e-9, "{}", most(0));
        assert!((most(2) - 0.003 * 68.0 / tau).abs() < 1e-9, "{}", most(2));
        assert!((most(1) - most(2)).abs() < 1e-9);
        assert!(PairSums::new(&raised([0.0, 0.0, most(2)])).is_ok());
        assert!(PairSums::new(&raised([0.0, 0.0, most(2) + 1e-6])).is_err());
    }

    #[test]
    fn cameras_rise_together_in_order() {
        assert_eq!(raised([5.0; 3]).height_error(), Some(0.0));
        let mut rig = Rig::paper();
        rig.cameras.swap(0, 1);
        assert_eq!(rig.height_error(), None);
        rig.cameras.pop();
        assert!(!rig.is_in_line());
        let mut nowhere = raised([0.0, 0.0, f64::NAN]);
        assert!(!nowhere.is_in_line());
        nowhere.cameras[2].offset_mm = [f64::NAN, 0.0];
        assert!(!nowhere.is_in_line());
    }
}
