//! From where the stage should be to segments of motion.
//!
//! Limits come in as integers in physical units ([`AxisConfig`]) and are converted once ([`Limits`]). The
//! [`Planner`] then makes one [`Segment`](crate::steps::Segment) of 250 µs after the other, four to a control tick. The target can
//! change before any of them, also in mid-move: the newest one wins.
//!
//! # The grid
//!
//! With `n` slots to a segment, speeds at segment borders are multiples of `2n` fine units per slot. Say an axis has
//! the speed `2n m` at the start of a segment and `2n m'` at its end. Slot `k` then gets the increment
//!
//! ```text
//! 2n m + e + 2e k      e = m' - m      k = 0..n
//! ```
//!
//! that is, the exact straight line from one speed to the other, sampled in the middle of each slot. The segment moves
//! the axis by `n² (m + m')` fine units: mean speed times time, without any rounding. So all
//! planning is done in small integers `m` for speed and `n²` fine units for distance, and is exact. The quanta are tiny: with words at
//! 1 MHz, n = 125, a speed quantum is 0.029 steps/s, an acceleration quantum 116 steps/s² and a
//! distance quantum 3.6·10⁻⁶ step.

mod limits;
mod planner;

pub use limits::{AxisConfig, AxisLimits, ConfigFault, Field, LimitFault, Limits};
pub use planner::Planner;
