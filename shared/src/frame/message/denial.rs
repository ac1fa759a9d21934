//! Reasons for the denial of a command.

// The documentation names fields of the configuration.
#[cfg(doc)]
use super::{Config, HomeSwitch, StageConfig, Trigger};
#[cfg(doc)]
use crate::estimate::Gate;
use crate::estimate::Refusal;
#[cfg(doc)]
use crate::motion::AxisConfig;
use crate::motion::{Bound, Field};
#[cfg(doc)]
use crate::track::pursuit::Settings;
use serde::{Deserialize, Serialize};

/// Reason for the denial of a command. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Denial {
    /// The station has no configuration yet.
    Unconfigured,
    /// The stage is moving.
    Moving,
    /// The position is unknown or degraded: home or zero the stage first.
    PositionUnknown,
    /// The station is stopped: reset it first.
    Stopped,
    /// A fault is latched: reset the station first.
    Faulted,
    /// The cause of the fault is still present.
    CauseRemains,
    /// A value of the configuration is impossible.
    Config(ConfigField),
    /// The sums give no usable displacement.
    Estimate(Refusal),
    /// The capture time lies in the future, or at a port word that is not emitted yet.
    CaptureInFuture,
    /// The capture time lies before the recorded history of positions.
    CaptureTooOld,
    /// The capture time is not after that of the last frame used.
    CaptureOutOfOrder,
    /// The keyframe is neither the present one nor a recent frame set.
    UnknownReference,
    /// The move leads onto a tripped limit switch.
    LimitSwitch,
    /// No target that the stage can follow moves this fast. A second frame that agrees is accepted.
    Outlier,
    /// The position is unknown, and the move leads farther from where it became unknown than the
    /// configuration allows.
    OutsideWindow,
    /// An axis to home has no home switch, or the command names no axis.
    NoHomeSwitch,
    /// A stop that was sent later arrived before the command took effect.
    Dropped,
    /// The axis stands outside its travel: it can only move inwards, and the station does not
    /// follow a target.
    OutsideTravel {
        /// Axis, from 0.
        axis: u8,
    },
    /// No ping arrived within the heartbeat timeout: the host must send pings before it moves the
    /// stage.
    NoHeartbeat,
    /// A fault appeared that no status has reported yet: read the status, then reset.
    FaultUnread,
    /// The motors are off.
    MotorsOff,
    /// The board has no camera pin.
    NoCameraPin,
}

/// Invalid part of a configuration. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ConfigField {
    /// The matrix is singular: its determinant is below one thousandth.
    Matrix,
    /// The driver does not support this board's word rate.
    Driver,
    /// A number lies beyond a bound.
    Value {
        /// Setting that is refused.
        setting: Setting,
        /// Axis of the setting, from 0; `None` for a setting without axis.
        axis: Option<u8>,
        /// Nearest value that is accepted.
        bound: Bound,
    },
}

/// Numeric setting of the configuration. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Setting {
    /// [`AxisConfig::steps_per_m`].
    StepsPerM,
    /// [`AxisConfig::max_speed_um_s`].
    MaxSpeed,
    /// [`AxisConfig::max_acceleration_um_s2`].
    MaxAcceleration,
    /// [`AxisConfig::max_jerk_um_s3`].
    MaxJerk,
    /// The low end of [`AxisConfig::travel_um`].
    TravelLow,
    /// The high end of [`AxisConfig::travel_um`].
    TravelHigh,
    /// [`Gate::max_sigma_nm`]; the axis is one of the camera.
    GateSigma,
    /// [`Gate::max_displacement_nm`].
    GateDisplacement,
    /// [`Config::heartbeat_ms`].
    Heartbeat,
    /// [`Config::slow_speed_um_s`].
    SlowSpeed,
    /// [`Settings::coast_ms`].
    Coast,
    /// [`StageConfig::backlash_um`].
    Backlash,
    /// [`HomeSwitch::position_um`].
    HomePosition,
    /// First element of [`StageConfig::home_speed_um_s`].
    HomeSpeedFirst,
    /// Second element of [`StageConfig::home_speed_um_s`].
    HomeSpeedSecond,
    /// [`StageConfig::back_off_um`].
    BackOff,
    /// [`StageConfig::window_um`].
    Window,
    /// [`StageConfig::largest_error_um`].
    LargestError,
    /// [`StageConfig::longest_error_ms`].
    LongestError,
    /// [`StageConfig::unseen_um`].
    Unseen,
    /// [`Trigger::rate_hz`].
    TriggerRate,
    /// [`Trigger::pulse_us`].
    TriggerPulse,
    /// [`Trigger::quiet_us`].
    TriggerQuiet,
}

