use core::fmt;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use super::{AXES, AxisMotion, PortFault, PortMap, Position, Segment};

/// Reason for which [`Generator::load`] refused a segment. The generator is then unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadFault {
    /// Slots of the last segment are left.
    Busy,
    /// The axis must reverse, but DIR cannot get its set-up time: the segment has only one slot, or
    /// its first two increments together reach a whole step.
    Turn {
        /// The axis, from 0.
        axis: usize,
    },
}

impl fmt::Display for LoadFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy => write!(f, "the last segment is not finished"),
            Self::Turn { axis } => write!(f, "axis {axis} turns too fast for its DIR set-up"),
        }
    }
}

impl core::error::Error for LoadFault {}

/// State of one axis between two slots.
#[derive(Clone, Copy, Debug)]
struct AxisPins {
    /// Steps emitted, backward ones subtracted.
    count: i64,
    /// Fraction of a step, 2⁻³²: of the position when moving forwards, of its complement backwards.
    phase: u32,
    /// Increment of the next slot.
    increment: u32,
    /// Change of the increment after each slot, two's complement.
    change: u32,
    /// Increment held back by the slot that wrote DIR.
    held: u32,
    backward: bool,
    /// True if the DIR pin is known to show `backward`.
    dir_written: bool,
    step_bit: u32,
    dir_forward: u32,
    dir_backward: u32,
}

impl AxisPins {
    fn turns(&self, motion: &AxisMotion) -> bool {
        !motion.is_rest() && (!self.dir_written || self.backward != motion.backward)
    }

    fn is_rest(&self) -> bool {
        self.increment == 0 && self.change == 0
    }

    /// Advances by `way` fine units in the present direction.
    fn advance(&mut self, distance: u64) {
        let sum = u64::from(self.phase).saturating_add(distance);
        // Truncation splits the sum into phase and carries; the carries number fewer than 2³².
        self.phase = sum as u32;
        let steps = i64::from((sum >> 32) as u32);
        self.count = self
            .count
            .saturating_add(if self.backward { -steps } else { steps });
    }

    /// Returns the number of steps in the next slots.
    fn steps_in(&self, slots: u16) -> u32 {
        if self.is_rest() {
            return 0;
        }
        // The distance of a valid segment is not negative.
        let distance = self.motion_left().distance(slots).max(0).cast_unsigned();
        (u64::from(self.phase).saturating_add(distance) >> 32) as u32
    }

    /// Writes STEP into the slots of the next `steps` steps, searching one step at a time: phase
    /// `p` and increments of at most `i` make no carry in `(2^32 - 1 - p) / i` slots, which the
    /// search skips at once.
    fn raise(&self, places: &[[AtomicU32; 2]], steps: u32) {
        let change = self.change;
        let nth = |increment: u32, n: u32| increment.wrapping_add(change.wrapping_mul(n));
        let (mut phase, mut increment) = (self.phase, self.increment);
        let mut rest = places;
        for _ in 0..steps {
            while let Some((place, others)) = rest.split_first() {
                let last = nth(increment, others.len() as u32);
                let most = increment.max(last);
                let safe = (!phase).checked_div(most).unwrap_or(u32::MAX);
                if safe == 0 {
                    let (sum, carry) = phase.overflowing_add(increment);
                    (phase, increment) = (sum, nth(increment, 1));
                    rest = others;
                    if carry {
                        let [raise, _] = place;
                        let others = raise.load(Relaxed) & 0xffff;
                        raise.store(others | self.step_bit, Relaxed);
                        break;
                    }
                    continue;
                }
                let (passed, others) = rest.split_at((safe as usize).min(rest.len()));
                // The distance of at most 2^16 slots is below 2^32.
                let n = passed.len() as u32;
                let pairs = n.wrapping_mul(n.wrapping_sub(1)) / 2;
                phase = phase
                    .wrapping_add(increment.wrapping_mul(n))
                    .wrapping_add(change.wrapping_mul(pairs));
                increment = nth(increment, n);
                rest = others;
            }
        }
    }

    fn motion_left(&self) -> AxisMotion {
        AxisMotion {
            first: self.increment,
            change: self.change.cast_signed(),
            backward: self.backward,
        }
    }
}

