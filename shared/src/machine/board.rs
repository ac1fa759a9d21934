//! The board around the machine.

use crate::frame::message::{LastRun, ResetCause};
use crate::steps::WordRate;

/// Properties of the board, as its shell states them.
///
/// ```
/// use trinocular_core::frame::message::{LastRun, ResetCause};
/// use trinocular_core::machine::{Board, Machine, Output};
/// use trinocular_core::safety::State;
/// use trinocular_core::{steps::WordRate, time::Instant};
///
/// let mut machine = Machine::new(Board {
///     name: "example",
///     version: [1, 0, 0],
///     word_rate: WordRate::MHZ_1,
///     delay_us: 512,
///     session: 1,
///     reset_cause: ResetCause::PowerOn,
///     last_run: LastRun::UNKNOWN,
///     camera_pin: None,
/// });
/// // The shell polls with its own time and the room in its ring of port words.
/// let Output::Segment(pause) = machine.poll(Instant::from_micros(0), 1_000) else { panic!() };
/// assert_eq!((pause.slots(), pause.displacement()), (125, [0; 3]));
/// let next = Instant::from_micros(250);
/// assert_eq!(machine.poll(Instant::from_micros(0), 1_000), Output::Idle(next));
/// assert_eq!(machine.state(), State::Unconfigured);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Board {
    /// Name of the board, at most 16 bytes.
    pub name: &'static str,
    /// Version of the firmware.
    pub version: [u8; 3],
    /// Port words per second.
    pub word_rate: WordRate,
    /// Delay from the moment `poll` hands out a segment to its first word on the pins, µs.
    pub delay_us: u32,
    /// Number that differs after every start.
    pub session: u32,
    /// Reason for the last start.
    pub reset_cause: ResetCause,
    /// Record of the run before that start.
    pub last_run: LastRun,
    /// Pin of the step port that triggers cameras, 0 to 15; `None` if the board has none.
    pub camera_pin: Option<u8>,
}
