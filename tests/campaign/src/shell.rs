//! A shell around the station: clock, link, switches and step engine.

use crate::pins::WIRING;
use std::collections::VecDeque;
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{Command, LastRun, Packet, Report, ResetCause};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::machine::{Board, Machine, Output};
use trinocular_core::safety::Inputs;
use trinocular_core::steps::{Generator, LoadFault, WordRate};
use trinocular_core::time::Instant;

/// Output of the station.
pub enum Deed {
    /// A report.
    Report(Report),
    /// Bytes that are no report.
    Garbage,
    /// A segment, with its words in [`Shell::words`]; they reach the pins from [`Shell::first_us`]
    /// on.
    Words,
    /// A refusal of the segment by the step generator.
    Refused(LoadFault),
    /// No further output before the requested instant.
    Done,
}

/// Station, step generator, and a step engine that plays words at an exact rate on the caller's
/// clock.
pub struct Shell {
    machine: Machine,
    generator: Generator,
    rate: WordRate,
    delay_us: u64,
    birth_us: u64,
    now_us: u64,
    /// Present state of the switches; `words_emitted` belongs to the step engine.
    pub inputs: Inputs,
    /// Runs of words queued or being played: first word period since birth, number of words.
    queue: VecDeque<(u64, u64)>,
    /// Number of words in runs that were played to their end.
    played: u64,
    receiver: Receiver<Report>,
    /// Words of the last segment.
    pub words: Vec<u32>,
    /// Instant at which the first of these words reaches the pins, µs.
    pub first_us: f64,
    /// Sequence number of the last packet.
    pub sequence: u16,
}

impl Shell {
    /// Returns a shell that is switched on at `birth_us` of its clock.
    pub fn new(rate: WordRate, delay_us: u32, birth_us: u64) -> Self {
        let board = Board {
            name: "campaign",
            version: [0, 1, 0],
            word_rate: rate,
            delay_us,
            session: 1,
            reset_cause: ResetCause::PowerOn,
            last_run: LastRun::UNKNOWN,
            camera_pin: Some(8),
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

    /// Returns the station's clock, µs.
    pub fn now_us(&self) -> u64 {
        self.now_us
    }

    /// Delivers bytes to the station.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.machine
            .receive(Instant::from_micros(self.now_us), bytes);
    }

    /// Returns the next packet with `command`.
    pub fn packet(&mut self, command: Command) -> (u16, Vec<u8>) {
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        let bytes = encode(&Packet { sequence, command }).expect("every command fits");
        (sequence, bytes.to_vec())
    }

    /// Stalls the shell for a while.
    pub fn stall(&mut self, us: u64) {
        self.now_us += us;
    }

    /// Runs until `end_us` or the station's next output.
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

    /// Returns the word periods since birth after `us` more.
    fn periods(&self, us: u64) -> u64 {
        let since = u128::from(self.now_us - self.birth_us + us);
        (since * u128::from(self.rate.hz()) / 1_000_000) as u64
    }

    /// Appends the segment's words to the queue. After an underrun they start after the engine's
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

    /// Passes the switches and the number of words played to the station.
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

    /// Returns true if the drivers hold the motors.
    pub fn motors(&self) -> bool {
        self.machine.motors_on()
    }
}
