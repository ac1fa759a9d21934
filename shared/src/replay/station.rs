use super::log::{Entry, Log, LogFault};
use crate::frame::encode::Bytes;
use crate::machine::{Board, Machine, Output};
use crate::safety::Inputs;
use crate::steps::{Generator, LoadFault, PortFault, PortMap, Segment, WordRate};
use crate::time::Instant;

/// What a [`Station`] does next.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant)] // no alloc
pub enum Event {
    /// Bytes for the host.
    Sent(Bytes),
    /// A segment, and how many words of the buffer were filled from it.
    Segment(Segment, usize),
    /// The generator did not take the segment: a defect of the planner.
    Refused(LoadFault),
    /// Nothing more before this instant.
    Idle(Instant),
}

/// Machine, generator and a step engine that emits words exactly at the word rate, by the caller's
/// clock.
#[derive(Clone, Debug)]
pub struct Station {
    machine: Machine,
    generator: Generator,
    rate: WordRate,
    /// Words the step engine holds at the start, all zero: its delay.
    ring: u64,
    /// Words made of segments.
    made: u64,
    /// Words on the pins since the start, those of the first filling included.
    out: u64,
    inputs: Inputs,
    now: Instant,
}

impl Station {
    /// Switched on at instant 0. `ring_words` are queued ahead of the pins; `board.delay_us` must
    /// be their duration.
    ///
    /// # Errors
    /// If the pins are impossible.
    pub fn new(board: Board, map: PortMap, ring_words: u32) -> Result<Self, PortFault> {
        let rate = board.word_rate;
        Ok(Self {
            machine: Machine::new(board),
            generator: Generator::new(map)?,
            rate,
            ring: u64::from(ring_words),
            made: 0,
            out: 0,
            inputs: Inputs::default(),
            now: Instant::default(),
        })
    }

    /// The machine, for shells that show its state.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// The instant up to which time has passed.
    pub fn now(&self) -> Instant {
        self.now
    }

    /// Takes bytes from the link, now.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.machine.receive(self.now, bytes);
    }

    /// Sets the switches; they are sensed when time next passes. `words_emitted` is the step
    /// engine's own and ignored.
    pub fn set_switches(&mut self, switches: Inputs) {
        let words_emitted = self.inputs.words_emitted;
        self.inputs = Inputs {
            words_emitted,
            ..switches
        };
    }

    /// Lets time pass until `instant`: the words of that time go to the pins.
    pub fn pass(&mut self, instant: Instant) {
        let due = instant.micros().saturating_mul(u64::from(self.rate.hz())) / 1_000_000;
        self.out = due.min(self.ring.saturating_add(self.made)).max(self.out);
        self.now = instant;
        self.inputs.words_emitted = self.out.saturating_sub(self.ring);
        self.machine.sense(self.inputs);
    }

    /// What is to be done at the present instant. `words` must hold a whole segment.
    pub fn poll(&mut self, words: &mut [u32]) -> Event {
        // The engine has room for whatever the machine gives out in time: it never holds more than
        // one segment above its ring.
        match self.machine.poll(self.now, words.len()) {
            Output::Send(bytes) => Event::Sent(bytes),
            Output::Idle(until) => Event::Idle(until),
            Output::Segment(segment) => {
                self.generator.set_invert(self.machine.inverted());
                if let Err(fault) = self.generator.load(&segment) {
                    return Event::Refused(fault);
                }
                let filled = self.generator.fill(words);
                self.made = self.made.saturating_add(filled as u64);
                Event::Segment(segment, filled)
            }
        }
    }

    /// Lets time pass up to and including `end`, as far as the next thing to be done;
    /// [`Event::Idle`] means that `end` was reached.
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

/// A station that lives through a [`Log`].
#[derive(Clone, Debug)]
pub struct Replay<'a> {
    station: Station,
    log: Log<'a>,
    next: Option<(Instant, Entry<'a>)>,
    /// Time has passed up to the next entry, and everything due by then is done.
    arrived: bool,
}

impl<'a> Replay<'a> {
    /// `station`, just switched on, at the start of `log`.
    ///
    /// # Errors
    /// If the log's first entry is broken.
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

    /// The station.
    pub fn station(&self) -> &Station {
        &self.station
    }

    /// Entries of the present instant are taken before the station is asked again.
    fn is_present(&self) -> bool {
        let next = self.next.as_ref();
        next.is_some_and(|(at, _)| *at <= self.station.now())
    }

    /// The next thing the station does, with the instant; `None` at the end of the log.
    ///
    /// # Errors
    /// If the log is broken.
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
