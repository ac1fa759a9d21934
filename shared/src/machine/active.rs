//! Checked configuration, with values for the control loop computed once.

use crate::estimate::{DisplacementNm, Gate};
use crate::fixed::{multiply_shift, ratio, times, wide};
use crate::frame::message::{Config, ConfigField, MATRIX_BITS, Mounting, Setting};
use crate::motion::{AxisConfig, Bound, ConfigFault, Limits};
use crate::steps::WordRate;
use crate::track::StepVector;
use crate::track::filter::KinematicLimits;
use crate::track::pursuit::Settings;
use crate::track::watch::Bounds;
use nalgebra::{Matrix3, Vector3};

/// Fraction bits of [`Active::fine_per_nm`].
const SCALE_BITS: u32 = 16;

/// Smallest determinant of the hand-eye matrix, Q3·29: one thousandth.
const MIN_DETERMINANT: u128 = (1 << (3 * MATRIX_BITS)) / 1000;

/// Farthest home switch from zero, steps: leaves as much again to search.
const FARTHEST_HOME: i64 = 1 << 28;

/// Farthest position from zero, steps, which also limits all distances of the configuration.
const FARTHEST: i64 = 1 << 29;

/// Longest displacement that the gate may let pass, steps.
const FARTHEST_SIGHT: i64 = 1 << 29;

/// Configuration in use.
#[derive(Clone, Debug)]
pub(super) struct Active {
    pub config: Config,
    /// Limits of motion with a known position.
    pub limits: Limits,
    /// Limits of motion while the position is unknown: slow, and without soft limits.
    pub slow: Limits,
    /// Limits of the search for a home switch, the first approach and the second.
    pub home: [Limits; 2],
    /// Scale of each axis, 2⁻³² steps per nm, Q48.16. Below 2⁵¹.
    fine_per_nm: [i64; 3],
    /// Kinematic limits of each axis, which bound the motion of a target that can be followed.
    pub reach: [KinematicLimits; 3],
    /// Limits of the supervision by the cameras. Without prediction the stage lags behind the
    /// target, which looks like a stall.
    pub bounds: Option<Bounds>,
    /// Conversion of variances along the camera axes, nm², to variances along the stage axes,
    /// steps². Ignores correlations between the errors of the camera axes.
    variances: Matrix3<f32>,
}

/// Checks a configuration for a board with this word rate, as the station does.
///
/// # Errors
/// The first invalid value, with the nearest valid one.
pub fn check(config: &Config, rate: WordRate) -> Result<(), ConfigField> {
    Active::new(config, rate).map(|_| ())
}

impl Active {
    /// Checks every value and prepares the configuration.
    ///
    /// # Errors
    /// The first invalid value, with the nearest valid one.
    pub fn new(config: &Config, rate: WordRate) -> Result<Self, ConfigField> {
        if determinant(&config.matrix).unsigned_abs() < MIN_DETERMINANT {
            return Err(ConfigField::Matrix);
        }
        check_gate(config)?;
        between(Setting::Heartbeat, config.heartbeat_ms.into(), 20..=10_000)?;
        between(
            Setting::Coast,
            config.tracking.coast_ms.into(),
            1..=Settings::LONGEST_COAST_MS.into(),
        )?;
        let limits = Limits::new(&config.axes, rate).map_err(limit_field)?;
        check_stage(config)?;
        let backlash = backlash_steps(config, &limits)?;
        let limits = limits.with_backlash(backlash);
        let slow = |setting, speed| {
            let axes = config.axes.map(|axis| slow_axis(axis, speed));
            let limits = Limits::new(&axes, rate).map_err(|fault| on_axis(setting, fault))?;
            Ok::<_, ConfigField>(limits.with_backlash(backlash))
        };
        let [fast, second] = config.stage.home_speed_um_s;
        // Without a home switch the speeds have no effect.
        let home = |setting, speed| match config.stage.home {
            [None, None, None] => Ok(limits),
            _ => slow(setting, speed),
        };
        let mut active = Self {
            config: *config,
            limits,
            slow: slow(Setting::SlowSpeed, config.slow_speed_um_s)?,
            home: [
                home(Setting::HomeSpeedFirst, fast)?,
                home(Setting::HomeSpeedSecond, second)?,
            ],
            fine_per_nm: config.axes.map(|axis| {
                // steps/m 2^32 2^16 / 10^9 nm/m: below 2^51.
                ratio(u64::from(axis.steps_per_m) << SCALE_BITS, 1_000_000_000) as i64
            }),
            reach: config.axes.map(reach),
            variances: variances(config),
            bounds: None,
        };
        active.bounds = active.bounds();
        config.driver.check(rate).map_err(|_| ConfigField::Driver)?;
        Ok(active)
    }

