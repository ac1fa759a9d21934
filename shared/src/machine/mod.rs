//! The station: bytes and switches in, bytes and segments out.
//!
//! The shell around it (firmware, QEMU, the host's twin) owns the clock and the wires:
//!
//! * [`Machine::receive`] takes bytes from the link whenever they come;
//! * [`Machine::sense`] takes the switches, and how many port words the step engine has emitted;
//! * [`Machine::poll`] says what to do next: send bytes, feed a segment to the step generator, or wait.
//!
//! # Ticks
//! The station lives in control ticks of 1 ms: tick `k` is at `k` ms of the station's clock. Whatever arrives between two ticks takes effect at
//! the later one, and every answer and status names its tick; so a log of (tick, input) replays to the same bits on any shell. Each tick
//! plans four segments of 250 µs, which `poll` gives out one after the other as their time comes.
//!
//! # Order within a tick
//! Switches and heartbeat, then a stop, then the other commands in the order they came, then motion. A stop never waits in the queue.

mod active;
mod follow;

use crate::frame::encode::{Bytes, encode};
use crate::frame::message::{
    Command, Config, Denial, Drops, EstimateReport, Hello, Outcome, Packet, Report, ResetCause,
    Status,
};
use crate::frame::receive::Receiver;
use crate::frame::{PROTOCOL, SCHEMA_HASH};
use crate::motion::Planner;
use crate::safety::{Fault, Inputs, State, Trust};
use crate::steps::{Position, Segment, WordRate};
use crate::time::Instant;
use crate::track::history::History;
use crate::track::{Fine, Tracker};
use active::Active;

/// A control tick, µs.
pub const TICK_US: u64 = 1000;

/// Segments per control tick.
const SEGMENTS: u8 = 4;

/// A segment, µs.
pub const SEGMENT_US: u64 = TICK_US / SEGMENTS as u64;

/// A status goes out at least this often, ticks.
const STATUS_TICKS: u64 = 100;

/// How far the shell may fall behind before motion is stopped, µs.
const MAX_LAG_US: u64 = 2_000;

/// Commands that may wait for one tick.
const INBOX: usize = 8;

/// Reports that may wait to be sent.
const OUTBOX: usize = 8;

/// What the shell knows about the board.
#[derive(Clone, Copy, Debug)]
pub struct Board {
    /// Its name, at most 16 bytes.
    pub name: &'static str,
    /// Version of the firmware.
    pub version: [u8; 3],
    /// Port words per second.
    pub word_rate: WordRate,
    /// From the moment `poll` gives out a segment to its first word on the pins, µs.
    pub delay_us: u32,
    /// A number that differs after every start.
    pub session: u32,
    /// Why the board last started.
    pub reset_cause: ResetCause,
}

/// What the shell is to do.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant)] // no alloc
pub enum Output {
    /// Send these bytes to the host.
    Send(Bytes),
    /// Feed this segment to the step generator.
    Segment(Segment),
    /// Nothing before this instant, unless bytes or switches come.
    Idle(Instant),
}

/// The station.
#[derive(Clone, Debug)]
pub struct Machine {
    board: Board,
    receiver: Receiver<Packet>,
    /// The last accepted sequence number; `None` before the first hello.
    sequence: Option<u16>,
    inbox: heapless::Deque<Packet, INBOX>,
    stop: Option<u16>,
    outbox: heapless::Deque<Report, OUTBOX>,
    inputs: Inputs,

    /// The next control tick.
    tick: u64,
    /// Segments of the present tick already given out; [`SEGMENTS`] when the next tick is due.
    given: u8,
    started: bool,
    /// Port words in all segments given out.
    words_planned: u64,
    /// Tick of the last ping.
    heard: u64,
    /// Tick of the last status.
    told: u64,

    active: Option<Active>,
    planner: Option<Planner>,
    history: History,
    tracker: Tracker,
    state: State,
    fault: Option<Fault>,
    trust: Trust,
    frames_used: u32,
    frames_refused: u32,
    drops: Drops,
    estimate: Option<EstimateReport>,
}

