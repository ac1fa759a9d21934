//! The host's half of the protocol: numbers packets, decodes reports, keeps the latest status.
//! Does no input or output.

use super::clock::Clock;
use super::motion::Motion;
use super::plausible::{self, Implausible, Known};
use super::positions::Positions;
use std::collections::VecDeque;
use trinocular_core::frame::encode::{Bytes, encode};
use trinocular_core::frame::message::{
    Command, Denial, Hello, LastRun, Outcome, Packet, Report, Status,
};
use trinocular_core::frame::receive::{Receiver, Rejects};
use trinocular_core::safety::State;
use trinocular_core::time::Instant;
use trinocular_rig::printable::is_printable;

/// Number of answers kept until the caller takes them.
const ANSWERS: usize = 64;

/// Replacement for an unprintable character in a board's name. Not longer than any character.
const UNPRINTABLE: char = '?';

/// Sequence numbers of the packets to a station.
#[derive(Debug, Default)]
pub struct Numbering(u16);

impl Numbering {
    /// Returns the next packet and its sequence number.
    pub fn packet(&mut self, command: Command) -> (u16, Bytes) {
        self.0 = self.0.wrapping_add(1);
        let packet = Packet {
            sequence: self.0,
            command,
        };
        let bytes = encode(&packet)
            .expect("every command fits a packet (tests/link.rs: every_message_fits)");
        (self.0, bytes)
    }
}

/// A conversation with one station.
///
/// ```
/// use trinocular_client::conversation::Client;
/// use trinocular_core::frame::encode::encode;
/// use trinocular_core::frame::message::{Command, Denial, Outcome, Report};
///
/// let mut client = Client::default();
/// let (sequence, bytes) = client.packet(Command::Zero);
/// assert!(bytes.len() < 20); // They go to the station, whose reply may come in any pieces.
/// let denial = Outcome::Denied(Denial::Moving);
/// let reply = encode(&Report::Answer { sequence, tick: 0, outcome: denial }).unwrap();
/// for byte in &reply {
///     client.feed(0, &[*byte]);
/// }
/// assert_eq!(client.answer(sequence), Some(Err(Denial::Moving)));
/// ```
#[derive(Debug, Default)]
pub struct Client {
    numbering: Numbering,
    receiver: Receiver<Report>,
    hello: Option<Hello>,
    last_run: Option<LastRun>,
    status: Option<Status>,
    positions: Positions,
    /// Sequence number of the latest command that may move the zero of the positions.
    zeroing: Option<u16>,
    /// True if `status` came after the last hello.
    status_is_fresh: bool,
    /// Sequence number, control tick and outcome.
    answers: VecDeque<(u16, u32, Result<(), Denial>)>,
    answered_tick: Option<u32>,
    clock: Clock,
    rejects: Rejects,
    motion: Motion,
    implausible: Option<Implausible>,
}

impl Client {
    /// Returns the next packet and its sequence number.
    pub fn packet(&mut self, command: Command) -> (u16, Bytes) {
        self.numbering.packet(command)
    }

    /// Takes bytes from the station, in any chunking. `host_us` is the host's clock.
    pub fn feed(&mut self, host_us: u64, mut bytes: &[u8]) {
        while let Some(outcome) = self.receiver.next(&mut bytes) {
            match outcome {
                Ok(report) => self.judge(host_us, report),
                Err(reject) => self.rejects.count(reject),
            }
        }
    }

    /// Takes a report whose numbers are plausible, and keeps the first that are not.
    fn judge(&mut self, host_us: u64, report: Report) {
        if let Report::Pong {
            host_us: left_us, ..
        } = report
        {
            let is_later = left_us > host_us && self.clock.offset_us(host_us).is_none();
            if self.hello.is_none() || is_later {
                // The line may still hold a reply to the ping of an earlier host.
                return;
            }
        }
        let known = Known {
            host_us,
            station_us: self.clock.station_us(host_us),
            tick: self.status_since_hello().map(|status| status.tick),
        };
        match plausible::check(&report, known) {
            Ok(()) => self.take(host_us, report),
            Err(implausible) => {
                self.implausible.get_or_insert(implausible);
            }
        }
    }

