//! Messages of the protocol. `schema.txt` lists them in words; tests compare it with this file.

use super::{PROTOCOL, SCHEMA_HASH};
use crate::estimate::{Gate, Refusal};
use crate::motion::{AxisConfig, Bound};
use crate::safety::{Fault, Faults, State, Trust};
use crate::steps::DriverTiming;
use crate::sums::centred::FixedCentredSums;
use crate::sums::pair::FixedPairSums;
use crate::time::Instant;
use crate::track::pursuit::{Settings, Sight};
use serde::{Deserialize, Serialize};

/// Message from the host to the station.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Packet {
    /// Sequence number: counts up by one per packet, modulo 65536.
    #[serde(with = "postcard::fixint::le")]
    pub sequence: u16,
    /// Command to execute.
    pub command: Command,
}

/// A request to the station. The wire numbers are in `schema.txt`; append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant)] // no alloc: the largest message sets the size
pub enum Command {
    /// Starts a session: the sequence count begins here. The station replies with [`Report::Hello`]
    /// and [`Report::LastRun`].
    Hello,
    /// Replaces the whole configuration. Requires rest; the station refuses the whole if any value
    /// is impossible.
    Config(Config),
    /// Gives the flow sums of one frame set.
    Frame(Frame),
    /// Moves to a stage position. Requires a known position.
    Setpoint {
        /// Absolute stage position per axis, µm.
        position_um: [i32; 3],
    },
    /// Moves by a distance from where the axes are; slowly while the position is unknown.
    ///
    /// In motion it replaces the rest of an earlier move of the axes that it names, and never
    /// reverses an axis against the direction of its own distance. Other axes continue their
    /// earlier move. The distance is rounded to whole steps and clamped to the soft limits.
    Jog {
        /// Distance per stage axis, µm.
        distance_um: [i32; 3],
    },
    /// Declares the present position to be zero on all axes. Requires rest.
    Zero,
    /// Ramps down at once; the station then stays stopped until a reset.
    Stop,
    /// Clears a fault or a stop whose cause is gone.
    Reset,
    /// Heartbeat and time synchronisation. The station replies with [`Report::Pong`].
    Ping {
        /// The host's clock, µs; the reply returns it unchanged.
        host_us: u64,
    },
    /// Finds the home switches of these axes, one axis after the other: Z, X, Y. Requires rest. The
    /// switches define the position.
    Home {
        /// Axes to home; each needs a home switch in the configuration.
        axes: [bool; 3],
    },
    /// Switches the motors on or off. Requires rest. Motors without current lose the position, so
    /// that a known position becomes degraded.
    Motors {
        /// True switches the motors on.
        on: bool,
    },
}

/// Flow frame: the target's flow since the keyframe, as the cameras on the stage saw it.
///
/// The word *frame* means this message and nothing else in the project; the protocol keeps it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Capture time of the frame set, station time.
    pub capture: Instant,
    /// Capture time of the keyframe that the flow is measured against, station time.
    pub reference: Instant,
    /// Flow sums.
    pub sums: Sums,
}

/// Flow sums of one kind, which also selects the estimator. On the wire each kind is a command of
/// its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sums {
    /// Sums for the paper's closed form.
    ClosedForm(FixedPairSums),
    /// Sums for the midpoint estimator.
    Midpoint(FixedCentredSums),
}

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

/// Message from the station to the host. Append-only.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Report {
    /// Identity of the station.
    Hello(Hello),
    /// Reply to a ping.
    Pong {
        /// The host's clock as in the ping, µs.
        host_us: u64,
        /// Instant at which the ping arrived.
        received: Instant,
        /// Instant at which this reply was made.
        sent: Instant,
    },
    /// State of the station: sent after every flow frame, on every change of state, and ten times a
    /// second.
    Status(Status),
    /// Answer to a command other than hello and ping.
    Answer {
        /// Sequence number of the command.
        sequence: u16,
        /// Control tick at which the command took effect.
        tick: u32,
        /// Acceptance, or the reason for a denial.
        outcome: Outcome,
    },
    /// Record of the run before the present start, sent after every hello. A message of its own, so
    /// that hosts of any version can read the hello.
    LastRun(LastRun),
}

/// Identity of the station.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hello {
    /// [`PROTOCOL`] of the firmware.
    pub protocol: u16,
    /// [`SCHEMA_HASH`] of the firmware.
    pub schema: u32,
    /// Major, minor, patch of the firmware.
    pub version: [u8; 3],
    /// Name of the board, for people.
    pub board: heapless::String<16>,
    /// Port words per second, Hz.
    pub word_rate_hz: u32,
    /// Delay from the control tick to its first port word, µs.
    pub delay_us: u32,
    /// Number that differs after every start.
    pub session: u32,
    /// Reason for the last start.
    pub reset_cause: ResetCause,
}

