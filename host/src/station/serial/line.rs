//! One serial line and the conversation on it: heartbeat, loss, and finding back.
//!
//! A line is up, down or given up. It goes down when the port fails or the station answers no ping for [`SILENCE`]. From then on the port is
//! closed, and opened again and greeted every [`RETRY`], until a station answers or the patience ends. A line that came back is not used by
//! itself: the interruption stays, without heartbeat, until somebody decides (`resume`). So no motion goes on because a plug was put back.

use super::super::StationError;
use super::super::client::Client;
use serialport::SerialPort;
use shared::frame::message::{Command, Hello, Mismatch};
use shared::safety::State;
use std::io::{self, Read as _, Write as _};
use std::time::{Duration, Instant};

/// Speed of the line, baud. USB has none; a UART link is wired for this one.
const BAUD: u32 = 921_600;

/// The heartbeat.
const PING: Duration = Duration::from_millis(20);

/// How long a write may take.
const WRITE_PATIENCE: Duration = Duration::from_millis(100);

/// A station that says nothing for so long, although it is pinged, is lost.
const SILENCE: Duration = Duration::from_secs(2);

/// How often a lost port is opened again, and hello repeated.
const RETRY: Duration = Duration::from_millis(250);

/// Whether the line can be used.
enum Link {
    Up,
    /// Being looked for: since when, why, and when to try next.
    Down {
        since: Instant,
        reason: String,
        next_try: Instant,
    },
    /// Given up, and why.
    Over(String),
}

/// What happened to a line that is up again.
#[derive(Clone, Debug)]
enum Interruption {
    /// The same station with all it knew.
    Away { reason: String, away: Duration },
    /// It lost its configuration and position, or is another one.
    Restarted { cause: &'static str },
    /// Its firmware is another.
    Mismatch(Vec<Mismatch>),
}

/// One line.
pub(super) struct Line {
    /// `None` while the line is down.
    port: Option<Box<dyn SerialPort>>,
    pub path: String,
    pub client: Client,
    epoch: Instant,
    pings: bool,
    next_ping: Instant,
    /// When the station last said something.
    heard: Instant,
    link: Link,
    interruption: Option<Interruption>,
    /// The session that commands belong to; `None` before the first hello.
    session: Option<u32>,
    /// Whether the station was configured in this session.
    pub configured: bool,
    /// How long a lost line is looked for.
    pub patience: Duration,
    /// The owner is gone.
    pub closed: bool,
}

impl Line {
    pub fn open(path: &str, patience: Duration) -> Result<Self, StationError> {
        let port = open(path).map_err(|cause| StationError::Port {
            path: path.to_owned(),
            reason: format!("cannot open: {cause}"),
        })?;
        let now = Instant::now();
        Ok(Self {
            port: Some(port),
            path: path.to_owned(),
            client: Client::default(),
            epoch: now,
            pings: false,
            next_ping: now,
            heard: now,
            link: Link::Up,
            interruption: None,
            session: None,
            configured: false,
            patience,
            closed: false,
        })
    }

    pub fn now_us(&self) -> u64 {
        u64::try_from(self.epoch.elapsed().as_micros()).unwrap_or(u64::MAX)
    }

    pub fn set_pings(&mut self, on: bool) {
        self.pings = on;
        self.next_ping = Instant::now();
        self.heard = self.next_ping;
    }

    /// Whether there is anything left to attend to.
    pub fn is_over(&self) -> bool {
        self.closed || matches!(self.link, Link::Over(_))
    }

    /// Does what is due.
    pub fn attend(&mut self) {
        match self.link {
            Link::Up => {
                self.take_in();
                self.beat();
            }
            Link::Down { .. } => self.look_for(),
            Link::Over(_) => {}
        }
    }

    /// Numbers and writes a command, unless the line is interrupted: then it goes nowhere, and the number is never answered.
    pub fn send(&mut self, command: Command) -> u16 {
        let (sequence, bytes) = self.client.packet(command);
        if self.check().is_ok() {
            self.write(&bytes);
        }
        sequence
    }

    /// Says hello. A closing zero first: the line may hold half a packet.
    pub fn greet(&mut self) {
        let (_, bytes) = self.client.packet(Command::Hello);
        self.write(&[0]);
        self.write(&bytes);
    }

    /// Remembers whom commands are for.
    pub fn begin_session(&mut self) {
        self.session = self.client.hello().map(|hello| hello.session);
    }

    fn write(&mut self, bytes: &[u8]) {
        let Some(port) = &mut self.port else { return };
        if let Err(cause) = port.write_all(bytes) {
            self.lose(format!("cannot write: {cause}"));
        }
    }

