//! What the points' scatter says about the error of their mean.
//!
//! The residuals `r_ik` of point `i` in camera `k` show how much one point errs. Their mean errs
//! less, but not as if all were independent: the cameras share a point's depth, and windows that
//! overlap share pixels, thus noise. What does *not* correlate is interpolation, which errs by
//! where each point lies between the pixels. So correlation is measured, not assumed. With
//! `R_i = Σ_k r_ik` and the share `s_ij` that two windows have in common,
//!
//! ```text
//! own = Σ |R_i|² / Σ |r_ik|²                                 1 if cameras err independently
//! ρ   = Σ' s_ij R_i·R_j / (Σ' s_ij² Σ |R_i|²/N)              pairs of different points; 1 if all error is noise, evenly spread over windows
//! widening = own (1 + ρ Σ' s_ij / N)
//! ```
//!
//! is by how much the variance of the mean is larger than for independent observations. That `ρ` is
//! the least-squares fit of `E[R_i·R_j] = ρ s_ij E|R|²`; its standard deviation is `1/√Σ' s_ij²`.
//! Two corrections:
//!
//! * The fit of three unknowns to `2N` sums has taken its part out of every product: `E[R_i·R_j]`
//!   is smaller by `b = 3/2 w/N` of `E|R|²`, `w` being the widening of the sum over points,
//!   `1 + ρ Σ' s_ij/N`. That makes the equation for `ρ` linear in itself.
//! * Few pairs say little, so `ρ` begins at 1 with the weight of ten pairs of equal windows.

use crate::matching::geometry::Geometry;
use crate::matching::lucas_kanade::Large;
use shared::sums::View;

/// Side of the windows that are followed, px.
const SIDE_PX: f64 = Large::SIDE as f64;
/// The correlation that is believed without a look: all of the windows' error is noise.
const PRIOR: f64 = 1.0;
/// Weight of that belief, in pairs of equal windows.
const PRIOR_PAIRS: f64 = 10.0;
/// Limits of the measured correlation. Above 1 where texture is concentrated in what windows share.
const CORRELATION: [f64; 2] = [0.0, 2.0];

/// Of points and their windows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// By how much the variance of the mean would be larger if all error were noise shared by
    /// overlapping windows: the mean over all windows of the sum of the shares each has in common
    /// with all, itself included.
    pub overlap: f64,
    /// By how much it is, as far as residuals tell.
    pub widening: f64,
}

impl Scatter {
    /// Of `views` (per point, per camera) that agree on `displacement_mm`; `centres_px` are the
    /// windows' in one camera.
    pub fn of(
        geometry: &Geometry,
        views: &[Vec<View>],
        centres_px: &[[f64; 2]],
        displacement_mm: [f64; 3],
    ) -> Self {
        let mut white = 0.0;
        let sums: Vec<[f64; 2]> = (views.iter())
            .map(|views| {
                let mut sum = [0.0; 2];
                let Some(fit) = geometry.arms.point(views) else {
                    return sum;
                };
                for (k, view) in views.iter().enumerate() {
                    let (seen, expected) = (view.flow(), fit.flow(k, displacement_mm));
                    for axis in 0..2 {
                        let residual = seen[axis] - expected[axis];
                        white += residual * residual;
                        sum[axis] += residual;
                    }
                }
                sum
            })
            .collect();
        let (mut shared, mut squares, mut products) = (0.0, 0.0, 0.0);
        for (i, (a, at)) in sums.iter().zip(centres_px).enumerate() {
            for (b, other) in sums.iter().zip(centres_px).take(i) {
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
        let overlap = 1.0 + more;
        let all: f64 = sums.iter().map(|s| s[0] * s[0] + s[1] * s[1]).sum();
        if !(white > 0.0 && all > 0.0) {
            // A capture measured against itself.
            let widening = overlap;
            return Self { overlap, widening };
        }
        // squares ρ = products/(all/N) + 1.5/N (1 + ρ more) shared
        let taken = 1.5 / count * shared;
        let known = (squares - taken * more).max(0.0);
        let seen = products * count / all + taken;
        let [least, most] = CORRELATION;
        let correlation = ((seen + PRIOR * PRIOR_PAIRS) / (known + PRIOR_PAIRS)).clamp(least, most);
        let of_sum = 1.0 + correlation * more;
        let own = all / white / (1.0 - 1.5 * of_sum / count).max(0.5);
        Self {
            overlap,
            widening: own * of_sum,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::cloud::{Cloud, independent};
    use crate::random::Random;

    const MOVED: [f64; 3] = [9.0, -4.0, 2.0];

    fn moved(_: usize, place: [f64; 3]) -> [f64; 3] {
        core::array::from_fn(|i| place[i] + MOVED[i])
    }

    #[test]
    fn independent_errors_are_not_taken_for_common_ones_however_much_windows_overlap() {
        let cloud = Cloud::new();
        for seed in 0..5 {
            let views = cloud.views(moved, independent(0.02, seed));
            let scatter = Scatter::of(&cloud.geometry, &views, &cloud.centres_px, MOVED);
            assert!(scatter.overlap > 3.5, "{scatter:?}");
            assert!((0.7..1.6).contains(&scatter.widening), "{scatter:?}");
        }
    }

    #[test]
    fn noise_that_windows_share_widens_as_they_overlap() {
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
            let views = cloud.views(moved, noise);
            let scatter = Scatter::of(&cloud.geometry, &views, &cloud.centres_px, MOVED);
            let ratio = scatter.widening / scatter.overlap;
            assert!((0.6..1.5).contains(&ratio), "{scatter:?}");
        }
    }

    #[test]
    fn errors_that_a_points_cameras_share_count_for_each() {
        let cloud = Cloud::new();
        let mut random = Random::seeded(3);
        let common: Vec<[f64; 2]> = (0..cloud.places.len())
            .map(|_| [(); 2].map(|()| 0.02 * random.gaussian()))
            .collect();
        let views = cloud.views(moved, |_, i| common[i]);
        let scatter = Scatter::of(&cloud.geometry, &views, &cloud.centres_px, MOVED);
        assert!((2.4..4.2).contains(&scatter.widening), "{scatter:?}");
    }

    #[test]
    fn without_residuals_all_error_is_taken_for_noise() {
        let cloud = Cloud::new();
        let views = cloud.views(|_, place| place, |_, _| [0.0; 2]);
        let scatter = Scatter::of(&cloud.geometry, &views, &cloud.centres_px, [0.0; 3]);
        assert_eq!(scatter.widening, scatter.overlap);
    }
}
