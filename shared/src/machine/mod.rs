//! The station's logic: bytes and switches in, bytes and segments out.
//!
//! The shell around it (firmware, QEMU, the host's twin) owns the clock and the wires:
//!
//! * [`Machine::receive`] takes bytes from the link whenever they arrive;
//! * [`Machine::sense`] takes the switches, and the number of port words that the step engine has
//!   emitted;
//! * [`Machine::poll`] returns what the shell must do next: send bytes, feed a segment to the step
//!   generator, or wait.
//!
//! # Ticks
//! The station works in control ticks of 1 ms: tick `k` is at `k` ms of the station's clock. Inputs
//! between two ticks take effect at the later one, and every answer and status names its tick; so a
//! log of (tick, input) replays to the same bits on any shell. Each tick plans four segments of 250
//! µs, which `poll` hands out one after the other when they are due.
//!
//! # Order within a tick
//! Switches and heartbeat, then a stop, then the commands that came after the stop in their order,
//! then motion. A stop overrides the commands before it: those that have not taken effect yet are
//! dropped, and answered as such.

mod active;
mod board;
mod command;
mod conversation;
mod fault;
mod follow;
mod homing;
mod inbox;
mod motors;
mod moves;
mod outbox;
mod triggers;
mod window;

use crate::frame::encode::{Bytes, encode};
use crate::frame::message::{Command, Denial, Drops, End, EstimateReport, Packet, ResetCause};
use crate::frame::receive::{Receiver, Reject};
use crate::motion::Planner;
use crate::safety::{Fault, Faults, Inputs, State, Trust};
use crate::steps::{CameraEdges, Position, Segment};
use crate::time::Instant;
use crate::track::history::History;
use crate::track::{StepVector, Tracker};
use active::Active;
use conversation::stamped;
use homing::Homing;
use inbox::Inbox;
use outbox::Outbox;
use triggers::Triggers;
use window::Window;

pub use active::{check, limit_field};
pub use board::Board;

/// Length of a control tick, µs.
pub const TICK_US: u64 = 1000;

/// Segments per control tick.
const SEGMENTS: u8 = 4;

/// Length of a segment, µs.
pub const SEGMENT_US: u64 = TICK_US / SEGMENTS as u64;

/// Longest interval between two statuses, ticks.
const STATUS_TICKS: u64 = 100;

/// Largest delay of the shell before motion is stopped, µs.
const MAX_LAG_US: u64 = 2_000;

/// Action that the shell must take.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant)] // no alloc
pub enum Output {
    /// Send these bytes to the host.
    Send(Bytes),
    /// Feed this segment to the step generator.
    Segment(Segment),
    /// Wait until this instant, unless bytes or switches arrive.
    Idle(Instant),
}

/// Inputs that count at the next tick however short they are.
#[derive(Clone, Copy, Debug, Default)]
struct LatchedInputs {
    emergency_stop: bool,
    driver_fault: bool,
}

/// State of the station, and its only entry points: [`Machine::receive`], [`Machine::sense`] and
/// [`Machine::poll`].
///
/// ```
/// use trinocular_core::frame::encode::encode;
/// use trinocular_core::frame::message::{Command, LastRun, Packet, Report, ResetCause};
/// use trinocular_core::frame::receive::Receiver;
/// use trinocular_core::machine::{Board, Machine, Output};
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
/// // The shell passes bytes on as they come, and sends what `poll` returns.
/// let hello = encode(&Packet { sequence: 1, command: Command::Hello })?;
/// machine.receive(Instant::from_micros(100), &hello);
/// let mut reports = Receiver::<Report>::default();
/// let sent = (0..50).find_map(|tick| match machine.poll(Instant::from_micros(1_000 * tick), 0) {
///     Output::Send(bytes) => reports.next(&mut &bytes[..]),
///     _ => None,
/// });
/// assert!(matches!(sent, Some(Ok(Report::Hello(hello))) if hello.board == "example"));
/// # Ok::<(), trinocular_core::frame::encode::TooLong>(())
/// ```
#[derive(Clone, Debug)]
pub struct Machine {
    board: Board,
    receiver: Receiver<Packet>,
    /// Last accepted sequence number; `None` before the first hello.
    sequence: Option<u16>,
    inbox: Inbox,
    outbox: Outbox,
    inputs: Inputs,
    /// Inputs sensed since the last tick that forbid any motion.
    latched_inputs: LatchedInputs,
    /// True if an emergency stop or a driver's fault counts in this tick.
    forbidden: bool,

    /// Next control tick.
    tick: u64,
    /// Segments of the present tick already handed out; [`SEGMENTS`] when the next tick is due.
    emitted_segments: u8,
    started: bool,
    /// Port words in all segments handed out.
    words_planned: u64,
    /// Tick of the last ping; `None` before the first.
    last_ping_tick: Option<u64>,
    /// Tick of the last status.
    last_status_tick: u64,

