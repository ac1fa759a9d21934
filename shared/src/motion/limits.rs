use core::fmt;

use serde::{Deserialize, Serialize};

use crate::fixed::{ratio, wide};
use crate::steps::{AXES, Position, WordRate};

/// Resolution and limits of one axis as the host states them: physical units, integers only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AxisConfig {
    /// Steps (micro-steps) per metre of travel; 1,000 times the steps per mm.
    pub steps_per_m: u32,
    /// Highest speed, µm/s.
    pub max_speed_um_s: u32,
    /// Highest acceleration, µm/s².
    pub max_acceleration_um_s2: u32,
    /// Highest change of acceleration, µm/s³.
    pub max_jerk_um_s3: u32,
    /// Lowest and highest allowed position, µm from zero.
    pub travel_um: [i32; 2],
    /// True if the DIR pin is low forwards.
    pub invert: bool,
}

/// A field of [`AxisConfig`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Field {
    /// `steps_per_m`
    StepsPerM,
    /// `max_speed_um_s`
    MaxSpeed,
    /// `max_acceleration_um_s2`
    MaxAcceleration,
    /// `max_jerk_um_s3`
    MaxJerk,
    /// `travel_um[0]`
    TravelLow,
    /// `travel_um[1]`
    TravelHigh,
}

impl Field {
    /// Returns the name of the field in the configuration.
    pub const fn name(self) -> &'static str {
        match self {
            Self::StepsPerM => "steps_per_m",
            Self::MaxSpeed => "max_speed_um_s",
            Self::MaxAcceleration => "max_acceleration_um_s2",
            Self::MaxJerk => "max_jerk_um_s3",
            Self::TravelLow => "travel_um[0]",
            Self::TravelHigh => "travel_um[1]",
        }
    }
}

/// Nearest value that a refused number may have, in the unit of its field. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Bound {
    /// Smallest accepted value.
    AtLeast(i64),
    /// Largest accepted value.
    AtMost(i64),
}

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AtLeast(least) => write!(f, "must be at least {least}"),
            Self::AtMost(most) => write!(f, "must be at most {most}"),
        }
    }
}

/// Value of an [`AxisConfig`] that the planner cannot use, with the nearest one that it can.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LimitFault {
    /// Field that is refused.
    pub field: Field,
    /// Nearest value that is accepted.
    pub bound: Bound,
}

impl LimitFault {
    const fn at_least(field: Field, least: i64) -> Self {
        Self {
            field,
            bound: Bound::AtLeast(least),
        }
    }

    const fn at_most(field: Field, most: i64) -> Self {
        Self {
            field,
            bound: Bound::AtMost(most),
        }
    }
}

impl fmt::Display for LimitFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.field.name(), self.bound)
    }
}

impl core::error::Error for LimitFault {}

/// A [`LimitFault`] with its axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfigFault {
    /// Axis, from 0.
    pub axis: usize,
    /// Refused value.
    pub fault: LimitFault,
}

impl fmt::Display for ConfigFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "axis {}: {}", self.axis, self.fault)
    }
}

impl core::error::Error for ConfigFault {}

/// Limits of one axis, in the planner's grid (see the [module](super)).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AxisLimits {
    /// Highest speed, multiples of `2N` fine units per slot; from 1, and `2N` times it fits a
    /// `u32`.
    pub(super) speed: u32,
    /// Highest change of speed per tick, same unit; from 1 to `speed`.
    pub(super) acceleration: u32,
    /// Highest change of acceleration per tick, same unit; from 1 to `speed`.
    pub(super) jerk: u32,
    /// Allowed step numbers, both ends included, within ±2²⁹.
    range: [i32; 2],
    /// Backlash between motor and load, whole steps, up to 2²⁹.
    backlash: u32,
}

/// Farthest position of soft limits, steps: leaves room to stop within the range of [`Position`]
/// from anywhere.
const FARTHEST: i64 = 1 << 29;

