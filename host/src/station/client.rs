//! The host's half of the protocol: numbers packets, understands reports, keeps the latest status. No input or output.

use super::clock::Clock;
use shared::frame::encode::{Bytes, encode};
use shared::frame::message::{Command, Denial, Hello, Outcome, Packet, Report, Status};
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
    status: Option<Status>,
    answers: VecDeque<(u16, Result<(), Denial>)>,
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
            Report::Hello(hello) => self.hello = Some(hello),
            Report::Status(status) => self.status = Some(status),
            Report::Pong {
                host_us,
                received,
                sent,
            } => {
                self.clock
                    .pong(host_us, received.micros(), sent.micros(), now_us);
            }
            Report::Answer {
                sequence, outcome, ..
            } => {
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
        self.status = None;
        self.answers.clear();
    }

    /// Another station, or the same after a restart: its clock began anew.
    pub fn forget_clock(&mut self) {
        self.clock.clear();
    }

    /// Who the station said it is.
    pub fn hello(&self) -> Option<&Hello> {
        self.hello.as_ref()
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

    /// The station's clock as seen from here.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Bytes from the station that were no report.
    pub fn rejects(&self) -> Rejects {
        self.rejects
    }
}