    active: Option<Active>,
    planner: Option<Planner>,
    history: History,
    tracker: Tracker,
    state: State,
    /// Faults latched since the last reset. While there is one, the state is `Stopping` or
    /// `Faulted`.
    faults: Faults,
    /// Faults that the last status reported.
    reported_faults: Faults,
    trust: Trust,
    /// Axes whose zero is known; all of them when the trust is `Homed`.
    referenced: [bool; 3],
    /// Limits of motion while the position is unknown.
    window: Window,
    /// True while the drivers hold the motors.
    motors: bool,
    /// Tick since which the stage is at rest.
    rests: u64,
    homing: Option<Homing>,
    /// Home switch of a search that was abandoned, axis and end, until the stage is at rest.
    abandoned_switch: Option<(usize, usize)>,
    frames_used: u32,
    frames_refused: u32,
    drops: Drops,
    estimate: Option<EstimateReport>,
    triggers: Triggers,
}

impl Machine {
    /// Creates a station that was just switched on. After an unexpected restart, [`Fault::Restart`]
    /// is latched.
    pub fn new(board: Board) -> Self {
        let unexpected = matches!(
            board.reset_cause,
            ResetCause::Watchdog | ResetCause::BrownOut
        ) || board.last_run.end != End::Outside;
        Self {
            board,
            receiver: Receiver::default(),
            sequence: None,
            inbox: Inbox::default(),
            outbox: Outbox::default(),
            inputs: Inputs::default(),
            latched_inputs: LatchedInputs::default(),
            forbidden: false,
            tick: 0,
            emitted_segments: SEGMENTS,
            started: false,
            words_planned: 0,
            last_ping_tick: None,
            last_status_tick: 0,
            active: None,
            planner: None,
            history: History::default(),
            tracker: Tracker::default(),
            state: match unexpected {
                true => State::Faulted,
                false => State::default(),
            },
            faults: unexpected.then_some(Fault::Restart).into_iter().collect(),
            reported_faults: Faults::NONE,
            trust: Trust::default(),
            referenced: [false; 3],
            window: Window::default(),
            motors: false,
            rests: 0,
            homing: None,
            abandoned_switch: None,
            frames_used: 0,
            frames_refused: 0,
            drops: Drops::default(),
            estimate: None,
            triggers: Triggers::default(),
        }
    }

    /// Takes bytes from the link, in any chunking.
    pub fn receive(&mut self, now: Instant, mut bytes: &[u8]) {
        while let Some(outcome) = self.receiver.next(&mut bytes) {
            self.take(now, outcome);
        }
    }

    /// Takes a packet, or the reason for a reject. For shells with several links, which have a
    /// [`Receiver`] for each.
    pub fn take(&mut self, now: Instant, outcome: Result<Packet, Reject>) {
        match outcome {
            Ok(packet) => self.accept(now, packet),
            Err(reject) => self.drops.rejects.count(reject),
        }
    }

    /// Takes the switches and the progress of the step engine, which take effect at the next tick.
    ///
    /// An emergency stop or a driver's fault that ends before the next tick is not lost: it counts
    /// there as if it were present.
    pub fn sense(&mut self, inputs: Inputs) {
        self.inputs = inputs;
        self.latched_inputs.emergency_stop |= inputs.emergency_stop;
        self.latched_inputs.driver_fault |= inputs.driver_fault;
    }

    /// Returns the action at `now`. Call again at once after any output but [`Output::Idle`].
    ///
    /// `room` is the number of port words that the shell can still queue; a segment is handed out
    /// only if it fits.
    pub fn poll(&mut self, now: Instant, room: usize) -> Output {
        let report = self.outbox.next();
        if let Some(Ok(bytes)) = report.map(|report| encode(&stamped(report, now))) {
            return Output::Send(bytes);
        }
        if !self.started {
            // The first tick at or after the first poll.
            self.started = true;
            self.tick = now.micros().div_ceil(TICK_US);
        }
        let due = self.due();
        let words = usize::from(self.board.word_rate.slots_per_segment()) * 2;
        if now < due {
            return Output::Idle(due);
        }
        if room < words {
            // The ring plays as much within a segment's time.
            return Output::Idle(now.plus_micros(SEGMENT_US));
        }
        if now.since(due) > MAX_LAG_US {
            self.catch_up(now);
        }
        if self.emitted_segments == SEGMENTS {
            self.control();
            self.emitted_segments = 0;
        }
        let due = self.due();
        self.emitted_segments += 1;
        self.words_planned = self.words_planned.saturating_add(words as u64);
        let segment = self.next_segment();
        self.plan_triggers(due, &segment);
        if self.emitted_segments == SEGMENTS {
            self.remember();
            self.tick = self.tick.saturating_add(1);
        }
        Output::Segment(segment)
    }