impl AxisLimits {
    /// Converts `config` to the largest multiples of the grid's quanta that exceed nothing in it.
    ///
    /// # Errors
    /// [`LimitFault`] with the first value that the planner cannot use.
    pub fn new(config: &AxisConfig, rate: WordRate) -> Result<Self, LimitFault> {
        if config.steps_per_m == 0 {
            return Err(LimitFault::at_least(Field::StepsPerM, 1));
        }
        // Convert µm per second to fine units per slot, then to the grid: speed quanta, these per
        // tick, and per tick again. Dividing by one factor after the other rounds down just as
        // dividing by the product does.
        let um = |per_s: u32| u64::from(config.steps_per_m) * u64::from(per_s);
        let um_slots = 1_000_000 * u64::from(rate.slots_per_s());
        let quantum = 2 * u64::from(rate.slots_per_tick());
        let fine_per_slot = ratio(um(config.max_speed_um_s), um_slots);
        if fine_per_slot > 1 << 32 {
            let most = um_slots / u64::from(config.steps_per_m);
            return Err(LimitFault::at_most(Field::MaxSpeed, most.cast_signed()));
        }
        // Exactly one step per slot is one fine unit more than an increment can hold.
        let speed = (fine_per_slot.min(u64::from(u32::MAX)) / quantum) as u32;
        // Smallest number that makes one quantum; `ticks` is the power of ticks per second in the
        // unit.
        let too_small = |field, ticks: u64| {
            let product = wide((um_slots * quantum).cast_signed(), ticks.cast_signed());
            // One quantum is 2^32 of these; below 2^46.
            let least = ((product + i128::from(u32::MAX)) >> 32) as u64;
            let scale = u64::from(config.steps_per_m);
            match least.div_ceil(scale) {
                value if value <= u64::from(u32::MAX) => {
                    LimitFault::at_least(field, value.cast_signed())
                }
                // An axis this coarse has no valid value of this field.
                _ => LimitFault::at_least(
                    Field::StepsPerM,
                    least.div_ceil(u64::from(u32::MAX)).cast_signed(),
                ),
            }
        };
        if speed == 0 {
            return Err(too_small(Field::MaxSpeed, 1));
        }
        // More than the whole speed in one tick has no effect.
        let quantise = |per_s: u32, ticks: u64, field| {
            let value = ratio(um(per_s), um_slots * quantum) / ticks;
            match value.min(u64::from(speed)) as u32 {
                0 => Err(too_small(field, ticks)),
                value => Ok(value),
            }
        };
        const TICKS: u64 = WordRate::TICKS_PER_S as u64;
        let acceleration = quantise(config.max_acceleration_um_s2, TICKS, Field::MaxAcceleration)?;
        let jerk = quantise(config.max_jerk_um_s3, TICKS * TICKS, Field::MaxJerk)?;
        Ok(Self {
            speed,
            acceleration,
            jerk,
            range: travel_steps(config)?,
            backlash: 0,
        })
    }

    /// Returns the steps of the motor on a reversal before the load moves.
    pub const fn backlash(&self) -> u32 {
        self.backlash
    }

    /// Returns the lowest and highest step number at which the axis may stand.
    pub const fn range(&self) -> [i32; 2] {
        self.range
    }

    /// Returns the centres of the first and the last allowed step.
    pub fn ends(&self) -> [Position; 2] {
        self.range.map(Position::centre)
    }

    /// Returns the motor's positions at the two ends of the load's travel: pushed backwards, the
    /// motor is `backlash` steps ahead.
    pub(super) fn motor_ends(&self) -> [Position; 2] {
        let [low, high] = self.ends();
        [low.saturating_add(-(i64::from(self.backlash) << 32)), high]
    }

    /// Returns the allowed position nearest to `target`.
    pub fn clamp(&self, target: Position) -> Position {
        let [low, high] = self.ends();
        target.clamp(low, high)
    }
}