impl Machine {
    /// A station that was just switched on.
    pub fn new(board: Board) -> Self {
        Self {
            board,
            receiver: Receiver::default(),
            sequence: None,
            inbox: heapless::Deque::new(),
            stop: None,
            outbox: heapless::Deque::new(),
            inputs: Inputs::default(),
            tick: 0,
            given: SEGMENTS,
            started: false,
            words_planned: 0,
            heard: 0,
            told: 0,
            active: None,
            planner: None,
            history: History::default(),
            tracker: Tracker::default(),
            state: State::default(),
            fault: None,
            trust: Trust::default(),
            frames_used: 0,
            frames_refused: 0,
            drops: Drops::default(),
            estimate: None,
        }
    }

    /// Takes bytes from the link, in any chunking.
    pub fn receive(&mut self, now: Instant, mut bytes: &[u8]) {
        while let Some(outcome) = self.receiver.next(&mut bytes) {
            match outcome {
                Ok(packet) => self.accept(now, packet),
                Err(reject) => self.drops.rejects.count(reject),
            }
        }
    }

    /// Takes the switches and the step engine's progress. They take effect at the next tick.
    pub fn sense(&mut self, inputs: Inputs) {
        self.inputs = inputs;
    }

    /// What to do at `now`. Call again at once after anything but [`Output::Idle`].
    ///
    /// `room` is how many port words the shell can still queue; without room for a segment none is given out.
    pub fn poll(&mut self, now: Instant, room: usize) -> Output {
        let report = self.outbox.pop_front();
        if let Some(Ok(bytes)) = report.map(|report| encode(&stamped(report, now))) {
            return Output::Send(bytes);
        }
        if !self.started {
            // The first tick at or after the first poll.
            self.started = true;
            self.tick = now.micros().div_ceil(TICK_US);
            self.heard = self.tick;
        }
        let due = self.due();
        let words = usize::from(self.board.word_rate.slots_per_segment()) * 2;
        if now < due {
            return Output::Idle(due);
        }
        if room < words {
            // As much is played while a segment lasts.
            return Output::Idle(now.plus_micros(SEGMENT_US));
        }
        if now.since(due) > MAX_LAG_US {
            self.catch_up(now);
        }
        if self.given == SEGMENTS {
            self.control();
            self.given = 0;
        }
        self.given += 1;
        self.words_planned = self.words_planned.saturating_add(words as u64);
        let segment = self.next_segment();
        if self.given == SEGMENTS {
            self.remember();
            self.tick += 1;
        }
        Output::Segment(segment)
    }

    /// The state, for shells that show it.
    pub fn state(&self) -> State {
        self.state
    }

    /// The latched fault, for shells that keep it across a restart.
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Which axes count against their motor: the shell hands this to the step generator before each segment.
    pub fn inverted(&self) -> [bool; 3] {
        self.active.as_ref().map_or([false; 3], |active| {
            active.config.axes.map(|axis| axis.invert)
        })
    }

    /// Planned position, 2⁻³² steps from zero. Whole steps are where the motor stands.
    pub fn position(&self) -> Fine {
        self.planner
            .as_ref()
            .map_or([0; 3], |planner| planner.positions().map(from_centre))
    }

    /// When the next segment is due.
    fn due(&self) -> Instant {
        let given = if self.given == SEGMENTS {
            0
        } else {
            self.given
        };
        Instant::from_micros(self.tick * TICK_US + u64::from(given) * SEGMENT_US)
    }

    /// The instant of the present tick.
    fn now(&self) -> Instant {
        Instant::from_micros(self.tick * TICK_US)
    }

