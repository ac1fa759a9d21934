//! The messages. `schema.txt` lists them in words; keep the two together (tests compare them).

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

/// What the host sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Packet {
    /// Counts up by one per packet, modulo 65536.
    #[serde(with = "postcard::fixint::le")]
    pub sequence: u16,
    /// What to do.
    pub command: Command,
}

/// A request to the station. The wire numbers are in `schema.txt`; append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant)] // no alloc: the largest message sets the size
pub enum Command {
    /// Starts a session: the sequence count begins here. Answered by [`Report::Hello`] and
    /// [`Report::LastRun`].
    Hello,
    /// Replaces the whole configuration. Only at rest; refused as a whole if any value is
    /// impossible.
    Config(Config),
    /// One frame's flow sums.
    Frame(Frame),
    /// Move to a stage position. Needs a known position.
    Setpoint {
        /// Absolute stage position per axis, µm.
        position_um: [i32; 3],
    },
    /// Move by a distance from where the axes are; slowly while the position is unknown.
    ///
    /// In motion it replaces what is left of an earlier move of the axes that it names, and never
    /// turns an axis against its own direction. Other axes go on to where an earlier move sends
    /// them. Rounded to whole steps, and clamped to the soft limits.
    Jog {
        /// Distance per stage axis, µm.
        distance_um: [i32; 3],
    },
    /// Declares the present position to be zero on all axes. Only at rest.
    Zero,
    /// Ramps down at once and stays stopped until a reset.
    Stop,
    /// Clears a fault or a stop whose cause is gone.
    Reset,
    /// Heartbeat and time sync. Answered by [`Report::Pong`].
    Ping {
        /// The host's clock, µs; returned as it is.
        host_us: u64,
    },
    /// Find the home switches of these axes, one axis after the other: Z, X, Y. Only at rest. What
    /// the switches find becomes the position.
    Home {
        /// Which axes; each needs a home switch in the configuration.
        axes: [bool; 3],
    },
    /// Switches the motors on or off. Only at rest; motors without current lose the position, so
    /// that a known one is degraded.
    Motors {
        /// On.
        on: bool,
    },
}

/// One frame: the target's flow since the reference instant, as the cameras on the stage saw it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// When the images were taken, station time.
    pub capture: Instant,
    /// When the images that the flow is measured against were taken, station time.
    pub reference: Instant,
    /// The sums.
    pub sums: Sums,
}

/// The sums, which also choose the estimator. On the wire each kind is a command of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sums {
    /// For the paper's closed form.
    ClosedForm(FixedPairSums),
    /// For the midpoint estimator.
    Midpoint(FixedCentredSums),
}

/// Everything the station must know about the stage. It keeps none of it across a restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Config {
    /// Resolution and limits of the stage's axes.
    pub axes: [AxisConfig; 3],
    /// Camera axes to stage axes, row by row, Q2.29 (±4): `stage = matrix camera`.
    pub matrix: [[i32; 3]; 3],
    /// What the motor drivers need of STEP and DIR.
    pub driver: DriverTiming,
    /// When an estimate is not used.
    pub gate: Gate,
    /// Longest silence of the host while moving, ms. 20 to 10000.
    pub heartbeat_ms: u16,
    /// Fastest motion while the position is unknown, µm/s.
    pub slow_speed_um_s: u32,
    /// Whether the cameras ride on the stage.
    pub mounting: Mounting,
    /// How the target is followed.
    pub tracking: Settings,
    /// Lost motion, home switches, and what is watched.
    pub stage: StageConfig,
}

/// What the station must know of the stage beyond its axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageConfig {
    /// Lost motion of each axis when it turns round, µm; 0 is none. Rounded to whole steps.
    pub backlash_um: [u16; 3],
    /// The home switch of each axis.
    pub home: [Option<HomeSwitch>; 3],
    /// Speed towards a home switch the first and the second time, µm/s.
    pub home_speed_um_s: [u32; 2],
    /// How far an axis backs off from its home switch, µm.
    pub back_off_um: u32,
    /// While the position is unknown: how far an axis may go from where that began, µm.
    pub window_um: u32,
    /// Longest distance between target and stage while following, on any axis, µm; 0 is any.
    pub largest_error_um: u32,
    /// For how long it may be longer, ms.
    pub longest_error_ms: u16,
    /// How far the stage may move towards the target without the cameras seeing it come nearer, on
    /// any axis, µm; 0 is any. Only with prediction.
    pub unseen_um: u32,
    /// Time at rest after which the motors are switched off, s; 0 is never. Following is no rest.
    pub motors_off_after_s: u16,
}

/// A limit switch that also says where the axis is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HomeSwitch {
    /// Which of the axis's two switches it is.
    pub side: Side,
    /// Where it trips on the way onto it, µm from zero.
    pub position_um: i32,
}

