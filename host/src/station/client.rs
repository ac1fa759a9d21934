//! The host's half of the protocol: numbers packets, understands reports, keeps the latest status. No input or output.

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

/// Offset of the station's clock, from the ping with the shortest round trip among the last ones (as NTP does).
#[derive(Debug, Default)]
pub struct Clock {
    pongs: VecDeque<(i64, u64)>,
}

/// Pongs that are looked back at: a few seconds' worth.
const PONGS: usize = 128;

impl Clock {
    /// A ping left at `left` and its reply arrived at `arrived` (host clock, µs); the station had it from `received` to `sent`
    /// (its clock, µs).
    fn pong(&mut self, left: u64, received: u64, sent: u64, arrived: u64) {
        let away = arrived.saturating_sub(left);
        let there = sent.saturating_sub(received);
        let middle_here = left.saturating_add(arrived) / 2;
        let middle_there = received.saturating_add(sent) / 2;
        if self.pongs.len() == PONGS {
            self.pongs.pop_front();
        }
        self.pongs.push_back((
            middle_there as i64 - middle_here as i64,
            away.saturating_sub(there),
        ));
    }

    /// Station time minus host time and the bound of its error (half the shortest round trip), µs. `None` before the first pong.
    pub fn offset_us(&self) -> Option<(i64, u64)> {
        let (offset, round_trip) = self.pongs.iter().min_by_key(|(_, trip)| *trip)?;
        Some((*offset, round_trip.div_ceil(2)))
    }

    /// The host instant in station time, µs.
    pub fn station_us(&self, host_us: u64) -> Option<u64> {
        let (offset, _) = self.offset_us()?;
        host_us.checked_add_signed(offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shortest_round_trip_sets_the_clock() {
        let mut clock = Clock::default();
        assert_eq!(clock.offset_us(), None);
        clock.pong(1_000, 51_900, 51_950, 2_050); // 1000 µs on the way
        clock.pong(3_000, 53_040, 53_060, 3_100); // 80 µs
        clock.pong(5_000, 55_900, 55_900, 5_950);
        assert_eq!(clock.offset_us(), Some((50_000, 40)));
        assert_eq!(clock.station_us(7), Some(50_007));
    }
}
