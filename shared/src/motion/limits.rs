use core::fmt;

use serde::{Deserialize, Serialize};

use crate::fixed::ratio;
use crate::steps::{AXES, Position, WordRate};

/// One axis of the stage as the host describes it: physical units, integers only.
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
    /// The DIR pin is low forwards.
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
    /// `travel_um`
    Travel,
}

impl Field {
    /// As the configuration calls it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::StepsPerM => "steps_per_m",
            Self::MaxSpeed => "max_speed_um_s",
            Self::MaxAcceleration => "max_acceleration_um_s2",
            Self::MaxJerk => "max_jerk_um_s3",
            Self::Travel => "travel_um",
        }
    }
}

/// What is wrong with an [`AxisConfig`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LimitFault {
    /// The field must not be zero.
    Zero(Field),
    /// The field is below one quantum of the planner's grid: the axis could not move.
    TooSmall(Field),
    /// The speed asks for more steps per second than the word rate can make.
    TooFast {
        /// Asked for, steps/s, rounded down.
        steps_per_s: u64,
        /// The most there is, steps/s.
        most: u32,
    },
    /// The travel's low end is not below its high end.
    NoTravel,
    /// The travel reaches beyond ±2²⁹ steps.
    TravelTooFar,
}

impl LimitFault {
    /// The field at fault.
    pub const fn field(self) -> Field {
        match self {
            Self::Zero(field) | Self::TooSmall(field) => field,
            Self::TooFast { .. } => Field::MaxSpeed,
            Self::NoTravel | Self::TravelTooFar => Field::Travel,
        }
    }
}

impl fmt::Display for LimitFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ", self.field().name())?;
        match self {
            Self::Zero(_) => write!(f, "must not be zero"),
            Self::TooSmall(_) => write!(f, "is below what the step generator can resolve"),
            Self::TooFast { steps_per_s, most } => {
                write!(f, "needs {steps_per_s} steps/s, the word rate gives {most}")
            }
            Self::NoTravel => write!(f, "must go from low to high"),
            Self::TravelTooFar => write!(f, "reaches beyond 2^29 steps"),
        }
    }
}

impl core::error::Error for LimitFault {}

/// A [`LimitFault`] and the axis it is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfigFault {
    /// The axis, from 0.
    pub axis: usize,
    /// What is wrong.
    pub fault: LimitFault,
}

impl fmt::Display for ConfigFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "axis {}: {}", self.axis, self.fault)
    }
}

impl core::error::Error for ConfigFault {}

/// What one axis may do, in the planner's grid (see the [module](super)).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AxisLimits {
    /// Highest speed, multiples of `2N` fine units per slot; from 1, and `2N` times it fits a `u32`.
    pub(super) speed: u32,
    /// Highest change of speed per tick, same unit; from 1 to `speed`.
    pub(super) acceleration: u32,
    /// Highest change of acceleration per tick, same unit; from 1 to `speed`.
    pub(super) jerk: u32,
    /// Allowed step numbers, both ends included, within ±2²⁹.
    range: [i32; 2],
    /// Lost motion between motor and load, whole steps, up to 2²⁹.
    backlash: u32,
}

/// Positions of soft limits stay within this, steps: leaves room to stop within the range of [`Position`] from anywhere.
const FARTHEST: i64 = 1 << 29;