/// An end of an axis. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// The one that is met going backwards.
    Negative,
    /// The one that is met going forwards.
    Positive,
}

impl StageConfig {
    /// No lost motion, no home switches; 10 and 1 mm/s and 2 mm to back off if there were any; 10
    /// mm while the position is unknown; nothing watched; the motors stay on.
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

/// Where the cameras are. Append-only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mounting {
    /// On the stage, which keeps their view of the target constant: the servo of the paper.
    #[default]
    OnStage,
    /// Beside it: the stage copies the target's motion as resting cameras see it (recorded images,
    /// for one).
    Fixed,
}

/// Fraction bits of [`Config::matrix`].
pub const MATRIX_BITS: u32 = 29;

/// What the station sends. Append-only.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Report {
    /// Who it is.
    Hello(Hello),
    /// Reply to a ping.
    Pong {
        /// As in the ping.
        host_us: u64,
        /// When the ping arrived.
        received: Instant,
        /// When this reply was made.
        sent: Instant,
    },
    /// How it is: after every frame, on every change of state, and ten times a second.
    Status(Status),
    /// What became of a command (all but hello and ping).
    Answer {
        /// The command's sequence number.
        sequence: u16,
        /// The control tick at which it took effect.
        tick: u32,
        /// Accepted, or refused and why.
        outcome: Outcome,
    },
    /// What was before it started: after every hello. A message of its own, so that hello stays
    /// readable for hosts of any version.
    LastRun(LastRun),
}

/// Who the station is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hello {
    /// [`PROTOCOL`] of the firmware.
    pub protocol: u16,
    /// [`SCHEMA_HASH`] of the firmware.
    pub schema: u32,
    /// Major, minor, patch of the firmware.
    pub version: [u8; 3],
    /// The board, for people.
    pub board: heapless::String<16>,
    /// Port words per second, Hz.
    pub word_rate_hz: u32,
    /// From the control tick to its first port word, µs.
    pub delay_us: u32,
    /// A number that differs after every start.
    pub session: u32,
    /// Why the station last started.
    pub reset_cause: ResetCause,
}

/// Why the station started. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ResetCause {
    /// Power came.
    PowerOn,
    /// The supply dipped.
    BrownOut,
    /// The reset pin.
    Pin,
    /// Software asked for it.
    Software,
    /// The watchdog was not fed.
    Watchdog,
}

/// What the station remembers of the time before its present start, in memory that a reset does not
/// clear. Power-on forgets it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LastRun {
    /// Starts since power-on, the present one included; 0 from a station that does not count.
    pub starts: u32,
    /// The fault that was latched when it ended.
    pub fault: Option<Fault>,
    /// How it ended.
    pub end: End,
    /// Addresses in the program, 0 is none: the instruction that failed, then what on the stack
    /// looks like return addresses (odd, as Thumb has them), innermost first.
    pub places: [u32; PLACES],
}

impl LastRun {
    /// Of a station that keeps nothing across its starts.
    pub const UNKNOWN: Self = Self {
        starts: 0,
        fault: None,
        end: End::Outside,
        places: [0; PLACES],
    };
}

/// Addresses in a [`LastRun`].
pub const PLACES: usize = 6;

/// How a run of the program ended. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum End {
    /// Not by itself: power, the pin, or a watchdog that nobody fed ([`Hello::reset_cause`] says
    /// which).
    Outside,
    /// It panicked.
    Panic,
    /// The processor faulted.
    HardFault,
}

impl Hello {
    /// Names what keeps this host from moving that station, field by field. Empty when they fit.
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

/// A field of [`Hello`] in which station and host differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mismatch {
    /// The field's name.
    pub field: &'static str,
    /// The station's value.
    pub station: u32,
    /// The host's value.
    pub host: u32,
}

/// The station at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// When it was made.
    pub time: Instant,
    /// Control ticks since the start, modulo 2^32.
    pub tick: u32,
    /// What it is doing.
    pub state: State,
    /// The worst of the latched faults.
    pub fault: Option<Fault>,
    /// Trust in `position_steps`.
    pub trust: Trust,
    /// Planned stage position at the start of this tick, whole steps.
    pub position_steps: [i32; 3],
    /// Where the stage is going, whole steps.
    pub target_steps: [i32; 3],
    /// Flow frames that were used, modulo 2^32.
    pub frames_used: u32,
    /// Flow frames that were refused, modulo 2^32.
    pub frames_refused: u32,
    /// Packets that were not understood, or not new.
    pub drops: Drops,
    /// The last frame that was used.
    pub estimate: Option<EstimateReport>,
    /// What is known of the target.
    pub sight: Sight,
    /// How long ago the target was seen, ms, saturating; 0 while nothing is followed.
    pub seen_ms: u16,
    /// All latched faults; [`Status::fault`] is the worst of them.
    pub faults: Faults,
    /// The motors are on.
    pub motors: bool,
}

