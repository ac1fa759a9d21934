//! One serial line and the conversation on it: heartbeat, loss, and reconnection.
//!
//! A line is up, down or given up. It goes down when the port fails or the station answers no ping
//! for [`SILENCE`]. From then on the port is closed, and opened again and greeted every [`RETRY`],
//! until a station answers or the patience ends. A pseudo-terminal is not opened again by its own
//! name ([`terminal`](super::terminal)). A line that came back stays interrupted, without
//! heartbeat, until the caller calls `resume`. So no motion goes on because a plug was put back. The
//! line also goes down when the station has forgotten its configuration: it restarted.
//!
//! This module also repeats a stop, once begun, until it is answered or given up (`stop`).

use super::super::StationError;
use super::super::conversation::Client;
use super::super::motion::moves;
use super::super::observer::StationObserver;
use super::super::owner::{self, Purpose, Reception};
use super::busy::{self, Holder};
use super::port::{self, Half, Halves};
use super::sender::Sender;
use super::sharing::Guests;
use super::stop::{STOP_PATIENCE, Stop};
use super::terminal::Terminal;
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};
use trinocular_core::frame::message::{Command, Config, Hello, Mismatch};
use trinocular_core::safety::State;
use trinocular_rig::interruption;

/// Silence after which a pinged station counts as lost.
const SILENCE: Duration = Duration::from_secs(2);

/// Period at which a lost port is opened again and hello repeated.
const RETRY: Duration = Duration::from_millis(250);

/// Default time for reconnecting a lost line.
pub(super) const RECONNECT_PATIENCE: Duration = Duration::from_secs(10);

/// Time between two stops, until one is answered. An answer comes within a few ms.
const STOP_PERIOD: Duration = Duration::from_millis(30);

/// Number of unanswered stops after which a hello goes before the next one.
const STOPS_PER_HELLO: u32 = 4;

/// Reason why a lost pseudo-terminal is given up.
const GONE: &str = "the program behind this pseudo-terminal has ended or was unplugged, and its \
                    name may lead to another program by now, so it is not opened again";

/// Condition of the line.
enum Link {
    Up,
    /// Being reconnected: start of the loss, its reason, and the next attempt.
    Down {
        since: Instant,
        reason: String,
        next_try: Instant,
    },
    /// Given up for this reason.
    Over(String),
}

/// Interruption of a line that is up again.
#[derive(Clone, Debug)]
enum Interruption {
    /// Same station with all its state.
    Away { reason: String, away: Duration },
    /// Station without configuration and position, or another station.
    Restarted { cause: &'static str },
    /// Station with other firmware.
    Mismatch(Vec<Mismatch>),
}

/// One serial line.
pub(super) struct Line {
    /// Reading half; `None` while the line is down.
    port: Option<Half>,
    /// Writing half, with the heartbeat.
    sender: Arc<Sender>,
    pub path: String,
    /// The port, if it is a pseudo-terminal.
    terminal: Option<Terminal>,
    pub client: Client,
    pings: bool,
    pub stop: Stop,
    /// Instant of the last bytes from the station.
    heard: Instant,
    link: Link,
    interruption: Option<Interruption>,
    /// True once a status has shown the configuration that this program has sent.
    is_configured: bool,
    /// Session that commands belong to; `None` before the first hello.
    session: Option<u32>,
    /// Time for reconnecting a lost line.
    pub patience: Duration,
    /// True once the owner is gone.
    pub closed: bool,
    /// Program that stopped the stage through this one. Until it is cleared, nothing that may move
    /// the stage is sent.
    pub stopped_by: Option<String>,
    observer: Option<Arc<dyn StationObserver>>,
    /// Program through which the line leads, because it has the port.
    pub owner: Option<Holder>,
    pub guests: Guests,
    /// Configuration that this program gave the station in this session.
    pub configuration: Option<Config>,
}

impl Line {
    /// Opens the port; if another program has it and lets others in, connects to that program.
    pub fn open(path: &str, purpose: Purpose, sender: Arc<Sender>) -> Result<Self, StationError> {
        let terminal = Terminal::at(path);
        let (halves, owner) = match owner::connect_to_owner(path, purpose) {
            Some(Reception::Welcome(stream, owner)) => {
                let halves = port::through(stream).map_err(serialport::Error::from);
                (halves, Some(owner))
            }
            Some(Reception::Refused(holder)) => {
                return Err(StationError::Busy {
                    path: path.to_owned(),
                    holder: Some(holder),
                });
            }
            None => (port::open(path), None),
        };
        let (reader, writer) = halves.map_err(|cause| busy::explain(path, &cause))?;
        sender.set_port(Some(writer));
        Ok(Self {
            port: Some(reader),
            sender,
            path: path.to_owned(),
            // A guest opens no port.
            terminal: terminal.filter(|_| owner.is_none()),
            client: Client::default(),
            pings: false,
            stop: Stop::default(),
            heard: Instant::now(),
            link: Link::Up,
            interruption: None,
            is_configured: false,
            session: None,
            patience: match owner {
                // When the owner is gone, so is the knowledge of what it did.
                Some(_) => Duration::ZERO,
                None => RECONNECT_PATIENCE,
            },
            closed: false,
            stopped_by: None,
            observer: None,
            owner,
            guests: Guests::default(),
            configuration: None,
        })
    }