/// Reason for a start of the station. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ResetCause {
    /// Power-on.
    PowerOn,
    /// Brown-out: the supply dipped.
    BrownOut,
    /// Reset pin.
    Pin,
    /// Reset requested by software.
    Software,
    /// Watchdog timeout.
    Watchdog,
}

/// Record of the run before the present start, in memory that a reset does not clear. Power-on
/// clears it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LastRun {
    /// Starts since power-on, the present one included; 0 from a station that does not count.
    pub starts: u32,
    /// Fault that was latched at the end of the run.
    pub fault: Option<Fault>,
    /// Cause of the end of the run.
    pub end: End,
    /// Addresses in the program, 0 for none: the instruction that failed, then the apparent return
    /// addresses on the stack (odd, as in Thumb code), innermost first.
    pub places: [u32; PLACES],
}

impl LastRun {
    /// Record of a station that keeps nothing across its starts.
    pub const UNKNOWN: Self = Self {
        starts: 0,
        fault: None,
        end: End::Outside,
        places: [0; PLACES],
    };
}

/// Number of addresses in a [`LastRun`].
pub const PLACES: usize = 6;

/// Cause of the end of a run. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum End {
    /// External cause: power, the reset pin, or a watchdog timeout ([`Hello::reset_cause`] says
    /// which).
    Outside,
    /// Panic of the program.
    Panic,
    /// Fault of the processor.
    HardFault,
}

impl Hello {
    /// Returns the fields in which the station differs from this host, and which therefore keep the
    /// host from moving it. Empty if they agree.
    pub fn mismatches(&self) -> heapless::Vec<Mismatch, 2> {
        let ours = [
            ("protocol", u32::from(self.protocol), u32::from(PROTOCOL)),
            ("schema", self.schema, SCHEMA_HASH),
        ];
        let differ = ours
            .into_iter()
            .filter(|(_, station, host)| station != host);
        differ
            .map(|(field, station, host)| Mismatch {
                field,
                station,
                host,
            })
            .collect()
    }
}

/// Field of [`Hello`] in which station and host differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mismatch {
    /// Name of the field.
    pub field: &'static str,
    /// Value of the station.
    pub station: u32,
    /// Value of the host.
    pub host: u32,
}

/// State of the station at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// Instant at which this status was made.
    pub time: Instant,
    /// Control ticks since the start, modulo 2^32.
    pub tick: u32,
    /// Activity of the station.
    pub state: State,
    /// Worst of the latched faults.
    pub fault: Option<Fault>,
    /// Trust in `position_steps`.
    pub trust: Trust,
    /// Planned stage position at the start of this tick, whole steps.
    pub position_steps: [i32; 3],
    /// Target of the motion, whole steps.
    pub target_steps: [i32; 3],
    /// Number of flow frames used, modulo 2^32.
    pub frames_used: u32,
    /// Number of flow frames refused, modulo 2^32.
    pub frames_refused: u32,
    /// Counts of packets that were invalid or out of sequence.
    pub drops: Drops,
    /// Estimate from the last flow frame that was used.
    pub estimate: Option<EstimateReport>,
    /// State of the target track.
    pub sight: Sight,
    /// Time since the target was last seen, ms, saturating; 0 while the station does not follow.
    pub seen_ms: u16,
    /// All latched faults; [`Status::fault`] is the worst of them.
    pub faults: Faults,
    /// True while the motors are on.
    pub motors: bool,
}

/// Counts of packets that had no effect; the counts saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Drops {
    /// Byte sequences that were not valid packets.
    pub rejects: super::receive::Rejects,
    /// Packets with the sequence number of the last one.
    pub duplicate: u16,
    /// Packets with a sequence number behind the last one.
    pub stale: u16,
    /// Commands beyond the number that one control tick takes.
    pub overflow: u16,
    /// Answers and other reports that found no room in the queue.
    pub answers: u16,
}

/// Estimate from one flow frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EstimateReport {
    /// Sequence number of the flow frame.
    pub sequence: u16,
    /// Displacement of the target since the keyframe, camera axes, nm.
    pub displacement_nm: [i32; 3],
    /// Standard deviation of the displacement, nm; `None` for the paper's estimators.
    pub sigma_nm: Option<[u32; 3]>,
    /// Latency from the capture time to the first port word that the frame can change, µs.
    pub latency_us: u32,
}

/// Outcome of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Outcome {
    /// Accepted.
    Accepted,
    /// Denied for this reason; the command changed nothing.
    Denied(Denial),
}

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
}

impl Setting {
    /// Returns the name of the setting in the configuration.
    pub const fn name(self) -> &'static str {
        match self {
            Self::StepsPerM => "steps_per_m",
            Self::MaxSpeed => "max_speed_um_s",
            Self::MaxAcceleration => "max_acceleration_um_s2",
            Self::MaxJerk => "max_jerk_um_s3",
            Self::TravelLow => "travel_um[0]",
            Self::TravelHigh => "travel_um[1]",
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
        };
        f.write_str(text)
    }
}
