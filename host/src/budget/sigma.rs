//! Predicts the standard deviation of a displacement before any image is taken.
//!
//! `N` points are spread evenly over the view common to all cameras at the depth `Z`. Each gives in
//! each camera the flow `v = g (T_xy - ξ T_z)`, `g = 1/Z`, with noise of `s` px, that is `s/f` in
//! normalised coordinates. The midpoint estimator is the least-squares solution for `T` with equal
//! weights. With `A` the rows `g [1 0 -ξ]`, `g [0 1 -η]` and `S` the variances `(s/f)²`, its
//! covariance is
//!
//! ```text
//! Cov = w/N (Ā'Ā)^-1 (Ā'S Ā) (Ā'Ā)^-1          means over the points, sums over the cameras
//! ```
//!
//! For equal focal lengths that is the Cramér-Rao bound of small displacements (a test compares the
//! two). The means of polynomials of the second degree over a rectangle are computed exactly from
//! its four Gauss points.
//!
//! `w` is the variance inflation factor for correlated errors: overlapping windows share noise, and
//! sub-pixel tracking errs alike for all points ([`trinocular_vision::sums`]). Beyond some number
//! of points, more points therefore do not help. The prediction takes all noise to be the sensor's.
//! Windows do not share the part of it that is interpolation's own error, so with sharp texture and
//! little noise a measurement states a smaller factor
//! ([`trinocular_vision::flow::variance_inflation`]).

use nalgebra::{Matrix2x3, Matrix3};
use trinocular_core::rig::{Camera, Rig};

use trinocular_vision::field_of_view::{FieldOfView, Rectangle};
use trinocular_vision::flow::variance_inflation::with_common_error;
use trinocular_vision::matching::lucas_kanade::FineTemplate;

/// Side of the window in which the flow of a point is measured, px.
pub const WINDOW_PX: f64 = 21.0;

/// Least distance between two points, px
/// ([`trinocular_vision::flow::FlowSettings::min_spacing_px`]).
const APART_PX: f64 = 8.0;

/// Margin that a window needs from the image's border, px.
pub const MARGIN_PX: f64 = FineTemplate::MARGIN as f64;

/// Prediction for one depth and number of points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Standard deviation of each component of the displacement, mm.
    pub sigma_mm: [f64; 3],
    /// Variance inflation factor: variance over that of independent points, at least 1.
    pub widening: f64,
}

/// Information of one point at a depth.
#[derive(Clone, Debug, PartialEq)]
pub struct Predictor {
    /// Covariance of the displacement from one point, averaged over the view, mm².
    covariance_mm2: Matrix3<f64>,
    /// Mean share of a window that another window covers.
    overlap: f64,
    /// Largest number of points in the view at the flow's spacing.
    room_for: u32,
    cameras: f64,
    noise_px: f64,
}

impl Predictor {
    /// Creates a predictor for points at `depth_mm` whose flow has noise of `noise_px` (standard
    /// deviation of each component in each camera). Returns `None` if the cameras have no common
    /// view.
    pub fn new(rig: &Rig, view: &FieldOfView, depth_mm: f64, noise_px: f64) -> Option<Self> {
        Self::over(rig, &view.common(depth_mm)?, depth_mm, noise_px)
    }

    /// Creates a predictor as [`Predictor::new`] does, for points on a rectangle instead of the
    /// whole view.
    pub fn over(rig: &Rig, target: &Rectangle, depth_mm: f64, noise_px: f64) -> Option<Self> {
        let (mut normal, mut noisy) = (Matrix3::zeros(), Matrix3::zeros());
        for at in gauss_points(target) {
            for camera in &rig.cameras {
                let rows = flow_rows(camera, at, depth_mm);
                normal += rows.transpose() * rows;
                noisy += rows.transpose() * spoilt(&rows, camera, noise_px);
            }
        }
        let inverse = normal.try_inverse()?;
        let px_per_mm = rig.mean_focal_px() / depth_mm;
        let sides_px = target.sides().map(|side| side * px_per_mm);
        Some(Self {
            // The sums are over four points.
            covariance_mm2: inverse * noisy * inverse * 4.0,
            overlap: overlap(sides_px),
            room_for: room_for(sides_px),
            cameras: rig.cameras.len() as f64,
            noise_px,
        })
    }

    /// Returns the standard deviation per axis from `points` independent points, mm.
    pub fn independent(&self, points: u32) -> [f64; 3] {
        self.with(points, 1.0)
    }

    /// Returns the largest number of points in the view at the flow's least spacing.
    pub fn room_for(&self) -> u32 {
        self.room_for
    }