    /// Sets the observer of everything on the line from now on.
    pub fn set_observer(&mut self, observer: Option<Arc<dyn StationObserver>>) {
        self.sender.set_observer(observer.clone());
        self.observer = observer;
    }

    /// Begins to stop the stage for another program, in whatever state the line's own stop is.
    pub fn stop_for(&mut self, by: String) {
        self.stop_again();
        self.stopped_by = Some(by);
    }

    /// Stops the stage now, whether or not an earlier stop was answered.
    pub fn stop_again(&mut self) {
        // The answer to an earlier stop counts only while no command came after it.
        let is_known = self.client.motion().stopped_tick().is_some();
        let is_over = match self.stop {
            Stop::Unanswered { .. } => true,
            Stop::Answered => !is_known,
            Stop::None | Stop::Asked { .. } => false,
        };
        if is_over {
            self.stop = Stop::None;
        }
        self.begin_stop();
        self.repeat_stop();
    }

    /// Returns true if the heartbeat is on.
    pub fn is_pinging(&self) -> bool {
        self.pings
    }

    pub fn set_pings(&mut self, on: bool) {
        self.pings = on;
        self.heard = Instant::now();
        let is_usable = matches!(self.link, Link::Up) && self.interruption.is_none();
        self.sender.set_pings(on && is_usable);
    }

    /// Starts the heartbeat unless it is on.
    pub fn keep_pinging(&mut self) {
        if !self.pings {
            self.set_pings(true);
        }
    }

    /// Returns the host's clock, µs since the line was opened.
    pub fn now_us(&self) -> u64 {
        self.sender.now_us()
    }

    /// Returns true if the line is closed or given up.
    pub fn is_over(&self) -> bool {
        self.closed || matches!(self.link, Link::Over(_))
    }

    /// Runs all due work: reads, repeats a stop, or reconnects.
    pub fn attend(&mut self) {
        match self.link {
            Link::Up => {
                self.take_in();
                self.listen();
                if interruption::is_requested() && self.client.motion().may_go_on() {
                    self.begin_stop();
                }
                self.repeat_stop();
            }
            Link::Down { .. } => self.look_for(),
            Link::Over(_) => {}
        }
    }