    fn take(&mut self, now_us: u64, report: Report) {
        match report {
            Report::Hello(mut hello) => {
                // It goes to terminals and logs.
                let name = hello.board.clone();
                hello.board.clear();
                for letter in name.chars() {
                    let shown = match is_printable(letter) {
                        true => letter,
                        false => UNPRINTABLE,
                    };
                    let _ = hello.board.push(shown);
                }
                self.hello = Some(hello);
                // The line may still hold reports to an earlier host: only those after this
                // hello count.
                self.status_is_fresh = false;
                self.answers.clear();
                self.answered_tick = None;
            }
            Report::LastRun(last_run) => self.last_run = Some(last_run),
            // An observer of the line takes them to the images.
            Report::Triggered(_) => {}
            Report::Status(status) => {
                self.motion.told(&status);
                let was_homing = self.status.is_some_and(|last| last.state == State::Homing);
                if was_homing && status.state != State::Homing {
                    self.positions.clear();
                }
                self.positions.add(&status);
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
                // An old answer that comes late makes no older status a fresh one.
                let is_later = |before: u32| tick.wrapping_sub(before) <= u32::MAX / 2;
                if self.answered_tick.is_none_or(is_later) {
                    self.answered_tick = Some(tick);
                }
                let is_denied = matches!(outcome, Outcome::Denied(_));
                self.motion.answered(sequence, tick, is_denied);
                if self.zeroing == Some(sequence) {
                    self.zeroing = None;
                    if !is_denied {
                        self.positions.clear();
                    }
                }
                if self.answers.len() == ANSWERS {
                    self.answers.pop_front();
                }
                let outcome = match outcome {
                    Outcome::Accepted => Ok(()),
                    Outcome::Denied(denial) => Err(denial),
                };
                self.answers.push_back((sequence, tick, outcome));
            }
        }
    }

    /// Starts over on a line that was lost: forgets all reports of the station, except its clock.
    pub fn begin_again(&mut self) {
        self.receiver = Receiver::default();
        self.hello = None;
        self.last_run = None;
        self.status = None;
        self.positions.clear();
        self.zeroing = None;
        self.answers.clear();
        self.answered_tick = None;
        self.implausible = None;
    }

    /// Records a command that was sent with this sequence number by other means than
    /// [`Client::packet`].
    pub(super) fn sent(&mut self, sequence: u16, command: &Command) {
        self.motion.sent(sequence, command);
        if matches!(command, Command::Zero | Command::Config(_)) {
            self.zeroing = Some(sequence);
        }
    }

    /// Returns the motion that the commands of this conversation have started.
    pub(super) fn motion(&self) -> &Motion {
        &self.motion
    }

    /// Returns the motion of [`Client::motion`] for changes.
    pub(super) fn motion_mut(&mut self) -> &mut Motion {
        &mut self.motion
    }

    /// Returns the first implausible number of the station; its report was not taken.
    pub fn implausible(&self) -> Option<Implausible> {
        self.implausible
    }

    /// Forgets the station's clock, for another station or the same after a restart.
    pub fn forget_clock(&mut self) {
        self.clock.clear();
    }

    /// Returns the station's hello.
    pub fn hello(&self) -> Option<&Hello> {
        self.hello.as_ref()
    }

    /// Returns the station's report of its previous run, which comes after its hello.
    pub fn last_run(&self) -> Option<&LastRun> {
        self.last_run.as_ref()
    }

    /// Returns the latest status.
    pub fn status(&self) -> Option<&Status> {
        self.status.as_ref()
    }

    /// Takes the answer to the packet with this sequence number.
    pub fn answer(&mut self, sequence: u16) -> Option<Result<(), Denial>> {
        self.answer_with_tick(sequence).map(|(_, outcome)| outcome)
    }

    /// Takes the answer to the packet with this sequence number, and the control tick at which the
    /// command took effect.
    pub(super) fn answer_with_tick(&mut self, sequence: u16) -> Option<(u32, Result<(), Denial>)> {
        let at = self
            .answers
            .iter()
            .position(|(number, ..)| *number == sequence)?;
        self.answers
            .remove(at)
            .map(|(_, tick, outcome)| (tick, outcome))
    }

    /// Returns the position of the stage at an instant of the station's clock, whole steps and parts
    /// of them, from the reports around it: up to a second ago at 60 frames per second. `None`
    /// without a report since the latest zero.
    pub fn position_steps_at(&self, at: Instant) -> Option<[f64; 3]> {
        self.positions.at(at.micros())
    }

