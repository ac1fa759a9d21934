//! Motion planning: from target positions of the stage to segments of motion.
//!
//! Limits come in as integers in physical units ([`AxisConfig`]) and are converted once
//! ([`Limits`]). The [`Planner`] then plans one control tick (1 ms) after the other, as four
//! [`Segment`](crate::steps::Segment)s of 250 µs each. The target can change before any tick, also
//! in mid-move: the newest one wins.
//!
//! # The grid
//!
//! With `N` slots to a tick, speeds at tick borders are multiples of `2N` fine units per slot. Say
//! an axis has the speed `2N m` at the start of a tick and `2N (m + e)` at its end. Slot `k` of the
//! tick then gets the increment
//!
//! ```text
//! 2N m + e + 2e k      k = 0..N
//! ```
//!
//! that is, the exact straight line from one speed to the other, sampled in the middle of each
//! slot. The tick moves the axis by `N² (m + (m + e))` fine units: mean speed times time, without
//! any rounding. So all planning is done in small integers and is exact: `m` for speed, `e` for
//! acceleration and its change for jerk, and `N²` fine units for distance. With words at 1 MHz, N =
//! 500, a speed quantum is 0.116 steps/s, an acceleration quantum 116 steps/s², a jerk quantum
//! 116,000 steps/s³ and a distance quantum 5.8·10⁻⁵ step. The first is proportional to the word
//! rate, the second and the third to its square.
//!
//! # Reversal
//!
//! Within a segment an axis keeps its direction. In the one segment of a reversal in which the
//! speed goes through zero, the axis gets the segment's mean speed instead. At the end of the
//! segment its position is exact (but for less than `N/4` fine units), and within the segment the
//! error is less than an eighth of the acceleration times (250 µs)².

mod backlash;
mod limits;
mod planner;
mod stopping;

pub use limits::{AxisConfig, AxisLimits, Bound, ConfigFault, Field, LimitFault, Limits};
pub use planner::Planner;
