//! Messages of the protocol. `schema.txt` lists them in words; tests compare it with this module.

use super::{PROTOCOL, SCHEMA_HASH};
use crate::safety::{Fault, Faults, State, Trust};
use crate::sums::centred::FixedCentredSums;
use crate::sums::pair::FixedPairSums;
use crate::time::Instant;
use crate::track::pursuit::Sight;
use serde::{Deserialize, Serialize};

mod configuration;
mod denial;
mod trigger;

pub use configuration::{Config, HomeSwitch, MATRIX_BITS, Mounting, Side, StageConfig};
pub use denial::{ConfigField, Denial, Setting};
pub use trigger::{Trigger, Triggered};

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
    /// Starts the triggers of cameras anew, with the number 1, or ends them. Possible in any state,
    /// with or without a configuration.
    Trigger(Trigger),
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
    /// A trigger that the cameras got.
    Triggered(Triggered),
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

impl EstimateReport {
    /// Returns the displacement, mm.
    pub fn displacement_mm(&self) -> [f64; 3] {
        self.displacement_nm.map(|nm| f64::from(nm) * MM_PER_NM)
    }

    /// Returns the standard deviation of the displacement, mm.
    pub fn sigma_mm(&self) -> Option<[f64; 3]> {
        let sigma = self.sigma_nm?;
        Some(sigma.map(|nm| f64::from(nm) * MM_PER_NM))
    }
}

const MM_PER_NM: f64 = 1e-6;

/// Outcome of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Outcome {
    /// Accepted.
    Accepted,
    /// Denied for this reason; the command changed nothing.
    Denied(Denial),
}
