//! The configuration of the station.

use crate::estimate::Gate;
use crate::motion::AxisConfig;
use crate::steps::DriverTiming;
use crate::track::pursuit::Settings;
use serde::{Deserialize, Serialize};

/// Configuration of the station: everything it must know about the stage. The station keeps none of
/// it across a restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Config {
    /// Resolution and limits of the stage's axes.
    pub axes: [AxisConfig; 3],
    /// Hand-eye matrix from camera axes to stage axes, row by row, Q2.29 (±4): `stage = matrix
    /// camera`.
    pub matrix: [[i32; 3]; 3],
    /// STEP and DIR timing that the motor drivers need.
    pub driver: DriverTiming,
    /// Limits that an estimate must meet.
    pub gate: Gate,
    /// Heartbeat timeout while moving, ms, 20 to 10000.
    pub heartbeat_ms: u16,
    /// Highest speed while the position is unknown, µm/s.
    pub slow_speed_um_s: u32,
    /// Place of the cameras: on the stage or beside it.
    pub mounting: Mounting,
    /// Settings of the target tracker.
    pub tracking: Settings,
    /// Backlash, home switches and supervision.
    pub stage: StageConfig,
}

/// Configuration of the stage beyond the limits of its axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageConfig {
    /// Backlash of each axis, µm; 0 means none. Rounded to whole steps.
    pub backlash_um: [u16; 3],
    /// Home switch of each axis.
    pub home: [Option<HomeSwitch>; 3],
    /// Speeds towards a home switch, µm/s: the first approach and the second.
    pub home_speed_um_s: [u32; 2],
    /// Distance by which an axis backs off from its home switch, µm.
    pub back_off_um: u32,
    /// Distance by which an axis may leave the place at which its position became unknown, µm.
    pub window_um: u32,
    /// Largest distance between target and stage while following, per axis, µm; 0 means any.
    pub largest_error_um: u32,
    /// Longest time for which that distance may be exceeded, ms.
    pub longest_error_ms: u16,
    /// Distance that the stage may move towards the target, per axis, while the cameras do not see
    /// it come nearer, µm; 0 means any. Requires prediction.
    pub unseen_um: u32,
    /// Time at rest after which the motors are switched off, s; 0 means never. Following does not
    /// count as rest.
    pub motors_off_after_s: u16,
}

/// Limit switch that also defines the position of its axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HomeSwitch {
    /// End of the axis at which the switch is.
    pub side: Side,
    /// Position at which the switch trips when the axis moves onto it, µm from zero.
    pub position_um: i32,
}

/// End of an axis. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// End in the negative direction.
    Negative,
    /// End in the positive direction.
    Positive,
}

impl StageConfig {
    /// Default configuration: no backlash, no home switches (with speeds of 10 and 1 mm/s and a
    /// back-off of 2 mm for those that are added), a window of 10 mm while the position is unknown,
    /// no supervision, and motors that stay on.
    pub const DEFAULT: Self = Self {
        backlash_um: [0; 3],
        home: [None; 3],
        home_speed_um_s: [10_000, 1_000],
        back_off_um: 2_000,
        window_um: 10_000,
        largest_error_um: 0,
        longest_error_ms: 0,
        unseen_um: 0,
        motors_off_after_s: 0,
    };
}

/// Place of the cameras. Append-only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mounting {
    /// On the stage (eye-in-hand): the stage keeps the cameras' view of the target constant, as in
    /// the paper.
    #[default]
    OnStage,
    /// Beside the stage (eye-to-hand): the stage copies the target's motion as seen by resting
    /// cameras, for example from recorded images.
    Fixed,
}

/// Fraction bits of [`Config::matrix`].
pub const MATRIX_BITS: u32 = 29;
