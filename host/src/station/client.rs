//! The host's half of the protocol: numbers packets, understands reports, keeps the latest status. No input or output.

use super::clock::Clock;
use shared::frame::encode::{Bytes, encode};
use shared::frame::message::{Command, Denial, Hello, LastRun, Outcome, Packet, Report, Status};
use shared::frame::receive::{Receiver, Rejects};
use std::collections::VecDeque;

/// Answers kept until somebody asks for them.
const ANSWERS: usize = 64;

/// A conversation with one station.
#[derive(Debug, Default)]
pub struct Client {
    sequence: u16,
    receiver: Receiver<Report>,
    hello: Option<Hello>,
    last_run: Option<LastRun>,
    status: Option<Status>,
    /// `status` came after the last hello.
    status_is_fresh: bool,
    answers: VecDeque<(u16, Result<(), Denial>)>,
    answered_tick: Option<u32>,
    clock: Clock,
    rejects: Rejects,
}

impl Client {
    /// The next packet, with its sequence number.
    pub fn packet(&mut self, command: Command) -> (u16, Bytes) {
        self.sequence = self.sequence.wrapping_add(1);
        let packet = Packet {
            sequence: self.sequence,
            command,
        };
        let bytes = encode(&packet)
            .expect("every command fits a packet (tests/link.rs: every_message_fits)");
        (self.sequence, bytes)
    }

    /// Takes bytes from the station, in any chunking. `host_us` is the host's clock.
    pub fn feed(&mut self, host_us: u64, mut bytes: &[u8]) {
        while let Some(outcome) = self.receiver.next(&mut bytes) {
            match outcome {
                Ok(report) => self.take(host_us, report),
                Err(reject) => self.rejects.count(reject),
            }
        }
    }

    fn take(&mut self, now_us: u64, report: Report) {
        match report {
            Report::Hello(hello) => {
                self.hello = Some(hello);
                // A line may have kept what the station told somebody else: of that, only what comes after our hello is for us.
                self.status_is_fresh = false;
                self.answers.clear();
                self.answered_tick = None;
            }
            Report::LastRun(last_run) => self.last_run = Some(last_run),
            Report::Status(status) => {
                self.status = Some(status);
                self.status_is_fresh = true;
            }
            Report::Pong {
                host_us,
                received,
                sent,
            } => {
                self.clock
                    .pong(host_us, received.micros(), sent.micros(), now_us);
            }
            Report::Answer {
                sequence,
                tick,
                outcome,
            } => {
                self.answered_tick = Some(tick);
                if self.answers.len() == ANSWERS {
                    self.answers.pop_front();
                }
                let outcome = match outcome {
                    Outcome::Accepted => Ok(()),
                    Outcome::Denied(denial) => Err(denial),
                };
                self.answers.push_back((sequence, outcome));
            }
        }
    }

    /// Starts over on a line that was lost: what was heard of the station no longer counts, except its clock.
    pub fn begin_again(&mut self) {
        self.receiver = Receiver::default();
        self.hello = None;
        self.last_run = None;
        self.status = None;
        self.answers.clear();
        self.answered_tick = None;
    }

    /// Another station, or the same after a restart: its clock began anew.
    pub fn forget_clock(&mut self) {
        self.clock.clear();
    }

    /// Who the station said it is.
    pub fn hello(&self) -> Option<&Hello> {
        self.hello.as_ref()
    }

    /// What the station said of the time before it started; comes after its hello.
    pub fn last_run(&self) -> Option<&LastRun> {
        self.last_run.as_ref()
    }

    /// The latest status.
    pub fn status(&self) -> Option<&Status> {
        self.status.as_ref()
    }

    /// The answer to the packet with this number, once.
    pub fn answer(&mut self, sequence: u16) -> Option<Result<(), Denial>> {
        let at = self
            .answers
            .iter()
            .position(|(number, _)| *number == sequence)?;
        self.answers.remove(at).map(|(_, outcome)| outcome)
    }

    /// The latest status, if it came after the station's hello.
    pub fn status_since_hello(&self) -> Option<&Status> {
        self.status.as_ref().filter(|_| self.status_is_fresh)
    }

    /// The latest status, if it was made at or after the control tick of the latest answer: so it shows what that command has done.
    pub fn status_since_answer(&self) -> Option<&Status> {
        let status = self.status_since_hello()?;
        let since = status.tick.wrapping_sub(self.answered_tick?);
        (since <= u32::MAX / 2).then_some(status)
    }

    /// The station's clock as seen from here.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Bytes from the station that were no report.
    pub fn rejects(&self) -> Rejects {
        self.rejects
    }
}
