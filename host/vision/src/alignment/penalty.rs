//! Errors in Z that a wrong rig causes in each estimator, without noise.
//!
//! Points spread over the common field of view at one depth make the paper's move of (4, 4, 1) mm.
//! They are projected with the true principal points and rotations and estimated with the assumed
//! ones. The lateral part of the move leaks into the closed form's Z.

use serde::Serialize;
use trinocular_core::estimate::{closed_form, midpoint};
use trinocular_core::rig::Rig;
use trinocular_core::sums::View as PointView;
use trinocular_core::sums::centred::CentredSums;
use trinocular_core::sums::pair::PairSums;

use super::fit::{Point, Sample, corrected};
use crate::field_of_view::FieldOfView;
use crate::matching::geometry::RigGeometry;

/// Error in Z of each estimator, per cent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// Error of the midpoint estimator.
    pub midpoint: Option<f64>,
    /// Error of the paper's closed form; `None` if it cannot be used with the rig or gives no
    /// displacement.
    pub closed_form: Option<f64>,
}

/// Errors in Z before and after an alignment.
///
/// The offsets that a scene shows cause no error of the midpoint estimator, because its depths and
/// flows depend only on the offsets that the scene does not show.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Penalty {
    /// Error with the rig file as it is.
    pub before_percent: Cost,
    /// Error with the offsets that were found, one standard deviation from the right ones.
    pub after_percent: Cost,
    /// Error with 0.1 px along x in the worse outer image.
    pub tenth_px_percent: Cost,
    /// Error with a common error of all disparities, 0.1 px to the farthest camera: equal for all
    /// estimators.
    pub unseen_percent: f64,
}

/// Displacement of the target, mm: a step of the paper's section 4.3.
const MOVE_MM: [f64; 3] = [4.0, 4.0, 1.0];

impl Penalty {
    /// Computes the errors for targets at `depth_mm`, with the principal points of `assumed`
    /// instead of those of `found`, which are right within `sigma_px`. Without a known depth, the
    /// common error of all disparities is left out.
    pub fn of(
        assumed: &Rig,
        found: &Rig,
        sigma_px: &[[f64; 2]],
        depth_mm: f64,
        is_depth_known: bool,
    ) -> Self {
        let off = |k: usize, i: usize, px: f64| {
            let mut truth = found.clone();
            truth.cameras[k].principal_px[i] += px;
            truth
        };
        let mut squares = Cost {
            midpoint: Some(0.0),
            closed_form: Some(0.0),
        };
        for (k, sigma) in sigma_px.iter().enumerate() {
            for (i, sigma) in sigma.iter().enumerate().filter(|(_, s)| **s > 0.0) {
                let mut truth = off(k, i, *sigma);
                if !is_depth_known {
                    truth = visible(&truth, found, depth_mm).unwrap_or(truth);
                }
                squares = squares.with(cost(&truth, found, depth_mm), |sum, c| sum + c * c);
            }
        }
        let mut tenth = squares.map(|_| 0.0);
        for k in 0..found.cameras.len() {
            let cost = cost(&off(k, 0, 0.1), found, depth_mm).map(f64::abs);
            if sigma_px.get(k).is_some_and(|sigma| sigma[0] > 0.0) {
                tenth = tenth.with(cost, f64::max);
            }
        }
        let px = RigGeometry::new(found)
            .map_or(f64::NAN, |g| g.focal_px * g.longest_baseline_mm / depth_mm);
        Self {
            before_percent: cost(found, assumed, depth_mm),
            after_percent: squares.map(f64::sqrt),
            tenth_px_percent: tenth,
            unseen_percent: 100.0 * 0.1 / px,
        }
    }
}

impl Cost {
    fn map(self, by: impl Fn(f64) -> f64) -> Self {
        Self {
            midpoint: self.midpoint.map(&by),
            closed_form: self.closed_form.map(&by),
        }
    }

    fn with(self, other: Self, by: impl Fn(f64, f64) -> f64) -> Self {
        let both = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| by(a, b));
        Self {
            midpoint: both(self.midpoint, other.midpoint),
            closed_form: both(self.closed_form, other.closed_form),
        }
    }
}

/// Adds the part of the offsets of `truth` that a scene shows to `assumed`.
fn visible(truth: &Rig, assumed: &Rig, depth_mm: f64) -> Option<Rig> {
    let geometry = RigGeometry::new(assumed)?;
    let seen = truth.cameras.iter();
    let point = Point {
        pixels: seen.map(|c| c.project([0.0, 0.0, depth_mm])).collect(),
    };
    let sample = Sample::of(&geometry, &point);
    Some(corrected(assumed, geometry.reference, &sample.components))
}

