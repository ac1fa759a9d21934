//! The `[stage]` section: three axes of stepping motors and the hand-eye matrix.

use std::fmt::Write as _;

use super::care::Care;
use super::field::Field;
use crate::error::InputError;
use trinocular_core::track::pursuit::Settings;

/// Step drivers whose pulse timing is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Driver {
    /// Allegro A4988.
    A4988,
    /// Texas Instruments DRV8825.
    Drv8825,
    /// Trinamic TMC2209.
    Tmc2209,
}

impl Driver {
    /// All drivers.
    pub const ALL: [Self; 3] = [Self::A4988, Self::Drv8825, Self::Tmc2209];

    /// Returns the name in a rig file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::A4988 => "A4988",
            Self::Drv8825 => "DRV8825",
            Self::Tmc2209 => "TMC2209",
        }
    }
}

/// The stage that carries the cameras. Arrays are per stage axis X, Y, Z.
///
/// ```
/// use std::path::Path;
/// use trinocular_rig::rig_file::{Driver, RigFile};
///
/// let stage = "
/// [stage]
/// steps_per_mm = [80, 80, 400]
/// max_speed_mm_s = [100, 100, 20]
/// max_acceleration_mm_s2 = [2000, 2000, 400]
/// max_jerk_mm_s3 = [50000, 50000, 10000]
/// travel_mm = [[-60, 60], [-60, 60], [0, 40]]
/// invert = [false, false, true]
/// matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
/// driver = 'TMC2209'
/// ";
/// let text = RigFile::paper().to_toml() + stage;
/// let stage = RigFile::parse(Path::new("rig.toml"), &text)?.stage.expect("a stage");
/// assert_eq!(stage.driver, Driver::Tmc2209);
/// assert_eq!(stage.steps_per_mm, [80.0, 80.0, 400.0]);
/// # Ok::<(), trinocular_rig::error::InputError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// Steps (micro steps included) per mm of travel, > 0.
    pub steps_per_mm: [f64; 3],
    /// Greatest speed, mm/s, > 0.
    pub max_speed_mm_s: [f64; 3],
    /// Greatest acceleration, mm/s², > 0.
    pub max_acceleration_mm_s2: [f64; 3],
    /// Greatest jerk, mm/s³, > 0.
    pub max_jerk_mm_s3: [f64; 3],
    /// Soft limits, mm from the home position: lower, upper.
    pub travel_mm: [[f64; 2]; 3],
    /// True if the motor's positive direction is the axis's negative one.
    pub invert: [bool; 3],
    /// Hand-eye matrix, for [`along_stage`]: its rows take a displacement along the camera axes to one along the stage
    /// axes. Dimensionless, invertible.
    pub matrix: [[f64; 3]; 3],
    /// The step drivers, the same on all axes.
    pub driver: Driver,
    /// Settings of tracking: `prediction` (optional, default true) and `coast_ms` (optional,
    /// default 800).
    pub tracking: Settings,
    /// Backlash, home switches, and supervision.
    pub care: Care,
}

pub(super) const KEYS: [&str; 21] = [
    "steps_per_mm",
    "max_speed_mm_s",
    "max_acceleration_mm_s2",
    "max_jerk_mm_s3",
    "travel_mm",
    "invert",
    "matrix",
    "driver",
    "prediction",
    "coast_ms",
    "backlash_mm",
    "home_switch",
    "home_position_mm",
    "home_speed_mm_s",
    "back_off_mm",
    "slow_speed_mm_s",
    "unknown_window_mm",
    "largest_error_mm",
    "longest_error_s",
    "largest_unseen_mm",
    "motors_off_after_s",
];

/// Fields that every stage has, each with an example.
const REQUIRED: [(&str, &str); 8] = [
    ("steps_per_mm", "steps_per_mm = [80.0, 80.0, 80.0]"),
    ("max_speed_mm_s", "max_speed_mm_s = [100.0, 100.0, 100.0]"),
    (
        "max_acceleration_mm_s2",
        "max_acceleration_mm_s2 = [2000.0, 2000.0, 2000.0]",
    ),
    (
        "max_jerk_mm_s3",
        "max_jerk_mm_s3 = [50000.0, 50000.0, 50000.0]",
    ),
    (
        "travel_mm",
        "travel_mm = [[-60.0, 60.0], [-60.0, 60.0], [-60.0, 60.0]]",
    ),
    ("invert", "invert = [false, false, false]"),
    (
        "matrix",
        "matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
    ),
    ("driver", "driver = \"TMC2209\""),
];

/// Largest number of steps per mm of a stage. Larger figures are mistakes of the unit.
const LIMIT_STEPS_PER_MM: f64 = 1e6;
const LIMIT_RATE: f64 = 1e9;
const LIMIT_TRAVEL_MM: f64 = 1e5;
const LIMIT_MATRIX: f64 = 1e3;