impl Setting {
    /// Returns the name of the setting in the configuration.
    pub const fn name(self) -> &'static str {
        match self {
            Self::StepsPerM => Field::StepsPerM.name(),
            Self::MaxSpeed => Field::MaxSpeed.name(),
            Self::MaxAcceleration => Field::MaxAcceleration.name(),
            Self::MaxJerk => Field::MaxJerk.name(),
            Self::TravelLow => Field::TravelLow.name(),
            Self::TravelHigh => Field::TravelHigh.name(),
            Self::GateSigma => "max_sigma_nm",
            Self::GateDisplacement => "max_displacement_nm",
            Self::Heartbeat => "heartbeat_ms",
            Self::SlowSpeed => "slow_speed_um_s",
            Self::Coast => "coast_ms",
            Self::Backlash => "backlash_um",
            Self::HomePosition => "home.position_um",
            Self::HomeSpeedFirst => "home_speed_um_s[0]",
            Self::HomeSpeedSecond => "home_speed_um_s[1]",
            Self::BackOff => "back_off_um",
            Self::Window => "window_um",
            Self::LargestError => "largest_error_um",
            Self::LongestError => "longest_error_ms",
            Self::Unseen => "unseen_um",
            Self::TriggerRate => "trigger.rate_hz",
            Self::TriggerPulse => "trigger.pulse_us",
            Self::TriggerQuiet => "trigger.quiet_us",
        }
    }
}

impl From<Field> for Setting {
    fn from(field: Field) -> Self {
        match field {
            Field::StepsPerM => Self::StepsPerM,
            Field::MaxSpeed => Self::MaxSpeed,
            Field::MaxAcceleration => Self::MaxAcceleration,
            Field::MaxJerk => Self::MaxJerk,
            Field::TravelLow => Self::TravelLow,
            Field::TravelHigh => Self::TravelHigh,
        }
    }
}

impl core::fmt::Display for ConfigField {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Matrix => f.write_str("the matrix is singular"),
            Self::Driver => f.write_str("the driver does not support this board's word rate"),
            Self::Value {
                setting,
                axis,
                bound,
            } => {
                f.write_str(setting.name())?;
                if let Some(axis) = axis {
                    write!(f, " of axis {axis}")?;
                }
                write!(f, " {bound}")
            }
        }
    }
}

impl core::fmt::Display for Denial {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let text = match self {
            Self::Unconfigured => "no configuration yet",
            Self::Moving => "the stage is moving",
            Self::PositionUnknown => "the position is unknown: home or zero first",
            Self::Stopped => "stopped: reset first",
            Self::Faulted => "a fault is latched: reset first",
            Self::CauseRemains => "the cause of the fault is still present",
            Self::Config(field) => return write!(f, "configuration: {field}"),
            Self::Estimate(refusal) => return write!(f, "estimate refused: {refusal}"),
            Self::CaptureInFuture => "the capture time lies in the future",
            Self::CaptureTooOld => "the capture time is too old",
            Self::CaptureOutOfOrder => "the capture time is not after that of the last frame used",
            Self::UnknownReference => {
                "the keyframe is neither the present one nor a recent frame set"
            }
            Self::LimitSwitch => "the move leads onto a tripped limit switch",
            Self::Outlier => {
                "the target moved too far for one frame: a second frame that agrees is accepted"
            }
            Self::OutsideWindow => {
                "the position is unknown, and the move is too long for that: home or zero first"
            }
            Self::NoHomeSwitch => "an axis to home has no home switch",
            Self::Dropped => "dropped, because a stop came later",
            Self::OutsideTravel { axis } => {
                return write!(f, "axis {axis} stands outside its travel");
            }
            Self::NoHeartbeat => "no ping came within the heartbeat timeout",
            Self::FaultUnread => {
                "a fault appeared that no status has reported yet: read the status, then reset"
            }
            Self::MotorsOff => "the motors are off",
            Self::NoCameraPin => "the board has no camera pin",
        };
        f.write_str(text)
    }
}
