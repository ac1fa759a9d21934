//! The station without hardware: the very code of the board, on virtual time.
//!
//! A twin is an [emulated station](EmulatedStation), a [plant](Plant) at its step pins, and the
//! [`Client`] at the other end. Commands and reports travel as the bytes that a serial port would
//! carry; segments become port words, and the plant counts the edges that these make. Nothing here
//! looks past the bytes and the pins, except for tests and reports.
//!
//! [`real_time`] is the same station on this computer's clock, for other programs to connect to, and
//! [`far_end`] the line that they use. A [`TwinOnPort`] has both on a thread of this process.

pub mod far_end;
pub(crate) mod link;
#[cfg_attr(not(unix), path = "twin/no_port.rs")]
mod on_port;
pub mod real_time;

pub use on_port::TwinOnPort;

use super::StationError;
use super::conversation::Client;
use super::observer::StationObserver;
use super::stage::{configuration, setpoint};
use super::tape::Tape;
use crate::plant::Plant;
use std::collections::VecDeque;
use std::sync::Arc;
use trinocular_core::frame::encode::Bytes;
use trinocular_core::frame::message::{Command, Denial, LastRun, Mounting, ResetCause, Status};
use trinocular_core::machine::Board;
use trinocular_core::replay::{EmulatedStation, Event};
use trinocular_core::safety::{Inputs, State};
use trinocular_core::steps::{PortMap, WordRate};
use trinocular_core::time::Instant;
use trinocular_rig::rig_file::Stage;

/// STEP and DIR pins of the twin's port.
pub const PORT: PortMap = PortMap {
    step: [0, 1, 2],
    dir: [3, 4, 5],
    invert: [false; 3],
};

/// Camera pin of the twin's port.
pub const CAMERA_PIN: u8 = 8;

/// Largest number of exposures that wait to be taken.
const EXPOSURES: usize = 1_000;

/// Words that the twin's step engine queues ahead, as the board's ring does: half a millisecond at
/// 1 MHz.
pub const RING_WORDS: usize = 512;

/// Period of the heartbeat, µs.
const PING_US: u64 = 20_000;

/// Timeout for an answer, µs of virtual time.
const PATIENCE_US: u64 = 100_000;

/// Returns the board of a twin with this name, at most 16 bytes.
pub fn board(name: &'static str) -> Board {
    let rate = WordRate::MHZ_1;
    Board {
        name,
        version: [0, 1, 0],
        word_rate: rate,
        delay_us: (RING_WORDS as u64 * 1_000_000 / u64::from(rate.hz())) as u32,
        session: 1,
        reset_cause: ResetCause::PowerOn,
        last_run: LastRun::UNKNOWN,
        camera_pin: Some(CAMERA_PIN),
    }
}

/// Returns the station of a twin with this board, just switched on.
pub fn emulated(board: Board) -> EmulatedStation {
    EmulatedStation::new(board, PORT, RING_WORDS as u32).expect("seven distinct pins below 16")
}

/// The emulated board and the stage at its pins.
struct Hardware {
    station: EmulatedStation,
    plant: Plant,
    rate: WordRate,
    /// Words that are generated and not yet on the pins.
    ring: VecDeque<u32>,
    /// Buffer for the words of a segment.
    words: Box<[u32]>,
    /// Packets to the host, each with its instant of sending.
    to_host: Vec<(Instant, Bytes)>,
    tape: Option<Tape>,
    observer: Option<Arc<dyn StationObserver>>,
    exposures: VecDeque<Exposure>,
}

/// Trigger at the camera pin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Instant of the trigger on the station's clock.
    pub at: Instant,
    /// Position of the stage then, mm.
    pub stage_mm: [f64; 3],
}

impl std::fmt::Debug for Hardware {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Hardware")
            .field("now", &self.station.now())
            .field("steps", &self.plant.steps())
            .finish_non_exhaustive()
    }
}

impl Hardware {
    fn new(stage: &Stage, name: &'static str, session: u32) -> Self {
        let board = Board {
            session,
            ..board(name)
        };
        let pins = PortMap {
            invert: stage.invert,
            ..PORT
        };
        Self {
            rate: board.word_rate,
            station: emulated(board),
            plant: Plant::new(pins, stage.steps_per_mm),
            ring: std::iter::repeat_n(0, RING_WORDS).collect(),
            words: vec![0; RING_WORDS].into(),
            to_host: Vec::new(),
            tape: None,
            observer: None,
            exposures: VecDeque::new(),
        }
    }

