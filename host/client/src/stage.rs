//! Conversion of a stage in physical units to the station's configuration.

use super::StationError;
use trinocular_core::estimate::Gate;
use trinocular_core::frame::message::{
    Command, Config, HomeSwitch, MATRIX_BITS, Mounting, StageConfig,
};
use trinocular_core::motion::AxisConfig;
use trinocular_core::steps::DriverTiming;
use trinocular_core::track::pursuit::Settings;
use trinocular_rig::rig_file::{Care, Driver, Stage};

/// Default heartbeat timeout, ms: longest silence of the host while the stage moves.
pub const HEARTBEAT_MS: u16 = 100;

/// Returns the stage of the twin and of the paper's experiment: 80 steps/mm, 100 mm/s,
/// 2,000 mm/s², 50,000 mm/s³, ±60 mm, TMC2209 drivers.
pub fn default_stage() -> Stage {
    Stage {
        steps_per_mm: [80.0; 3],
        max_speed_mm_s: [100.0; 3],
        max_acceleration_mm_s2: [2_000.0; 3],
        max_jerk_mm_s3: [50_000.0; 3],
        travel_mm: [[-60.0, 60.0]; 3],
        invert: [false; 3],
        matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        driver: Driver::Tmc2209,
        tracking: Settings::DEFAULT,
        care: Care::default(),
    }
}

/// Returns the command to go to a position, mm from zero.
///
/// ```
/// use trinocular_client::stage::setpoint;
/// use trinocular_core::frame::message::Command;
///
/// let position_um = [1_500, 0, -20];
/// assert_eq!(setpoint([1.5, 0.0, -0.02]), Command::Setpoint { position_um });
/// ```
pub fn setpoint(position_mm: [f64; 3]) -> Command {
    Command::Setpoint {
        position_um: position_mm.map(|mm| (mm * 1e3).round() as i32),
    }
}

/// Converts a stage to the station's integers and units.
///
/// # Errors
/// [`StationError::Stage`] names the first field whose value does not fit.
///
/// # Example
/// ```
/// use trinocular_client::stage::{configuration, default_stage};
/// use trinocular_core::frame::message::Mounting;
///
/// let mut stage = default_stage();
/// let config = configuration(&stage, Mounting::OnStage)?;
/// assert_eq!(config.axes[0].max_speed_um_s, 100_000);
///
/// stage.steps_per_mm[2] = 0.0;
/// let error = configuration(&stage, Mounting::OnStage).unwrap_err();
/// assert!(error.to_string().contains("steps_per_mm[2]"));
/// # Ok::<(), trinocular_client::StationError>(())
/// ```
pub fn configuration(stage: &Stage, mounting: Mounting) -> Result<Config, StationError> {
    let mut axes = Vec::new();
    for axis in 0..3 {
        let unsigned = |field: &str, value: f64, scale: f64| -> Result<u64, StationError> {
            let scaled = (value * scale).round();
            if !(scaled >= 1.0 && scaled < u64::MAX as f64) {
                return Err(StationError::Stage {
                    field: format!("{field}[{axis}]"),
                });
            }
            Ok(scaled as u64)
        };
        let narrow = |field: &str, value: f64, scale: f64| -> Result<u32, StationError> {
            u32::try_from(unsigned(field, value, scale)?).map_err(|_| StationError::Stage {
                field: format!("{field}[{axis}]"),
            })
        };
        let travel = |end: usize| -> Result<i32, StationError> {
            let um = (stage.travel_mm[axis][end] * 1e3).round();
            if um.abs() > f64::from(i32::MAX) {
                return Err(StationError::Stage {
                    field: format!("travel_mm[{axis}]"),
                });
            }
            Ok(um as i32)
        };
        axes.push(AxisConfig {
            steps_per_m: narrow("steps_per_mm", stage.steps_per_mm[axis], 1e3)?,
            max_speed_um_s: narrow("max_speed_mm_s", stage.max_speed_mm_s[axis], 1e3)?,
            max_acceleration_um_s2: narrow(
                "max_acceleration_mm_s2",
                stage.max_acceleration_mm_s2[axis],
                1e3,
            )?,
            max_jerk_um_s3: narrow("max_jerk_mm_s3", stage.max_jerk_mm_s3[axis], 1e3)?,
            travel_um: [travel(0)?, travel(1)?],
            invert: stage.invert[axis],
        });
    }
    let mut matrix = [[0; 3]; 3];
    for (row, values) in stage.matrix.iter().enumerate() {
        for (column, value) in values.iter().enumerate() {
            matrix[row][column] = trinocular_core::fixed::quantise(*value, MATRIX_BITS as i32)
                .ok_or_else(|| StationError::Stage {
                    field: format!("matrix[{row}][{column}]"),
                })?;
        }
    }
    Ok(Config {
        axes: [axes[0], axes[1], axes[2]],
        matrix,
        driver: timing(stage.driver),
        gate: Gate::DEFAULT,
        heartbeat_ms: HEARTBEAT_MS,
        slow_speed_um_s: micro("slow_speed_mm_s", stage.care.slow_speed_mm_s)?,
        mounting,
        tracking: stage.tracking,
        stage: treatment(&stage.care)?,
    })
}

