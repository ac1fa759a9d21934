//! Centred sums of the midpoint model, which the default estimator needs.
//!
//! For any finite displacement `T` of a point, with bars the mean of the two instants, camera `k`
//! sees exactly
//!
//! ```text
//! v_k = (T_xy - ξ_k T_z) / Z̄          ξ_k = the mean of the two normalised positions, per axis
//! ```
//!
//! so with `g = 1/Z̄` each observation is a small linear equation `v/g = T_xy - ξ T_z` of weight
//! `g²` (constant pixel noise). Depth comes from the views themselves: at each instant the views of
//! one point satisfy `ξ_k = α - ρ c_k`, with `c_k` the camera's position and `ρ` the inverse depth;
//! `ρ` is fitted by least squares over the cameras. `Z̄` is the mean of the two depths, thus `g = 2
//! ρ0 ρ1 / (ρ0 + ρ1)`. The sums use ξ as refitted to the rig, which removes most of its noise.
//!
//! Everything is accumulated as weighted deviations from running means (West 1979), never as raw
//! sums, because the raw form loses the residual in cancellation when the motion is large. All
//! results are divided by `Σ g²`, which makes them independent of focal length, depth and number of
//! points:
//!
//! | name | meaning | unit |
//! |---|---|---|
//! | `mean_mm` | weighted mean of `v/g`: `tx, ty` | mm |
//! | `centroid` | weighted mean of `ξ, η` | - |
//! | `spread` | weighted mean of `\|ξ - centroid\|²` | - |
//! | `coupling_mm` | minus the weighted mean of `(ξ - centroid)·(v/g - mean)` | mm |
//! | `scatter_mm2` | weighted mean of `\|v/g - mean\|²` | mm² |
//!
//! Then `T_z = coupling / spread` and `T_xy = mean + centroid T_z` (see
//! [`crate::estimate::midpoint`]).

use super::View;
use crate::estimate::Refusal;
use crate::fixed::quantise;
use crate::rig::{MAX_CAMERAS, Rig};
use serde::{Deserialize, Serialize};

/// Positions of a rig's cameras relative to their mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Geometry {
    centre_mm: [f64; 2],
    arms_mm: heapless::Vec<[f64; 2], MAX_CAMERAS>,
    /// `Σ |arm|²`, mm²: the denominator of the fit of inverse depth.
    arms_squared_mm2: f64,
}

/// Depth and positions of one point, fitted to all its views.
#[derive(Clone, Debug, PartialEq)]
pub struct PointFit {
    /// Inverse depth `g = 1/Z̄`, 1/mm.
    pub inverse_depth: f64,
    /// Normalised mid position in each camera, refitted to the rig.
    pub middles: heapless::Vec<[f64; 2], MAX_CAMERAS>,
}

impl PointFit {
    /// Computes the flow in camera `k` of a target displaced by `[tx, ty, tz]` mm, normalised: `g
    /// (T_xy - ξ T_z)`.
    pub fn flow(&self, k: usize, [tx, ty, tz]: [f64; 3]) -> [f64; 2] {
        let [xi, eta] = self.middles[k];
        [
            self.inverse_depth * (tx - xi * tz),
            self.inverse_depth * (ty - eta * tz),
        ]
    }
}

impl Geometry {
    /// Creates the geometry of 2 to 8 cameras in a plane.
    ///
    /// # Errors
    /// [`Refusal::WrongRig`] if there are fewer than two cameras or all stand in one place.
    pub fn new(rig: &Rig) -> Result<Self, Refusal> {
        let count = rig.cameras.len() as f64;
        let mean: [f64; 2] = core::array::from_fn(|i| {
            rig.cameras.iter().map(|c| c.offset_mm[i]).sum::<f64>() / count
        });
        let arms_mm: heapless::Vec<[f64; 2], MAX_CAMERAS> = rig
            .cameras
            .iter()
            .map(|c| [c.offset_mm[0] - mean[0], c.offset_mm[1] - mean[1]])
            .collect();
        let arms_squared_mm2 = arms_mm.iter().map(|[x, y]| x * x + y * y).sum();
        if rig.cameras.len() < 2 || !(arms_squared_mm2 > 0.0) {
            return Err(Refusal::WrongRig);
        }
        Ok(Self {
            centre_mm: mean,
            arms_mm,
            arms_squared_mm2,
        })
    }