    fn receive(&mut self, bytes: &[u8]) {
        if let Some(observer) = &self.observer {
            observer.sent(self.station.now().micros(), bytes);
        }
        if let Some(tape) = &mut self.tape {
            tape.received(self.station.now(), bytes);
        }
        self.station.receive(bytes);
    }

    /// Lets virtual time pass until `end`.
    fn run_until(&mut self, end: Instant) {
        loop {
            let event = self.station.run(end, &mut self.words);
            let now = self.station.now();
            self.feed_plant(now);
            match event {
                Event::Idle(_) => return,
                Event::Sent(bytes) => {
                    if let Some(observer) = &self.observer {
                        observer.received(now.micros(), &bytes);
                    }
                    if let Some(tape) = &mut self.tape {
                        tape.sent(now, &bytes);
                    }
                    self.to_host.push((now, bytes));
                }
                Event::Segment(segment, filled) => {
                    let words = &self.words[..filled];
                    if let Some(observer) = &self.observer {
                        observer.segment(now, &segment, words);
                    }
                    if let Some(tape) = &mut self.tape {
                        tape.segment(now, &segment, words);
                    }
                    self.ring.extend(words);
                }
                Event::Refused(fault) => {
                    unreachable!("the planner turns slowly and segments are used up: {fault:?}")
                }
            }
        }
    }

    /// Puts the words of the time until `now` on the pins.
    fn feed_plant(&mut self, now: Instant) {
        let due = now.micros() * u64::from(self.rate.hz()) / 1_000_000;
        let count = (due - self.plant.words()).min(self.ring.len() as u64) as usize;
        let begins: u32 = match self.station.machine().camera_edges().active_low {
            true => 1 << (CAMERA_PIN + 16),
            false => 1 << CAMERA_PIN,
        };
        let (front, back) = self.ring.as_slices();
        let front = &front[..count.min(front.len())];
        for mut words in [front, &back[..count - front.len()]] {
            while let Some(at) = words.iter().position(|word| word & begins != 0) {
                let (trigger, rest) = words.split_at(at + 1);
                self.plant.feed(trigger);
                if self.exposures.len() == EXPOSURES {
                    self.exposures.pop_front();
                }
                let us = (self.plant.words() - 1) * 1_000_000 / u64::from(self.rate.hz());
                self.exposures.push_back(Exposure {
                    at: Instant::from_micros(us),
                    stage_mm: self.plant.position_mm(),
                });
                words = rest;
            }
            self.plant.feed(words);
        }
        self.ring.drain(..count);
    }

    fn set_switches(&mut self, switches: Inputs) {
        self.station.set_switches(switches);
        if let Some(observer) = &self.observer {
            observer.switches(self.station.now(), &switches);
        }
        if let Some(tape) = &mut self.tape {
            let words_emitted = self.plant.words().saturating_sub(RING_WORDS as u64);
            let inputs = Inputs {
                words_emitted,
                ..switches
            };
            tape.switched(self.station.now(), inputs);
        }
    }
}

/// A station on virtual time and the host's conversation with it.
///
/// ```
/// use trinocular_client::stage::default_stage;
/// use trinocular_client::twin::Twin;
/// use trinocular_core::frame::message::{Command, Mounting};
/// use trinocular_core::safety::State;
///
/// let mut twin = Twin::start(&default_stage(), "example", Mounting::OnStage)?;
/// twin.command("jog", Command::Jog { distance_um: [1_500, 0, 0] })?;
/// twin.advance(twin.now().plus_micros(500_000));
/// assert_eq!(twin.position_mm(), [1.5, 0.0, 0.0]);
///
/// twin.command("stop", Command::Stop)?;
/// twin.advance(twin.now().plus_micros(100_000));
/// assert_eq!(twin.status().map(|status| status.state), Some(State::Stopped));
/// # Ok::<(), trinocular_client::StationError>(())
/// ```
#[derive(Debug)]
pub struct Twin {
    hardware: Hardware,
    client: Client,
    next_ping: Instant,
    pings: bool,
    /// Steps counted at the pins when the position was last zeroed.
    zero_steps: [i64; 3],
}

