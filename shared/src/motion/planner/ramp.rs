//! Tick of constant acceleration, as the step generator takes it.

use crate::fixed::product;
use crate::steps::AxisMotion;

/// Ramp of one axis in one tick: velocity at its start and acceleration, quanta.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ramp {
    pub(super) speed: i64,
    pub(super) acceleration: i64,
}

impl Ramp {
    /// Returns the motion in one quarter of the tick, from 0: see the [module](crate::motion).
    pub(super) fn quarter(self, slots: u16, quarter: i64) -> AxisMotion {
        let n = i64::from(slots);
        let e = self.acceleration;
        // All below 2^40: speeds are below 2^32 fine units per slot.
        let start = product(2 * n, 4 * self.speed + product(e, quarter));
        let end = start + product(2 * n, e);
        if (start < 0 && end > 0) || (start > 0 && end < 0) {
            // Reversal: the mean speed, which is a whole number too.
            let mean = start + product(n, e);
            return motion(mean, 0, mean < 0);
        }
        let backward = start < 0 || end < 0;
        motion(start + e, 2 * e, backward)
    }
}

/// Converts signed increments to a motion. Increments that did not fit would become rest; speeds on
/// the grid do fit.
fn motion(first: i64, change: i64, backward: bool) -> AxisMotion {
    let forwards = |value: i64| {
        if backward {
            value.saturating_neg()
        } else {
            value
        }
    };
    match (
        u32::try_from(forwards(first)),
        i32::try_from(forwards(change)),
    ) {
        (Ok(first), Ok(change)) => AxisMotion {
            first,
            change,
            backward,
        },
        _ => AxisMotion::REST,
    }
}