    /// The shell did not poll for a while: the pins stood still meanwhile, so time goes on without motion.
    fn catch_up(&mut self, now: Instant) {
        self.tick = now.micros() / TICK_US;
        self.given = SEGMENTS;
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

    /// Remembers where the pins will be when this tick's words are out.
    fn remember(&mut self) {
        let end = self
            .now()
            .plus_micros(TICK_US + u64::from(self.board.delay_us));
        self.history.record(end, self.position());
    }

    fn accept(&mut self, now: Instant, packet: Packet) {
        let Packet { sequence, command } = packet;
        if command == Command::Hello {
            self.sequence = Some(sequence);
            self.heard = self.tick;
            self.report(Report::Hello(self.hello()));
            return;
        }
        match self.sequence.map(|last| sequence.wrapping_sub(last)) {
            Some(0) => self.drops.duplicate = self.drops.duplicate.saturating_add(1),
            Some(1..=0x7fff) => {
                self.sequence = Some(sequence);
                self.queue(now, packet);
            }
            _ => self.drops.stale = self.drops.stale.saturating_add(1),
        }
    }

    fn queue(&mut self, now: Instant, packet: Packet) {
        match packet.command {
            Command::Ping { host_us } => {
                self.heard = self.tick;
                self.report(Report::Pong {
                    host_us,
                    received: now,
                    sent: now,
                });
            }
            Command::Stop => self.stop = Some(packet.sequence),
            _ => {
                if self.inbox.push_back(packet).is_err() {
                    self.drops.overflow = self.drops.overflow.saturating_add(1);
                }
            }
        }
    }

    fn hello(&self) -> Hello {
        let mut board = heapless::String::new();
        // A longer name is cut to nothing rather than to half a letter.
        let _ = board.push_str(self.board.name);
        Hello {
            protocol: PROTOCOL,
            schema: SCHEMA_HASH,
            version: self.board.version,
            board,
            word_rate_hz: self.board.word_rate.hz(),
            delay_us: self.board.delay_us,
            session: self.board.session,
            reset_cause: self.board.reset_cause,
        }
    }

    /// Queues a report. The link being slow must never stop motion: when the queue is full the oldest is dropped.
    fn report(&mut self, report: Report) {
        if self.outbox.is_full() {
            self.outbox.pop_front();
        }
        let _ = self.outbox.push_back(report);
    }

    fn answer(&mut self, sequence: u16, outcome: Result<(), Denial>) {
        let outcome = outcome.map_or_else(Outcome::Denied, |()| Outcome::Accepted);
        self.report(Report::Answer {
            sequence,
            tick: self.tick as u32,
            outcome,
        });
    }

    /// One control tick.
    fn control(&mut self) {
        let before = (self.state, self.fault);
        self.check_switches();
        self.check_heartbeat();
        if let Some(sequence) = self.stop.take() {
            self.halt_on_ramp(State::Stopped);
            self.answer(sequence, Ok(()));
        }
        let mut followed = false;
        while let Some(Packet { sequence, command }) = self.inbox.pop_front() {
            followed |= matches!(command, Command::Frame(_));
            let outcome = self.apply(sequence, command);
            self.answer(sequence, outcome);
        }
        self.settle();
        let changed = before != (self.state, self.fault);
        if followed || changed || self.tick.saturating_sub(self.told) >= STATUS_TICKS {
            self.told = self.tick;
            self.report(Report::Status(self.status()));
        }
    }

    fn status(&self) -> Status {
        let steps = |positions: [Position; 3]| positions.map(Position::whole_steps);
        let of = |get: fn(&Planner) -> [Position; 3]| {
            self.planner.as_ref().map_or([0; 3], |p| steps(get(p)))
        };
        Status {
            time: self.now(),
            tick: self.tick as u32,
            state: self.state,
            fault: self.fault,
            trust: self.trust,
            position_steps: of(Planner::positions),
            target_steps: of(Planner::targets),
            frames_used: self.frames_used,
            frames_refused: self.frames_refused,
            drops: self.drops,
            estimate: self.estimate,
        }
    }

    fn apply(&mut self, sequence: u16, command: Command) -> Result<(), Denial> {
        match command {
            Command::Config(config) => self.configure(&config),
            Command::Frame(frame) => {
                let outcome = self.follow(sequence, &frame);
                let counter = if outcome.is_ok() {
                    &mut self.frames_used
                } else {
                    &mut self.frames_refused
                };
                *counter = counter.wrapping_add(1);
                outcome
            }
            Command::Setpoint { position_um } => self.setpoint(position_um),
            Command::Jog { distance_um } => self.jog(distance_um),
            Command::Zero => self.zero(),
            Command::Reset => self.reset(),
            // Handled on arrival.
            Command::Hello | Command::Stop | Command::Ping { .. } => Ok(()),
        }
    }

    fn configure(&mut self, config: &Config) -> Result<(), Denial> {
        self.require_rest()?;
        let active = Active::new(config, self.board.word_rate).map_err(Denial::Config)?;
        let same_scale = self.active.as_ref().is_some_and(|old| {
            let scale = |config: &Config| config.axes.map(|axis| (axis.steps_per_m, axis.invert));
            scale(&old.config) == scale(config)
        });
        if self.trust == Trust::Homed && !same_scale {
            self.trust = Trust::Degraded;
        }
        self.active = Some(active);
        self.use_limits();
        self.tracker.reset();
        if self.state == State::Unconfigured {
            self.state = State::Idle;
        }
        Ok(())
    }

    /// Plans anew from where the stage stands, with the limits that go with the present trust.
    fn use_limits(&mut self) {
        let Some(active) = &self.active else { return };
        let limits = if self.trust == Trust::Homed {
            active.limits
        } else {
            active.slow
        };
        let start = [Position::centre(0); 3];
        let positions = self.planner.as_ref().map_or(start, Planner::positions);
        self.planner = Some(Planner::new(limits, positions));
    }

    fn setpoint(&mut self, position_um: [i32; 3]) -> Result<(), Denial> {
        self.require_ready()?;
        self.require_homed()?;
        let active = self.active.as_ref().ok_or(Denial::Unconfigured)?;
        let target = active.fine_from_um(position_um);
        self.go(target, State::Moving)?;
        self.tracker.reset();
        Ok(())
    }

    fn jog(&mut self, distance_um: [i32; 3]) -> Result<(), Denial> {
        self.require_ready()?;
        let active = self.active.as_ref().ok_or(Denial::Unconfigured)?;
        let distance = active.fine_from_um(distance_um);
        let from = self.position();
        let target = core::array::from_fn(|i| {
            let (from, distance) = (from.get(i).copied(), distance.get(i).copied());
            from.unwrap_or(0).saturating_add(distance.unwrap_or(0))
        });
        self.go(target, State::Moving)?;
        self.tracker.reset();
        Ok(())
    }

    /// Sends the stage to `target`, 2⁻³² steps from zero, rounded to whole steps and clamped to the soft limits.
    fn go(&mut self, target: Fine, state: State) -> Result<(), Denial> {
        let planner = self.planner.as_mut().ok_or(Denial::Unconfigured)?;
        let target = target.map(to_centre);
        for axis in 0..3 {
            let (Some(target), Some(position)) =
                (target.get(axis), planner.positions().get(axis).copied())
            else {
                continue;
            };
            let [negative, positive] = self.inputs.limits.get(axis).copied().unwrap_or_default();
            if (negative && *target < position) || (positive && *target > position) {
                return Err(Denial::LimitSwitch);
            }
        }
        match state {
            State::Following => planner.set_target(target),
            _ => planner.move_in_step(target),
        }
        self.state = state;
        Ok(())
    }

    fn zero(&mut self) -> Result<(), Denial> {
        self.require_rest()?;
        let planner = self.planner.as_mut().ok_or(Denial::Unconfigured)?;
        // Whole steps only: the generator's phase stays as it is.
        let by = planner
            .positions()
            .map(|p| -(i64::from(p.whole_steps()) << 32));
        let zeroed = planner
            .positions()
            .map(|p| Position::from_fine(i64::from(p.phase())));
        planner.resume_at(zeroed);
        self.history.shift(by);
        self.trust = Trust::Homed;
        self.use_limits();
        self.tracker.reset();
        Ok(())
    }

    fn reset(&mut self) -> Result<(), Denial> {
        self.require_rest()?;
        let remains = match self.fault {
            Some(Fault::EmergencyStop) => self.inputs.emergency_stop,
            Some(Fault::Driver) => self.inputs.driver_fault,
            _ => false,
        };
        if remains {
            return Err(Denial::CauseRemains);
        }
        self.fault = None;
        self.tracker.reset();
        self.state = if self.active.is_some() {
            State::Idle
        } else {
            State::Unconfigured
        };
        Ok(())
    }

    fn require_rest(&self) -> Result<(), Denial> {
        match self.stands() {
            true => Ok(()),
            false => Err(Denial::Moving),
        }
    }

    /// The stage stands, and no motion is planned.
    fn stands(&self) -> bool {
        self.planner.as_ref().is_none_or(Planner::has_arrived)
    }

    fn require_ready(&self) -> Result<(), Denial> {
        match self.state {
            State::Unconfigured => Err(Denial::Unconfigured),
            State::Stopping | State::Stopped => Err(Denial::Stopped),
            State::Faulted => Err(Denial::Faulted),
            State::Idle | State::Moving | State::Following => match self.fault {
                Some(_) => Err(Denial::Faulted),
                None => Ok(()),
            },
        }
    }

    fn require_homed(&self) -> Result<(), Denial> {
        match self.trust {
            Trust::Homed => Ok(()),
            Trust::Unknown | Trust::Degraded => Err(Denial::PositionUnknown),
        }
    }

    fn check_switches(&mut self) {
        if self.inputs.emergency_stop {
            self.fail(Fault::EmergencyStop);
        }
        if self.inputs.driver_fault {
            self.fail(Fault::Driver);
        }
        if let Some(planner) = &self.planner {
            let towards = planner.speeds().into_iter().zip(self.inputs.limits);
            let met = |(v, [negative, positive]): (i64, [bool; 2])| {
                (negative && v < 0) || (positive && v > 0)
            };
            if towards.into_iter().any(met) {
                self.fail(Fault::Limit);
            }
        }
        let lag = self.words_planned.saturating_sub(self.inputs.words_emitted);
        let queued_us = lag.saturating_mul(1_000_000) / u64::from(self.board.word_rate.hz());
        if !self.stands() && queued_us > u64::from(self.board.delay_us) + MAX_LAG_US {
            self.fail(Fault::Underrun);
        }
    }

    fn check_heartbeat(&mut self) {
        let Some(active) = &self.active else { return };
        let moving = matches!(self.state, State::Moving | State::Following);
        if moving && self.tick.saturating_sub(self.heard) > active.heartbeat_ticks() {
            self.fail(Fault::Heartbeat);
        }
    }

    /// Latches a fault and stops; the first one stays.
    fn fail(&mut self, fault: Fault) {
        if self.fault.is_none() {
            self.fault = Some(fault);
        }
        if fault.is_abrupt() {
            if !self.stands() {
                if self.trust == Trust::Homed {
                    self.trust = Trust::Degraded;
                }
                self.use_limits();
            }
            self.tracker.reset();
            self.state = State::Faulted;
        } else {
            self.halt_on_ramp(State::Faulted);
        }
    }

    /// Ramps down; `settle` goes on to the state that fits when the stage stands.
    fn halt_on_ramp(&mut self, then: State) {
        if let Some(planner) = &mut self.planner {
            planner.stop();
        }
        self.tracker.reset();
        self.state = match self.state {
            State::Faulted => State::Faulted,
            _ if !self.stands() => State::Stopping,
            _ => then,
        };
    }

    /// What follows from standing still.
    fn settle(&mut self) {
        if !self.stands() {
            return;
        }
        self.state = match self.state {
            State::Moving => State::Idle,
            State::Stopping if self.fault.is_some() => State::Faulted,
            State::Stopping => State::Stopped,
            state => state,
        };
    }
}

/// Fills in the moment of sending.
fn stamped(report: Report, now: Instant) -> Report {
    match report {
        Report::Pong {
            host_us, received, ..
        } => Report::Pong {
            host_us,
            received,
            sent: now,
        },
        other => other,
    }
}

/// A planner position to the distance from zero: resting positions become whole steps.
fn from_centre(position: Position) -> i64 {
    position.fine().saturating_sub(Position::centre(0).fine())
}

/// The resting position nearest to a distance from zero.
fn to_centre(fine: i64) -> Position {
    let nearest = Position::from_fine(fine.saturating_add(Position::centre(0).fine()));
    Position::centre(nearest.whole_steps())
}