/// Computes the error in Z with the rig `assumed` instead of `truth`, per cent of the displacement.
pub fn cost(truth: &Rig, assumed: &Rig, depth_mm: f64) -> Cost {
    let frame = frame(truth, assumed, depth_mm);
    let percent = |z: f64| 100.0 * (z / MOVE_MM[2] - 1.0);
    let centred = || {
        let mut sums = CentredSums::new(assumed).ok()?;
        for views in &frame {
            sums.add(views);
        }
        midpoint::solve(&sums).ok()
    };
    let pair = || {
        let mut sums = PairSums::new(assumed).ok()?;
        for views in &frame {
            if let [left, middle, right] = views.as_slice() {
                sums.add([*left, *middle, *right]);
            }
        }
        closed_form::solve(&sums).ok()
    };
    Cost {
        midpoint: centred().map(|estimate| percent(estimate.displacement_mm[2])),
        closed_form: pair().map(|[_, _, z]| percent(z)),
    }
}

/// Computes the correspondences of a grid of points in the common field of view.
fn frame(truth: &Rig, assumed: &Rig, depth_mm: f64) -> Vec<Vec<PointView>> {
    const SIDE: i32 = 8;
    let Some(common) = FieldOfView::new(truth, 0.0).common(depth_mm) else {
        return Vec::new();
    };
    let place = |i: usize, n: i32| {
        common.low[i] + common.sides()[i] * (f64::from(n) + 0.5) / f64::from(SIDE)
    };
    let grid = (0..SIDE).flat_map(|x| (0..SIDE).map(move |y| [x, y]));
    grid.map(|[x, y]| {
        let (x, y) = (place(0, x), place(1, y));
        let cameras = truth.cameras.iter().zip(&assumed.cameras);
        cameras
            .map(|(truth, assumed)| {
                let start = truth.project([x, y, depth_mm]);
                let end = truth.project([x + MOVE_MM[0], y + MOVE_MM[1], depth_mm + MOVE_MM[2]]);
                PointView::from_pixels(assumed, start, end)
            })
            .collect()
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests the figures behind the choice of the midpoint estimator.
    #[test]
    fn tenth_px_hurts_closed_form_most() {
        let rig = Rig::paper();
        let mut moved = rig.clone();
        moved.cameras[2].principal_px[0] += 0.1;
        let cost = cost(&moved, &rig, 850.0);
        let (midpoint, closed_form) = (cost.midpoint.unwrap(), cost.closed_form.unwrap());
        println!("midpoint {midpoint:.3} %, closed form {closed_form:.2} %");
        assert!((0.05..0.3).contains(&midpoint.abs()), "{midpoint}");
        assert!((10.0..14.0).contains(&closed_form.abs()), "{closed_form}");
    }

    #[test]
    fn true_rig_costs_only_closed_form_bias() {
        let rig = Rig::paper();
        let cost = cost(&rig, &rig, 900.0);
        assert!(cost.midpoint.unwrap().abs() < 1e-9);
        // Z/(Z + Vz), of 1 mm at 900.
        assert!((cost.closed_form.unwrap() + 100.0 / 901.0).abs() < 0.05);
    }

    #[test]
    fn visible_offsets_cost_midpoint_nothing() {
        let rig = Rig::paper();
        let mut truth = rig.clone();
        truth.cameras[2].principal_px = [161.4, 119.0];
        let shown = visible(&truth, &rig, 900.0).unwrap();
        assert!((shown.cameras[2].principal_px[1] - 119.0).abs() < 1e-9);
        assert!(cost(&shown, &rig, 900.0).midpoint.unwrap().abs() < 1e-9);
        assert!(cost(&truth, &rig, 900.0).midpoint.unwrap().abs() > 0.5);
        assert!(cost(&shown, &rig, 900.0).closed_form.unwrap().abs() > 50.0);
        // The visible part of the rest is zero.
        let rest = visible(&truth, &shown, 900.0).unwrap();
        for (a, b) in rest.cameras.iter().zip(&shown.cameras) {
            assert!((a.principal_px[0] - b.principal_px[0]).abs() < 1e-9);
        }
    }

    #[test]
    fn two_camera_rig_has_no_closed_form() {
        let mut rig = Rig::paper();
        rig.cameras.pop();
        let penalty = Penalty::of(&rig, &rig, &[[0.0; 2], [0.02, 0.02]], 900.0, true);
        assert_eq!(penalty.after_percent.closed_form, None);
        // 0.02 px of 41.
        let after = penalty.after_percent.midpoint.unwrap();
        assert!((after - 0.048).abs() < 0.003, "{after}");
        // 533 px times 70 mm over 900 mm are 41 px.
        assert!((penalty.unseen_percent - 0.24).abs() < 0.01);
    }
}