    /// Numbers and writes a command. Writes nothing if the line is interrupted, or if the command
    /// might undo a stop that is not answered yet or that ends the program; the number is then
    /// never answered.
    pub fn send(&mut self, command: Command) -> u16 {
        // A stop is repeated until it is answered; nothing overtakes it.
        let is_stopping = interruption::is_requested() || matches!(self.stop, Stop::Asked { .. });
        if self.check().is_err() || is_stopping && may_undo_a_stop(&command) {
            return self.sender.skip();
        }
        if may_undo_a_stop(&command) {
            self.stop = Stop::None;
        }
        let sequence = self.sender.send(command);
        self.client.sent(sequence, &command);
        sequence
    }

    /// Returns true if the stage moves, or may move because of what went over this line.
    pub fn is_moving(&self) -> bool {
        self.client.motion().is_open()
            || (self.client.status()).is_some_and(|status| status.state.is_moving())
    }

    /// Sends hello.
    pub fn greet(&mut self) {
        self.sender.greet();
    }

    /// Begins to stop the stage, unless a stop is under way or done. Sends on an interrupted line,
    /// too.
    pub fn begin_stop(&mut self) {
        if matches!(self.stop, Stop::None) {
            self.client.motion_mut().forget_stops();
            self.stop = Stop::Asked {
                since: Instant::now(),
                next: Instant::now(),
                sent: 0,
            };
        }
    }

    /// Sends the stop that is due. Each is a new packet, because the station drops a packet whose
    /// number it has seen.
    fn repeat_stop(&mut self) {
        let Stop::Asked { since, next, sent } = &mut self.stop else {
            return;
        };
        let now = Instant::now();
        if self.client.motion().stopped_tick().is_some() {
            self.stop = Stop::Answered;
        } else if now.duration_since(*since) > STOP_PATIENCE {
            // Without a heartbeat the station stops by itself.
            self.stop = Stop::Unanswered { sent: *sent };
            self.set_pings(false);
        } else if now >= *next {
            *next = now + STOP_PERIOD;
            *sent += 1;
            if sent.is_multiple_of(STOPS_PER_HELLO) {
                // A station that has restarted takes nothing before a hello.
                self.sender.greet();
            }
            let sequence = self.sender.send(Command::Stop);
            self.client.sent(sequence, &Command::Stop);
        }
    }

    /// Records the session that commands belong to.
    pub fn begin_session(&mut self) {
        self.session = self.client.hello().map(|hello| hello.session);
    }

    /// Reads all bytes that have arrived, without waiting.
    pub fn take_in(&mut self) {
        let mut buffer = [0; 1024];
        while let Some(port) = &mut self.port {
            match port.read_arrived(&mut buffer) {
                Ok(0) => return,
                Ok(count) => {
                    self.heard = Instant::now();
                    let now_us = self.sender.now_us();
                    if let Some(observer) = &self.observer {
                        observer.received(now_us, &buffer[..count]);
                    }
                    self.client.feed(now_us, &buffer[..count]);
                }
                Err(cause) if is_pause(&cause) => return,
                Err(cause) => return self.lose(format!("cannot read: {cause}")),
            }
        }
    }

    /// Detects a failed or silent line.
    fn listen(&mut self) {
        if let Some(reason) = self.sender.broken() {
            return self.lose(reason);
        }
        if self.has_forgotten() {
            // The hello that follows tells the reset's cause.
            return self.go_down("the station restarted".to_owned());
        }
        let is_pinged = self.pings && self.interruption.is_none();
        if is_pinged && self.heard.elapsed() > SILENCE {
            let reason = format!("no answer for {} s", SILENCE.as_secs());
            // A silent pseudo-terminal is kept open, because its name may not be opened again. A
            // silent owner may go on; only one that closes the connection is lost.
            match (&self.terminal, &self.owner) {
                (None, None) => self.lose(reason),
                _ => self.go_down(reason),
            }
        }
    }

    /// Returns true if the station lost the configuration that it had from this program: it
    /// restarted while the line stayed up, after a brown-out or by its watchdog.
    fn has_forgotten(&mut self) -> bool {
        let Some(state) = self.client.status().map(|status| status.state) else {
            return false;
        };
        let is_configured = self.configuration.is_some() && state != State::Unconfigured;
        self.is_configured |= is_configured;
        self.is_configured && !is_configured && self.interruption.is_none()
    }