/// Converts segments to port words, by the floor law of the [module](super).
///
/// The generator owns the only count of steps that were emitted. It knows nothing of time: the
/// hardware sets the duration of a word.
///
/// *Cost* on a Cortex-M4 with all three axes accelerating and stepping in every slot: 10.3
/// instructions per word at opt-level s, loading the segments included (`tests/qemu/bench`).
///
/// ```
/// use trinocular_core::steps::{AxisMotion, Generator, PortMap, Segment};
///
/// let map = PortMap { step: [0, 1, 2], dir: [3, 4, 5], invert: [false; 3] };
/// let mut generator = Generator::new(map)?;
/// // X moves a quarter of a step per slot, forwards, for 8 slots.
/// let quarter = AxisMotion { first: 1 << 30, change: 0, backward: false };
/// let segment = Segment::new(8, [quarter, AxisMotion::REST, AxisMotion::REST])?;
/// generator.load(&segment)?;
///
/// let mut words = [0; 16];
/// assert_eq!(generator.fill(&mut words), 16);
/// let rises = words.iter().filter(|word| *word & 1 != 0).count();
/// assert_eq!((rises, generator.emitted()), (2, [2, 0, 0]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Generator {
    axes: [AxisPins; AXES],
    /// Slots left of the loaded segment.
    left: u16,
    /// Slots left that need the careful path: two when an axis reverses.
    careful: u8,
    /// The raise word for each combination of stepping axes; axis `i` has bit `i` of the index.
    raise: [u32; 1 << AXES],
}

impl Generator {
    /// Creates a generator at rest in the centre of step 0. The DIR levels are unknown, so the
    /// first motion of each axis writes them.
    ///
    /// # Errors
    /// [`PortFault`] if the port lacks a pin or two signals share one.
    pub fn new(map: PortMap) -> Result<Self, PortFault> {
        let mut seen = 0u32;
        for pin in map.step.into_iter().chain(map.dir) {
            if pin > 15 {
                return Err(PortFault::NoSuchPin(pin));
            }
            if seen & (1 << pin) != 0 {
                return Err(PortFault::PinTwice(pin));
            }
            seen |= 1 << pin;
        }
        let axis = |((step, dir), invert): ((u8, u8), bool)| {
            let (high, low) = (1u32 << dir, 1u32 << (dir + 16));
            AxisPins {
                count: 0,
                phase: Position::centre(0).phase(),
                increment: 0,
                change: 0,
                held: 0,
                backward: false,
                dir_written: false,
                step_bit: 1 << step,
                dir_forward: if invert { low } else { high },
                dir_backward: if invert { high } else { low },
            }
        };
        let [x, y, z] = [0, 1, 2].map(|i| axis(((map.step[i], map.dir[i]), map.invert[i])));
        let raise = core::array::from_fn(|code| {
            let bit =
                |i: usize, axis: &AxisPins| if code >> i & 1 == 1 { axis.step_bit } else { 0 };
            bit(0, &x) | bit(1, &y) | bit(2, &z)
        });
        Ok(Self {
            axes: [x, y, z],
            left: 0,
            careful: 0,
            raise,
        })
    }

    /// Sets the axes whose DIR is low forwards. An axis that changes writes DIR again before it
    /// next moves.
    pub fn set_invert(&mut self, invert: [bool; AXES]) {
        for (axis, invert) in self.axes.iter_mut().zip(invert) {
            let inverted = axis.dir_forward > axis.dir_backward;
            if inverted != invert {
                core::mem::swap(&mut axis.dir_forward, &mut axis.dir_backward);
                axis.dir_written = false;
            }
        }
    }

    /// Loads the next segment.
    ///
    /// # Errors
    /// [`LoadFault::Busy`] while slots of the last segment are left, [`LoadFault::Turn`] if an axis
    /// cannot reverse in time.
    pub fn load(&mut self, segment: &Segment) -> Result<(), LoadFault> {
        if self.left != 0 {
            return Err(LoadFault::Busy);
        }
        let mut turning = [false; AXES];
        for (axis, (state, motion)) in self.axes.iter().zip(segment.axes()).enumerate() {
            let turns = state.turns(motion);
            if turns && (segment.slots() < 2 || motion.distance(2) > i64::from(u32::MAX)) {
                return Err(LoadFault::Turn { axis });
            }
            if let Some(flag) = turning.get_mut(axis) {
                *flag = turns;
            }
        }
        for ((state, motion), turns) in self.axes.iter_mut().zip(segment.axes()).zip(turning) {
            state.increment = motion.first;
            state.change = motion.change.cast_unsigned();
            if turns {
                if state.backward != motion.backward {
                    state.phase = !state.phase;
                }
                state.backward = motion.backward;
                state.dir_written = false;
            }
        }
        self.left = segment.slots();
        self.careful = if turning.contains(&true) { 2 } else { 0 };
        Ok(())
    }