impl Twin {
    /// Switches a station on, sends hello, configures and zeroes it.
    ///
    /// # Errors
    /// If the stage does not fit the configuration or the station refuses it.
    pub fn start(
        stage: &Stage,
        name: &'static str,
        mounting: Mounting,
    ) -> Result<Self, StationError> {
        Self::start_observed(stage, name, mounting, None)
    }

    /// Starts a station as [`Twin::start`] does; `observer` sees it from its first byte on.
    ///
    /// # Errors
    /// As [`Twin::start`].
    pub fn start_observed(
        stage: &Stage,
        name: &'static str,
        mounting: Mounting,
        observer: Option<Arc<dyn StationObserver>>,
    ) -> Result<Self, StationError> {
        let mut hardware = Hardware::new(stage, name, 1);
        hardware.observer = observer;
        let mut twin = Self::switch_on(hardware)?;
        twin.command("config", Command::Config(configuration(stage, mounting)?))?;
        twin.zero()?;
        Ok(twin)
    }

    /// Switches a station on and sends hello; the station has no configuration yet. Its pins drive
    /// `stage`.
    ///
    /// # Errors
    /// If the station does not answer, or speaks another protocol.
    pub fn power_on(stage: &Stage, name: &'static str) -> Result<Self, StationError> {
        Self::switch_on(Hardware::new(stage, name, 1))
    }

    /// Switches a station on as [`Twin::power_on`] does; `observer` sees it from its first byte on.
    ///
    /// # Errors
    /// As [`Twin::power_on`].
    pub fn power_on_observed(
        stage: &Stage,
        name: &'static str,
        observer: Arc<dyn StationObserver>,
    ) -> Result<Self, StationError> {
        let mut hardware = Hardware::new(stage, name, 1);
        hardware.observer = Some(observer);
        Self::switch_on(hardware)
    }

    /// Switches a station on as [`Twin::power_on`] does, and records a [`Tape`] from then on.
    ///
    /// # Errors
    /// As [`Twin::power_on`].
    pub fn power_on_recorded(stage: &Stage, name: &'static str) -> Result<Self, StationError> {
        let mut hardware = Hardware::new(stage, name, 1);
        hardware.tape = Some(Tape::new(PORT));
        Self::switch_on(hardware)
    }

    fn switch_on(hardware: Hardware) -> Result<Self, StationError> {
        let mut twin = Self {
            hardware,
            client: Client::default(),
            next_ping: Instant::default(),
            pings: true,
            zero_steps: [0; 3],
        };
        twin.hello()?;
        Ok(twin)
    }

    /// Declares the present position to be zero.
    ///
    /// # Errors
    /// If the station denies it, because the stage moves.
    pub fn zero(&mut self) -> Result<(), StationError> {
        self.command("zero", Command::Zero)?;
        self.zero_steps = self.steps();
        Ok(())
    }

    fn hello(&mut self) -> Result<(), StationError> {
        // A closing zero first, as on a real line that may hold half a packet.
        self.write(&[0]);
        let (_, bytes) = self.client.packet(Command::Hello);
        self.write(&bytes);
        self.wait("hello", |client| client.hello().map(|_| ()))?;
        let mismatches = self
            .client
            .hello()
            .map(|hello| hello.mismatches())
            .unwrap_or_default();
        if mismatches.is_empty() {
            Ok(())
        } else {
            Err(StationError::Mismatch(mismatches.to_vec()))
        }
    }

    /// Returns the virtual time.
    pub fn now(&self) -> Instant {
        self.hardware.station.now()
    }

    /// Converts an instant of virtual time to the station's clock, as the host knows it; `None`
    /// until the first reply to a ping.
    pub fn station_time(&self, at: Instant) -> Option<Instant> {
        let station_us = self.client.clock().station_us(at.micros());
        station_us.map(Instant::from_micros)
    }

    /// Lets time pass until `end`, with a heartbeat every 20 ms.
    pub fn advance(&mut self, end: Instant) {
        while self.pings && self.next_ping <= end {
            self.run(self.next_ping.max(self.now()));
            let host_us = self.now().micros();
            let (_, ping) = self.client.packet(Command::Ping { host_us });
            self.write(&ping);
            self.next_ping = self.now().plus_micros(PING_US);
        }
        self.run(end);
    }

