//! A shell around the station: its clock, its link, its switches and its step engine.

use crate::pins::WIRING;
use shared::frame::encode::encode;
use shared::frame::message::{Command, LastRun, Packet, Report, ResetCause};
use shared::frame::receive::Receiver;
use shared::machine::{Board, Machine, Output};
use shared::safety::Inputs;
use shared::steps::{Generator, LoadFault, WordRate};
use shared::time::Instant;
use std::collections::VecDeque;

/// What the station did.
pub enum Deed {
    /// It sent this.
    Report(Report),
    /// It sent bytes that are no report.
    Garbage,
    /// It gave out a segment: the words are in [`Shell::words`], and go to the pins from
    /// [`Shell::first_us`] on.
    Words,
    /// The generator refused its segment.
    Refused(LoadFault),
    /// Nothing more before the instant that was asked for.
    Done,
}

/// Machine, generator, and a step engine that plays words at an exact rate, by the caller's clock.
pub struct Shell {
    machine: Machine,
    generator: Generator,
    rate: WordRate,
    delay_us: u64,
    birth_us: u64,
    now_us: u64,
    /// Switches as they are; `words_emitted` is the step engine's.
    pub inputs: Inputs,
    /// Runs of words that are queued or being played: first word period since birth, words.
    queue: VecDeque<(u64, u64)>,
    /// Words of runs that were played to their end.
    played: u64,
    receiver: Receiver<Report>,
    /// The last segment's words.
    pub words: Vec<u32>,
    /// When the first of them reaches the pins, µs.
    pub first_us: f64,
    /// Number of the last packet.
    pub sequence: u16,
}

impl Shell {
    /// Switched on at `birth_us` of its clock.
    pub fn new(rate: WordRate, delay_us: u32, birth_us: u64) -> Self {
        let board = Board {
            name: "campaign",
            version: [0, 1, 0],
            word_rate: rate,
            delay_us,
            session: 1,
            reset_cause: ResetCause::PowerOn,
            last_run: LastRun::UNKNOWN,
        };
        Self {
            machine: Machine::new(board),
            generator: Generator::new(WIRING).expect("the pins are possible"),
            rate,
            delay_us: delay_us.into(),
            birth_us,
            now_us: birth_us,
            inputs: Inputs::default(),
            queue: VecDeque::new(),
            played: 0,
            receiver: Receiver::default(),
            words: Vec::new(),
            first_us: 0.0,
            sequence: 0,
        }
    }

    /// The station's clock, µs.
    pub fn now_us(&self) -> u64 {
        self.now_us
    }

    /// Bytes arrive.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.machine
            .receive(Instant::from_micros(self.now_us), bytes);
    }

    /// The next packet with `command`.
    pub fn packet(&mut self, command: Command) -> (u16, Vec<u8>) {
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        let bytes = encode(&Packet { sequence, command }).expect("every command fits");
        (sequence, bytes.to_vec())
    }

    /// The shell does not look for a while.
    pub fn stall(&mut self, us: u64) {
        self.now_us += us;
    }

    /// Lets time pass until `end_us` or the station's next deed.
    pub fn step(&mut self, end_us: u64) -> Deed {
        loop {
            self.sense();
            let now = Instant::from_micros(self.now_us);
            match self.machine.poll(now, 1 << 16) {
                Output::Send(bytes) => {
                    let mut rest = &bytes[..];
                    return match self.receiver.next(&mut rest) {
                        Some(Ok(report)) if rest.is_empty() => Deed::Report(report),
                        _ => Deed::Garbage,
                    };
                }
                Output::Segment(segment) => {
                    self.generator.set_invert(self.machine.inverted());
                    if let Err(fault) = self.generator.load(&segment) {
                        return Deed::Refused(fault);
                    }
                    self.words.resize(usize::from(segment.slots()) * 2, 0);
                    let made = self.generator.fill(&mut self.words);
                    assert_eq!(made, self.words.len(), "the generator fills whole segments");
                    self.enqueue();
                    return Deed::Words;
                }
                Output::Idle(until) if until.micros() > end_us => {
                    self.now_us = self.now_us.max(end_us);
                    self.sense();
                    return Deed::Done;
                }
                Output::Idle(until) => self.now_us = self.now_us.max(until.micros()),
            }
        }
    }

    /// Word periods since birth, after `us` more.
    fn periods(&self, us: u64) -> u64 {
        let since = u128::from(self.now_us - self.birth_us + us);
        (since * u128::from(self.rate.hz()) / 1_000_000) as u64
    }

    /// Appends the segment's words to what is queued; to an engine that ran dry they come after its
    /// delay.
    fn enqueue(&mut self) {
        let now = self.periods(0);
        let end = self.queue.back().map_or(0, |(first, words)| first + words);
        let first = if end > now {
            end
        } else {
            self.periods(self.delay_us)
        };
        self.queue.push_back((first, self.words.len() as u64));
        self.first_us = self.birth_us as f64 + first as f64 * 1e6 / f64::from(self.rate.hz());
    }

    /// Tells the machine its switches and how many words were played.
    fn sense(&mut self) {
        let now = self.periods(0);
        while let Some(&(first, words)) = self.queue.front()
            && (first + words <= now && self.queue.len() > 1)
        {
            self.played += words;
            self.queue.pop_front();
        }
        let part = self
            .queue
            .front()
            .map_or(0, |&(first, words)| now.saturating_sub(first).min(words));
        self.inputs.words_emitted = self.played + part;
        self.machine.sense(self.inputs);
    }

    /// The drivers hold the motors.
    pub fn motors(&self) -> bool {
        self.machine.motors_on()
    }
}