    /// Predicts a displacement from `points` points as the flow finds them, limited to the number
    /// that fits into the view.
    pub fn predict(&self, points: u32) -> Prediction {
        let points = points.min(self.room_for);
        let others = f64::from(points.saturating_sub(1));
        let components = 2.0 * self.cameras * f64::from(points);
        let widening = with_common_error(1.0 + others * self.overlap, self.noise_px, components);
        Prediction {
            sigma_mm: self.with(points, widening),
            widening,
        }
    }

    fn with(&self, points: u32, widening: f64) -> [f64; 3] {
        [0, 1, 2].map(|i| (self.covariance_mm2[(i, i)] * widening / f64::from(points)).sqrt())
    }
}

/// Returns the derivative of a point's normalised flow in one camera by the point's displacement.
pub(super) fn flow_rows(camera: &Camera, [x, y]: [f64; 2], depth_mm: f64) -> Matrix2x3<f64> {
    let [xi, eta] = [
        (x - camera.offset_mm[0]) / depth_mm,
        (y - camera.offset_mm[1]) / depth_mm,
    ];
    Matrix2x3::new(1.0, 0.0, -xi, 0.0, 1.0, -eta) / depth_mm
}

/// Returns the rows of [`flow_rows`] times the variances of their noise.
pub(super) fn spoilt(rows: &Matrix2x3<f64>, camera: &Camera, noise_px: f64) -> Matrix2x3<f64> {
    let mut spoilt = *rows;
    for (i, focal_px) in camera.focal_px.into_iter().enumerate() {
        spoilt.row_mut(i).scale_mut((noise_px / focal_px).powi(2));
    }
    spoilt
}

