//! Emulated board with a host at its other end: the host's own link code, on the board's time.

use crate::board::{Board, Make};
use crate::image::Image;
use crate::order::config;
use crate::time::{Beats, MS, US};
use crate::wiring;
use trinocular_client::conversation::Client;
use trinocular_core::frame::message::{Command, Denial, Report, Status};
use trinocular_core::frame::receive::Receiver;
use trinocular_rig::rig_file::Driver;

/// Period of the host's heartbeat.
const PING: Beats = 20 * MS;

/// Interval at which the host polls its link.
const LOOK: Beats = 250 * US;

/// Timeout of an answer.
const PATIENCE: Beats = 200 * MS;

/// Packet that the host wrote.
#[derive(Clone, Debug)]
pub struct Sent {
    /// Moment of the packet's last byte on the wire.
    pub at: Beats,
    /// Sequence number of the packet.
    pub sequence: u16,
    /// Command in the packet.
    pub command: Command,
    /// Bytes of the packet.
    pub bytes: Vec<u8>,
}

/// Link between host and station.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Link {
    /// USART3.
    #[default]
    Uart,
    /// USB CDC-ACM.
    Usb,
}

/// Board and host.
pub struct Station {
    /// The board.
    pub board: Board,
    /// Client of the protocol, on the host's side.
    pub client: Client,
    /// Packets of the host since the board's power-on.
    pub sent: Vec<Sent>,
    /// Reports of the board, with the moments of their last bytes.
    pub reports: Vec<(Beats, Report)>,
    receiver: Receiver<Report>,
    pings: bool,
    next_ping: Beats,
    taken: [usize; 2],
    link: Link,
}

impl Station {
    /// Powers on a correctly wired board, with a host that is silent so far.
    pub fn power_on(image: &Image, make: Make) -> Self {
        Self::of(Board::power_on(image, make, wiring::well))
    }

    /// Connects a host to this board.
    pub fn of(board: Board) -> Self {
        Self {
            board,
            client: Client::default(),
            sent: Vec::new(),
            reports: Vec::new(),
            receiver: Receiver::default(),
            pings: false,
            next_ping: 0,
            taken: [0; 2],
            link: Link::Uart,
        }
    }

    /// Returns the host's clock, µs.
    pub fn host_us(&self) -> u64 {
        self.board.now() / US
    }

    /// Returns the moment at which the station's clock was zero; the firmware must have started it.
    pub fn clock_zero(&mut self) -> Beats {
        let started = self.board.chip(|chip| chip.tim5.started);
        started.expect("the firmware's clock runs")
    }

    /// Returns the station's clock, µs.
    pub fn clock_us(&mut self) -> u64 {
        (self.board.now() - self.clock_zero()) / US
    }

    /// Lets time pass, with heartbeats if they are on.
    pub fn run(&mut self, beats: Beats) {
        let end = self.board.now() + beats;
        while self.board.now() < end {
            if self.pings && self.next_ping <= self.board.now() {
                self.next_ping = self.board.now() + PING;
                let host_us = self.host_us();
                self.send(Command::Ping { host_us });
            }
            let until = (self.board.now() + LOOK).min(end);
            self.board.run_until(until);
            self.listen();
        }
    }

    /// Switches the host to this link.
    pub fn use_link(&mut self, link: Link) {
        self.link = link;
    }

    /// Plugs USB in, and waits until the host's program has its port.
    ///
    /// # Panics
    /// If the device is not enumerated within a second.
    pub fn plug_usb(&mut self) {
        self.use_link(Link::Usb);
        self.board.chip(|chip| chip.usb_host.plug());
        let end = self.board.now() + 1_000 * MS;
        while !self.board.chip(|chip| chip.usb_host.is_open()) {
            let failures = self.board.chip(|chip| chip.usb_host.failures.clone());
            assert!(self.board.now() < end, "not enumerated: {failures:?}");
            self.run(MS);
        }
    }

