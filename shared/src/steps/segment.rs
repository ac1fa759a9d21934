use core::fmt;

use super::AXES;
use crate::fixed::product;

/// Motion of one axis in a [`Segment`]: in slot `k` (from 0) it moves `first + k * change` fine
/// units (2⁻³² step), forwards or backwards.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisMotion {
    /// Increment of the first slot, 2⁻³² step.
    pub first: u32,
    /// Change of the increment from slot to slot, 2⁻³² step per slot.
    pub change: i32,
    /// True for motion against the counting direction.
    pub backward: bool,
}

impl AxisMotion {
    /// No motion; the DIR pin is left alone.
    pub const REST: Self = Self {
        first: 0,
        change: 0,
        backward: false,
    };

    /// Returns true if no slot moves this axis.
    pub const fn is_rest(&self) -> bool {
        self.first == 0 && self.change == 0
    }

    /// Returns the increment of slot `k`, without a limit to its range. Below 2⁴⁸ in size.
    const fn increment(&self, k: u16) -> i64 {
        self.first as i64 + product(self.change as i64, k as i64)
    }

    /// Returns the distance of the first `slots` slots without sign, fine units: `slots * first +
    /// change * slots (slots - 1) / 2`. Below 2⁶³ in size for all arguments.
    pub(super) const fn distance(&self, slots: u16) -> i64 {
        let n = slots as i64;
        let pairs = product(n, n - 1) >> 1;
        product(n, self.first as i64) + product(pairs, self.change as i64)
    }
}

/// Run of slots with constant directions and linearly changing velocities.
///
/// *Invariant:* between 1 and 65,535 slots, and every increment of every slot lies in 0..2³², so
/// that an axis makes at most one step per slot.
///
/// ```
/// use trinocular_core::steps::{AxisMotion, Segment};
///
/// // A quarter of a step per slot on the first axis: 100 slots make 25 steps.
/// let quarter = AxisMotion { first: 1 << 30, change: 0, backward: false };
/// let segment = Segment::new(100, [quarter, AxisMotion::REST, AxisMotion::REST])?;
/// assert_eq!(segment.displacement()[0], 25 << 32);
/// # Ok::<(), trinocular_core::steps::SegmentFault>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    slots: u16,
    axes: [AxisMotion; AXES],
}

impl Segment {
    /// Creates a segment of `slots` slots.
    ///
    /// # Errors
    /// [`SegmentFault`] if there is no slot, or an increment leaves 0..2³².
    pub fn new(slots: u16, axes: [AxisMotion; AXES]) -> Result<Self, SegmentFault> {
        let Some(last) = slots.checked_sub(1) else {
            return Err(SegmentFault::NoSlots);
        };
        // A linear function stays within bounds when its two ends do.
        let fits = |motion: &AxisMotion| u32::try_from(motion.increment(last)).is_ok();
        match axes.iter().position(|motion| !fits(motion)) {
            Some(axis) => Err(SegmentFault::Speed { axis }),
            None => Ok(Self { slots, axes }),
        }
    }

    /// Creates a pause: no axis moves. Zero `slots` become one.
    pub const fn pause(slots: u16) -> Self {
        Self {
            slots: if slots == 0 { 1 } else { slots },
            axes: [AxisMotion::REST; AXES],
        }
    }

    /// Returns the number of slots (of two words each), never zero.
    pub const fn slots(&self) -> u16 {
        self.slots
    }

    /// Returns the motion of each axis.
    pub const fn axes(&self) -> &[AxisMotion; AXES] {
        &self.axes
    }

    /// Returns the distance of each axis in the whole segment, 2⁻³² step, negative backwards.
    /// Exact, below 2⁴⁸ in size.
    pub fn displacement(&self) -> [i64; AXES] {
        // By components, because `map` copies the axes.
        let [x, y, z] = &self.axes;
        let signed = |motion: &AxisMotion| {
            let distance = motion.distance(self.slots);
            if motion.backward {
                distance.wrapping_neg()
            } else {
                distance
            }
        };
        [signed(x), signed(y), signed(z)]
    }
}

/// Reason to refuse a [`Segment`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SegmentFault {
    /// The segment has no slot.
    NoSlots,
    /// An increment would leave 0..2³²: the axis would reverse within the segment, or need two
    /// steps in a slot.
    Speed {
        /// The axis, from 0.
        axis: usize,
    },
}

impl fmt::Display for SegmentFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSlots => write!(f, "segment without slots"),
            Self::Speed { axis } => write!(
                f,
                "axis {axis} turns within the segment or exceeds one step per slot"
            ),
        }
    }
}

impl core::error::Error for SegmentFault {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn both_ends_are_checked() {
        let with = |first, change| {
            let motion = AxisMotion {
                first,
                change,
                backward: false,
            };
            Segment::new(10, [AxisMotion::REST, motion, AxisMotion::REST])
        };
        assert!(with(90, -10).is_ok());
        assert_eq!(with(89, -10), Err(SegmentFault::Speed { axis: 1 }));
        assert!(with(u32::MAX - 90, 10).is_ok());
        assert_eq!(
            with(u32::MAX - 89, 10),
            Err(SegmentFault::Speed { axis: 1 })
        );
        assert_eq!(
            Segment::new(0, [AxisMotion::REST; 3]),
            Err(SegmentFault::NoSlots)
        );
    }

    proptest! {
        #[test]
        fn displacement_sums_increments(
            slots: u16, first: u32, change: i32, backward: bool,
        ) {
            let motion = AxisMotion { first, change, backward };
            // Total for all inputs, even those of no valid segment.
            let all = motion.distance(slots);
            let increment = |k: i128| i128::from(first) + k * i128::from(change);
            let sum: i128 = (0..i128::from(slots)).map(increment).sum();
            prop_assert_eq!(i128::from(all), sum);
            if let Ok(segment) = Segment::new(slots, [motion; 3]) {
                let sign = if backward { -1 } else { 1 };
                prop_assert_eq!(segment.displacement(), [sign * all; 3]);
                prop_assert!((0..1 << 48).contains(&all));
            }
        }
    }
}