    /// Returns the state.
    pub fn state(&self) -> State {
        self.state
    }

    /// Returns true if the station has a configuration. Before that the drivers stay off, in any
    /// state.
    pub fn is_configured(&self) -> bool {
        self.active.is_some()
    }

    /// Returns the worst of the latched faults, for shells that keep it across a restart.
    pub fn fault(&self) -> Option<Fault> {
        self.faults.worst()
    }

    /// Returns true if the drivers must hold the motors.
    pub fn motors_on(&self) -> bool {
        self.motors
    }

    /// Returns true for each axis that counts against its motor; the shell passes this to the step
    /// generator before each segment.
    pub fn inverted(&self) -> [bool; 3] {
        self.active.as_ref().map_or([false; 3], |active| {
            active.config.axes.map(|axis| axis.invert)
        })
    }

    /// Returns true while the cameras are triggered.
    pub fn is_triggering(&self) -> bool {
        self.triggers.are_on()
    }

    /// Returns the edges of the camera pin in the segment that [`Machine::poll`] handed out last.
    pub fn camera_edges(&self) -> CameraEdges {
        self.triggers.edges()
    }

    /// Returns the planned position of the stage, 2⁻³² steps from zero.
    pub fn position(&self) -> StepVector {
        self.planner.as_ref().map_or([0; 3], |planner| {
            planner.loads().map(Position::distance_from_zero)
        })
    }

    /// Returns the planned position of the motors, 2⁻³² steps from zero: that of the stage but for
    /// backlash. Their whole steps are where the motors stand.
    pub fn motors(&self) -> StepVector {
        self.planner.as_ref().map_or([0; 3], |planner| {
            planner.positions().map(Position::distance_from_zero)
        })
    }

    /// Returns the instant at which the next segment is due.
    fn due(&self) -> Instant {
        let emitted = if self.emitted_segments == SEGMENTS {
            0
        } else {
            self.emitted_segments
        };
        self.now().plus_micros(u64::from(emitted) * SEGMENT_US)
    }

    /// Returns the instant of the present tick.
    fn now(&self) -> Instant {
        Instant::from_micros(self.tick.saturating_mul(TICK_US))
    }

    /// Skips the time in which the shell did not poll: the pins stood still, so time passes without
    /// motion.
    fn catch_up(&mut self, now: Instant) {
        self.tick = now.micros() / TICK_US;
        self.emitted_segments = SEGMENTS;
        self.history.clear();
        if !self.stands() {
            self.fail(Fault::Underrun);
        }
    }

    fn next_segment(&mut self) -> Segment {
        match &mut self.planner {
            Some(planner) => planner.plan_segment(),
            None => Segment::pause(self.board.word_rate.slots_per_segment()),
        }
    }

    /// Records where the pins will be when this tick's words are emitted.
    fn remember(&mut self) {
        let end = self
            .now()
            .plus_micros(TICK_US + u64::from(self.board.delay_us));
        self.history.record(end, self.position());
    }

    /// Executes one control tick.
    fn control(&mut self) {
        let before = (self.state, self.faults, self.motors);
        self.watch();
        self.check_switches();
        self.check_heartbeat();
        if self.inbox.take_stop() {
            self.stop();
        }
        let mut followed = false;
        // By reference, because a command is large: each copy costs a flow frame hundreds of
        // instructions.
        while let Some(packet) = self.inbox.next() {
            followed |= matches!(packet.command, Command::Frame(_));
            let outcome = self.apply(packet.sequence, &packet.command);
            self.answer(packet.sequence, outcome);
        }
        self.check_sight();
        if !followed {
            self.swing();
        }
        self.go_on_homing();
        self.settle();
        self.rest_motors();
        self.report_triggers();
        let changed = before != (self.state, self.faults, self.motors);
        let unread = !self.faults.is_within(self.reported_faults);
        let due = self.tick.saturating_sub(self.last_status_tick) >= STATUS_TICKS;
        if followed || changed || unread || due {
            self.last_status_tick = self.tick;
            self.reported_faults = self.faults;
            let status = self.status();
            self.outbox.status(status);
        }
    }

    /// Stops on a ramp, and answers the stops and the commands that they dropped.
    fn stop(&mut self) {
        self.halt_on_ramp();
        while let Some(sequence) = self.inbox.next_dropped() {
            self.answer(sequence, Err(Denial::Dropped));
        }
        while let Some(sequence) = self.inbox.next_stop() {
            self.answer(sequence, Ok(()));
        }
    }
}
