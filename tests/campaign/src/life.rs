//! A random life: commands, noise, switches, stalls; and at its end the way back.

use crate::frames::Views;
use crate::judge::{Counts, Judge};
use crate::laws::{Law, Violation};
use crate::random::Random;
use crate::sabotage::Sabotage;
use crate::shell::{Deed, Shell};
use crate::stages;
use shared::frame::message::{Command, Config, Outcome, Report};
use shared::safety::{Inputs, State, Trust};

/// A host pings this often, µs.
const PING_US: u64 = 20_000;

/// A segment that was given out and is judged when the reports of its tick have been heard.
struct Held {
    at_us: u64,
    words: Vec<u32>,
    inputs: Inputs,
    motors: bool,
}

/// What came of a life.
pub struct Fate {
    /// What was counted.
    pub counts: Counts,
    /// The laws that were broken.
    pub violations: Vec<Violation>,
}

/// A station, its host, and its judge.
pub struct Life {
    shell: Shell,
    judge: Judge,
    random: Random,
    held: Option<Held>,
    /// When the host pings next; it may be silent for a while.
    ping_us: u64,
    views: Views,
    origin_us: u64,
    /// Packets that were sent before, to be sent again.
    last: Vec<u8>,
    rate: shared::steps::WordRate,
    delay_us: u32,
    /// Before the first hello the station takes nothing else.
    greeted: bool,
    sabotage: Sabotage,
    segments: u64,
    reports: u64,
    /// The last configuration that was sent.
    config: Option<Config>,
}

/// Lives the life of `seed`.
pub fn live(seed: u64, trace: bool) -> Fate {
    live_with(seed, trace, Sabotage::None)
}

/// Lives it before a judge who is deceived.
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
    life.judge
        .note(birth_us, || format!("{hz} Hz, {delay_us} us to the pins, clock {birth_us} us"));
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

