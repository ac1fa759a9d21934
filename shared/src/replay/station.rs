use super::log::{Entry, Log, LogFault};
use crate::frame::encode::Bytes;
use crate::machine::{Board, Machine, Output};
use crate::safety::Inputs;
use crate::steps::{CameraPin, Generator, LoadFault, PortFault, PortMap, Segment, WordRate};
use crate::time::Instant;

/// Next action of a [`Station`].
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant)] // no alloc
pub enum Event {
    /// Bytes for the host.
    Sent(Bytes),
    /// A segment, and the number of words of the buffer filled from it.
    Segment(Segment, usize),
    /// The generator refused the segment, which is a defect of the planner.
    Refused(LoadFault),
    /// No further action before this instant.
    Idle(Instant),
}

/// Emulated station: machine, generator, and a step engine that emits words exactly at the word
/// rate, by the caller's clock.
///
/// ```
/// use trinocular_core::frame::encode::encode;
/// use trinocular_core::frame::message::{Command, LastRun, Packet, Report, ResetCause};
/// use trinocular_core::frame::receive::Receiver;
/// use trinocular_core::machine::Board;
/// use trinocular_core::replay::{Event, Station};
/// use trinocular_core::{steps::{PortMap, WordRate}, time::Instant};
///
/// let board = Board {
///     name: "example",
///     version: [1, 0, 0],
///     word_rate: WordRate::MHZ_1,
///     delay_us: 512,
///     session: 1,
///     reset_cause: ResetCause::PowerOn,
///     last_run: LastRun::UNKNOWN,
///     camera_pin: None,
/// };
/// let map = PortMap { step: [0, 1, 2], dir: [3, 4, 5], invert: [false; 3] };
/// let mut station = Station::new(board, map, 512)?;
/// station.receive(&encode(&Packet { sequence: 1, command: Command::Hello })?);
///
/// let mut words = [0; 250];
/// let Event::Sent(bytes) = station.run(Instant::from_micros(5_000), &mut words) else { panic!() };
/// let report = Receiver::default().next(&mut &bytes[..]);
/// let Some(Ok(Report::Hello(hello))) = report else { panic!() };
/// assert_eq!((hello.board.as_str(), hello.mismatches().len()), ("example", 0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Station {
    machine: Machine,
    generator: Generator,
    camera: Option<CameraPin>,
    rate: WordRate,
    /// Words that the step engine holds at the start, all zero: its delay.
    ring_words: u64,
    /// Words made from segments.
    words_made: u64,
    /// Words on the pins since the start, those of the first filling included.
    words_out: u64,
    inputs: Inputs,
    now: Instant,
}

impl Station {
    /// Creates a station that is switched on at instant 0. `ring_words` are queued ahead of the
    /// pins; `board.delay_us` must be their duration.
    ///
    /// # Errors
    /// [`PortFault`] if the port lacks a pin or two signals share one.
    pub fn new(board: Board, map: PortMap, ring_words: u32) -> Result<Self, PortFault> {
        let rate = board.word_rate;
        let camera = board.camera_pin.map(|pin| CameraPin::new(pin, &map));
        Ok(Self {
            machine: Machine::new(board),
            generator: Generator::new(map)?,
            camera: camera.transpose()?,
            rate,
            ring_words: u64::from(ring_words),
            words_made: 0,
            words_out: 0,
            inputs: Inputs::default(),
            now: Instant::default(),
        })
    }

    /// Returns the machine.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Returns the instant up to which time has passed.
    pub fn now(&self) -> Instant {
        self.now
    }

    /// Takes bytes from the link at the present instant.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.machine.receive(self.now, bytes);
    }

    /// Sets the switches, which are sensed when time next passes. Ignores `words_emitted`, which
    /// the step engine counts itself.
    pub fn set_switches(&mut self, switches: Inputs) {
        let words_emitted = self.inputs.words_emitted;
        self.inputs = Inputs {
            words_emitted,
            ..switches
        };
    }

    /// Lets time pass until `instant`; the words of that time go to the pins.
    pub fn pass(&mut self, instant: Instant) {
        let due = instant.micros().saturating_mul(u64::from(self.rate.hz())) / 1_000_000;
        self.words_out = due
            .min(self.ring_words.saturating_add(self.words_made))
            .max(self.words_out);
        self.now = instant;
        self.inputs.words_emitted = self.words_out.saturating_sub(self.ring_words);
        self.machine.sense(self.inputs);
    }

    /// Returns the action at the present instant. `words` must hold a whole segment.
    pub fn poll(&mut self, words: &mut [u32]) -> Event {
        // The engine has room for everything that the machine hands out in time: it never holds
        // more than one segment above its ring.
        match self.machine.poll(self.now, words.len()) {
            Output::Send(bytes) => Event::Sent(bytes),
            Output::Idle(until) => Event::Idle(until),
            Output::Segment(segment) => {
                self.generator.set_invert(self.machine.inverted());
                if let Err(fault) = self.generator.load(&segment) {
                    return Event::Refused(fault);
                }
                let filled = self.generator.fill(words);
                if let (Some(pin), Some(words)) = (self.camera, words.get_mut(..filled)) {
                    pin.mark(&self.machine.camera_edges(), words);
                }
                self.words_made = self.words_made.saturating_add(filled as u64);
                Event::Segment(segment, filled)
            }
        }
    }

    /// Lets time pass up to and including `end`, but only to the next action; [`Event::Idle`] means
    /// that `end` was reached.
    pub fn run(&mut self, end: Instant, words: &mut [u32]) -> Event {
        loop {
            match self.poll(words) {
                Event::Idle(until) if until > end => {
                    self.pass(end);
                    return Event::Idle(until);
                }
                Event::Idle(until) => self.pass(until),
                event => return event,
            }
        }
    }
}

/// Station that runs through a [`Log`].
#[derive(Clone, Debug)]
pub struct Replay<'a> {
    station: Station,
    log: Log<'a>,
    next: Option<(Instant, Entry<'a>)>,
    /// True when time has passed up to the next entry, and everything due by then is done.
    arrived: bool,
}

impl<'a> Replay<'a> {
    /// Creates a replay of `log` on `station`, which was just switched on.
    ///
    /// # Errors
    /// [`LogFault`] if the log's first entry is broken.
    pub fn new(station: Station, mut log: Log<'a>) -> Result<Self, LogFault> {
        let mut replay = Self {
            next: log.entry()?,
            station,
            log,
            arrived: false,
        };
        replay.arrived = replay.is_present();
        Ok(replay)
    }

    /// Returns the station.
    pub fn station(&self) -> &Station {
        &self.station
    }

    /// Returns true if the next entry is due: entries of the present instant go in before the
    /// station is polled again.
    fn is_present(&self) -> bool {
        let next = self.next.as_ref();
        next.is_some_and(|(at, _)| *at <= self.station.now())
    }

    /// Returns the next action of the station with its instant, or `None` at the end of the log.
    ///
    /// # Errors
    /// [`LogFault`] if the log is broken.
    pub fn step(&mut self, words: &mut [u32]) -> Result<Option<(Instant, Event)>, LogFault> {
        while let Some((at, entry)) = self.next {
            if !self.arrived {
                match self.station.run(at, words) {
                    Event::Idle(_) => {}
                    event => return Ok(Some((self.station.now(), event))),
                }
            }
            match entry {
                Entry::Bytes(bytes) => self.station.receive(bytes),
                Entry::Switches(inputs) => self.station.set_switches(inputs),
                Entry::Wait => {}
            }
            self.next = self.log.entry()?;
            self.arrived = self.is_present();
        }
        Ok(None)
    }
}