/// Packets that changed nothing; the counts saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Drops {
    /// Bytes that were no message.
    pub rejects: super::receive::Rejects,
    /// Sequence number seen before.
    pub duplicate: u16,
    /// Sequence number from behind.
    pub stale: u16,
    /// Commands that were not done because there were more than one control tick takes.
    pub overflow: u16,
    /// Answers and other reports that found no room.
    pub answers: u16,
}

/// What the station made of one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EstimateReport {
    /// The frame's sequence number.
    pub sequence: u16,
    /// Displacement of the target since the reference, camera axes, nm.
    pub displacement_nm: [i32; 3],
    /// Its standard deviation, nm; `None` for the paper's estimators.
    pub sigma_nm: Option<[u32; 3]>,
    /// From the capture to the first port word that it can change, µs.
    pub latency_us: u32,
}

/// What became of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Outcome {
    /// Taken.
    Accepted,
    /// Nothing was changed, for this reason.
    Denied(Denial),
}

/// Why a command was refused. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Denial {
    /// There is no configuration yet.
    Unconfigured,
    /// The stage is moving.
    Moving,
    /// The position is unknown or degraded: home or zero first.
    PositionUnknown,
    /// Stopped: reset first.
    Stopped,
    /// A fault is latched: reset first.
    Faulted,
    /// The fault's cause is still there.
    CauseRemains,
    /// A value of the configuration is impossible.
    Config(ConfigField),
    /// The sums give no usable displacement.
    Estimate(Refusal),
    /// The capture lies in the future, or at a word that is not emitted yet.
    CaptureInFuture,
    /// The capture lies before the history of positions.
    CaptureTooOld,
    /// The capture is not after the last one used.
    CaptureOutOfOrder,
    /// The reference is neither the present one nor a recent capture.
    UnknownReference,
    /// The way leads onto a tripped limit switch.
    LimitSwitch,
    /// No target that the stage can follow moves so fast. A second frame that agrees is followed.
    Outlier,
    /// The position is unknown, and the way leads farther from where that began than the
    /// configuration allows.
    OutsideWindow,
    /// An axis that is to be homed has no home switch, or no axis was named.
    NoHomeSwitch,
    /// A stop that was sent later came before it was done.
    Dropped,
    /// The axis stands outside its travel: it moves inwards only, and no target is followed.
    OutsideTravel {
        /// Number from 0.
        axis: u8,
    },
    /// No ping came within the heartbeat time: the host must send pings before it moves the stage.
    NoHeartbeat,
    /// A fault appeared that no status has named so far: read the status, then reset.
    FaultUnread,
    /// The motors are off.
    MotorsOff,
}

/// Which part of a configuration is impossible. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ConfigField {
    /// The matrix is singular: its determinant is below one thousandth.
    Matrix,
    /// The driver cannot take this board's word rate.
    Driver,
    /// A number beyond a bound.
    Value {
        /// The number that is refused.
        setting: Setting,
        /// Its axis, from 0; `None` for a number that belongs to no axis.
        axis: Option<u8>,
        /// The nearest value that is accepted.
        bound: Bound,
    },
}

/// A number of the configuration. Append-only.
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
    /// [`Gate::max_sigma_nm`]; the axis is the camera's.
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
    /// The position of [`StageConfig::home`].
    HomePosition,
    /// The first of [`StageConfig::home_speed_um_s`].
    HomeSpeedFirst,
    /// The second of [`StageConfig::home_speed_um_s`].
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
    /// The field's name in the configuration.
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
            Self::Driver => f.write_str("the driver cannot take this board's word rate"),
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
            Self::CauseRemains => "the cause of the fault is still there",
            Self::Config(field) => return write!(f, "configuration: {field}"),
            Self::Estimate(refusal) => return write!(f, "estimate refused: {refusal}"),
            Self::CaptureInFuture => "the capture lies in the future",
            Self::CaptureTooOld => "the capture is too old",
            Self::CaptureOutOfOrder => "the capture is not after the last one used",
            Self::UnknownReference => {
                "the reference is neither the present one nor a recent capture"
            }
            Self::LimitSwitch => "the way leads onto a tripped limit switch",
            Self::Outlier => {
                "the target cannot have moved so far: waiting for a second frame that says so"
            }
            Self::OutsideWindow => "the position is unknown: so far away the stage may not move",
            Self::NoHomeSwitch => "an axis to be homed has no home switch",
            Self::Dropped => "dropped, because a stop came later",
            Self::OutsideTravel { axis } => {
                return write!(f, "axis {axis} stands outside its travel");
            }
            Self::NoHeartbeat => "no ping came within the heartbeat time",
            Self::FaultUnread => "a new fault has appeared that no status has named yet",
            Self::MotorsOff => "the motors are off",
        };
        f.write_str(text)
    }
}
