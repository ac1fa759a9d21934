//! Every axis of every estimator, in floating and in fixed point, with and without noise.
//!
//! The expected values come from this file's own geometry (a point `(X, Y, Z)` appears at
//! `((X - cx) / Z, (Y - cy) / Z)`), from batch solutions of the estimators' definitions, and from
//! one reference case. A wrong sign or an error of 5 % fails within a second.

mod eight_points;

use super::{closed_form, least_squares, midpoint};
use crate::rig::{Camera, Rig};
use crate::sums::View;
use crate::sums::centred::CentredSums;
use crate::sums::pair::PairSums;
use nalgebra::{Matrix3, Matrix4x3, Vector3, Vector4};
use std::vec::Vec;

/// Focal length of all cameras, px.
const FOCAL_PX: f64 = 530.0;

/// Cameras of the paper's rig, mm.
const LINE: [[f64; 2]; 3] = [[-70.0, 0.0], [0.0, 0.0], [68.0, 0.0]];

/// Cameras in two dimensions and off the origin, mm.
const PLANE: [[f64; 2]; 4] = [[-60.0, -45.0], [70.0, -50.0], [65.0, 40.0], [-55.0, 60.0]];

fn rig(cameras_mm: &[[f64; 2]]) -> Rig {
    let camera = |offset_mm: &[f64; 2]| Camera::ideal([FOCAL_PX; 2], [160.0, 120.0], *offset_mm);
    Rig {
        image_size_px: [320, 240],
        cameras: cameras_mm.iter().map(camera).collect(),
    }
}

/// Deterministic pseudo-random numbers.
struct Random(u64);

impl Random {
    /// Returns a number between -1 and 1.
    fn uniform(&mut self) -> f64 {
        let factor = 6_364_136_223_846_793_005;
        self.0 = self
            .0
            .wrapping_mul(factor)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Returns an approximately normal number with unit variance: the sum of twelve uniform ones.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() / 2.0
    }
}

/// Returns the views of `points` points off the axis, displaced by `displacement_mm`.
///
/// `depths_mm` are the nearest and the farthest; the noise of `noise_px` is in both instants.
fn views(
    cameras_mm: &[[f64; 2]],
    points: usize,
    depths_mm: [f64; 2],
    displacement_mm: [f64; 3],
    (noise_px, random): (f64, &mut Random),
) -> Vec<Vec<View>> {
    let mut point = || {
        let [near, far] = depths_mm;
        let z = 0.5 * (near + far + (far - near) * random.uniform());
        let at = [
            (0.05 + 0.2 * random.uniform()) * z,
            (0.15 * random.uniform() - 0.04) * z,
            z,
        ];
        let moved: [f64; 3] = core::array::from_fn(|i| at[i] + displacement_mm[i]);
        let mut seen = |[x, y, z]: [f64; 3], [cx, cy]: [f64; 2]| {
            let mut noise = || random.normal() * noise_px / FOCAL_PX;
            [(x - cx) / z + noise(), (y - cy) / z + noise()]
        };
        let views = cameras_mm.iter().map(|camera| View {
            start: seen(at, *camera),
            end: seen(moved, *camera),
        });
        views.collect()
    };
    (0..points).map(|_| point()).collect()
}

fn centred(rig: &Rig, views: &[Vec<View>]) -> CentredSums {
    let mut sums = CentredSums::new(rig).unwrap();
    assert!(views.iter().all(|views| sums.add(views)));
    sums
}

fn pairs(rig: &Rig, views: &[Vec<View>]) -> PairSums {
    let mut sums = PairSums::new(rig).unwrap();
    views.iter().for_each(|v| sums.add([v[0], v[1], v[2]]));
    sums
}

#[track_caller]
fn assert_close(got: [f64; 3], want: [f64; 3], bound: f64) {
    let off = core::array::from_fn::<_, 3, _>(|i| (got[i] - want[i]).abs());
    assert!(
        off.iter().all(|off| *off <= bound),
        "{got:?} is not {want:?}"
    );
}

/// Displacements along each axis in either direction, and along all at once.
fn displacements(size_mm: f64) -> impl Iterator<Item = [f64; 3]> {
    let along =
        move |axis: usize, by: f64| core::array::from_fn(|i| if i == axis { by } else { 0.0 });
    let single = (0..3).flat_map(move |axis| [size_mm, -size_mm].map(|by| along(axis, by)));
    single.chain([[size_mm, -0.7 * size_mm, 1.3 * size_mm]])
}

fn millimetres(nm: super::DisplacementNm) -> [f64; 3] {
    nm.map(|nm| f64::from(nm) * 1e-6)
}

#[test]
fn midpoint_is_exact_on_every_axis() {
    for cameras in [&LINE[..], &PLANE[..]] {
        let rig = rig(cameras);
        for moved in displacements(20.0) {
            let views = views(cameras, 20, [700.0, 1_000.0], moved, (0.0, &mut Random(1)));
            let sums = centred(&rig, &views);
            let estimate = midpoint::solve(&sums).unwrap();
            assert_close(estimate.displacement_mm, moved, 1e-8);
            let fixed = midpoint::solve_fixed(&sums.quantise().unwrap()).unwrap();
            assert_close(millimetres(fixed.displacement_nm), moved, 1e-4);
        }
    }
}