    /// Returns the mean position of the cameras, mm right and down of the rig's origin.
    pub fn centre_mm(&self) -> [f64; 2] {
        self.centre_mm
    }

    /// Returns the sum of the squared distances of the cameras from their mean, mm².
    pub fn arms_squared_mm2(&self) -> f64 {
        self.arms_squared_mm2
    }

    /// Returns the positions of the cameras relative to their mean, mm.
    pub fn arms_mm(&self) -> &[[f64; 2]] {
        &self.arms_mm
    }

    /// Returns the number of cameras.
    pub fn cameras(&self) -> usize {
        self.arms_mm.len()
    }

    /// Fits inverse depth (1/mm) and mean position of one point to its normalised positions in all
    /// cameras: least squares of `ξ_k = α - ρ c_k` over cameras and axes.
    pub fn fit(&self, positions: impl Iterator<Item = [f64; 2]>) -> (f64, [f64; 2]) {
        let count = self.arms_mm.len() as f64;
        let mut mean = [0.0; 2];
        let mut lever = 0.0;
        for (arm, at) in self.arms_mm.iter().zip(positions) {
            mean = [mean[0] + at[0] / count, mean[1] + at[1] / count];
            lever -= arm[0] * at[0] + arm[1] * at[1];
        }
        (lever / self.arms_squared_mm2, mean)
    }

    /// Computes the position in each camera of a point fitted by [`Geometry::fit`].
    fn refit(&self, inverse_depth: f64, mean: [f64; 2]) -> impl Iterator<Item = [f64; 2]> {
        self.arms_mm
            .iter()
            .map(move |arm| core::array::from_fn(|i| mean[i] - arm[i] * inverse_depth))
    }

    /// Fits depth and mid positions of one point to its views, which are in the rig's order.
    ///
    /// Returns `None` if the point is not in front of the cameras at both instants, is not finite,
    /// or does not have exactly one view per camera.
    pub fn point(&self, views: &[View]) -> Option<PointFit> {
        if views.len() != self.cameras() {
            return None;
        }
        let (before, start) = self.fit(views.iter().map(|v| v.start));
        let (after, end) = self.fit(views.iter().map(|v| v.end));
        let inverse_depth = 2.0 * before * after / (before + after);
        let in_front = before > 0.0 && after > 0.0 && inverse_depth.is_finite();
        let finite = views.iter().all(|v| v.flow().iter().all(|c| c.is_finite()));
        let middle = core::array::from_fn(|i| 0.5 * (start[i] + end[i]));
        let middles = self.refit(0.5 * (before + after), middle).collect();
        (in_front && finite).then_some(PointFit {
            inverse_depth,
            middles,
        })
    }
}

