//! Variance inflation: the factor by which correlated errors increase the displacement's variance.
//!
//! The residuals `r_ik` of point `i` in camera `k` show the error of one point. The error of their
//! mean is smaller, but not by as much as for independent points: cameras share a point's depth,
//! and overlapping windows share pixels, thus noise. Interpolation errors do not correlate; they
//! depend on the sub-pixel phase of each point. The correlation is therefore measured. With
//! `R_i = Σ_k r_ik` and the share `s_ij` that two windows have in common,
//!
//! ```text
//! own = Σ |R_i|² / Σ |r_ik|²                          1 if cameras err independently
//! ρ   = Σ' s_ij R_i·R_j / (Σ' s_ij² Σ |R_i|²/N)       pairs of different points;
//!                                                     1 if all error is noise of windows
//! factor = own (1 + ρ Σ' s_ij / N)
//! ```
//!
//! `ρ` is the least-squares fit of `E[R_i·R_j] = ρ s_ij E|R|²`; its standard deviation is
//! `1/√Σ' s_ij²`. Two corrections:
//!
//! * The fit of `u` unknowns to `2N` sums (3 of a displacement, 6 of a pose) has taken its part out
//!   of every product: `E[R_i·R_j]` is smaller by `b = u/2 w/N` of `E|R|²`, with
//!   `w = 1 + ρ Σ' s_ij/N` the inflation of the sum over points. The equation for `ρ` stays linear.
//! * Few pairs say little, so `ρ` has a prior of 1 with the weight of ten pairs of equal windows.
//!
//! [`with_common_error`] adds the error that all points share, which no residual shows.

use super::Correspondence;
use crate::matching::geometry::RigGeometry;
use crate::matching::lucas_kanade::FineTemplate;
use trinocular_core::sums::View;

/// Side of the tracked windows, px.
const SIDE_PX: f64 = FineTemplate::SIDE as f64;
/// Prior of the correlation: all error of the windows is noise.
const PRIOR: f64 = 1.0;
/// Weight of the prior, in pairs of equal windows.
const PRIOR_PAIRS: f64 = 10.0;
/// Limits of the measured correlation. It is above 1 where the texture is concentrated in the
/// pixels that windows share.
const CORRELATION: [f64; 2] = [0.0, 2.0];

/// Sub-pixel error that all points have in common, px: the rest of its dependence on the phase of
/// the pixel grid when the points are spread over all phases. No residual shows it.
///
/// `trinocular bench robustness --only bias` measures it: where all points move alike it is below
/// 0.00003 px at every phase; motions along z and scenes of several depths mix the phases. With
/// this value, errors of sharp posters at a noise of half a grey level are as large as sigma says
/// or a little smaller (the rows `plain`, `still` and `500-mm` with `--noise`).
const COMMON_PX: f64 = 0.000_05;

/// Inflation of the displacement's variance, against independent errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VarianceInflation {
    /// Factor if all error were noise shared by overlapping windows: the mean over all windows of
    /// the sum of the shares that each has in common with all, itself included.
    pub window_overlap: f64,
    /// Factor that the residuals show.
    pub factor: f64,
    /// Inflation by overlapping windows alone, without the errors that the cameras of one point
    /// share.
    pub of_windows: f64,
}

impl VarianceInflation {
    /// Measures the inflation from the residuals of inliers against their displacement.
    pub fn of(
        geometry: &RigGeometry,
        inliers: &[Correspondence],
        displacement_mm: [f64; 3],
    ) -> Self {
        Self::of_residuals(geometry, inliers, 3.0, |inlier| {
            let fit = geometry.arms.point(&inlier.views)?;
            let residual = move |(k, view): (usize, &View)| {
                let (seen, expected) = (view.flow(), fit.flow(k, displacement_mm));
                [0, 1].map(|axis| seen[axis] - expected[axis])
            };
            Some(inlier.views.iter().enumerate().map(residual))
        })
    }