    fn run(&mut self, end: Instant) {
        if end > self.now() {
            self.hardware.run_until(end);
        }
        for (sent, bytes) in self.hardware.to_host.drain(..) {
            self.client.feed(sent.micros(), &bytes);
        }
    }

    /// Puts raw bytes on the link to the station.
    pub fn write(&mut self, bytes: &[u8]) {
        self.hardware.receive(bytes);
    }

    /// Numbers a command as [`Twin::send`] does, without sending it: for tests of bad lines.
    pub fn packet(&mut self, command: Command) -> (u16, Bytes) {
        self.client.packet(command)
    }

    /// Sends a command without waiting; returns its sequence number.
    pub fn send(&mut self, command: Command) -> u16 {
        let (sequence, bytes) = self.client.packet(command);
        self.write(&bytes);
        sequence
    }

    /// Sends a command and waits for the answer.
    ///
    /// # Errors
    /// [`StationError::Denied`] with the station's reason, [`StationError::Silent`] without an
    /// answer.
    pub fn command(&mut self, name: &'static str, command: Command) -> Result<(), StationError> {
        let sequence = self.send(command);
        let outcome = self.wait(name, |client| client.answer(sequence))?;
        outcome.map_err(|denial| StationError::Denied {
            command: name,
            denial,
        })
    }

    /// Takes the station's answer to a sent command, if it has come.
    pub fn answer(&mut self, sequence: u16) -> Option<Result<(), Denial>> {
        self.client.answer(sequence)
    }

    fn wait<T>(
        &mut self,
        command: &'static str,
        mut got: impl FnMut(&mut Client) -> Option<T>,
    ) -> Result<T, StationError> {
        let deadline = self.now().plus_micros(PATIENCE_US);
        loop {
            if let Some(value) = got(&mut self.client) {
                return Ok(value);
            }
            if self.client.rejects().total() > 0 {
                return Err(StationError::Garbled(self.client.rejects()));
            }
            if self.now() >= deadline {
                return Err(StationError::Silent {
                    command,
                    waited_ms: PATIENCE_US / 1000,
                });
            }
            self.advance(self.now().plus_micros(1_000));
        }
    }

    /// Stops or resumes the heartbeat; stopped, it stands for a host that hangs.
    pub fn set_pings(&mut self, on: bool) {
        self.pings = on;
        self.next_ping = self.now();
    }

    /// Sets the switches that the station senses.
    pub fn set_switches(&mut self, switches: Inputs) {
        self.hardware.set_switches(switches);
    }

    /// Sends the stage to a position, mm from zero, and lets time pass until it stands.
    ///
    /// # Errors
    /// As [`Twin::command`].
    pub fn go(&mut self, position_mm: [f64; 3]) -> Result<(), StationError> {
        /// Longer than the time between two reports, µs.
        const REPORTED_US: u64 = 110_000;
        self.command("setpoint", setpoint(position_mm))?;
        loop {
            self.advance(self.now().plus_micros(REPORTED_US));
            if self.status().map(|status| status.state) != Some(State::Moving) {
                return Ok(());
            }
        }
    }

    /// Returns the station's latest status.
    pub fn status(&self) -> Option<&Status> {
        self.client.status()
    }

    /// Returns the host's end of the conversation.
    pub fn client(&self) -> &Client {
        &self.client
    }

    /// Returns the steps that the pins made since the start, backward ones subtracted.
    pub fn steps(&self) -> [i64; 3] {
        self.hardware.plant.steps()
    }

    /// Returns the steps that the pins made since the position was zeroed.
    pub fn steps_from_zero(&self) -> [i64; 3] {
        let now = self.steps();
        std::array::from_fn(|i| now[i] - self.zero_steps[i])
    }

    /// Returns the position of the simulated stage, mm from its position at power-on, from counted
    /// edges alone.
    pub fn position_mm(&self) -> [f64; 3] {
        self.hardware.plant.position_mm()
    }

    /// Returns the tape of a recorded twin.
    pub fn tape(&self) -> Option<&Tape> {
        self.hardware.tape.as_ref()
    }

    /// Returns the simulated stage.
    pub fn plant(&self) -> &Plant {
        &self.hardware.plant
    }
}
