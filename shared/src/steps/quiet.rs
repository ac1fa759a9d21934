//! Times without steps.

use super::{AXES, Position, Segment};

impl Segment {
    /// Returns true if no axis makes a step in `slots` slots from slot `from` on, which must lie in
    /// the segment. `at` is the position of each motor at the segment's start. Exact within the
    /// segment; beyond its end each axis is taken to keep its last velocity.
    ///
    /// ```
    /// use trinocular_core::steps::{AxisMotion, Position, Segment};
    ///
    /// // 1/64 step per slot from the middle of a step: the next step is in slot 31.
    /// let slow = AxisMotion { first: 1 << 26, change: 0, backward: false };
    /// let segment = Segment::new(40, [slow, AxisMotion::REST, AxisMotion::REST])?;
    /// let at = [Position::centre(0); 3];
    /// assert!(segment.is_quiet(&at, 0, 31));
    /// assert!(!segment.is_quiet(&at, 0, 32));
    /// assert!(!segment.is_quiet(&at, 1, 31));
    /// assert!(segment.is_quiet(&at, 32, 63));
    /// assert!(!segment.is_quiet(&at, 32, 64));
    /// # Ok::<(), trinocular_core::steps::SegmentFault>(())
    /// ```
    pub fn is_quiet(&self, at: &[Position; AXES], from: u16, slots: u32) -> bool {
        let all = self.slots();
        // A reversal gives the first slot's step in the second slot.
        let (from, slots) = match from {
            1 => (0, slots.saturating_add(1)),
            _ => (from.min(all), slots),
        };
        let room = all.saturating_sub(from);
        let within = u16::try_from(slots).unwrap_or(room).min(room);
        let beyond = u64::from(slots).saturating_sub(u64::from(within));
        (self.axes().iter().zip(at)).all(|(motion, at)| {
            if motion.is_rest() {
                return true;
            }
            let phase = match motion.backward {
                true => !at.phase(),
                false => at.phase(),
            };
            // A valid segment moves an axis forwards by less than 2^16 steps of 2^32.
            let after = |slots: u16| {
                let distance = motion.distance(slots).max(0).cast_unsigned();
                distance.saturating_add(u64::from(phase))
            };
            let end = after(from.saturating_add(within));
            let last = match all.checked_sub(1) {
                Some(before) => after(all).saturating_sub(after(before)),
                None => 0,
            };
            let far = end.saturating_add(last.saturating_mul(beyond));
            // Beyond the end, `end` is the place at the end.
            after(from) >> 32 == far >> 32
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::{AxisMotion, Generator, PortMap};
    use super::*;
    use proptest::prelude::*;

    const MAP: PortMap = PortMap {
        step: [0, 1, 2],
        dir: [3, 4, 5],
        invert: [false; 3],
    };

    proptest! {
        /// Within the segment, a quiet time is one in which the generator raises no STEP.
        #[test]
        fn generator_makes_no_step_in_quiet_time(
            first in 0..1u32 << 28,
            change in -2_000_000..2_000_000i32,
            start in -4_000_000_000i64..4_000_000_000,
            backward: bool,
            from in 0..125u16,
            slots in 1..125u32,
        ) {
            let motion = AxisMotion { first, change, backward };
            let axes = [motion, AxisMotion::REST, AxisMotion::REST];
            let Ok(segment) = Segment::new(125, axes) else { return Ok(()) };
            let at = Position::centre(0).saturating_add(start);
            let mut generator = Generator::new(MAP).unwrap();
            // To the place, and then the segment.
            let way = AxisMotion {
                first: u32::try_from(start.unsigned_abs() / 16).unwrap(),
                change: 0,
                backward: start < 0,
            };
            let at = match start {
                0 => at,
                _ => {
                    let there = Segment::new(16, [way, AxisMotion::REST, AxisMotion::REST]).unwrap();
                    if generator.load(&there).is_err() {
                        return Ok(());
                    }
                    generator.fill(&mut [0; 32]);
                    Position::centre(0).saturating_add(there.displacement()[0])
                }
            };
            if generator.load(&segment).is_err() {
                return Ok(());
            }
            let mut words = [0; 250];
            generator.fill(&mut words);
            let last = (u32::from(from) + slots).min(125) as usize;
            let steps = (usize::from(from)..last).filter(|slot| words[2 * slot] & 1 != 0).count();
            let at = [at, Position::centre(0), Position::centre(0)];
            let within = (last - usize::from(from)) as u32;
            let is_quiet = segment.is_quiet(&at, from, within);
            if is_quiet {
                prop_assert_eq!(steps, 0);
            } else if from >= 2 {
                prop_assert!(steps > 0);
            }
        }
    }
}