/// Returns the [`configuration`] of a stage with another heartbeat timeout, ms.
///
/// # Errors
/// As [`configuration`].
pub fn configuration_at(
    stage: &Stage,
    mounting: Mounting,
    heartbeat_ms: u16,
) -> Result<Config, StationError> {
    Ok(Config {
        heartbeat_ms,
        ..configuration(stage, mounting)?
    })
}

/// Converts to thousandths: mm to µm, s to ms.
fn micro<T: TryFrom<i64>>(field: &str, value: f64) -> Result<T, StationError> {
    let scaled = (value * 1e3).round();
    // The conversion saturates at a value that no field takes.
    T::try_from(scaled as i64).map_err(|_| StationError::Stage {
        field: field.to_owned(),
    })
}

/// Converts a monitored distance to µm. 0 stands for no monitoring, so a distance below half a µm
/// is refused.
fn watched(field: &str, mm: Option<f64>) -> Result<u32, StationError> {
    match (mm, micro(field, mm.unwrap_or(0.0))?) {
        (Some(_), 0) => Err(StationError::Stage {
            field: field.to_owned(),
        }),
        (_, um) => Ok(um),
    }
}

fn treatment(care: &Care) -> Result<StageConfig, StationError> {
    let mut backlash_um = [0; 3];
    let mut home = [None; 3];
    for axis in 0..3 {
        backlash_um[axis] = micro(&format!("backlash_mm[{axis}]"), care.backlash_mm[axis])?;
        home[axis] = match care.home[axis] {
            None => None,
            Some(switch) => Some(HomeSwitch {
                side: switch.side,
                position_um: micro(&format!("home_position_mm[{axis}]"), switch.position_mm)?,
            }),
        };
    }
    let [first, second] = care.home_speed_mm_s;
    Ok(StageConfig {
        backlash_um,
        home,
        home_speed_um_s: [
            micro("home_speed_mm_s[0]", first)?,
            micro("home_speed_mm_s[1]", second)?,
        ],
        back_off_um: micro("back_off_mm", care.back_off_mm)?,
        window_um: micro("unknown_window_mm", care.unknown_window_mm)?,
        largest_error_um: watched("largest_error_mm", care.largest_error_mm)?,
        longest_error_ms: micro("longest_error_s", care.longest_error_s)?,
        unseen_um: watched("largest_unseen_mm", care.largest_unseen_mm)?,
        motors_off_after_s: care.motors_off_after_s,
    })
}

/// Returns the timing that the driver needs at its STEP and DIR inputs.
pub fn timing(driver: Driver) -> DriverTiming {
    match driver {
        Driver::A4988 => DriverTiming::A4988,
        Driver::Drv8825 => DriverTiming::DRV8825,
        Driver::Tmc2209 => DriverTiming::TMC2209,
    }
}