    fn listen(&mut self) {
        let (link, [uart, usb]) = (self.link, self.taken);
        let (new, taken) = self.board.chip(|chip| {
            let (sent, received) = (&chip.usart3.sent, &chip.usb_host.received);
            let new = match link {
                Link::Uart => sent[uart..].to_vec(),
                Link::Usb => received[usb..].to_vec(),
            };
            (new, [sent.len(), received.len()])
        });
        self.taken = taken;
        for (at, byte) in new {
            self.client.feed(at / US, &[byte]);
            let mut one = &[byte][..];
            while let Some(outcome) = self.receiver.next(&mut one) {
                self.reports.extend(outcome.ok().map(|report| (at, report)));
            }
        }
    }

    /// Writes bytes to the line.
    pub fn write(&mut self, bytes: &[u8]) {
        let link = self.link;
        self.board.chip(|chip| match link {
            Link::Uart => chip.uart_arrives(bytes),
            Link::Usb => chip.usb_host.write(bytes),
        });
    }

    /// Starts or stops the heartbeat.
    pub fn set_pings(&mut self, on: bool) {
        self.pings = on;
        self.next_ping = self.board.now();
    }

    /// Numbers and writes a command, and returns its sequence number.
    pub fn send(&mut self, command: Command) -> u16 {
        let (sequence, bytes) = self.client.packet(command);
        self.write(&bytes);
        let at = match self.link {
            Link::Uart => self.board.chip(|chip| chip.usart3.quiet_at()),
            Link::Usb => None,
        };
        self.sent.push(Sent {
            at: at.unwrap_or(self.board.now()),
            sequence,
            command,
            bytes: bytes.to_vec(),
        });
        sequence
    }

    /// Waits for a report of the station.
    ///
    /// # Panics
    /// If it does not come.
    pub fn wait<T>(&mut self, what: &str, mut got: impl FnMut(&mut Client) -> Option<T>) -> T {
        let end = self.board.now() + PATIENCE;
        loop {
            if let Some(value) = got(&mut self.client) {
                return value;
            }
            let now = self.board.now();
            assert!(
                now < end,
                "no {what}; rejects {:?}, last reset {:?}, at {:#x}, {:?}",
                self.client.rejects(),
                self.board.last_reset(),
                self.board.program_counter(),
                self.board.chip(|chip| chip.complaints.clone()),
            );
            self.run(LOOK);
        }
    }

    /// Sends a command and waits for its answer.
    pub fn command(&mut self, command: Command) -> Result<(), Denial> {
        let sequence = self.send(command);
        self.wait("answer", |client| client.answer(sequence))
    }

    /// Sends hello to a station that has just started, with the closing zero of a host that joins a
    /// line in any state, and starts the heartbeat.
    pub fn greet(&mut self) {
        self.client.begin_again();
        self.write(&[0]);
        self.send(Command::Hello);
        self.wait("hello", |client| client.hello().map(|_| ()));
        self.wait("account of the last run", |client| {
            client.last_run().map(|_| ())
        });
        self.set_pings(true);
    }

    /// Configures the station, and zeroes its position.
    ///
    /// # Panics
    /// If the station refuses.
    pub fn set_up(&mut self, driver: Driver) {
        let config = Command::Config(config(driver));
        assert_eq!(self.command(config), Ok(()));
        assert_eq!(self.command(Command::Zero), Ok(()));
    }

    /// Returns a new status.
    pub fn status(&mut self) -> Status {
        let before = self.reports.len();
        let end = self.board.now() + PATIENCE;
        loop {
            let status = self.reports[before..]
                .iter()
                .find_map(|(_, report)| match report {
                    Report::Status(status) => Some(*status),
                    _ => None,
                });
            if let Some(status) = status {
                return status;
            }
            assert!(self.board.now() < end, "no status");
            self.run(MS);
        }
    }

    /// Returns the STEP and DIR edges since power-on.
    pub fn edges(&mut self) -> Vec<(Beats, u16)> {
        let changes = self.board.changes(wiring::C);
        wiring::stepper_edges(&changes)
    }
}
