//! Events of a life: commands, noise, switches and stalls.

use super::Life;
use crate::sabotage::Sabotage;
use crate::stages;
use trinocular_core::frame::message::{Command, Config, Outcome, Report};
use trinocular_core::safety::{Inputs, State};

impl Life {
    /// Begins a life, mostly with a hello, a configuration and a zero.
    pub(super) fn begin(&mut self) {
        if self.random.one_in(30) {
            return;
        }
        self.send(Command::Hello);
        for _ in 0..3 {
            self.configure();
            self.run(3_000);
            if self
                .judge
                .status()
                .is_some_and(|s| s.state != State::Unconfigured)
            {
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

    pub(super) fn event(&mut self) {
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

    /// Waits for a random time: none, within a tick, some ticks, and now and then long.
    pub(super) fn wait(&mut self) {
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

    /// Sends some frames of a target that wanders.
    fn follow(&mut self) {
        let every = self.random.decades(1_000.0, 40_000.0) as u64;
        for _ in 0..self.random.below(12) {
            let now = self.shell.now_us();
            let frame = self.views.sound(&mut self.random, now, self.origin_us);
            self.send(Command::Frame(frame));
            self.run(every);
        }
    }

    /// Recovers as an operator does: releases every switch, resets, and now and then zeroes.
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

    /// Moves away in one direction repeatedly, with other events between the moves.
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
                    // Configure the same stage with one axis inverted.
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

    /// Keeps the host silent for a while, which may exceed the heartbeat timeout.
    fn silence(&mut self) {
        let us = self.random.decades(10_000.0, 500_000.0) as u64;
        self.ping_us = self.shell.now_us() + us;
        let until = self.ping_us;
        self.judge
            .note(self.shell.now_us(), || format!("no pings until {until} us"));
    }

    /// Changes one switch. Limit switches may bounce.
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

    pub(super) fn release(&mut self) {
        let words_emitted = self.shell.inputs.words_emitted;
        self.shell.inputs = Inputs {
            words_emitted,
            ..Inputs::default()
        };
        self.judge.switched(self.shell.now_us(), &self.shell.inputs);
    }

    /// Sends bytes that are no packet, and damaged packets.
    fn noise(&mut self) {
        let now = self.shell.now_us();
        match self.random.below(5) {
            0 => {
                let count = self.random.decades(1.0, 700.0) as usize;
                let bytes: Vec<u8> = (0..count).map(|_| self.random.bits() as u8).collect();
                self.judge.note(now, || format!("{count} bytes of noise"));
                self.shell.receive(&bytes);
            }
            // Repeat an earlier packet, which must have no effect.
            1 => {
                self.judge.note(now, || "the last packet again".to_string());
                let last = self.last.clone();
                self.shell.receive(&last);
            }
            // Send a stale sequence number.
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
                    self.judge.heard(
                        now,
                        &Report::Answer {
                            sequence: old,
                            tick: 0,
                            outcome: Outcome::Accepted,
                        },
                    );
                }
            }
            kind => {
                let (sequence, mut bytes) = self.shell.packet(Command::Jog {
                    distance_um: [3_000, -3_000, 2_000],
                });
                // Keep the closing zero or drop at least one more byte; otherwise the next packet's
                // first zero would complete the packet.
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

    /// Stalls the shell, either for less than the pins' queue holds, which must have no effect, or
    /// long enough to empty the queue and hold motion. (A delay between the two stops the step
    /// engine; the emulated board tests that.)
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

    /// Sends more commands at once than a tick takes.
    fn burst(&mut self) {
        // An answer to a configuration must not be lost in the burst, because the judge would no
        // longer know the stage.
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

    /// Connects the host anew, with new sequence numbers in some cases.
    fn hello(&mut self) {
        if self.random.one_in(2) {
            self.shell.sequence = self.random.bits() as u16;
        }
        self.send(Command::Hello);
    }
}