    /// Measures the inflation from the residuals of inliers in each camera, normalised, against a
    /// model with this number of fitted `unknowns`.
    pub fn of_residuals<'a, I: Iterator<Item = [f64; 2]>>(
        geometry: &RigGeometry,
        inliers: &'a [Correspondence],
        unknowns: f64,
        residuals: impl Fn(&'a Correspondence) -> Option<I>,
    ) -> Self {
        // Sum over cameras of each point's residuals, and the sum of all squares.
        let mut white = 0.0;
        let sums: Vec<[f64; 2]> = (inliers.iter())
            .map(|inlier| {
                let mut sum = [0.0; 2];
                for residual in residuals(inlier).into_iter().flatten() {
                    for axis in 0..2 {
                        white += residual[axis] * residual[axis];
                        sum[axis] += residual[axis];
                    }
                }
                sum
            })
            .collect();

        // Covariances over all pairs of overlapping windows of the reference camera.
        let centre_px = |inlier: &Correspondence| inlier.pixels[geometry.reference][0];
        let centres_px: Vec<[f64; 2]> = inliers.iter().map(centre_px).collect();
        let (mut shared, mut squares, mut products) = (0.0, 0.0, 0.0);
        for (i, (a, at)) in sums.iter().zip(&centres_px).enumerate() {
            for (b, other) in sums.iter().zip(&centres_px).take(i) {
                let [dx, dy] = [0, 1].map(|axis| (at[axis] - other[axis]).abs());
                if dx < SIDE_PX && dy < SIDE_PX {
                    let share = (1.0 - dx / SIDE_PX) * (1.0 - dy / SIDE_PX);
                    shared += 2.0 * share;
                    squares += 2.0 * share * share;
                    products += 2.0 * share * (a[0] * b[0] + a[1] * b[1]);
                }
            }
        }
        let count = sums.len().max(1) as f64;
        let more = shared / count;
        let window_overlap = 1.0 + more;
        let all: f64 = sums.iter().map(|s| s[0] * s[0] + s[1] * s[1]).sum();
        if !(white > 0.0 && all > 0.0) {
            // A frame set measured against itself has no residuals.
            let factor = window_overlap;
            return Self {
                window_overlap,
                factor,
                of_windows: factor,
            };
        }

        // Least squares for ρ with its prior, corrected for the u fitted unknowns:
        // squares ρ = products/(all/N) + u/2N (1 + ρ more) shared
        let half = 0.5 * unknowns;
        let taken = half / count * shared;
        let known = (squares - taken * more).max(0.0);
        let seen = products * count / all + taken;
        let [least, most] = CORRELATION;
        let correlation = ((seen + PRIOR * PRIOR_PAIRS) / (known + PRIOR_PAIRS)).clamp(least, most);
        let of_sum = 1.0 + correlation * more;
        let own = all / white / (1.0 - half * of_sum / count).max(0.5);
        Self {
            window_overlap,
            factor: own * of_sum,
            of_windows: of_sum,
        }
    }
}

/// Adds the error that all points share to a variance inflation factor: for the mean over
/// `components` flow components of standard deviation `sigma_px`,
///
/// ```text
/// variance = factor s²/n + common² = (factor + common² n/s²) s²/n
/// ```
///
/// The inflation reaches the station as fewer degrees of freedom, so that the wire needs no field
/// for it. Depth noise is in the residual already: with a wrong `g`, `v - g T` is not zero.
pub fn with_common_error(factor: f64, sigma_px: f64, components: f64) -> f64 {
    let common = COMMON_PX * COMMON_PX * components / (sigma_px * sigma_px);
    // Without residuals there is no variance to inflate.
    if common.is_finite() {
        factor + common
    } else {
        factor
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::cloud::{Cloud, independent};
    use trinocular_rig::random::Random;

    const MOVED: [f64; 3] = [9.0, -4.0, 2.0];

    fn moved(_: usize, place: [f64; 3]) -> [f64; 3] {
        core::array::from_fn(|i| place[i] + MOVED[i])
    }

    #[test]
    fn independent_errors_do_not_inflate() {
        let cloud = Cloud::new();
        for seed in 0..5 {
            let points = cloud.points(moved, independent(0.02, seed));
            let inflation = VarianceInflation::of(&cloud.geometry, &points, MOVED);
            assert!(inflation.window_overlap > 3.5, "{inflation:?}");
            assert!((0.7..1.6).contains(&inflation.factor), "{inflation:?}");
        }
    }

    #[test]
    fn shared_noise_inflates_by_overlap() {
        let cloud = Cloud::new();
        for seed in 0..5 {
            // Each point's error is the mean of the noise in its window, one number per pixel,
            // camera and axis.
            let mut random = Random::seeded(seed);
            let mut fields = Vec::new();
            for _ in 0..6 {
                let field: Vec<f64> = (0..320 * 240).map(|_| random.gaussian()).collect();
                fields.push(field);
            }
            let noise = |k: usize, i: usize| {
                let [x, y] = cloud.centres_px[i].map(|c| c as usize);
                [0, 1].map(|axis| {
                    let row = |r: usize| &fields[2 * k + axis][r * 320 + x - 10..][..21];
                    (y - 10..y + 11).flat_map(row).sum::<f64>() / 21.0 * 0.02
                })
            };
            let points = cloud.points(moved, noise);
            let inflation = VarianceInflation::of(&cloud.geometry, &points, MOVED);
            let ratio = inflation.factor / inflation.window_overlap;
            assert!((0.6..1.5).contains(&ratio), "{inflation:?}");
        }
    }

    #[test]
    fn shared_camera_errors_inflate_threefold() {
        let cloud = Cloud::new();
        let mut random = Random::seeded(3);
        let common: Vec<[f64; 2]> = (0..cloud.places.len())
            .map(|_| [(); 2].map(|()| 0.02 * random.gaussian()))
            .collect();
        let points = cloud.points(moved, |_, i| common[i]);
        let inflation = VarianceInflation::of(&cloud.geometry, &points, MOVED);
        assert!((2.4..4.2).contains(&inflation.factor), "{inflation:?}");
    }

    #[test]
    fn missing_residuals_count_as_noise() {
        let cloud = Cloud::new();
        let points = cloud.points(|_, place| place, |_, _| [0.0; 2]);
        let inflation = VarianceInflation::of(&cloud.geometry, &points, [0.0; 3]);
        assert_eq!(inflation.factor, inflation.window_overlap);
    }
}