    /// Returns the gate for estimates.
    pub fn gate(&self) -> &Gate {
        &self.config.gate
    }

    /// Returns true if the cameras are on the stage.
    pub fn on_stage(&self) -> bool {
        self.config.mounting == Mounting::OnStage
    }

    /// Returns the limits of the supervision, or `None` without supervision.
    fn bounds(&self) -> Option<Bounds> {
        let stage = &self.config.stage;
        let fine = |um: u32| self.fine([i64::from(um) * 1000; 3]);
        let unseen = match self.config.tracking.prediction {
            true => fine(stage.unseen_um),
            false => [0; 3],
        };
        let bounds = Bounds {
            unseen,
            error: fine(stage.largest_error_um),
            longest_us: u64::from(stage.longest_error_ms) * 1000,
        };
        (bounds != Bounds::default()).then_some(bounds)
    }

    /// Returns the heartbeat timeout, control ticks.
    pub fn heartbeat_ticks(&self) -> u64 {
        u64::from(self.config.heartbeat_ms)
    }

    /// Converts a displacement in camera axes to one in stage axes: matrix, then resolution.
    pub fn to_stage(&self, camera_nm: DisplacementNm) -> StepVector {
        // Loops over references: mapping arrays by value copies them.
        let mut stage_nm = [0_i64; 3];
        for (sum, row) in stage_nm.iter_mut().zip(&self.config.matrix) {
            for (m, nm) in row.iter().zip(camera_nm) {
                // Three terms below 2^34 each.
                *sum = sum.wrapping_add(multiply_shift(*m, nm, MATRIX_BITS));
            }
        }
        self.fine(stage_nm)
    }

    /// Converts standard deviations along the camera axes, nm, to variances along the stage axes,
    /// steps².
    pub fn variance(&self, camera_sigma_nm: [u32; 3]) -> [f32; 3] {
        let [x, y, z] = camera_sigma_nm.map(|sigma| sigma as f32);
        (self.variances * Vector3::new(x * x, y * y, z * z)).into()
    }

    /// Converts stage distances in nm to 2⁻³² steps, saturating.
    pub fn fine(&self, stage_nm: [i64; 3]) -> StepVector {
        let mut fine = [0; 3];
        for ((fine, nm), scale) in fine.iter_mut().zip(stage_nm).zip(&self.fine_per_nm) {
            let product = wide(nm, *scale) >> SCALE_BITS;
            *fine = i64::try_from(product).unwrap_or(if nm < 0 { i64::MIN } else { i64::MAX });
        }
        fine
    }

    /// Converts stage distances in µm to 2⁻³² steps, saturating.
    pub fn fine_from_um(&self, stage_um: [i32; 3]) -> StepVector {
        self.fine(stage_um.map(|um| i64::from(um) * 1000))
    }
}

fn reach(axis: AxisConfig) -> KinematicLimits {
    let steps_per_um = axis.steps_per_m as f32 * 1e-6;
    KinematicLimits {
        speed: axis.max_speed_um_s as f32 * steps_per_um * 1e-3,
        acceleration: axis.max_acceleration_um_s2 as f32 * steps_per_um * 1e-6,
        jerk: axis.max_jerk_um_s3 as f32 * steps_per_um * 1e-9,
    }
}