/// The paper's estimators are exact for lateral motion. At one depth `Z` the exact flow of a motion
/// along z is `-x Vz / (Z + Vz)`, which is the small-motion flow of `Vz Z / (Z + Vz)`.
#[test]
fn paper_is_exact_but_for_its_bias() {
    let rig = rig(&LINE);
    let depth = 900.0;
    for moved in displacements(20.0) {
        let views = views(&LINE, 20, [depth; 2], moved, (0.0, &mut Random(2)));
        let sums = pairs(&rig, &views);
        let want = moved.map(|mm| mm * depth / (depth + moved[2]));
        assert_close(closed_form::solve(&sums).unwrap(), want, 1e-8);
        assert_close(least_squares::solve(&sums).unwrap(), want, 1e-8);
        let fixed = closed_form::solve_fixed(&sums.quantise().unwrap()).unwrap();
        assert_close(millimetres(fixed), want, 1e-3);
    }
}

/// Solves the midpoint model in one batch, with plain sums: the weighted least-squares solution of
/// `v/g = T_xy - ξ T_z` with the weights `g²`. Returns the displacement and the covariance.
fn midpoint_by_definition(
    cameras_mm: &[[f64; 2]],
    views: &[Vec<View>],
) -> ([f64; 3], Matrix3<f64>) {
    let count = cameras_mm.len() as f64;
    let mean = |at: &dyn Fn(usize) -> f64| (0..cameras_mm.len()).map(at).sum::<f64>() / count;
    let centre = [0, 1].map(|i| mean(&|k| cameras_mm[k][i]));
    let arm = |k: usize, i: usize| cameras_mm[k][i] - centre[i];
    let size: f64 = (0..cameras_mm.len())
        .map(|k| arm(k, 0).powi(2) + arm(k, 1).powi(2))
        .sum();
    let mut rows = Vec::new();
    for views in views {
        // ξ_k = α - ρ c_k at both instants.
        let fit = |at: &dyn Fn(usize) -> [f64; 2]| {
            let slope = |k: usize| arm(k, 0) * at(k)[0] + arm(k, 1) * at(k)[1];
            let rho = -(0..views.len()).map(slope).sum::<f64>() / size;
            (rho, [0, 1].map(|i| mean(&|k| at(k)[i])))
        };
        let (before, start) = fit(&|k| views[k].start);
        let (after, end) = fit(&|k| views[k].end);
        let g = 2.0 / (1.0 / before + 1.0 / after);
        for (k, view) in views.iter().enumerate() {
            for i in 0..2 {
                let xi = 0.5 * (start[i] + end[i]) - 0.5 * (before + after) * arm(k, i);
                let unit = if i == 0 { [1.0, 0.0] } else { [0.0, 1.0] };
                let row = Vector3::new(unit[0], unit[1], -xi) * g;
                rows.push((row, view.end[i] - view.start[i]));
            }
        }
    }
    let normal: Matrix3<f64> = rows.iter().map(|(row, _)| row * row.transpose()).sum();
    let right: Vector3<f64> = rows.iter().map(|(row, flow)| row * *flow).sum();
    let inverse = normal.try_inverse().unwrap();
    let solution = inverse * right;
    let squares = rows
        .iter()
        .map(|(row, flow)| (flow - row.dot(&solution)).powi(2));
    let variance = squares.sum::<f64>() / (rows.len() - 3) as f64;
    (solution.into(), inverse * variance)
}

#[test]
fn noisy_midpoint_is_the_batch_solution() {
    for (cameras, seed) in [(&LINE[..], 3), (&PLANE[..], 4)] {
        let rig = rig(cameras);
        for moved in displacements(8.0) {
            let noise = (0.2, &mut Random(seed));
            let views = views(cameras, 30, [600.0, 1_100.0], moved, noise);
            let (want, covariance) = midpoint_by_definition(cameras, &views);
            let mut sums = centred(&rig, &views);
            let got = midpoint::solve(&sums).unwrap();
            assert_close(got.displacement_mm, want, 1e-8);
            for i in 0..3 {
                assert_close(
                    got.covariance_mm2[i],
                    covariance.row(i).transpose().into(),
                    1e-10,
                );
            }
            let fixed = midpoint::solve_fixed(&sums.quantise().unwrap()).unwrap();
            assert_close(millimetres(fixed.displacement_nm), want, 1e-4);
            let variances = |i: usize| fixed.variance_nm2[i] as f64 * 1e-12 / covariance[(i, i)];
            assert_close([0, 1, 2].map(variances), [1.0; 3], 0.01);
            // Inflated variances, in either form.
            sums.overlap = 4.0;
            let wide = midpoint::solve(&sums).unwrap().sigma_mm();
            let ratio = |i: usize| wide[i] / got.sigma_mm()[i];
            assert_close([0, 1, 2].map(ratio), [2.0; 3], 1e-9);
            let wide = midpoint::solve_fixed(&sums.quantise().unwrap()).unwrap();
            let ratio = |i: usize| wide.variance_nm2[i] as f64 / fixed.variance_nm2[i] as f64;
            assert_close([0, 1, 2].map(ratio), [4.0; 3], 0.12);
        }
    }
}

