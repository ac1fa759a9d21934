//! The stage in physical units, and as the station's configuration.

use super::StationError;
use crate::rig_file::{Driver, Stage};
use shared::estimate::Gate;
use shared::frame::message::{Config, MATRIX_BITS, Mounting};
use shared::motion::AxisConfig;
use shared::steps::DriverTiming;
use shared::track::pursuit::Settings;

/// Longest silence of the host while moving, unless another is chosen, ms.
pub const HEARTBEAT_MS: u16 = 100;

/// Fastest motion while the position is unknown, µm/s.
const SLOW_SPEED_UM_S: u32 = 5_000;

/// The stage of the twin and of the paper's experiment: 80 steps/mm, 100 mm/s, 2,000 mm/s², 50,000 mm/s³, ±60 mm, TMC2209 drivers.
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
    }
}

/// The stage as the station wants it: integers, in its units.
///
/// # Errors
/// [`StationError::Stage`] names the first field whose value does not fit.
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
            matrix[row][column] =
                shared::fixed::quantise(*value, MATRIX_BITS as i32).ok_or_else(|| {
                    StationError::Stage {
                        field: format!("matrix[{row}][{column}]"),
                    }
                })?;
        }
    }
    Ok(Config {
        axes: [axes[0], axes[1], axes[2]],
        matrix,
        driver: timing(stage.driver),
        gate: Gate::DEFAULT,
        heartbeat_ms: HEARTBEAT_MS,
        slow_speed_um_s: SLOW_SPEED_UM_S,
        mounting,
        tracking: stage.tracking,
    })
}

/// What the driver needs of its STEP and DIR inputs.
pub fn timing(driver: Driver) -> DriverTiming {
    match driver {
        Driver::A4988 => DriverTiming::A4988,
        Driver::Drv8825 => DriverTiming::DRV8825,
        Driver::Tmc2209 => DriverTiming::TMC2209,
    }
}