/// Returns the squares of the matrix from camera axes in nm to stage axes in steps.
fn variances(config: &Config) -> Matrix3<f32> {
    const ONE: f32 = (1 << MATRIX_BITS) as f32;
    let rows = config.matrix.iter().zip(&config.axes);
    let elements = rows.flat_map(|(row, axis)| {
        let steps_per_nm = axis.steps_per_m as f32 * 1e-9;
        row.map(|element| {
            let steps = element as f32 / ONE * steps_per_nm;
            steps * steps
        })
    });
    Matrix3::from_row_iterator(elements)
}

/// Checks the gate: some estimate must pass, and no displacement may overflow.
fn check_gate(config: &Config) -> Result<(), ConfigField> {
    let gate = &config.gate;
    for (axis, sigma) in (0..).zip(gate.max_sigma_nm) {
        if sigma == 0 {
            return Err(value(Setting::GateSigma, Some(axis), Bound::AtLeast(1)));
        }
    }
    let displacement = i64::from(gate.max_displacement_nm);
    // Each row of the matrix adds up three displacements; FARTHEST_SIGHT steps are far from
    // overflow.
    let mut most = i64::from(u32::MAX);
    for (row, axis) in config.matrix.iter().zip(&config.axes) {
        let gain = row.iter().map(|m| i64::from(m.unsigned_abs())).sum::<i64>();
        // Q2.29 by steps/m: below 2^65, so in whole thousandths of the gain.
        let scale = ((gain >> 19) + 1) * i64::from(axis.steps_per_m.max(1));
        most = most.min(times(FARTHEST_SIGHT * 1_000_000_000 / scale, 1 << 10));
    }
    between(Setting::GateDisplacement, displacement, 1..=most.max(1))
}

/// Checks the stage's settings that depend on no limit of an axis.
fn check_stage(config: &Config) -> Result<(), ConfigField> {
    let stage = &config.stage;
    // Farthest distance that every axis can express.
    let finest = config.axes.iter().map(|axis| axis.steps_per_m).max();
    let farthest = farthest_um(FARTHEST, finest.unwrap_or(1));
    between(Setting::Window, stage.window_um.into(), 1..=farthest)?;
    if stage.home.iter().any(Option::is_some) {
        between(Setting::BackOff, stage.back_off_um.into(), 1..=farthest)?;
    }
    let watched = i64::from(stage.largest_error_um);
    between(Setting::LargestError, watched, 0..=farthest)?;
    if watched > 0 {
        let longest = stage.longest_error_ms.into();
        between(Setting::LongestError, longest, 1..=u16::MAX.into())?;
    }
    between(Setting::Unseen, stage.unseen_um.into(), 0..=farthest)
}

/// Converts backlash to whole steps, to the nearest, and checks that home switches are in range.
fn backlash_steps(config: &Config, limits: &Limits) -> Result<[u32; 3], ConfigField> {
    let mut backlash = [0; 3];
    let axes = config.axes.iter().zip(limits.axes());
    let stage = config.stage.backlash_um.into_iter().zip(config.stage.home);
    for (number, ((axis, limits), (um, home))) in (0_u8..).zip(axes.zip(stage)) {
        let scale = u64::from(axis.steps_per_m);
        let steps = (u64::from(um) * scale + 500_000) / 1_000_000;
        let [low, high] = limits.range();
        let travel = u64::from(high.abs_diff(low));
        if steps > travel {
            // Largest value that still rounds down to the travel.
            let most = (travel * 1_000_000 + 499_999) / scale;
            let bound = Bound::AtMost(most.cast_signed());
            return Err(value(Setting::Backlash, Some(number), bound));
        }
        if home.is_some() {
            check_search(config, number, axis)?;
        }
        let most = farthest_um(FARTHEST_HOME, axis.steps_per_m);
        let position = home.map_or(0, |home| i64::from(home.position_um));
        if position > most {
            let bound = Bound::AtMost(most);
            return Err(value(Setting::HomePosition, Some(number), bound));
        }
        if position < -most {
            let bound = Bound::AtLeast(-most);
            return Err(value(Setting::HomePosition, Some(number), bound));
        }
        if let Some(slot) = backlash.get_mut(usize::from(number)) {
            *slot = steps as u32;
        }
    }
    Ok(backlash)
}