/// The paper's system `A x = d` (its eqs. 5-7), summed from the views by its definition.
fn paper_by_definition(views: &[Vec<View>]) -> (Matrix4x3<f64>, Vector4<f64>) {
    let (mut matrix, mut right) = (Matrix4x3::zeros(), Vector4::zeros());
    for views in views {
        for (pair, row) in [(0, 0), (1, 2)] {
            let [first, second] = [views[pair], views[pair + 1]];
            let baseline = LINE[pair + 1][0] - LINE[pair][0];
            let [[x1, y1], [x2, y2]] = [first.start, second.start];
            matrix[(row, 0)] += x1 - x2;
            matrix[(row + 1, 1)] += x1 - x2;
            matrix[(row, 2)] += (x2 * x2 - x1 * x1) / 2.0;
            matrix[(row + 1, 2)] += x2 * y2 - x1 * y1;
            for i in 0..2 {
                let flow = first.end[i] - first.start[i] + second.end[i] - second.start[i];
                right[row + i] += flow / 2.0 * baseline;
            }
        }
    }
    (matrix, right)
}

/// The closed form satisfies both x rows exactly and both y rows in the least-squares sense; least
/// squares satisfies all four in that sense.
#[test]
fn noisy_paper_solves_its_equations() {
    let rig = rig(&LINE);
    for moved in displacements(8.0) {
        let views = views(&LINE, 30, [600.0, 1_100.0], moved, (0.2, &mut Random(5)));
        let (matrix, right) = paper_by_definition(&views);
        let sums = pairs(&rig, &views);
        let closed = closed_form::solve(&sums).unwrap();
        let left = matrix * Vector3::from(closed) - right;
        let y_rows = matrix[(1, 1)] * left[1] + matrix[(3, 1)] * left[3];
        assert_close([left[0], left[2], y_rows], [0.0; 3], 1e-9);
        let fixed = closed_form::solve_fixed(&sums.quantise().unwrap()).unwrap();
        assert_close(millimetres(fixed), closed, 1e-3);

        let squares = least_squares::solve(&sums).unwrap();
        let left = matrix * Vector3::from(squares) - right;
        assert_close((matrix.transpose() * left).into(), [0.0; 3], 1e-9);
    }
}

/// The stated sigma is the standard deviation of the error, and the error has no bias.
#[test]
#[cfg_attr(miri, ignore)] // hundreds of runs: too slow for an interpreter
fn stated_sigma_is_that_of_the_error() {
    let rig = rig(&PLANE);
    let (moved, runs) = ([3.0, -4.0, 6.0], 400);
    let mut random = Random(6);
    let (mut sum, mut squares) = ([0.0; 3], [0.0; 3]);
    for _ in 0..runs {
        let views = views(&PLANE, 30, [600.0, 1_100.0], moved, (0.2, &mut random));
        let estimate = midpoint::solve(&centred(&rig, &views)).unwrap();
        for i in 0..3 {
            let error = (estimate.displacement_mm[i] - moved[i]) / estimate.sigma_mm()[i];
            (sum[i], squares[i]) = (sum[i] + error, squares[i] + error * error);
        }
    }
    let runs = f64::from(runs);
    assert_close(sum.map(|sum| sum / runs), [0.0; 3], 0.2);
    assert_close(
        squares.map(|squares| (squares / runs).sqrt()),
        [1.0; 3],
        0.12,
    );
}

#[test]
fn reference_case_is_reproduced() {
    use eight_points::*;
    let rig = rig(&CAMERAS_MM.map(|x| [x, 0.0]));
    let views = POINTS_PX.map(|point| {
        let view = |[start, end]: [[f64; 2]; 2]| View {
            start: start.map(|px| px / FOCAL_PX),
            end: end.map(|px| px / FOCAL_PX),
        };
        point.map(view).to_vec()
    });
    let sums = centred(&rig, &views);
    let estimate = midpoint::solve(&sums).unwrap();
    assert_close(estimate.displacement_mm, MIDPOINT_MM, 1e-8);
    assert_close(estimate.sigma_mm(), SIGMA_MM, 1e-8);
    let fixed = midpoint::solve_fixed(&sums.quantise().unwrap()).unwrap();
    assert_close(millimetres(fixed.displacement_nm), MIDPOINT_MM, 1e-4);
    assert_close(
        fixed.sigma_nm().map(|nm| f64::from(nm) * 1e-6),
        SIGMA_MM,
        1e-3,
    );

    let sums = pairs(&rig, &views);
    assert_close(closed_form::solve(&sums).unwrap(), CLOSED_FORM_MM, 1e-8);
    assert_close(least_squares::solve(&sums).unwrap(), LEAST_SQUARES_MM, 1e-8);
    let fixed = closed_form::solve_fixed(&sums.quantise().unwrap()).unwrap();
    assert_close(millimetres(fixed), CLOSED_FORM_MM, 1e-3);
}