/// Centred sums in floating point.
///
/// ```
/// use trinocular_core::estimate::midpoint;
/// use trinocular_core::{rig::Rig, sums::{View, centred::CentredSums}};
///
/// let rig = Rig::paper();
/// let mut sums = CentredSums::new(&rig)?;
/// for [x, y, z] in [[-60.0, -40.0, 900.0], [55.0, -35.0, 940.0], [5.0, 60.0, 880.0]] {
///     let start = rig.cameras.iter().map(|c| c.project([x, y, z]));
///     let end = rig.cameras.iter().map(|c| c.project([x + 4.0, y - 2.0, z + 20.0]));
///     let views: Vec<View> = (rig.cameras.iter().zip(start).zip(end))
///         .map(|((camera, start), end)| View::from_pixels(camera, start, end))
///         .collect();
///     assert!(sums.add(&views));
/// }
/// let [x, y, z] = midpoint::solve(&sums)?.displacement_mm;
/// assert!((x - 4.0).abs() < 1e-9 && (y + 2.0).abs() < 1e-9 && (z - 20.0).abs() < 1e-9);
/// # Ok::<(), trinocular_core::estimate::Refusal>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct CentredSums {
    geometry: Geometry,
    mean_focal_px: f64,
    /// Number of points added.
    pub points: u32,
    /// Variance inflation factor, at least 1: the ratio of the estimate's variance to that of
    /// independent observations. Points matched in overlapping windows see the same noise. Stays 1
    /// unless the caller sets it.
    pub overlap: f64,
    /// `Σ g²` over points and cameras, 1/mm².
    pub weight: f64,
    /// Weighted mean of `v/g`, mm.
    pub mean_mm: [f64; 2],
    /// Weighted mean of the normalised mid positions, dimensionless.
    pub centroid: [f64; 2],
    /// `Σ g² |ξ - centroid|²`, 1/mm².
    pub spread_sum: f64,
    /// `-Σ g² (ξ - centroid)·(v/g - mean)`, 1/mm.
    pub coupling_sum: f64,
    /// `Σ g² |v/g - mean|²`, dimensionless.
    pub scatter_sum: f64,
}

impl CentredSums {
    /// Creates empty sums for a rig of 2 to 8 cameras in a plane.
    ///
    /// # Errors
    /// [`Refusal::WrongRig`] if there are fewer than two cameras or all stand in one place.
    pub fn new(rig: &Rig) -> Result<Self, Refusal> {
        Ok(Self {
            geometry: Geometry::new(rig)?,
            mean_focal_px: rig.mean_focal_px(),
            points: 0,
            overlap: 1.0,
            weight: 0.0,
            mean_mm: [0.0; 2],
            centroid: [0.0; 2],
            spread_sum: 0.0,
            coupling_sum: 0.0,
            scatter_sum: 0.0,
        })
    }

    /// Creates the sums from which the midpoint estimator gets this displacement with its variance,
    /// for a displacement that was estimated in another way from `points` points; `sigma` is the
    /// standard deviation of one normalised coordinate.
    ///
    /// The covariance of the midpoint estimator, `v (diag(1, 1, 0) + u u' / d)` with `u = (ξ, η,
    /// 1)`, has one `v` for x and y: the larger one is stated for both.
    ///
    /// # Errors
    /// [`Refusal::WrongRig`] as [`CentredSums::new`]; [`Refusal::TooFewPoints`] without a degree of
    /// freedom, [`Refusal::Degenerate`] if a variance is not positive.
    ///
    /// ```
    /// use trinocular_core::estimate::midpoint;
    /// use trinocular_core::{rig::Rig, sums::centred::CentredSums};
    ///
    /// let covariance = [[4e-6, 0.0, 1e-6], [0.0, 1e-6, 0.0], [1e-6, 0.0, 9e-4]];
    /// let sums = CentredSums::of_displacement(&Rig::paper(), 100, [3.0, 4.0, -5.0], covariance, 2e-5)?;
    /// let estimate = midpoint::solve(&sums)?;
    /// let [x, y, z] = estimate.sigma_mm();
    /// assert!((estimate.displacement_mm[2] + 5.0).abs() < 1e-12);
    /// assert!((x - 0.002).abs() < 1e-9 && (z - 0.03).abs() < 1e-9 && y >= 0.001);
    /// # Ok::<(), trinocular_core::estimate::Refusal>(())
    /// ```
    pub fn of_displacement(
        rig: &Rig,
        points: u32,
        [tx, ty, tz]: [f64; 3],
        covariance_mm2: [[f64; 3]; 3],
        sigma: f64,
    ) -> Result<Self, Refusal> {
        let mut sums = Self::new(rig)?;
        sums.points = points;
        let freedom = sums.freedom();
        if freedom <= 0 {
            return Err(Refusal::TooFewPoints);
        }
        // v/d is the variance of z, ξ and η are its regressions to x and y, v is what is left.
        let [[xx, _, xz], [_, yy, yz], [_, _, zz]] = covariance_mm2;
        let centroid = [xz / zz, yz / zz];
        let left = f64::max(xx - centroid[0] * xz, yy - centroid[1] * yz);
        let spread = left / zz;
        if !(left > 0.0 && zz > 0.0 && spread.is_finite() && sigma > 0.0) {
            return Err(Refusal::Degenerate);
        }
        // The total weight is that for which the midpoint estimator states the same sigma.
        sums.weight = sigma * sigma / left;
        sums.centroid = centroid;
        sums.mean_mm = [tx - centroid[0] * tz, ty - centroid[1] * tz];
        sums.spread_sum = sums.weight * spread;
        sums.coupling_sum = tz * sums.spread_sum;
        sums.scatter_sum = sums.weight * (left * freedom as f64 + tz * tz * spread);
        Ok(sums)
    }

