//! Window of motion while the position is unknown.
//!
//! While the position is unknown, an axis stays within a distance of where it became unknown: where
//! the power came on, or where trust was lost. Only a known position moves the window: no further
//! loss of trust, no stop, and no configuration does.

use crate::track::{StepVector, add};

/// Anchor of the window: the place at which the position became unknown, 2⁻³² steps from zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Window {
    anchor: StepVector,
}

impl Window {
    /// Creates the window around a place that is known, or at which trust is lost.
    pub fn around(anchor: StepVector) -> Self {
        Self { anchor }
    }

    /// Shifts the window with the origin of one axis, whose position is known to be `place`.
    pub fn found(&mut self, axis: usize, place: i64) {
        if let Some(anchor) = self.anchor.get_mut(axis) {
            *anchor = place;
        }
    }

    /// Shifts the window with positions that changed without a motion, 2⁻³² steps.
    pub fn shift(&mut self, by: StepVector) {
        self.anchor = add(self.anchor, by);
    }

    /// Keeps the distance from the anchor, in mm, when an axis that stands at `at` gets another
    /// scale, steps/m, or counts in the other direction.
    pub fn rescale(&mut self, axis: usize, at: i64, scales: [u32; 2], turned: bool) {
        let Some(anchor) = self.anchor.get_mut(axis) else {
            return;
        };
        let [old, new] = scales.map(|scale| u64::from(scale.max(1)));
        let distance = at.abs_diff(*anchor);
        // The remainder is below 2^32, so its product is below 2^64.
        let distance = (distance / old)
            .saturating_mul(new)
            .saturating_add(distance % old * new / old);
        let distance = i64::try_from(distance).unwrap_or(i64::MAX);
        let forwards = (at >= *anchor) != turned;
        *anchor = at.saturating_sub(if forwards { distance } else { -distance });
    }

    /// Returns true if no axis moves more than half a step farther than `width` from where it may
    /// be. The way back is always allowed.
    pub fn allows(&self, from: StepVector, to: StepVector, width: StepVector) -> bool {
        let ends = from.into_iter().zip(to);
        let mut axes = ends.zip(self.anchor.into_iter().zip(width));
        axes.all(|((from, to), (anchor, width))| {
            let within = to.abs_diff(anchor) <= width.unsigned_abs().saturating_add(1 << 31);
            within || (from.min(anchor)..=from.max(anchor)).contains(&to)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: i64 = 1 << 32;

    #[test]
    fn moves_within_or_back_are_allowed() {
        let window = Window::around([5 * STEP, 0, 0]);
        let width = [10 * STEP; 3];
        let allows =
            |from: i64, to: i64| window.allows([from * STEP, 0, 0], [to * STEP, 0, 0], width);
        assert!(allows(5, 15) && allows(5, -5));
        assert!(!allows(5, 16) && !allows(5, -6));
        // From outside: only back, and not through to the far end of the other side.
        assert!(allows(30, 29) && allows(30, -5) && allows(30, 30));
        assert!(!allows(30, 31) && !allows(30, -6) && !allows(30, -20));
    }

    #[test]
    fn rescaling_keeps_the_distance_in_mm() {
        let mut window = Window::around([0; 3]);
        window.rescale(0, 800 * STEP, [80_000, 160_000], false);
        assert_eq!(window, Window::around([-800 * STEP, 0, 0]));
        window.rescale(0, 800 * STEP, [160_000, 160_000], true);
        assert_eq!(window, Window::around([2_400 * STEP, 0, 0]));
        // Far beyond any position the window saturates.
        window.rescale(0, i64::MAX, [1, u32::MAX], false);
    }
}