/// Converts the travel to steps, rounded inwards.
fn travel_steps(config: &AxisConfig) -> Result<[i32; 2], LimitFault> {
    let [low_um, high_um] = config.travel_um.map(i64::from);
    let scale = i64::from(config.steps_per_m);
    // Below 2^63 in size.
    let floor = |um: i64| (um * scale).div_euclid(1_000_000);
    let (low, high) = (-floor(-low_um), floor(high_um));
    let farthest_um = FARTHEST * 1_000_000 / scale;
    // Last step at or below which a high end can lie.
    let last = FARTHEST.min(floor(i32::MAX.into()));
    if low > last {
        let most = (last * 1_000_000).div_euclid(scale);
        return Err(LimitFault::at_most(Field::TravelLow, most));
    }
    if low < -FARTHEST {
        return Err(LimitFault::at_least(Field::TravelLow, -farthest_um));
    }
    if high > FARTHEST {
        return Err(LimitFault::at_most(Field::TravelHigh, farthest_um));
    }
    if low_um >= high_um || low > high {
        // At least one whole step lies within.
        let first_um = -(-low * 1_000_000).div_euclid(scale);
        let least = first_um.max(low_um + 1);
        return Err(LimitFault::at_least(Field::TravelHigh, least));
    }
    Ok([low as i32, high as i32])
}

/// Limits of all axes, and the word rate that belongs to them.
///
/// ```
/// use trinocular_core::motion::{AxisConfig, Limits};
/// use trinocular_core::steps::WordRate;
///
/// let axis = AxisConfig {
///     steps_per_m: 80_000,
///     max_speed_um_s: 100_000,
///     max_acceleration_um_s2: 1_000_000,
///     max_jerk_um_s3: 50_000_000,
///     travel_um: [-150_000, 150_000],
///     invert: false,
/// };
/// let limits = Limits::new(&[axis; 3], WordRate::MHZ_1)?;
/// assert_eq!(limits.axes()[0].range(), [-12_000, 12_000]);
///
/// let refused = Limits::new(&[AxisConfig { max_speed_um_s: 0, ..axis }; 3], WordRate::MHZ_1);
/// assert_eq!(refused.unwrap_err().to_string(), "axis 0: max_speed_um_s must be at least 2");
/// # Ok::<(), trinocular_core::motion::ConfigFault>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    pub(super) rate: WordRate,
    pub(super) axes: [AxisLimits; AXES],
}

impl Limits {
    /// Converts the configuration of each axis.
    ///
    /// # Errors
    /// [`ConfigFault`] with the first value that the planner cannot use, and its axis.
    pub fn new(configs: &[AxisConfig; AXES], rate: WordRate) -> Result<Self, ConfigFault> {
        let of = |axis: usize, config| {
            AxisLimits::new(config, rate).map_err(|fault| ConfigFault { axis, fault })
        };
        let [x, y, z] = configs;
        Ok(Self {
            rate,
            axes: [of(0, x)?, of(1, y)?, of(2, z)?],
        })
    }

    /// Returns the limits with this backlash on each axis, steps, at most 2²⁹.
    pub fn with_backlash(mut self, steps: [u32; AXES]) -> Self {
        for (axis, steps) in self.axes.iter_mut().zip(steps) {
            axis.backlash = steps.min(FARTHEST as u32);
        }
        self
    }

    /// Returns the limits with `axis` limited as in `other`, which was computed for the same word
    /// rate.
    pub fn with_axis_of(mut self, axis: usize, other: &Self) -> Self {
        if let (Some(own), Some(limits)) = (self.axes.get_mut(axis), other.axes.get(axis)) {
            *own = *limits;
        }
        self
    }

    /// Returns the word rate.
    pub const fn word_rate(&self) -> WordRate {
        self.rate
    }

    /// Returns the limits of each axis.
    pub const fn axes(&self) -> &[AxisLimits; AXES] {
        &self.axes
    }

    /// Returns the highest speeds after quantisation, fine units (2⁻³² step) per slot.
    pub fn speeds(&self) -> [u32; AXES] {
        self.axes.map(|axis| self.fine(axis.speed))
    }

    /// Returns the highest accelerations after quantisation, fine units per slot, per tick.
    pub fn accelerations(&self) -> [u32; AXES] {
        self.axes.map(|axis| self.fine(axis.acceleration))
    }

    /// Returns the highest jerks after quantisation, fine units per slot, per tick, per tick.
    pub fn jerks(&self) -> [u32; AXES] {
        self.axes.map(|axis| self.fine(axis.jerk))
    }

    /// Converts quanta to fine units per slot: no more than `speed` quanta times 2N, which fits by
    /// the invariant of [`AxisLimits`].
    fn fine(&self, quanta: u32) -> u32 {
        quanta.saturating_mul(2 * self.rate.slots_per_tick())
    }
}

#[cfg(test)]
mod tests;