    /// Adds one point seen by every camera, views in the rig's order.
    ///
    /// Returns false, and adds nothing, if the point is not in front of the cameras at both
    /// instants, is not finite, or does not have exactly one view per camera.
    pub fn add(&mut self, views: &[View]) -> bool {
        let Some(fit) = self.geometry.point(views) else {
            return false;
        };
        self.points += 1;
        let g = fit.inverse_depth;
        for (view, middle) in views.iter().zip(fit.middles) {
            self.observe(g * g, middle, view.flow().map(|flow| flow / g));
        }
        true
    }

    /// Adds one observation: West's update of weighted means and centred second moments.
    fn observe(&mut self, weight: f64, position: [f64; 2], shift_mm: [f64; 2]) {
        self.weight += weight;
        let share = weight / self.weight;
        for axis in 0..2 {
            let position_off = position[axis] - self.centroid[axis];
            let shift_off = shift_mm[axis] - self.mean_mm[axis];
            self.centroid[axis] += share * position_off;
            self.mean_mm[axis] += share * shift_off;
            let position_now = position[axis] - self.centroid[axis];
            let shift_now = shift_mm[axis] - self.mean_mm[axis];
            self.spread_sum += weight * position_off * position_now;
            self.coupling_sum -= weight * position_off * shift_now;
            self.scatter_sum += weight * shift_off * shift_now;
        }
    }

    /// Returns the number of observations: points times cameras.
    pub fn observations(&self) -> u32 {
        self.points * self.geometry.cameras() as u32
    }

    /// Returns the degrees of freedom of the residual, `2 K N - 3`; negative if the fit is
    /// underdetermined.
    pub fn freedom(&self) -> i64 {
        2 * i64::from(self.observations()) - 3
    }

    /// Returns the weighted mean of the squared distance from the centroid, dimensionless.
    pub fn spread(&self) -> f64 {
        self.spread_sum / self.weight
    }

    /// Returns `Σ g²` in px²/mm², which converts mm² to px².
    pub fn weight_px2(&self) -> f64 {
        self.weight * self.mean_focal_px * self.mean_focal_px
    }

    /// Returns the weighted mean of the squared residual of the best fit, mm².
    pub fn residual_mm2(&self) -> f64 {
        let explained = self.coupling_sum * self.coupling_sum / self.spread_sum;
        ((self.scatter_sum - explained) / self.weight).max(0.0)
    }