    /// Takes in what has arrived, without waiting.
    pub fn take_in(&mut self) {
        let mut buffer = [0; 1024];
        while let Some(port) = &mut self.port {
            let waiting = match port.bytes_to_read() {
                Ok(0) => return,
                Ok(waiting) => (waiting as usize).min(buffer.len()),
                Err(cause) => return self.lose(format!("cannot read: {cause}")),
            };
            match port.read(&mut buffer[..waiting]) {
                Ok(count) => {
                    self.heard = Instant::now();
                    let now_us = self.now_us();
                    self.client.feed(now_us, &buffer[..count]);
                }
                Err(cause) if is_pause(&cause) => return,
                Err(cause) => return self.lose(format!("cannot read: {cause}")),
            }
        }
    }

    fn beat(&mut self) {
        let now = Instant::now();
        if !self.pings || self.interruption.is_some() || now < self.next_ping {
            return;
        }
        if now.duration_since(self.heard) > SILENCE {
            return self.lose(format!("no answer for {} s", SILENCE.as_secs()));
        }
        let host_us = self.now_us();
        self.send(Command::Ping { host_us });
        // After a pause of this process one ping is enough.
        self.next_ping = (self.next_ping + PING).max(now);
    }

    fn lose(&mut self, reason: String) {
        self.port = None;
        if matches!(self.link, Link::Up) {
            let since = Instant::now();
            self.client.begin_again();
            self.link = Link::Down {
                since,
                reason,
                next_try: since,
            };
        }
    }

    /// Opens and greets; judges what answers.
    fn look_for(&mut self) {
        let Link::Down {
            since,
            reason,
            next_try,
        } = &mut self.link
        else {
            return;
        };
        let now = Instant::now();
        let (since, cause) = (*since, reason.clone());
        let due = now >= *next_try;
        if due {
            *next_try = now + RETRY;
        }
        self.take_in();
        if let Some(interruption) = self.judge(since, &cause) {
            self.interruption = Some(interruption);
            self.link = Link::Up;
        } else if now.duration_since(since) > self.patience || self.session.is_none() {
            self.port = None;
            self.link = Link::Over(cause);
        } else if due {
            if self.port.is_none() {
                self.port = open(&self.path).ok();
            }
            self.greet();
        }
    }

    /// Who answered on a line that was lost. Its state is in the first status, which comes within a tenth of a second.
    fn judge(&mut self, since: Instant, reason: &str) -> Option<Interruption> {
        let hello: &Hello = self.client.hello()?;
        let mismatches = hello.mismatches();
        if !mismatches.is_empty() {
            return Some(Interruption::Mismatch(mismatches.to_vec()));
        }
        let state = self.client.status()?.state;
        let forgot = self.configured && state == State::Unconfigured;
        if self.session != Some(hello.session) || forgot {
            let cause = super::super::reset_cause(hello.reset_cause);
            self.client.forget_clock();
            return Some(Interruption::Restarted { cause });
        }
        Some(Interruption::Away {
            reason: reason.to_owned(),
            away: since.elapsed(),
        })
    }

    /// Whether the line is being looked for.
    pub fn is_down(&self) -> bool {
        matches!(self.link, Link::Down { .. })
    }

    /// Whether commands reach the station.
    pub fn check(&self) -> Result<(), StationError> {
        let path = || self.path.clone();
        match (&self.link, &self.interruption) {
            (Link::Up, None) => Ok(()),
            (Link::Down { reason, .. } | Link::Over(reason), _) => Err(StationError::Lost {
                path: path(),
                reason: reason.clone(),
            }),
            (Link::Up, Some(Interruption::Away { reason, away })) => {
                Err(StationError::Interrupted {
                    path: path(),
                    reason: reason.clone(),
                    away_ms: away.as_millis() as u64,
                })
            }
            (Link::Up, Some(Interruption::Restarted { cause })) => Err(StationError::Restarted {
                path: path(),
                cause,
            }),
            (Link::Up, Some(Interruption::Mismatch(fields))) => {
                Err(StationError::Mismatch(fields.clone()))
            }
        }
    }

    /// Goes on after an interruption of a station that lost nothing and has no fault.
    pub fn resume(&mut self) -> Result<(), StationError> {
        if let (Link::Up, Some(Interruption::Away { .. })) = (&self.link, &self.interruption) {
            if let Some(fault) = self.client.status().and_then(|status| status.fault) {
                return Err(StationError::Faulted(fault));
            }
            self.interruption = None;
            self.set_pings(self.pings);
        }
        self.check()
    }
}

fn open(path: &str) -> serialport::Result<Box<dyn SerialPort>> {
    let mut port = serialport::new(path, BAUD).timeout(WRITE_PATIENCE).open()?;
    // Tells a board with USB that somebody listens. A pseudo-terminal has no such line and says so.
    let _ = port.write_data_terminal_ready(true);
    Ok(port)
}

fn is_pause(cause: &io::Error) -> bool {
    matches!(
        cause.kind(),
        io::ErrorKind::TimedOut | io::ErrorKind::Interrupted | io::ErrorKind::WouldBlock
    )
}