/// When the station's clock begins: often just before a count of bits is full.
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
    /// Mostly the usual: hello, a configuration, zero.
    fn begin(&mut self) {
        if self.random.one_in(30) {
            return;
        }
        self.send(Command::Hello);
        for _ in 0..3 {
            self.configure();
            self.run(3_000);
            if self.judge.status().is_some_and(|s| s.state != State::Unconfigured) {
                break;
            }
        }
        if !self.random.one_in(4) {
            self.send(Command::Zero);
            self.run(2_000);
        }
    }

    fn configure(&mut self) {
        let config = match self.random.below(5) {
            0 => stages::usual(),
            1 => stages::wild(&mut self.random, self.rate),
            _ => stages::likely(&mut self.random, self.rate),
        };
        self.send_config(config);
    }

    fn send_config(&mut self, config: Config) {
        self.config = Some(config);
        self.send(Command::Config(config));
    }

    fn event(&mut self) {
        match self.random.below(100) {
            0..20 => self.jog(),
            20..28 => self.setpoint(),
            28..42 => self.follow(),
            42..48 => self.hostile_frame(),
            48..54 => self.send(Command::Stop),
            54..62 => self.send(Command::Reset),
            62..64 => self.mend(),
            64..68 => self.send(Command::Zero),
            68..72 => self.configure(),
            72 => {
                let on = !self.random.one_in(3);
                self.send(Command::Motors { on });
            }
            73..76 => {
                let axes = std::array::from_fn(|_| self.random.one_in(2));
                self.send(Command::Home { axes });
            }
            76..79 => self.silence(),
            79..88 => self.switch(),
            88..92 => self.noise(),
            92..94 => self.stall(),
            94..96 => self.burst(),
            96 => self.hello(),
            97 => self.outing(),
            _ => self.mend(),
        }
    }

    /// Time between events: none at all, within a tick, some ticks, and now and then long.
    fn wait(&mut self) {
        let us = match self.random.below(10) {
            0..2 => 0,
            2..4 => self.random.below(1_500),
            4..6 => self.random.decades(500.0, 10_000.0) as u64,
            6..9 => self.random.decades(3_000.0, 80_000.0) as u64,
            _ => self.random.decades(50_000.0, 600_000.0) as u64,
        };
        self.run(us);
    }

    fn jog(&mut self) {
        let far = self.random.decades(1.0, 60_000.0);
        let only = self.random.below(6);
        let distance_um = std::array::from_fn(|axis| match only {
            3.. => (self.random.range(-far, far)) as i32,
            only if only == axis as u64 => self.random.range(-far, far) as i32,
            _ => 0,
        });
        let distance_um = match self.random.one_in(40) {
            true => distance_um.map(|_| self.random.bits() as i32),
            false => distance_um,
        };
        self.send(Command::Jog { distance_um });
    }

    fn setpoint(&mut self) {
        let far = self.random.decades(10.0, 80_000.0);
        let position_um = match self.random.one_in(30) {
            true => std::array::from_fn(|_| self.random.bits() as i32),
            false => std::array::from_fn(|_| self.random.range(-far, far) as i32),
        };
        self.send(Command::Setpoint { position_um });
    }

    /// Some frames of a target that wanders.
    fn follow(&mut self) {
        let every = self.random.decades(1_000.0, 40_000.0) as u64;
        for _ in 0..self.random.below(12) {
            let now = self.shell.now_us();
            let frame = self.views.sound(&mut self.random, now, self.origin_us);
            self.send(Command::Frame(frame));
            self.run(every);
        }
    }

    /// What a person does after trouble: every switch released, reset, now and then zero.
    fn mend(&mut self) {
        self.release();
        self.run(2_000);
        self.send(Command::Reset);
        if self.random.one_in(3) {
            self.run(2_000);
            self.send(Command::Motors { on: true });
            self.run(2_000);
            self.send(Command::Zero);
        }
    }

    /// Away in one direction again and again, whatever comes between.
    fn outing(&mut self) {
        let axis = self.random.below(3) as usize;
        let far = self.random.decades(30.0, 20_000.0) * self.random.pick(&[-1.0, 1.0]);
        for _ in 0..2 + self.random.below(8) {
            let mut distance_um = [0; 3];
            distance_um[axis] = (far * self.random.range(0.2, 1.0)) as i32;
            self.send(Command::Jog { distance_um });
            let us = self.random.decades(2_000.0, 400_000.0) as u64;
            self.run(us);
            match self.random.below(6) {
                0 => self.shell.inputs.emergency_stop = true,
                1 => self.shell.inputs.driver_fault = true,
                2 => self.shell.inputs.limits[axis][usize::from(far > 0.0)] = true,
                3 => {
                    // The same stage with an axis turned round.
                    let mut config = self.config.unwrap_or_else(stages::usual);
                    config.axes[axis].invert ^= true;
                    self.run(100_000);
                    self.send_config(config);
                }
                _ => {}
            }
            self.judge.switched(self.shell.now_us(), &self.shell.inputs);
            self.run(3_000);
            self.release();
            self.run(2_000);
            self.send(Command::Reset);
            self.run(2_000);
        }
    }

    fn hostile_frame(&mut self) {
        let now = self.shell.now_us();
        let frame = self.views.hostile(&mut self.random, now);
        self.send(Command::Frame(frame));
    }

    /// The host is silent, perhaps for longer than the heartbeat allows.
    fn silence(&mut self) {
        let us = self.random.decades(10_000.0, 500_000.0) as u64;
        self.ping_us = self.shell.now_us() + us;
        let until = self.ping_us;
        self.judge
            .note(self.shell.now_us(), || format!("no pings until {until} us"));
    }

    /// One switch changes; limit switches may bounce.
    fn switch(&mut self) {
        let which = self.random.below(8);
        let bounces = match self.random.one_in(3) {
            true => 2 * self.random.below(6),
            false => 0,
        };
        for _ in 0..=bounces {
            let inputs = &mut self.shell.inputs;
            match which {
                0 => inputs.emergency_stop ^= true,
                1 => inputs.driver_fault ^= true,
                _ => {
                    let limit = &mut inputs.limits.as_flattened_mut()[which as usize - 2];
                    *limit ^= true;
                }
            }
            self.judge.switched(self.shell.now_us(), &self.shell.inputs);
            if bounces > 0 {
                let us = self.random.decades(20.0, 5_000.0) as u64;
                self.run(us);
            }
        }
        if self.random.one_in(3) {
            self.run(30_000);
            self.release();
        }
    }

    fn release(&mut self) {
        let words_emitted = self.shell.inputs.words_emitted;
        self.shell.inputs = Inputs {
            words_emitted,
            ..Inputs::default()
        };
        self.judge.switched(self.shell.now_us(), &self.shell.inputs);
    }

    /// Bytes that are no packet, and packets that came to harm.
    fn noise(&mut self) {
        let now = self.shell.now_us();
        match self.random.below(5) {
            0 => {
                let count = self.random.decades(1.0, 700.0) as usize;
                let bytes: Vec<u8> = (0..count).map(|_| self.random.bits() as u8).collect();
                self.judge.note(now, || format!("{count} bytes of noise"));
                self.shell.receive(&bytes);
            }
            // A packet from before, once more: nothing may come of it.
            1 => {
                self.judge.note(now, || "the last packet again".to_string());
                let last = self.last.clone();
                self.shell.receive(&last);
            }
            // From behind.
            2 => {
                let sequence = self.shell.sequence;
                self.shell.sequence = sequence.wrapping_sub(2 + self.random.below(30_000) as u16);
                let (old, bytes) = self.shell.packet(Command::Jog {
                    distance_um: [5_000; 3],
                });
                self.shell.sequence = sequence;
                self.judge.note(now, || format!("{old}: a jog from behind"));
                self.judge.sent_stale(old);
                self.shell.receive(&bytes);
                if self.sabotage == Sabotage::Credulous {
                    self.judge.heard(now, &Report::Answer {
                        sequence: old,
                        tick: 0,
                        outcome: Outcome::Accepted,
                    });
                }
            }
            kind => {
                let (sequence, mut bytes) = self.shell.packet(Command::Jog {
                    distance_um: [3_000, -3_000, 2_000],
                });
                // The closing zero stays, or at least one byte more is missing: else the next packet's first zero would mend it.
                let last = bytes.len() - 1;
                if kind == 3 {
                    bytes.truncate(1 + self.random.below(last as u64 - 1) as usize);
                } else {
                    let first = self.random.below(last as u64 - 4) as usize;
                    for byte in &mut bytes[first..=first + self.random.below(3) as usize] {
                        *byte ^= 1 << self.random.below(8);
                    }
                }
                self.judge.note(now, || format!("{sequence}: a broken jog"));
                self.judge.sent_stale(sequence);
                self.shell.receive(&bytes);
            }
        }
    }

    /// The shell does not look: for less than what is queued for the pins, which must not show, or for so long that time
    /// went on without motion. (What lies between stops the step engine; the emulated board tests that.)
    fn stall(&mut self) {
        let delay = self.delay_us as f64;
        let us = match self.random.one_in(2) {
            true => delay * 0.9 * self.random.unit(),
            false => delay + self.random.decades(2_300.0, 300_000.0),
        } as u64;
        self.drain();
        self.shell.stall(us);
        self.judge.stalled(self.shell.now_us(), us);
    }

    /// Many commands at once, more than a tick takes.
    fn burst(&mut self) {
        // An answer to a configuration must not be lost in it: the judge would not know the stage any more.
        self.run(1_500);
        for _ in 0..self.random.below(14) {
            match self.random.below(10) {
                0..2 => self.send(Command::Stop),
                2..4 => self.send(Command::Reset),
                4..7 => self.jog(),
                7 => self.setpoint(),
                8 => self.send(Command::Zero),
                _ => self.hostile_frame(),
            }
            let us = self.random.pick(&[0, 0, 10, 100, 400]);
            self.run(us);
        }
    }

    /// The host begins anew, perhaps with other numbers.
    fn hello(&mut self) {
        if self.random.one_in(2) {
            self.shell.sequence = self.random.bits() as u16;
        }
        self.send(Command::Hello);
    }

    fn send(&mut self, command: Command) {
        let (sequence, bytes) = self.shell.packet(command);
        self.greeted |= matches!(command, Command::Hello);
        match self.greeted {
            true => self.judge.sent(self.shell.now_us(), sequence, &command),
            false => self.judge.sent_stale(sequence),
        }
        match self.random.below(4) {
            0 => {
                // In any chunks.
                let at = self.random.below(bytes.len() as u64) as usize;
                self.shell.receive(&bytes[..at]);
                self.shell.receive(&bytes[at..]);
            }
            _ => self.shell.receive(&bytes),
        }
        self.last = bytes;
    }

    /// Lets time pass.
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
                Deed::Garbage => self.judge.breaks(Law::Report, || "bytes that are no report".into()),
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
            self.judge.words(held.at_us, &held.words, &held.inputs, held.motors);
        }
    }

    /// Whatever happened: reset, configuration, zero, and a move that ends exactly.
    fn come_back(&mut self) {
        self.judge.note(self.shell.now_us(), || "the way back".to_string());
        self.release();
        self.ping_us = self.shell.now_us();
        self.send(Command::Hello);
        self.send(Command::Stop);
        self.run(5_000);
        // The longest ramp there may be.
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
        let homed = self.judge.status().is_some_and(|s| s.trust == Trust::Homed && s.fault.is_none());
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

    /// Waits until `condition` or for `ms`; whether it came.
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