    /// Converts the sums to the integers that cross the wire.
    ///
    /// # Errors
    /// [`Refusal::TooFewPoints`] without a degree of freedom, [`Refusal::Degenerate`] if all points
    /// coincide, [`Refusal::OutOfRange`] if a number is not finite or does not fit its format.
    pub fn quantise(&self) -> Result<FixedCentredSums, Refusal> {
        let freedom = self.freedom();
        if freedom <= 0 {
            return Err(Refusal::TooFewPoints);
        }
        let spread = self.spread();
        if !(spread > 0.0) {
            return Err(Refusal::Degenerate);
        }
        // spread = mantissa 2^exponent, mantissa in [0.5, 1)
        let (mantissa, exponent) = libm::frexp(spread);
        let coupling_mm = libm::ldexp(self.coupling_sum / self.weight, -exponent);
        let fit = |value: Option<i32>| value.ok_or(Refusal::OutOfRange);
        let nanometre = |mm: f64| fit(quantise(mm * 1e6, 0));
        // Rounding may carry the mantissa to 2^32; the largest word is then the nearest.
        let spread_word = libm::round(libm::ldexp(mantissa, 32)).min(f64::from(u32::MAX)) as u32;
        let residual_nm = libm::round(libm::sqrt(self.residual_mm2()) * 1e6);
        if !(residual_nm <= f64::from(u32::MAX)) {
            return Err(Refusal::OutOfRange);
        }
        Ok(FixedCentredSums {
            points: u16::try_from(self.points).map_err(|_| Refusal::OutOfRange)?,
            freedom: effective_freedom(freedom, self.overlap),
            mean_nm: [nanometre(self.mean_mm[0])?, nanometre(self.mean_mm[1])?],
            centroid: [
                fit(quantise(self.centroid[0], FixedCentredSums::CENTROID_BITS))?,
                fit(quantise(self.centroid[1], FixedCentredSums::CENTROID_BITS))?,
            ],
            spread: spread_word,
            exponent: i8::try_from(exponent).map_err(|_| Refusal::OutOfRange)?,
            coupling: fit(quantise(coupling_mm * 1e6, FixedCentredSums::COUPLING_BITS))?,
            residual_nm: residual_nm as u32,
        })
    }
}

/// Returns the degrees of freedom that yield the inflated variance, 1 to 65535. The cap only makes
/// sigma larger.
fn effective_freedom(freedom: i64, overlap: f64) -> u16 {
    let effective = freedom as f64 / overlap.max(1.0);
    effective.clamp(1.0, f64::from(u16::MAX)) as u16
}

/// Centred sums as integers. No scale depends on the rig.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FixedCentredSums {
    /// Number of points.
    #[serde(with = "postcard::fixint::le")]
    pub points: u16,
    /// Degrees of freedom of the residual, `2 K N - 3`, at most 65535; the cap only makes sigma
    /// larger. The sender may state fewer where observations are not independent.
    #[serde(with = "postcard::fixint::le")]
    pub freedom: u16,
    /// Weighted mean of `v/g`: `tx, ty`, nm.
    #[serde(with = "super::fixint2")]
    pub mean_nm: [i32; 2],
    /// Centroid `ξ, η`, Q2.29 (±4).
    #[serde(with = "super::fixint2")]
    pub centroid: [i32; 2],
    /// Mantissa of the spread, Q0.32, always in `[2^31, 2^32)`: spread = `mantissa 2^exponent`.
    #[serde(with = "postcard::fixint::le")]
    pub spread: u32,
    /// Exponent of the spread, base 2.
    pub exponent: i8,
    /// Coupling divided by `2^exponent`, nm in Q28.3 (±268 mm), so that `T_z = coupling /
    /// mantissa`.
    #[serde(with = "postcard::fixint::le")]
    pub coupling: i32,
    /// Root of the weighted mean squared residual, nm.
    #[serde(with = "postcard::fixint::le")]
    pub residual_nm: u32,
}

impl FixedCentredSums {
    /// Fraction bits of the centroid.
    pub const CENTROID_BITS: i32 = 29;
    /// Fraction bits of the coupling, which is in nm.
    pub const COUPLING_BITS: i32 = 3;
}