/// Checks that the search for a home switch, five quarters of the travel plus the back-off, stays
/// within the range of positions.
fn check_search(config: &Config, number: u8, axis: &AxisConfig) -> Result<(), ConfigField> {
    let [low, high] = axis.travel_um.map(i64::from);
    let farthest = FARTHEST * 1_000_000 / i64::from(axis.steps_per_m.max(1));
    let most = low + (farthest - i64::from(config.stage.back_off_um)) * 4 / 5;
    if high > most {
        let bound = Bound::AtMost(most);
        return Err(value(Setting::TravelHigh, Some(number), bound));
    }
    Ok(())
}

/// Returns the longest distance of at most `steps`, µm, that an `i32` holds.
fn farthest_um(steps: i64, steps_per_m: u32) -> i64 {
    let um = steps * 1_000_000 / i64::from(steps_per_m.max(1));
    um.min(i32::MAX.into())
}

/// Checks that a number lies within `range`; the error names the nearest valid one.
fn between(
    setting: Setting,
    number: i64,
    range: core::ops::RangeInclusive<i64>,
) -> Result<(), ConfigField> {
    if number < *range.start() {
        return Err(value(setting, None, Bound::AtLeast(*range.start())));
    }
    if number > *range.end() {
        return Err(value(setting, None, Bound::AtMost(*range.end())));
    }
    Ok(())
}

const fn value(setting: Setting, axis: Option<u8>, bound: Bound) -> ConfigField {
    ConfigField::Value {
        setting,
        axis,
        bound,
    }
}

/// Converts a limit that the planner cannot use to the field of the configuration.
pub fn limit_field(fault: ConfigFault) -> ConfigField {
    on_axis(fault.fault.field.into(), fault)
}

/// Converts a fault of an axis's limits to one of `setting`, from which the limit comes.
fn on_axis(setting: Setting, fault: ConfigFault) -> ConfigField {
    value(setting, Some(fault.axis as u8), fault.fault.bound)
}

/// Returns the axis at `speed_um_s`, with the widest possible travel.
fn slow_axis(axis: AxisConfig, speed_um_s: u32) -> AxisConfig {
    let widest_um = (1u64 << 29) * 1_000_000 / u64::from(axis.steps_per_m.max(1));
    let widest_um = i32::try_from(widest_um).unwrap_or(i32::MAX);
    AxisConfig {
        max_speed_um_s: axis.max_speed_um_s.min(speed_um_s),
        travel_um: [widest_um.saturating_neg(), widest_um],
        ..axis
    }
}

/// Computes the determinant of three rows of Q.29 numbers, Q.87. Below 2^97 in size.
fn determinant(m: &[[i32; 3]; 3]) -> i128 {
    let &[[a, b, c], [d, e, f], [g, h, i]] = m;
    let product = |p: i32, q: i32| i64::from(p) * i64::from(q);
    // The difference of two products of 32-bit numbers is below 2^63.
    let minor = |p, q, r, s| product(p, q).saturating_sub(product(r, s));
    let terms = [
        wide(i64::from(a), minor(e, i, f, h)),
        wide(i64::from(b), minor(f, g, d, i)),
        wide(i64::from(c), minor(d, h, e, g)),
    ];
    terms.into_iter().fold(0, i128::wrapping_add)
}
