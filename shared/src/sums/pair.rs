//! The paper's ten sums over the camera pairs left-middle and middle-right (its eqs. 5-7).
//!
//! With `x, y` the normalised coordinates at the keyframe, `v` the flow since then, `h1` and `h2`
//! the baselines in mm:
//!
//! ```text
//! a1 = Σ x_l - Σ x_m     a2 = ½ Σ(x_m² - x_l²)     a3 = Σ x_m y_m - Σ x_l y_l
//! b1 = Σ x_m - Σ x_r     b2 = ½ Σ(x_r² - x_m²)     b3 = Σ x_r y_r - Σ x_m y_m
//! d1 = ½ h1 Σ(vx_l + vx_m)    d2 = ½ h1 Σ(vy_l + vy_m)
//! d3 = ½ h2 Σ(vx_m + vx_r)    d4 = ½ h2 Σ(vy_m + vy_r)
//! ```
//!
//! The paper writes pixels and one focal length `f`. Here each camera's own focal lengths are
//! divided out, which is the paper's system with `f = 1`: `a1, b1, d` shrink by `f`, the others by
//! `f²`, and the solution stays.

use super::View;
use crate::estimate::Refusal;
use crate::fixed::quantise;
use crate::rig::Rig;
use serde::{Deserialize, Serialize};

/// The paper's ten sums in floating point, over `points` points.
///
/// ```
/// use trinocular_core::rig::Rig;
/// use trinocular_core::sums::{View, pair::PairSums};
///
/// let rig = Rig::paper();
/// let mut sums = PairSums::new(&rig)?;
/// // A point on the axis at 850 mm that moves by 5 mm along x.
/// let view = |k: usize| {
///     let camera = &rig.cameras[k];
///     let [start, end] = [[0.0, 0.0, 850.0], [5.0, 0.0, 850.0]].map(|mm| camera.project(mm));
///     View::from_pixels(camera, start, end)
/// };
/// sums.add([view(0), view(1), view(2)]);
/// assert_eq!((sums.points, sums.baselines_mm), (1, [70.0, 68.0]));
/// assert!((sums.a1 - 70.0 / 850.0).abs() < 1e-12);
/// # Ok::<(), trinocular_core::estimate::Refusal>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[allow(missing_docs)] // the names are the paper's, defined above
pub struct PairSums {
    /// Baselines left-middle and middle-right, mm.
    pub baselines_mm: [f64; 2],
    /// Number of points added.
    pub points: u32,
    pub a1: f64,
    pub a2: f64,
    pub a3: f64,
    pub b1: f64,
    pub b2: f64,
    pub b3: f64,
    pub d1: f64,
    pub d2: f64,
    pub d3: f64,
    pub d4: f64,
}

impl PairSums {
    /// Creates empty sums for a rig of exactly three cameras from left to right, near enough to one
    /// line for [`Rig::is_in_line`].
    ///
    /// # Errors
    /// [`Refusal::WrongRig`] for any other rig, because the paper's two estimators assume this one.
    pub fn new(rig: &Rig) -> Result<Self, Refusal> {
        let [left, middle, right] = rig.cameras.as_slice() else {
            return Err(Refusal::WrongRig);
        };
        let baselines_mm = [
            middle.offset_mm[0] - left.offset_mm[0],
            right.offset_mm[0] - middle.offset_mm[0],
        ];
        if !rig.is_in_line() {
            return Err(Refusal::WrongRig);
        }
        Ok(Self {
            baselines_mm,
            ..Self::default()
        })
    }

    /// Adds one point seen by the left, the middle and the right camera.
    pub fn add(&mut self, [left, middle, right]: [View; 3]) {
        let [h1, h2] = self.baselines_mm;
        let [[xl, yl], [xm, ym], [xr, yr]] = [left.start, middle.start, right.start];
        let [[vxl, vyl], [vxm, vym], [vxr, vyr]] = [left.flow(), middle.flow(), right.flow()];
        self.points += 1;
        self.a1 += xl - xm;
        self.a2 += 0.5 * (xm * xm - xl * xl);
        self.a3 += xm * ym - xl * yl;
        self.b1 += xm - xr;
        self.b2 += 0.5 * (xr * xr - xm * xm);
        self.b3 += xr * yr - xm * ym;
        self.d1 += 0.5 * h1 * (vxl + vxm);
        self.d2 += 0.5 * h1 * (vyl + vym);
        self.d3 += 0.5 * h2 * (vxm + vxr);
        self.d4 += 0.5 * h2 * (vym + vyr);
    }

    /// Converts the sums to the integers that cross the wire: means over the points, in fixed
    /// point.
    ///
    /// # Errors
    /// [`Refusal::TooFewPoints`] without points, [`Refusal::OutOfRange`] if a mean is not finite or
    /// does not fit its format.
    pub fn quantise(&self) -> Result<FixedPairSums, Refusal> {
        if self.points == 0 {
            return Err(Refusal::TooFewPoints);
        }
        let count = f64::from(self.points);
        let mean = |sum: f64, bits: i32| quantise(sum / count, bits).ok_or(Refusal::OutOfRange);
        Ok(FixedPairSums {
            points: u16::try_from(self.points).map_err(|_| Refusal::OutOfRange)?,
            a1: mean(self.a1, FixedPairSums::FIRST_BITS)?,
            a2: mean(self.a2, FixedPairSums::SECOND_BITS)?,
            a3: mean(self.a3, FixedPairSums::SECOND_BITS)?,
            b1: mean(self.b1, FixedPairSums::FIRST_BITS)?,
            b2: mean(self.b2, FixedPairSums::SECOND_BITS)?,
            b3: mean(self.b3, FixedPairSums::SECOND_BITS)?,
            d1: mean(self.d1, FixedPairSums::FLOW_BITS)?,
            d2: mean(self.d2, FixedPairSums::FLOW_BITS)?,
            d3: mean(self.d3, FixedPairSums::FLOW_BITS)?,
            d4: mean(self.d4, FixedPairSums::FLOW_BITS)?,
        })
    }
}

/// The paper's ten sums divided by the number of points, which keeps the solution, as integers.
///
/// `a1 b1` are Q1.30 (±2), `a2 a3 b2 b3` are Q2.29 (±4), `d1..d4` are mm in Q7.24 (±128 mm).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs)] // the names are the paper's, defined above
pub struct FixedPairSums {
    /// Number of points in the means.
    #[serde(with = "postcard::fixint::le")]
    pub points: u16,
    #[serde(with = "postcard::fixint::le")]
    pub a1: i32,
    #[serde(with = "postcard::fixint::le")]
    pub a2: i32,
    #[serde(with = "postcard::fixint::le")]
    pub a3: i32,
    #[serde(with = "postcard::fixint::le")]
    pub b1: i32,
    #[serde(with = "postcard::fixint::le")]
    pub b2: i32,
    #[serde(with = "postcard::fixint::le")]
    pub b3: i32,
    #[serde(with = "postcard::fixint::le")]
    pub d1: i32,
    #[serde(with = "postcard::fixint::le")]
    pub d2: i32,
    #[serde(with = "postcard::fixint::le")]
    pub d3: i32,
    #[serde(with = "postcard::fixint::le")]
    pub d4: i32,
}

impl FixedPairSums {
    /// Fraction bits of `a1` and `b1`.
    pub const FIRST_BITS: i32 = 30;
    /// Fraction bits of `a2`, `a3`, `b2` and `b3`.
    pub const SECOND_BITS: i32 = 29;
    /// Fraction bits of `d1` to `d4`, which are in mm.
    pub const FLOW_BITS: i32 = 24;
}