    /// Returns the latest status, if it came after the station's hello.
    pub fn status_since_hello(&self) -> Option<&Status> {
        self.status.as_ref().filter(|_| self.status_is_fresh)
    }

    /// Returns the latest status if it is from the control tick of the latest answer or later, so
    /// that it shows the effect of that command.
    pub fn status_since_answer(&self) -> Option<&Status> {
        let status = self.status_since_hello()?;
        let since = status.tick.wrapping_sub(self.answered_tick?);
        (since <= u32::MAX / 2).then_some(status)
    }

    /// Returns the control tick at which the command of the latest answer took effect. Tick `k` is at
    /// `k` ms of the station's clock, modulo 2³².
    pub fn answered_tick(&self) -> Option<u32> {
        self.answered_tick
    }

    /// Returns the host's model of the station's clock.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Returns the counts of rejected packets.
    pub fn rejects(&self) -> Rejects {
        self.rejects
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::default_stage;
    use crate::twin::Twin;
    use trinocular_core::frame::message::Mounting;

    fn feed(client: &mut Client, report: Report) {
        client.feed(0, &encode(&report).expect("it fits"));
    }

    fn answer(sequence: u16, tick: u32) -> Report {
        Report::Answer {
            sequence,
            tick,
            outcome: Outcome::Accepted,
        }
    }

    /// A station that was suspended answers the pings of a program that has ended meanwhile.
    #[test]
    fn reply_to_an_earlier_program_is_ignored() {
        let twin = Twin::start(&default_stage(), "twin", Mounting::OnStage).expect("it starts");
        let hello = twin.client().hello().expect("it tells").clone();
        let pong = |host_us| Report::Pong {
            host_us,
            received: Instant::from_micros(7_000_000),
            sent: Instant::from_micros(7_000_000),
        };
        let at = |client: &mut Client, us, report| {
            client.feed(us, &encode(&report).expect("it fits"));
        };
        let mut client = Client::default();
        at(&mut client, 200, Report::Hello(hello));
        at(&mut client, 291, pong(1_280_456));
        assert_eq!(
            (client.implausible(), client.clock().offset_us(0)),
            (None, None)
        );
        at(&mut client, 400, pong(300));
        assert!(client.clock().offset_us(0).is_some());
        at(&mut client, 500, pong(501));
        assert!(client.implausible().is_some());
    }

    /// Between the positions before and after it lies no motion.
    #[test]
    fn positions_begin_anew_at_a_new_zero() {
        let twin = Twin::start(&default_stage(), "twin", Mounting::OnStage).expect("it starts");
        let known = *twin.status().expect("it tells");
        let status = |ms: u64, steps, state| {
            Report::Status(Status {
                time: Instant::from_micros(1_000 * ms),
                position_steps: [steps, 0, 0],
                state,
                ..known
            })
        };
        let at = |client: &Client, ms: u64| {
            let position = client.position_steps_at(Instant::from_micros(1_000 * ms));
            position.map(|[x, ..]| x)
        };
        let mut client = Client::default();
        feed(&mut client, status(100, 240, State::Idle));
        feed(&mut client, status(200, 250, State::Idle));
        assert_eq!(at(&client, 150), Some(245.0));
        client.sent(7, &Command::Zero);
        feed(&mut client, answer(6, 210));
        assert_eq!(at(&client, 150), Some(245.0));
        feed(&mut client, answer(7, 220));
        assert_eq!(at(&client, 150), None);
        feed(&mut client, status(300, 0, State::Idle));
        assert_eq!(at(&client, 210), Some(0.0));
        feed(&mut client, status(400, 90, State::Homing));
        feed(&mut client, status(500, 0, State::Idle));
        assert_eq!(at(&client, 450), Some(0.0));
    }

    #[test]
    fn late_answer_freshens_no_status() {
        let twin = Twin::start(&default_stage(), "twin", Mounting::OnStage).expect("it starts");
        let known = *twin.status().expect("it tells");
        let status = |tick| Report::Status(Status { tick, ..known });
        let mut client = Client::default();
        feed(&mut client, status(50));
        feed(&mut client, answer(2, 100));
        feed(&mut client, answer(1, 40));
        assert_eq!(client.status_since_answer(), None);
        feed(&mut client, status(100));
        assert!(client.status_since_answer().is_some());
    }
}