impl AxisLimits {
    /// The largest multiples of the grid's quanta that exceed nothing in `config`.
    pub fn new(config: &AxisConfig, rate: WordRate) -> Result<Self, LimitFault> {
        let fields = [
            (u64::from(config.steps_per_m), Field::StepsPerM),
            (u64::from(config.max_speed_um_s), Field::MaxSpeed),
            (
                u64::from(config.max_acceleration_um_s2),
                Field::MaxAcceleration,
            ),
            (u64::from(config.max_jerk_um_s3), Field::MaxJerk),
        ];
        for (value, field) in fields {
            if value == 0 {
                return Err(LimitFault::Zero(field));
            }
        }
        // µm per second to fine units per slot, then to the grid: speed quanta, and these per tick, and per tick again.
        // Dividing by one factor after the other rounds down just as dividing by the product does.
        let um = |per_s: u32| u64::from(config.steps_per_m) * u64::from(per_s);
        let um_slots = 1_000_000 * u64::from(rate.slots_per_s());
        let quantum = 2 * u64::from(rate.slots_per_tick());
        let fine_per_slot = ratio(um(config.max_speed_um_s), um_slots);
        if fine_per_slot > 1 << 32 {
            return Err(LimitFault::TooFast {
                steps_per_s: um(config.max_speed_um_s) / 1_000_000,
                most: rate.slots_per_s(),
            });
        }
        // Exactly one step per slot is one fine unit more than an increment can hold.
        let speed = (fine_per_slot.min(u64::from(u32::MAX)) / quantum) as u32;
        if speed == 0 {
            return Err(LimitFault::TooSmall(Field::MaxSpeed));
        }
        // `ticks` is how many ticks of a second come in. More than the whole speed in one tick is no use.
        let quantise = |per_s: u32, ticks: u64, field| {
            let value = ratio(um(per_s), um_slots * quantum) / ticks;
            match value.min(u64::from(speed)) as u32 {
                0 => Err(LimitFault::TooSmall(field)),
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

    /// How many steps the motor makes when it turns round before the load moves.
    pub const fn backlash(&self) -> u32 {
        self.backlash
    }

    /// The lowest and highest step number the axis may stand at.
    pub const fn range(&self) -> [i32; 2] {
        self.range
    }

    /// The centres of the first and the last allowed step.
    pub fn ends(&self) -> [Position; 2] {
        self.range.map(Position::centre)
    }

    /// Between what the motor stands at when the load is at either end: pushed backwards, the motor is `backlash` steps ahead.
    pub(super) fn motor_ends(&self) -> [Position; 2] {
        let [low, high] = self.ends();
        [low.saturating_add(-(i64::from(self.backlash) << 32)), high]
    }

    /// The allowed position nearest to `target`.
    pub fn clamp(&self, target: Position) -> Position {
        let [low, high] = self.ends();
        target.clamp(low, high)
    }
}

/// The travel in steps, rounded inwards.
fn travel_steps(config: &AxisConfig) -> Result<[i32; 2], LimitFault> {
    let [low, high] = config.travel_um;
    if low >= high {
        return Err(LimitFault::NoTravel);
    }
    // Below 2^63 in size.
    let micro_steps = |um: i32| i64::from(um) * i64::from(config.steps_per_m);
    let floor = |value: i64| value.div_euclid(1_000_000);
    let (low, high) = (-floor(-micro_steps(low)), floor(micro_steps(high)));
    if low < -FARTHEST || high > FARTHEST {
        return Err(LimitFault::TravelTooFar);
    }
    if low > high {
        // Not one whole step lies within.
        return Err(LimitFault::TooSmall(Field::Travel));
    }
    Ok([low as i32, high as i32])
}

/// What all axes may do, and the word rate it was worked out for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    pub(super) rate: WordRate,
    pub(super) axes: [AxisLimits; AXES],
}

impl Limits {
    /// Converts the configuration of each axis; the first fault is reported with its axis.
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

    /// With lost motion on each axis, steps. No axis loses more than 2²⁹.
    pub fn with_backlash(mut self, steps: [u32; AXES]) -> Self {
        for (axis, steps) in self.axes.iter_mut().zip(steps) {
            axis.backlash = steps.min(FARTHEST as u32);
        }
        self
    }

    /// The word rate.
    pub const fn word_rate(&self) -> WordRate {
        self.rate
    }

    /// Each axis's limits.
    pub const fn axes(&self) -> &[AxisLimits; AXES] {
        &self.axes
    }

    /// Highest speeds after quantisation, fine units (2⁻³² step) per slot.
    pub fn speeds(&self) -> [u32; AXES] {
        self.axes.map(|axis| self.fine(axis.speed))
    }

    /// Highest accelerations after quantisation, fine units per slot, per tick.
    pub fn accelerations(&self) -> [u32; AXES] {
        self.axes.map(|axis| self.fine(axis.acceleration))
    }

    /// Highest jerks after quantisation, fine units per slot, per tick, per tick.
    pub fn jerks(&self) -> [u32; AXES] {
        self.axes.map(|axis| self.fine(axis.jerk))
    }

    /// No more than `speed` quanta times 2N, which fits by the invariant of [`AxisLimits`].
    fn fine(&self, quanta: u32) -> u32 {
        quanta.saturating_mul(2 * self.rate.slots_per_tick())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CONFIG: AxisConfig = AxisConfig {
        steps_per_m: 80_000,
        max_speed_um_s: 100_000,
        max_acceleration_um_s2: 1_000_000,
        max_jerk_um_s3: 50_000_000,
        travel_um: [-150_001, 150_001],
        invert: false,
    };

    fn fault(config: AxisConfig) -> LimitFault {
        AxisLimits::new(&config, WordRate::MHZ_1).unwrap_err()
    }

    #[test]
    fn every_fault_names_its_field() {
        let zero = [
            (
                AxisConfig {
                    steps_per_m: 0,
                    ..CONFIG
                },
                Field::StepsPerM,
            ),
            (
                AxisConfig {
                    max_speed_um_s: 0,
                    ..CONFIG
                },
                Field::MaxSpeed,
            ),
            (
                AxisConfig {
                    max_acceleration_um_s2: 0,
                    ..CONFIG
                },
                Field::MaxAcceleration,
            ),
            (
                AxisConfig {
                    max_jerk_um_s3: 0,
                    ..CONFIG
                },
                Field::MaxJerk,
            ),
        ];
        for (config, field) in zero {
            assert_eq!(fault(config), LimitFault::Zero(field));
        }
        let small = [
            (
                AxisConfig {
                    max_speed_um_s: 1,
                    ..CONFIG
                },
                Field::MaxSpeed,
            ),
            (
                AxisConfig {
                    max_acceleration_um_s2: 1_000,
                    ..CONFIG
                },
                Field::MaxAcceleration,
            ),
            (
                AxisConfig {
                    max_jerk_um_s3: 1_000_000,
                    ..CONFIG
                },
                Field::MaxJerk,
            ),
            (
                AxisConfig {
                    travel_um: [1, 12],
                    ..CONFIG
                },
                Field::Travel,
            ),
        ];
        for (config, field) in small {
            assert_eq!(fault(config), LimitFault::TooSmall(field));
            assert_eq!(fault(config).field(), field);
        }
        assert_eq!(
            fault(AxisConfig {
                travel_um: [5, 5],
                ..CONFIG
            }),
            LimitFault::NoTravel
        );
        let far = AxisConfig {
            steps_per_m: 2_000_000,
            max_speed_um_s: 1_000,
            travel_um: [0, 300_000_000],
            ..CONFIG
        };
        assert_eq!(fault(far), LimitFault::TravelTooFar);
        let fast = AxisConfig {
            max_speed_um_s: 6_250_013,
            ..CONFIG
        };
        let limits = Limits::new(&[CONFIG, CONFIG, fast], WordRate::MHZ_1);
        assert_eq!(
            std::format!("{}", limits.unwrap_err()),
            "axis 2: max_speed_um_s needs 500001 steps/s, the word rate gives 500000"
        );
        // Exactly one step per slot is allowed.
        assert!(
            AxisLimits::new(
                &AxisConfig {
                    max_speed_um_s: 6_250_000,
                    ..CONFIG
                },
                WordRate::MHZ_1
            )
            .is_ok()
        );
    }

    #[test]
    fn travel_is_rounded_inwards() {
        let limits = AxisLimits::new(&CONFIG, WordRate::MHZ_1).unwrap();
        // 12,000.08 steps either way.
        assert_eq!(limits.range(), [-12_000, 12_000]);
    }

    proptest! {
        // Slow words refuse one configuration in fifty.
        #![proptest_config(ProptestConfig { max_global_rejects: u32::MAX, ..ProptestConfig::default() })]

        #[test]
        fn quantised_limits_exceed_nothing_and_lose_less_than_a_quantum(
            steps_per_m in 10_000..1_000_000u32, max_speed_um_s in 100..300_000u32, max_acceleration_um_s2 in 100_000..u32::MAX,
            max_jerk_um_s3 in 100_000_000..u32::MAX, slots in 4..=500u32,
        ) {
            let rate = WordRate::from_hz(8_000 * slots).unwrap();
            let config = AxisConfig { steps_per_m, max_speed_um_s, max_acceleration_um_s2, max_jerk_um_s3, travel_um: [-1_000, 1_000], invert: false };
            let limits = AxisLimits::new(&config, rate);
            prop_assume!(limits.is_ok());
            let limits = limits.unwrap();
            // Steps per slot, per slot and tick, per slot and tick and tick, in fine units.
            let fine = |um: u32, ticks: i32| {
                f64::from(steps_per_m) * f64::from(um) * 1e-6 * 4_294_967_296.0
                    / f64::from(rate.slots_per_s())
                    / 1_000f64.powi(ticks)
            };
            let quantum = 2.0 * f64::from(rate.slots_per_tick());
            let cap = f64::from(limits.speed);
            for (value, exact) in [
                (limits.speed, fine(max_speed_um_s, 0)),
                (limits.acceleration, fine(max_acceleration_um_s2, 1)),
                (limits.jerk, fine(max_jerk_um_s3, 2)),
            ] {
                let (value, exact) = (f64::from(value), exact / quantum);
                let rounding = 1e-9 * exact;
                prop_assert!(value <= exact + rounding);
                prop_assert!(value + 1.0 > exact - rounding || value == cap);
            }
        }
    }
}