/// Returns the four Gauss points of a rectangle, whose mean of any polynomial of up to the third
/// degree is that of the whole rectangle.
fn gauss_points(rectangle: &Rectangle) -> [[f64; 2]; 4] {
    let place = |i: usize, side: f64| {
        let middle = 0.5 * (rectangle.low[i] + rectangle.high[i]);
        middle + side * 0.5 * rectangle.sides()[i] / 3f64.sqrt()
    };
    [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
        .map(|[x, y]: [f64; 2]| [place(0, x), place(1, y)])
}

/// Returns the largest number of points in a view of this size at a spacing of [`APART_PX`]: discs
/// of that diameter in hexagonal order, half of each outermost one outside.
fn room_for(sides_px: [f64; 2]) -> u32 {
    let [width, height] = sides_px.map(|side| side + APART_PX);
    let each = 0.5 * 3f64.sqrt() * APART_PX * APART_PX;
    (width * height / each) as u32
}

/// Returns the mean overlap of two windows whose centres lie anywhere in a view of this size, but
/// not closer than [`APART_PX`].
fn overlap([width_px, height_px]: [f64; 2]) -> f64 {
    // What the circle around a corner in which there is no other would have added: the mean of |x|
    // over a disc is 4/3π of its radius.
    let free = core::f64::consts::PI * APART_PX * APART_PX;
    let share = 1.0 - 4.0 * APART_PX / (3.0 * core::f64::consts::PI * WINDOW_PX);
    let near = free * share * share / (width_px * height_px);
    (covered(width_px) * covered(height_px) - near).max(0.0)
}

/// Returns the mean overlap of two windows along one axis, each with its centre anywhere on a line
/// of `length_px`: the mean of `max(0, 1 - |distance|/side)`.
fn covered(length_px: f64) -> f64 {
    let ratio = length_px / WINDOW_PX;
    if ratio >= 1.0 {
        1.0 / ratio - 1.0 / (3.0 * ratio * ratio)
    } else {
        1.0 - ratio / 3.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::validation::bound;
    use trinocular_core::estimate::midpoint;
    use trinocular_core::sums::View as PointView;
    use trinocular_core::sums::centred::CentredSums;
    use trinocular_rig::random::Random;

    fn predictor(rig: &Rig, depth_mm: f64, noise_px: f64) -> (Predictor, Rectangle) {
        let view = FieldOfView::new(rig, MARGIN_PX);
        let common = view.common(depth_mm).unwrap();
        (
            Predictor::new(rig, &view, depth_mm, noise_px).unwrap(),
            common,
        )
    }

    fn place(common: &Rectangle, depth_mm: f64, random: &mut Random) -> [f64; 3] {
        let [x, y] = [0, 1].map(|i| random.between(common.low[i], common.high[i]));
        [x, y, depth_mm]
    }

    /// Returns the root mean squared error of many seeded estimates, per axis, mm.
    fn simulated(rig: &Rig, depth_mm: f64, noise_px: f64, points: u32, trials: u64) -> [f64; 3] {
        let (_, common) = predictor(rig, depth_mm, noise_px);
        let moved = [2.0, -1.5, 1.0];
        let mut squares = [0.0; 3];
        for trial in 0..trials {
            let mut random = Random::new(31, trial);
            let mut sums = CentredSums::new(rig).unwrap();
            for _ in 0..points {
                let at = place(&common, depth_mm, &mut random);
                let now = std::array::from_fn(|i| at[i] + moved[i]);
                // Half of the flow's variance is in each of its two ends.
                let mut seen = |camera: &trinocular_core::rig::Camera, at: [f64; 3]| {
                    let pixel = camera.project(at);
                    pixel.map(|p| p + noise_px / 2f64.sqrt() * random.gaussian())
                };
                let views: Vec<PointView> = rig
                    .cameras
                    .iter()
                    .map(|c| PointView::from_pixels(c, seen(c, at), seen(c, now)))
                    .collect();
                assert!(sums.add(&views));
            }
            let got = midpoint::solve(&sums).unwrap().displacement_mm;
            for axis in 0..3 {
                squares[axis] += (got[axis] - moved[axis]).powi(2);
            }
        }
        squares.map(|sum| (sum / trials as f64).sqrt())
    }

    /// Compares predicted with simulated errors. 3,000 trials leave a root mean square uncertain by
    /// 1.3 %.
    #[track_caller]
    fn assert_predicted(rig: &Rig, depths_mm: &[f64], what: &str) {
        for &depth_mm in depths_mm {
            for points in [30, 150] {
                let (predictor, _) = predictor(rig, depth_mm, 0.1);
                let predicted = predictor.independent(points);
                let measured = simulated(rig, depth_mm, 0.1, points, 3000);
                for axis in 0..3 {
                    let ratio = measured[axis] / predicted[axis];
                    assert!(
                        (0.93..=1.07).contains(&ratio),
                        "{what}, {depth_mm} mm, {points} points, axis {axis}: measured {} \
                         predicted {}",
                        measured[axis],
                        predicted[axis]
                    );
                }
            }
        }
    }

    #[test]
    fn predicted_sigma_matches_error() {
        assert_predicted(
            &Rig::paper(),
            &[350.0, 600.0, 850.0, 1400.0, 2000.0],
            "paper",
        );
    }

    #[test]
    fn prediction_holds_for_other_rigs() {
        let mut unlike = Rig::paper();
        unlike.cameras[0].focal_px = [900.0, 880.0];
        unlike.cameras[2].focal_px = [400.0, 420.0];
        assert_predicted(&unlike, &[700.0, 1500.0], "unlike focal lengths");
        let mut two = Rig::paper();
        two.cameras.pop();
        assert_predicted(&two, &[700.0, 1500.0], "two cameras");
        let mut cross = Rig::paper();
        cross.cameras[1].offset_mm = [0.0, 60.0];
        assert_predicted(&cross, &[700.0, 1500.0], "not in line");
    }

    #[test]
    fn sigma_matches_cramer_rao_bound() {
        let mut rig = Rig::paper();
        for camera in &mut rig.cameras {
            camera.focal_px = [530.0; 2];
        }
        let (predictor, common) = predictor(&rig, 900.0, 0.1);
        let points = gauss_points(&common).map(|[x, y]| [x, y, 900.0]);
        let bound = bound::variance_mm2(&rig, &points, [0.0; 3], 0.1 / 2f64.sqrt()).unwrap();
        let predicted = predictor.independent(4);
        for axis in 0..3 {
            assert!((predicted[axis] / bound[axis].sqrt() - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn overlap_matches_random_windows() {
        let mut random = Random::new(8, 0);
        for length_px in [5.0, 21.0, 30.0, 200.0] {
            let count = 200_000;
            let shares = (0..count).map(|_| {
                let [a, b] = [0, 1].map(|_| random.between(0.0, length_px));
                (1.0 - (a - b).abs() / WINDOW_PX).max(0.0)
            });
            let mean = shares.sum::<f64>() / f64::from(count);
            assert!(
                (mean / covered(length_px) - 1.0).abs() < 0.02,
                "{length_px}"
            );
        }
    }

    #[test]
    fn spacing_matches_flow_settings() {
        assert_eq!(
            trinocular_vision::flow::FlowSettings::default().min_spacing_px,
            APART_PX
        );
    }

    #[test]
    fn more_points_gain_less_and_less() {
        let (predictor, _) = predictor(&Rig::paper(), 850.0, 0.05);
        let sigma = |points| predictor.predict(points).sigma_mm;
        assert!(sigma(4)[2] > 1.7 * sigma(16)[2]);
        assert!(sigma(1000)[2] < sigma(500)[2] && sigma(1000)[2] > 0.9 * sigma(500)[2]);
        for points in [1, 8, 100, 4000] {
            assert!(sigma(points)[2] >= predictor.independent(points)[2]);
        }
    }

    #[test]
    fn no_common_view_predicts_nothing() {
        let rig = Rig::paper();
        assert_eq!(
            Predictor::new(&rig, &FieldOfView::new(&rig, MARGIN_PX), 100.0, 0.1),
            None
        );
    }
}
