//! A life: a station, its host and its judge, and a recovery at its end.

mod events;

use crate::frames::Views;
use crate::judge::{Counts, Judge};
use crate::laws::{Law, Violation};
use crate::random::Random;
use crate::sabotage::Sabotage;
use crate::shell::{Deed, Shell};
use crate::stages;
use trinocular_core::frame::message::{Command, Config, Report};
use trinocular_core::safety::{Inputs, State, Trust};

/// Interval of the host's pings, µs.
const PING_US: u64 = 20_000;

/// A segment that waits to be judged until the reports of its tick have been heard.
struct Held {
    at_us: u64,
    words: Vec<u32>,
    inputs: Inputs,
    motors: bool,
}

/// Result of a life.
pub struct Fate {
    /// Counts of the life.
    pub counts: Counts,
    /// Laws that were broken.
    pub violations: Vec<Violation>,
}

/// A station, its host, and its judge.
pub struct Life {
    shell: Shell,
    judge: Judge,
    random: Random,
    held: Option<Held>,
    /// Time of the host's next ping, µs; events may put it off.
    ping_us: u64,
    views: Views,
    origin_us: u64,
    /// Packets sent before, for repetition.
    last: Vec<u8>,
    rate: trinocular_core::steps::WordRate,
    delay_us: u32,
    /// True after the first hello; before it the station accepts no other command.
    greeted: bool,
    sabotage: Sabotage,
    segments: u64,
    reports: u64,
    /// Last configuration sent.
    config: Option<Config>,
}

/// Simulates the life of `seed` with a judge that `sabotage` may deceive.
pub fn live_with(seed: u64, trace: bool, sabotage: Sabotage) -> Fate {
    let mut random = Random::new(seed);
    let rate = stages::word_rate(&mut random);
    let delay_us = random.pick(&[0, 100, 256, 512, 512, 763, 1_000, 2_000]);
    let birth_us = birth(&mut random);
    let mut life = Life {
        shell: Shell::new(rate, delay_us, birth_us),
        judge: Judge::new(rate.hz(), birth_us, trace),
        random,
        held: None,
        ping_us: birth_us,
        views: Views::default(),
        origin_us: birth_us,
        last: Vec::new(),
        rate,
        delay_us,
        greeted: false,
        sabotage,
        segments: 0,
        reports: 0,
        config: None,
    };
    let hz = rate.hz();
    life.judge.note(birth_us, || {
        format!("{hz} Hz, {delay_us} us to the pins, clock {birth_us} us")
    });
    life.begin();
    let events = 10 + life.random.below(60);
    for _ in 0..events {
        life.event();
        life.wait();
    }
    life.come_back();
    life.judge.end(life.shell.now_us());
    Fate {
        counts: life.judge.counts,
        violations: life.judge.violations,
    }
}

/// Returns the initial time of the station's clock, often just before a power of two overflows.
fn birth(random: &mut Random) -> u64 {
    let before = random.decades(1.0, 3e6) as u64;
    match random.below(8) {
        0 => (1 << 31) - before,
        1 => (1 << 32) - before,
        2 => (1 << 31) * 1_000 - before,
        3 => (1 << 32) * 1_000 - before,
        4 => (1 << 47) - before,
        5 => (1 << 48) - before,
        _ => random.pick(&[0, 1, 999, 1_000, 123_456_789]),
    }
}

impl Life {
    fn send(&mut self, command: Command) {
        let (sequence, bytes) = self.shell.packet(command);
        self.greeted |= matches!(command, Command::Hello);
        match self.greeted {
            true => self.judge.sent(self.shell.now_us(), sequence, &command),
            false => self.judge.sent_stale(sequence),
        }
        match self.random.below(4) {
            0 => {
                // Deliver the bytes in random chunks.
                let at = self.random.below(bytes.len() as u64) as usize;
                self.shell.receive(&bytes[..at]);
                self.shell.receive(&bytes[at..]);
            }
            _ => self.shell.receive(&bytes),
        }
        self.last = bytes;
    }

    /// Simulates `us` microseconds.
    fn run(&mut self, us: u64) {
        let end = self.shell.now_us() + us;
        while self.ping_us <= end {
            let at = self.ping_us.max(self.shell.now_us());
            self.run_quietly(at);
            self.send(Command::Ping { host_us: at });
            self.ping_us = at + PING_US;
        }
        self.run_quietly(end);
    }

    fn run_quietly(&mut self, end: u64) {
        loop {
            match self.shell.step(end) {
                Deed::Report(report) => self.hear(report),
                Deed::Garbage => self
                    .judge
                    .breaks(Law::Report, || "bytes that are no report".into()),
                Deed::Refused(fault) => self.judge.breaks(Law::Segment, || fault.to_string()),
                Deed::Words => {
                    self.drain();
                    self.held = Some(Held {
                        at_us: self.shell.now_us(),
                        words: self.shell.words.clone(),
                        inputs: self.shell.inputs,
                        motors: self.shell.motors(),
                    });
                }
                Deed::Done => break,
            }
        }
        self.drain();
    }

    fn hear(&mut self, report: Report) {
        self.reports += 1;
        let now = self.shell.now_us();
        if let Some(report) = self.sabotage.report(self.reports, report) {
            self.judge.heard(now, &report);
            if self.sabotage == Sabotage::Echo && self.reports.is_multiple_of(10) {
                self.judge.heard(now, &report);
            }
        }
    }

    fn drain(&mut self) {
        if let Some(mut held) = self.held.take() {
            self.segments += 1;
            self.sabotage.words(self.segments, &mut held.words);
            self.judge
                .words(held.at_us, &held.words, &held.inputs, held.motors);
        }
    }

    /// Ends any life with a reset, a configuration, a zero, and a move that must end exactly.
    fn come_back(&mut self) {
        self.judge
            .note(self.shell.now_us(), || "the way back".to_string());
        self.release();
        self.ping_us = self.shell.now_us();
        self.send(Command::Hello);
        self.send(Command::Stop);
        self.run(5_000);
        // Wait for the longest possible ramp.
        let stops = self.until(2_000_000, |life| {
            life.state().is_some_and(|state| !state.is_moving())
        });
        self.send(Command::Reset);
        self.run(200_000);
        self.send(Command::Motors { on: true });
        self.run(5_000);
        self.send(Command::Config(stages::modest()));
        self.run(5_000);
        self.send(Command::Zero);
        self.run(150_000);
        let idle = self.state() == Some(State::Idle);
        self.send(Command::Setpoint {
            position_um: [3_000, -2_000, 1_000],
        });
        let arrives = self.until(5_000, |life| {
            life.judge.place() == Some([240, -160, 80]) && life.state() == Some(State::Idle)
        });
        let homed = self
            .judge
            .status()
            .is_some_and(|s| s.trust == Trust::Homed && s.fault.is_none());
        if !(stops && idle && arrives && homed) {
            let state = self.state();
            let place = self.judge.place();
            self.judge.breaks(Law::Wedge, || {
                format!(
                    "stops {stops}, idle {idle}, arrives {arrives}, homed {homed}: \
                     {state:?} at {place:?}"
                )
            });
        }
    }

    fn state(&self) -> Option<State> {
        self.judge.status().map(|status| status.state)
    }

    /// Waits for `condition` for at most `ms`. Returns true if it was met.
    fn until(&mut self, ms: u64, condition: impl Fn(&Self) -> bool) -> bool {
        for _ in 0..ms / 10 {
            if condition(self) {
                return true;
            }
            self.run(10_000);
        }
        condition(self)
    }
}