    /// Writes the next words of the loaded segment, two per slot, and returns their number: as many
    /// as fit into `words` and are left in the segment, zero without a segment. Does not touch the
    /// words behind them.
    pub fn fill(&mut self, words: &mut [u32]) -> usize {
        let (pairs, _) = words.as_chunks_mut::<2>();
        let room = pairs.len().min(usize::from(self.left));
        let (pairs, _) = pairs.split_at_mut(room);
        let (first, rest) = pairs.split_at_mut(usize::from(self.careful).min(room));
        self.emit(first.iter_mut(), rest.iter_mut());
        2 * room
    }

    /// Does the work of [`Generator::fill`] for a ring that hardware plays from. `words` must hold
    /// idle words, which lower STEP pins and do nothing else.
    ///
    /// Where few slots have a step, it writes only the words that raise a pin or change DIR. The
    /// idle word after a raise lowers the pin as the word of [`Generator::fill`] does, so the edges
    /// are the same.
    pub fn play(&mut self, words: &[AtomicU32]) {
        let (pairs, _) = words.as_chunks::<2>();
        let room = pairs.len().min(usize::from(self.left));
        let (pairs, _) = pairs.split_at(room);
        let (first, rest) = pairs.split_at(usize::from(self.careful).min(room));
        for place in first {
            place.put(self.careful_slot());
        }
        let slots = u16::try_from(rest.len()).unwrap_or(u16::MAX);
        let steps = self.axes.each_ref().map(|axis| axis.steps_in(slots));
        // Searching one step costs as much as about eight slots of the loop over all slots.
        if steps.iter().sum::<u32>() > u32::from(slots) / 8 {
            self.emit(core::iter::empty(), rest.iter());
        } else {
            for (axis, steps) in self.axes.iter().zip(steps) {
                axis.raise(rest, steps);
            }
            self.advance(slots);
        }
    }

    /// Forgets the levels of the DIR pins, because words that changed them may not have reached
    /// them. The next motion of each axis writes DIR.
    pub fn forget_directions(&mut self) {
        for axis in &mut self.axes {
            axis.dir_written = false;
        }
    }

    /// Counts the steps of the loaded segment without writing their words, for motion that must not
    /// reach the pins.
    pub fn skip(&mut self) {
        while self.careful > 0 && self.left > 0 {
            self.careful_slot();
        }
        self.advance(self.left);
    }

    /// Drops the rest of the segment at once. The position stays valid.
    pub fn halt(&mut self) {
        self.left = 0;
        self.careful = 0;
        for axis in &mut self.axes {
            axis.increment = 0;
            axis.change = 0;
            axis.held = 0;
        }
    }

    /// Returns true if the loaded segment is finished, so that [`Generator::load`] takes the next
    /// one.
    pub const fn is_idle(&self) -> bool {
        self.left == 0
    }

    /// Returns the number of slots left of the loaded segment.
    pub const fn slots_left(&self) -> u16 {
        self.left
    }

    /// Returns the steps emitted on each axis since the start, backward ones subtracted: exactly
    /// the rising edges in the words written.
    pub fn emitted(&self) -> [i64; AXES] {
        self.axes.map(|axis| axis.count)
    }

    /// Returns the position of each axis with its fraction of a step, from which a planner must
    /// continue after [`Generator::halt`]. Its floor is [`Generator::emitted`] as long as that is
    /// within ±2³¹.
    pub fn positions(&self) -> [Position; AXES] {
        self.axes.map(|axis| {
            let phase = if axis.backward {
                !axis.phase
            } else {
                axis.phase
            };
            let count = axis.count.clamp(i64::from(i32::MIN), i64::from(i32::MAX));
            Position::from_fine((count << 32) | i64::from(phase))
        })
    }

