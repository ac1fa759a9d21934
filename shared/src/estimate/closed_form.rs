//! The paper's closed form (its eq. 9).
//!
//! With the sums of [`crate::sums::pair`], `q = a1 b2 - a2 b1` and `n = a1² + b1²`:
//!
//! ```text
//! Vx = (b2 d1 - a2 d3) / q
//! Vz = (a1 d3 - b1 d1) / q
//! Vy = (a1 d2 + b1 d4) / n + (a1 a3 + b1 b3)(b1 d1 - a1 d3) / (n q)
//!    = ((a1 d2 + b1 d4) - (a1 a3 + b1 b3) Vz) / n
//! ```
//!
//! The closed form assumes a small motion: a finite `Vz` scales the whole result by `Z/(Z + Vz)`,
//! 2.2 % for 20 mm at 890 mm. It has no covariance.

use super::{DisplacementNm, Refusal};
use crate::fixed::{Reciprocal, multiply_shift, narrow, shift_right_rounded};
use crate::sums::pair::{FixedPairSums, PairSums};

/// Smallest `q / n^1.5` accepted as a real disparity. In an ideal rig it is `½ h1 h2 h3 / (h1² +
/// h2²)^1.5`: 0.35 for equal baselines, 0.05 for baselines of 1 to 10. If points differ between
/// cameras or disparity vanishes, `q` falls to zero or changes its sign.
const MIN_CONDITION: f64 = 1e-3;

/// Smallest `q` of [`solve_fixed`], Q5.59. Below it quantisation would cost more than 1 µm at 100
/// mm. A rig of 70 and 68 mm reaches it at 2.2 m.
const MIN_FIXED_Q: i64 = 1 << 44;

/// Computes the target's displacement since the keyframe, mm.
///
/// # Errors
/// [`Refusal::TooFewPoints`] without points; [`Refusal::Degenerate`] if the disparities do not
/// determine the displacement; [`Refusal::OutOfRange`] if a sum is not finite.
///
/// # Example
/// ```
/// use trinocular_core::estimate::closed_form;
/// use trinocular_core::{rig::Rig, sums::{View, pair::PairSums}};
///
/// let rig = Rig::paper();
/// let mut sums = PairSums::new(&rig)?;
/// for [x, y, z] in [[-60.0, -40.0, 900.0], [55.0, -35.0, 940.0], [5.0, 60.0, 880.0]] {
///     let view = |k: usize| {
///         let camera = &rig.cameras[k];
///         let end = camera.project([x + 1.0, y - 2.0, z]);
///         View::from_pixels(camera, camera.project([x, y, z]), end)
///     };
///     sums.add([view(0), view(1), view(2)]);
/// }
/// let [x, y, z] = closed_form::solve(&sums)?;
/// assert!((x - 1.0).abs() < 1e-9 && (y + 2.0).abs() < 1e-9 && z.abs() < 1e-9);
/// # Ok::<(), trinocular_core::estimate::Refusal>(())
/// ```
pub fn solve(sums: &PairSums) -> Result<[f64; 3], Refusal> {
    if sums.points == 0 {
        return Err(Refusal::TooFewPoints);
    }
    let &PairSums {
        a1,
        a2,
        a3,
        b1,
        b2,
        b3,
        d1,
        d2,
        d3,
        d4,
        ..
    } = sums;
    let q = a1 * b2 - a2 * b1;
    let n = a1 * a1 + b1 * b1;
    let vz = (a1 * d3 - b1 * d1) / q;
    let vx = (b2 * d1 - a2 * d3) / q;
    let vy = ((a1 * d2 + b1 * d4) - (a1 * a3 + b1 * b3) * vz) / n;
    if ![a1, a2, a3, b1, b2, b3, d1, d2, d3, d4]
        .iter()
        .all(|s| s.is_finite())
    {
        return Err(Refusal::OutOfRange);
    }
    if !(q > MIN_CONDITION * n * libm::sqrt(n)) {
        return Err(Refusal::Degenerate);
    }
    Ok([vx, vy, vz])
}

/// Computes the target's displacement since the keyframe, nm, in integers. Saturates at ±128 mm.
///
/// Within 1 µm per axis of [`solve`] on the unquantised sums for baselines of 60 to 300 mm, depth
/// 300-2000 mm, focal lengths 300-2500 px, displacements up to 100 mm (test
/// `closed_form_fixed_point_follows_the_oracle`).
///
/// # Errors
/// [`Refusal::Degenerate`] if `q` is too small to divide by, or negative.
pub fn solve_fixed(sums: &FixedPairSums) -> Result<DisplacementNm, Refusal> {
    let wide = |a: i32, b: i32| i64::from(a) * i64::from(b);
    let &FixedPairSums {
        a1,
        a2,
        a3,
        b1,
        b2,
        b3,
        d1,
        d2,
        d3,
        d4,
        ..
    } = sums;
    // Each difference of two products of 32-bit numbers is below 2^63.
    let q = wide(a1, b2) - wide(a2, b1); // Q59
    if q < MIN_FIXED_Q {
        return Err(Refusal::Degenerate);
    }
    let per_q = Reciprocal::of(q).ok_or(Refusal::Degenerate)?;
    // mm in Q24: numerators are Q53 and Q54 over Q59.
    let vx = narrow(per_q.times(wide(b2, d1) - wide(a2, d3), 24 + 59 - 53));
    let vz = narrow(per_q.times(wide(a1, d3) - wide(b1, d1), 24 + 59 - 54));
    // Halved so that two squares fit: Q59 and Q53, Q58.
    let n = (wide(a1, a1) >> 1) + (wide(b1, b1) >> 1); // Q59
    let per_n = Reciprocal::of(n).ok_or(Refusal::Degenerate)?;
    let flow = (wide(a1, d2) >> 1) + (wide(b1, d4) >> 1); // mm in Q53
    let lever = (wide(a1, a3) >> 1) + (wide(b1, b3) >> 1); // Q58
    let slope = narrow(per_n.times(lever, 29 + 59 - 58)); // Q29
    let vy = per_n
        .times(flow, 24 + 59 - 53)
        .saturating_sub(multiply_shift(slope, vz, 29));
    Ok([vx, narrow(vy), vz].map(nanometres))
}

/// Converts mm in Q7.24 to nm.
fn nanometres(mm: i32) -> i32 {
    narrow(shift_right_rounded(i64::from(mm) * 1_000_000, 24))
}
