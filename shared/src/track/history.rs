//! History of the stage: emitted positions of the last half second.

use super::StepVector;
use crate::time::Instant;

/// Number of control ticks in the history.
pub const TICKS: usize = 512;

/// Microseconds per control tick.
const TICK_US: u64 = 1000;

/// Fraction bits of a remembered position: 1/256 step.
const BITS: u32 = 8;

/// Position as remembered: the lowest 32 bits of 1/256 step.
pub(super) type Coarse = [i32; 3];

/// Unit of [`Coarse`], steps.
pub(super) const COARSE: f32 = 1.0 / 256.0;

/// Returns a position as remembered.
pub(super) fn coarse(position: StepVector) -> Coarse {
    position.map(|p| (p >> (32 - BITS)) as i32)
}

/// Emitted positions at the borders of the last [`TICKS`] control ticks.
///
/// Positions are kept in 1/256 step and interpolated linearly, with an error of at most 0.25 µm at
/// 2,000 mm/s². Only the lowest 32 bits of each are kept; the newest is known in full. Within the
/// history no axis moves 2²³ steps away from it, because the fastest words make 8 million steps/s.
///
/// ```
/// use trinocular_core::time::Instant;
/// use trinocular_core::track::history::History;
///
/// let mut history = History::default();
/// history.record(Instant::from_micros(1_000), [0; 3]);
/// history.record(Instant::from_micros(2_000), [1 << 32, 0, 0]);
/// let [x, _, _] = history.at(Instant::from_micros(1_500)).expect("it is remembered");
/// assert_eq!(x >> 24, 128); // half a step, in 1/256 step
/// assert!(history.at(Instant::from_micros(500)).is_err());
/// ```
#[derive(Clone, Debug)]
pub struct History {
    positions: [[i32; 3]; TICKS],
    /// Newest position, in full, 1/256 step.
    last: StepVector,
    /// Instant at which the pins reach the newest position.
    newest: Instant,
    /// Number of valid positions.
    count: usize,
    /// Index of the newest position.
    head: usize,
}

/// Reason for an unknown position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unknown {
    /// The instant is after the newest remembered position.
    Future,
    /// The instant is before the oldest remembered position.
    Past,
}

impl Default for History {
    fn default() -> Self {
        Self {
            positions: [[0; 3]; TICKS],
            last: [0; 3],
            newest: Instant::default(),
            count: 0,
            head: 0,
        }
    }
}

impl History {
    /// Records that the pins reach `position` (2⁻³² steps) at `instant`, which is one tick after
    /// the one before. A gap or a step back in time clears all older positions.
    pub fn record(&mut self, instant: Instant, position: StepVector) {
        let follows = self.count > 0 && self.newest.plus_micros(TICK_US) == instant;
        self.count = if follows {
            (self.count + 1).min(TICKS)
        } else {
            1
        };
        self.head = (self.head + 1) % TICKS;
        self.newest = instant;
        self.last = position.map(|p| p >> (32 - BITS));
        if let Some(slot) = self.positions.get_mut(self.head) {
            *slot = self.last.map(|p| p as i32);
        }
    }

    /// Clears the history.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Shifts all positions after a change of the origin.
    pub fn shift(&mut self, by: StepVector) {
        let by = by.map(|p| p >> (32 - BITS));
        for (last, d) in self.last.iter_mut().zip(by) {
            *last = last.wrapping_add(d);
        }
        for position in &mut self.positions {
            for (p, d) in position.iter_mut().zip(by) {
                *p = p.wrapping_add(d as i32);
            }
        }
    }

    /// Returns the position of the pins at `instant`, 2⁻³² steps, with a resolution of 1/256 step.
    ///
    /// # Errors
    /// [`Unknown`] if the instant is outside the remembered time.
    pub fn at(&self, instant: Instant) -> Result<StepVector, Unknown> {
        if instant > self.newest || self.count == 0 {
            return Err(Unknown::Future);
        }
        // 32 bits, which a Cortex-M4 divides in hardware.
        let age = u32::try_from(self.newest.since(instant)).map_err(|_| Unknown::Past)?;
        let (ticks, rest) = (age / TICK_US as u32, age % TICK_US as u32);
        let back = usize::try_from(ticks).map_err(|_| Unknown::Past)?;
        let later = self.entry(back).ok_or(Unknown::Past)?;
        let earlier = match rest {
            0 => later,
            _ => self.entry(back.saturating_add(1)).ok_or(Unknown::Past)?,
        };
        let [[lx, ly, lz], [ex, ey, ez]] = [later, earlier];
        // The share of the tick, Q0.32, rounded down: below 2^32.
        let share = i64::from(rest * (u32::MAX / TICK_US as u32));
        let between = |late: i32, early: i32, last: i64| {
            let late_in_full = last + i64::from(late.wrapping_sub(last as i32));
            // 31 bits by 32.
            let moved = i64::from(early.wrapping_sub(late)).wrapping_mul(share) >> BITS;
            (late_in_full << (32 - BITS)) + moved
        };
        let [x, y, z] = self.last;
        Ok([between(lx, ex, x), between(ly, ey, y), between(lz, ez, z)])
    }

    /// Returns the position of the pins at `instant`, later by less than a tick; `None` if it is
    /// outside the remembered time.
    pub(super) fn coarsely_at(&self, instant: Instant) -> Option<Coarse> {
        if instant > self.newest {
            return None;
        }
        let age = u32::try_from(self.newest.since(instant)).ok()?;
        self.entry(usize::try_from(age / TICK_US as u32).ok()?)
    }

    fn entry(&self, back: usize) -> Option<[i32; 3]> {
        if back >= self.count {
            return None;
        }
        self.positions
            .get((self.head + TICKS - back) % TICKS)
            .copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: i64 = 1 << 32;

    fn ms(ms: u64) -> Instant {
        Instant::from_micros(ms * 1000)
    }

    fn ramp(ticks: u64) -> History {
        let mut history = History::default();
        for t in 0..ticks {
            let p = t as i64 * 3 * STEP;
            history.record(ms(t), [p, -p, 0]);
        }
        history
    }

    #[test]
    fn position_is_interpolated() {
        let history = ramp(2000);
        let got = history.at(Instant::from_micros(1_800_250)).unwrap();
        let expected = 1800 * 3 * STEP + 3 * STEP / 4;
        assert!(
            (got[0] - expected).abs() <= STEP / 256
                && (got[1] + expected).abs() <= STEP / 256
                && got[2] == 0
        );
        assert_eq!(history.at(ms(1999)).unwrap()[0], 1999 * 3 * STEP);
    }

    #[test]
    fn instants_outside_are_unknown() {
        let history = ramp(2000);
        assert_eq!(
            history.at(Instant::from_micros(1_999_001)),
            Err(Unknown::Future)
        );
        assert!(history.at(ms(2000 - TICKS as u64)).is_ok());
        assert_eq!(
            history.at(Instant::from_micros((2000 - TICKS as u64) * 1000 - 1)),
            Err(Unknown::Past)
        );
        assert_eq!(History::default().at(ms(0)), Err(Unknown::Future));
        assert_eq!(ramp(3).at(ms(0)), Ok([0; 3]));
    }

    #[test]
    fn gap_forgets_earlier_positions() {
        let mut history = ramp(10);
        history.record(ms(20), [STEP; 3]);
        assert_eq!(history.at(ms(20)), Ok([STEP; 3]));
        assert_eq!(history.at(ms(9)), Err(Unknown::Past));
    }
}