    /// Makes one slot with all cases considered: DIR where it must change, and the increments that
    /// this holds back.
    fn careful_slot(&mut self) -> [u32; 2] {
        let mut steps = 0;
        let mut dirs = 0;
        for axis in &mut self.axes {
            let increment = axis.increment;
            axis.increment = increment.wrapping_add(axis.change);
            let moves = !(increment == 0 && axis.change == 0);
            if moves && !axis.dir_written {
                dirs |= if axis.backward {
                    axis.dir_backward
                } else {
                    axis.dir_forward
                };
                axis.dir_written = true;
                axis.held = increment;
            } else {
                // `load` made sure that both together stay below one step.
                let distance = u64::from(increment) + u64::from(core::mem::take(&mut axis.held));
                let before = axis.count;
                axis.advance(distance);
                if axis.count != before {
                    steps |= axis.step_bit;
                }
            }
        }
        self.left = self.left.saturating_sub(1);
        self.careful = self.careful.saturating_sub(1);
        [steps | dirs, steps << 16]
    }

    /// Writes the words of careful slots, then those of the slots after them, until the places are
    /// full.
    fn emit<S: Slot>(
        &mut self,
        careful: impl Iterator<Item = S>,
        others: impl ExactSizeIterator<Item = S>,
    ) {
        for place in careful {
            place.put(self.careful_slot());
        }
        // At most `left` slots.
        let slots = u16::try_from(others.len()).unwrap_or(u16::MAX);
        let [x, y, z] = &self.axes;
        if x.is_rest() && y.is_rest() && z.is_rest() {
            others.for_each(|place| place.put([0, 0]));
        } else {
            let state = [x, y, z].map(|axis| [axis.phase, axis.increment, axis.change]);
            step_loop(others, &self.raise, state);
        }
        self.advance(slots);
    }

    /// Updates the counts after `slots` ordinary slots, by the closed sum.
    fn advance(&mut self, slots: u16) {
        for axis in &mut self.axes {
            if axis.is_rest() {
                continue;
            }
            let distance = axis.motion_left().distance(slots);
            // The distance of a valid segment is not negative.
            axis.advance(distance.max(0).cast_unsigned());
            axis.increment = axis
                .increment
                .wrapping_add(axis.change.wrapping_mul(u32::from(slots)));
        }
        self.left = self.left.saturating_sub(slots);
    }
}

/// Destination of the two words of a slot.
trait Slot {
    fn put(self, words: [u32; 2]);
}

impl Slot for &mut [u32; 2] {
    #[inline(always)]
    fn put(self, words: [u32; 2]) {
        *self = words;
    }
}

/// The second word is already an idle word, which lowers what the first one raised.
impl Slot for &[AtomicU32; 2] {
    #[inline(always)]
    fn put(self, [first, _]: [u32; 2]) {
        let [raise, _] = self;
        raise.store(first, Relaxed);
    }
}

/// Runs the inner loop: for each axis `[phase, increment, change]`, add and collect the carry.
///
/// Never inlined, so that it has the registers to itself and its instructions can be counted.
#[inline(never)]
fn step_loop<S: Slot>(
    places: impl Iterator<Item = S>,
    raise: &[u32; 1 << AXES],
    axes: [[u32; 3]; AXES],
) {
    let [
        [mut px, mut ix, cx],
        [mut py, mut iy, cy],
        [mut pz, mut iz, cz],
    ] = axes;
    for place in places {
        // Axis 0 ends in bit 0.
        let mut carries;
        (carries, pz) = add_and_collect(0, pz, iz);
        (carries, py) = add_and_collect(carries, py, iy);
        (carries, px) = add_and_collect(carries, px, ix);
        ix = ix.wrapping_add(cx);
        iy = iy.wrapping_add(cy);
        iz = iz.wrapping_add(cz);
        let word = raise[(carries & 7) as usize];
        place.put([word, word << 16]);
    }
}

/// Adds `phase + increment`, and shifts the carry into `carries` from below.
///
/// Written as one 64-bit addition with the collected carries as both upper halves, because
/// compilers turn it into an add and an add-with-carry.
#[inline(always)]
fn add_and_collect(carries: u32, phase: u32, increment: u32) -> (u32, u32) {
    let join = |low: u32| u64::from(carries) << 32 | u64::from(low);
    let sum = join(phase).wrapping_add(join(increment));
    ((sum >> 32) as u32, sum as u32)
}

#[cfg(test)]
mod tests;
