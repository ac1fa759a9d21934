//! Packets from the host and reports to it: sequence numbers, hello, answers, status.

use super::Machine;
use super::outbox::Answer;
use crate::frame::message::{Command, Denial, Hello, Outcome, Packet, Report, Status};
use crate::frame::{PROTOCOL, SCHEMA_HASH};
use crate::motion::Planner;
use crate::steps::Position;
use crate::time::Instant;

impl Machine {
    pub(super) fn accept(&mut self, now: Instant, packet: Packet) {
        let sequence = packet.sequence;
        if matches!(packet.command, Command::Hello) {
            self.sequence = Some(sequence);
            self.introduce();
            return;
        }
        match self.sequence.map(|last| sequence.wrapping_sub(last)) {
            Some(0) => self.drops.duplicate = self.drops.duplicate.saturating_add(1),
            Some(1..=0x7fff) => {
                self.sequence = Some(sequence);
                self.queue(now, packet);
            }
            _ => self.drops.stale = self.drops.stale.saturating_add(1),
        }
    }

    fn queue(&mut self, now: Instant, packet: Packet) {
        match packet.command {
            Command::Ping { host_us } => {
                self.last_ping_tick = Some(self.tick);
                self.report(Report::Pong {
                    host_us,
                    received: now,
                    sent: now,
                });
            }
            Command::Stop => {
                let dropped = self.inbox.stop(packet.sequence);
                self.frames_refused = self.frames_refused.wrapping_add(dropped.frames);
                self.drops.answers = self.drops.answers.saturating_add(dropped.unanswered);
            }
            _ => {
                if self.inbox.push(packet).is_err() {
                    self.drops.overflow = self.drops.overflow.saturating_add(1);
                }
            }
        }
    }

    /// Reports the station's identity and its last run. Never inlined, because it is rare and
    /// large, which makes the image smaller.
    #[cold]
    #[inline(never)]
    fn introduce(&mut self) {
        self.report(Report::Hello(self.hello()));
        self.report(Report::LastRun(self.board.last_run));
    }

    fn hello(&self) -> Hello {
        let mut board = heapless::String::new();
        // A name that is too long becomes empty rather than cut within a letter.
        let _ = board.push_str(self.board.name);
        Hello {
            protocol: PROTOCOL,
            schema: SCHEMA_HASH,
            version: self.board.version,
            board,
            word_rate_hz: self.board.word_rate.hz(),
            delay_us: self.board.delay_us,
            session: self.board.session,
            reset_cause: self.board.reset_cause,
        }
    }

    /// Queues a report, or counts it if there is no room.
    pub(super) fn report(&mut self, report: Report) {
        if self.outbox.report(report).is_err() {
            self.drops.answers = self.drops.answers.saturating_add(1);
        }
    }

    pub(super) fn answer(&mut self, sequence: u16, outcome: Result<(), Denial>) {
        let answer = Answer {
            sequence,
            tick: self.tick as u32,
            outcome: outcome.map_or_else(Outcome::Denied, |()| Outcome::Accepted),
        };
        if self.outbox.answer(answer).is_err() {
            self.drops.answers = self.drops.answers.saturating_add(1);
        }
    }

    pub(super) fn status(&self) -> Status {
        let steps = |positions: [Position; 3]| positions.map(Position::whole_steps);
        let of = |get: fn(&Planner) -> [Position; 3]| {
            self.planner.as_ref().map_or([0; 3], |p| steps(get(p)))
        };
        Status {
            time: self.now(),
            tick: self.tick as u32,
            state: self.state,
            fault: self.faults.worst(),
            trust: self.trust,
            position_steps: of(Planner::loads),
            target_steps: of(Planner::targets),
            frames_used: self.frames_used,
            frames_refused: self.frames_refused,
            drops: self.drops,
            estimate: self.estimate,
            sight: self.tracker.pursuit.sight(self.now()),
            seen_ms: milliseconds(self.tracker.pursuit.age_us(self.now())),
            faults: self.faults,
            motors: self.motors,
        }
    }
}

/// Fills in the instant of sending.
pub(super) fn stamped(report: Report, now: Instant) -> Report {
    match report {
        Report::Pong {
            host_us, received, ..
        } => Report::Pong {
            host_us,
            received,
            sent: now,
        },
        other => other,
    }
}

/// Converts µs to ms, saturating. A Cortex-M4 divides 32 bits in hardware.
fn milliseconds(us: u64) -> u16 {
    let ms = u32::try_from(us).unwrap_or(u32::MAX) / 1000;
    u16::try_from(ms).unwrap_or(u16::MAX)
}