    fn lose(&mut self, reason: String) {
        // The socket's own error names neither program nor way out.
        let reason = match &self.owner {
            Some(Holder { pid, command }) => format!(
                "`{command}` (process {pid}), which had the port, has ended or closed this \
                 connection; run this again"
            ),
            None => reason,
        };
        self.set_port(None);
        self.go_down(reason);
    }

    fn go_down(&mut self, reason: String) {
        if matches!(self.link, Link::Up) {
            if let Some(observer) = &self.observer {
                observer.line_lost(self.sender.now_us(), &reason);
            }
            self.sender.set_pings(false);
            self.is_configured = false;
            let since = Instant::now();
            self.client.begin_again();
            self.link = Link::Down {
                since,
                reason,
                next_try: since,
            };
        }
    }

    fn set_port(&mut self, halves: Option<Halves>) {
        let (reader, writer) = halves.unzip();
        self.port = reader;
        self.sender.set_port(writer);
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
            return;
        }
        // A link that was made anew leads to the station, and the silent line that it led to before
        // does not.
        let is_back = self
            .terminal
            .is_some_and(|terminal| terminal.is_back(&self.path));
        if self.sender.broken().is_some() || is_back {
            self.set_port(None);
        }
        let is_broken = self.port.is_none();
        let terminal = self.terminal.filter(|_| is_broken);
        let is_gone = terminal.is_some_and(|terminal| terminal.is_gone(&self.path));
        let is_spent = now.duration_since(since) > self.patience || self.session.is_none();
        if is_gone || is_spent {
            self.set_port(None);
            self.link = Link::Over(match terminal {
                Some(_) => format!("{cause}; {GONE}"),
                None => cause,
            });
        } else if due && terminal.is_none_or(|terminal| terminal.is_back(&self.path)) {
            if is_broken {
                let terminal = Terminal::at(&self.path);
                let halves = port::open(&self.path).ok();
                // A link that did not open yet is still one made anew.
                if halves.is_some() {
                    self.terminal = terminal;
                }
                self.set_port(halves);
            }
            self.greet();
        }
    }

    /// Returns the kind of interruption, once a station has answered on a line that was lost. The
    /// station's state is in its first status, which comes within a tenth of a second.
    fn judge(&mut self, since: Instant, reason: &str) -> Option<Interruption> {
        let hello: &Hello = self.client.hello()?;
        let mismatches = hello.mismatches();
        if !mismatches.is_empty() {
            return Some(Interruption::Mismatch(mismatches.to_vec()));
        }
        let state = self.client.status()?.state;
        let forgot = self.configuration.is_some() && state == State::Unconfigured;
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

    /// Returns true while a lost line is being reconnected.
    pub fn is_down(&self) -> bool {
        matches!(self.link, Link::Down { .. })
    }

    /// Returns true if a stop reaches the station, in whatever condition it is.
    pub fn is_up(&self) -> bool {
        matches!(self.link, Link::Up)
    }

    /// Checks that commands reach the station and its numbers are plausible.
    pub fn check(&self) -> Result<(), StationError> {
        if let Some(implausible) = self.client.implausible() {
            return Err(implausible.into());
        }
        if let Some(by) = &self.stopped_by {
            return Err(StationError::StoppedByOther { by: by.clone() });
        }
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

    /// Resumes after an interruption, if the station lost no state and has no fault.
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

/// Returns true if a stopped stage might move because of this command, at once or later.
fn may_undo_a_stop(command: &Command) -> bool {
    moves(command) || matches!(command, Command::Reset)
}

fn is_pause(cause: &io::Error) -> bool {
    matches!(
        cause.kind(),
        io::ErrorKind::TimedOut | io::ErrorKind::Interrupted | io::ErrorKind::WouldBlock
    )
}