impl Stage {
    /// Reads the `[stage]` section.
    ///
    /// # Errors
    /// With the first field that is wrong.
    pub fn read(section: &Field<'_>) -> Result<Self, InputError> {
        section.only(&KEYS)?;
        section.require(&REQUIRED)?;
        let per_axis = |key: &str, limit: f64| {
            section
                .required(key)?
                .each::<3, f64>(|axis| axis.positive(limit))
        };
        Ok(Self {
            steps_per_mm: per_axis("steps_per_mm", LIMIT_STEPS_PER_MM)?,
            max_speed_mm_s: per_axis("max_speed_mm_s", LIMIT_RATE)?,
            max_acceleration_mm_s2: per_axis("max_acceleration_mm_s2", LIMIT_RATE)?,
            max_jerk_mm_s3: per_axis("max_jerk_mm_s3", LIMIT_RATE)?,
            travel_mm: section.required("travel_mm")?.each(travel)?,
            invert: section.required("invert")?.each(|axis| axis.flag())?,
            matrix: matrix(&section.required("matrix")?)?,
            driver: driver(&section.required("driver")?)?,
            tracking: tracking(section)?,
            care: Care::read(section)?,
        })
    }

    /// Converts whole steps per axis to mm.
    pub fn in_mm(&self, steps: [i32; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(steps[axis]) / self.steps_per_mm[axis])
    }

    pub(super) fn write_toml(&self, text: &mut String) {
        let per_axis = [
            ("steps_per_mm", self.steps_per_mm),
            ("max_speed_mm_s", self.max_speed_mm_s),
            ("max_acceleration_mm_s2", self.max_acceleration_mm_s2),
            ("max_jerk_mm_s3", self.max_jerk_mm_s3),
        ];
        text.push_str("\n[stage]\n");
        for (key, values) in per_axis {
            let _ = writeln!(text, "{key} = {values:?}");
        }
        let _ = writeln!(text, "travel_mm = {:?}", self.travel_mm);
        let _ = writeln!(text, "invert = {:?}", self.invert);
        let _ = writeln!(text, "matrix = {:?}", self.matrix);
        let _ = writeln!(text, "driver = \"{}\"", self.driver.name());
        if self.tracking != Settings::DEFAULT {
            let _ = writeln!(text, "prediction = {}", self.tracking.prediction);
            let _ = writeln!(text, "coast_ms = {}", self.tracking.coast_ms);
        }
        self.care.write_toml(text);
    }
}

fn tracking(section: &Field<'_>) -> Result<Settings, InputError> {
    let Settings {
        mut prediction,
        mut coast_ms,
    } = Settings::DEFAULT;
    if let Some(field) = section.optional("prediction")? {
        prediction = field.flag()?;
    }
    if let Some(field) = section.optional("coast_ms")? {
        coast_ms = field.whole(1..=u32::from(Settings::LONGEST_COAST_MS))? as u16;
    }
    Ok(Settings {
        prediction,
        coast_ms,
    })
}

fn travel(axis: &Field<'_>) -> Result<[f64; 2], InputError> {
    let [least, greatest] = axis.each(|end| end.number(LIMIT_TRAVEL_MM))?;
    if least < greatest {
        Ok([least, greatest])
    } else {
        Err(axis.fault(format!("{least} must be less than {greatest}")))
    }
}

fn matrix(field: &Field<'_>) -> Result<[[f64; 3]; 3], InputError> {
    let rows: [[f64; 3]; 3] = field.each(|row| row.each(|element| element.number(LIMIT_MATRIX)))?;
    let [a, b, c] = rows;
    let determinant = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0]);
    let length = |row: [f64; 3]| row.iter().map(|e| e * e).sum::<f64>().sqrt();
    // The determinant over the rows' lengths is the volume their directions span: 1 for a square
    // stage.
    if determinant.abs() > 1e-3 * length(a) * length(b) * length(c) {
        Ok(rows)
    } else {
        Err(field.fault("not invertible: two of its rows point the same way, or one is zero"))
    }
}

fn driver(field: &Field<'_>) -> Result<Driver, InputError> {
    let name = field.text()?;
    let found = Driver::ALL.into_iter().find(|driver| driver.name() == name);
    found.ok_or_else(|| field.unknown("driver", &Driver::ALL.map(Driver::name)))
}

/// Returns a displacement along the camera axes as one along the stage axes, by the rows of the
/// hand-eye matrix [`Stage::matrix`].
///
/// ```
/// use trinocular_rig::rig_file::along_stage;
///
/// // The stage's X axis is the cameras' Z axis.
/// let matrix = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]];
/// assert_eq!(along_stage(&matrix, [1.0, 2.0, 3.0]), [3.0, 2.0, -1.0]);
/// ```
pub fn along_stage(matrix: &[[f64; 3]; 3], displacement: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| (0..3).map(|i| row[i] * displacement[i]).sum())
}
