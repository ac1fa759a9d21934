//! Noise of the observations: a model of it, and its measurement without any model of the motion.

use super::Observation;
use super::quarter_turn::Turned;
use crate::sums::centred::Geometry;
use libm::sqrt;

/// Correlation of the misfits of both instants, in its standard deviations, above which the noise
/// of both counts as common: chance exceeds it once in 31,000.
const SIGNIFICANT: f64 = 4.0;

/// Largest correlation of both instants: with identical noise in both, points at rest would be
/// known exactly.
const MOST_CORRELATION: f64 = 0.999_999;

/// Variances of one normalised coordinate, dimensionless (px² over the squared focal length).
///
/// Points that are matched anew at either instant have independent noise. Points that are
/// *followed* from the keyframe share the error of their match between the cameras: the point of
/// the surface that a window in one camera shows differs a little from that of another, at both
/// instants alike.
///
/// ```
/// use trinocular_core::estimate::pose::Noise;
///
/// // 0.05 px between the cameras, 0.02 px from following, at 530 px.
/// let noise = Noise::followed(0.05 / 530.0, 0.02 / 530.0);
/// assert_eq!(noise.start, noise.common);
/// assert!((noise.end / noise.start - 1.16).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Variance at the keyframe.
    pub start: f64,
    /// Variance now.
    pub end: f64,
    /// Covariance of the two.
    pub common: f64,
}

impl Noise {
    /// Creates independent noise with the standard deviation `sigma` at either instant.
    pub fn independent(sigma: f64) -> Self {
        Self {
            start: sigma * sigma,
            end: sigma * sigma,
            common: 0.0,
        }
    }

    /// Creates the noise of points that were matched between the cameras at the keyframe with the
    /// standard deviation `stereo`, and followed from there with `following`.
    pub fn followed(stereo: f64, following: f64) -> Self {
        Self {
            start: stereo * stereo,
            end: stereo * stereo + following * following,
            common: stereo * stereo,
        }
    }

    /// Measures the noise by the misfit of the cameras to each other.
    ///
    /// The misfit has `N (2K - 3)` degrees of freedom at either instant. The noise counts as
    /// independent and equal at both, unless the correlation of the misfits is significant.
    pub fn of(geometry: &Geometry, observations: &[Observation]) -> Self {
        Self::of_turned(geometry, &Turned::nearest(geometry, observations))
    }

    /// Measures the noise of observations whose keyframe is turned.
    pub(super) fn of_turned(geometry: &Geometry, observations: &Turned<'_>) -> Self {
        let freedom = (observations.all.len() * (2 * geometry.cameras() - 3)).max(1) as f64;
        let mean =
            |value: fn(Observation) -> f64| observations.iter().map(value).sum::<f64>() / freedom;
        let start = mean(|o| o.start_misfit);
        let end = mean(|o| o.end_misfit);
        let common = mean(|o| o.common_misfit);
        let correlation = common / sqrt(start * end);
        if correlation * sqrt(freedom) > SIGNIFICANT {
            return Self { start, end, common };
        }
        Self::independent(sqrt(0.5 * (start + end)))
    }

    /// Splits the covariance of both instants into a scale and the Cholesky factor `L` of the rest,
    /// `[[start, common], [common, end]] = scale L L'`. Without noise the scale is 0 and `L` the
    /// unit matrix.
    pub(super) fn factor(&self) -> (f64, [[f64; 2]; 2]) {
        let scale = self.start.max(self.end);
        if !(scale > 0.0) {
            return (0.0, [[1.0, 0.0], [0.0, 1.0]]);
        }
        let [first, last] = [sqrt(self.start / scale), sqrt(self.end / scale)];
        let product = scale * first * last;
        let correlation = if product > 0.0 {
            (self.common / product).clamp(-MOST_CORRELATION, MOST_CORRELATION)
        } else {
            0.0
        };
        let own = sqrt(1.0 - correlation * correlation);
        (scale, [[first, 0.0], [correlation * last, own * last]])
    }
}

/// Returns the variance of one normalised coordinate from the scale of the noise, which has the
/// degrees of freedom of the cameras' misfit at both instants, and from the weighted sum of squares
/// of the residuals of `points` points.
///
/// Both are pooled, unless the residual is larger by more than chance: noise that all cameras share
/// does not show in the misfit, and then the residual alone counts.
pub(super) fn variance(geometry: &Geometry, scale: f64, squares: f64, points: usize) -> f64 {
    let freedom = (2 * points * (2 * geometry.cameras() - 3)) as f64;
    let rest = 3.0 * points as f64 - 6.0;
    let pooled = (scale * freedom + squares) / (freedom + rest);
    let chance = 1.0 + SIGNIFICANT * sqrt(2.0 / rest);
    if squares > chance * pooled * rest {
        return squares / rest;
    }
    pooled
}
