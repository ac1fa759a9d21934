//! One serial line and the conversation on it: heartbeat, commands and answers. Its [`loss`] and return
//! have a module of their own.
//!
//! This module also repeats a stop, once begun, until it is answered or given up (`stop`).

mod entry;
mod loss;

use super::super::StationError;
use super::super::conversation::Client;
use super::super::motion::moves;
use super::super::observer::StationObserver;
use super::super::owner::Purpose;
use super::holder::Holder;
use super::port::Half;
use super::sender::Sender;
use super::sharing::Guests;
use super::stop::{STOP_PATIENCE, Stop};
use super::terminal::Terminal;
use loss::{Interruption, Link};
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};
use trinocular_core::frame::message::{Command, Config};
use trinocular_rig::interruption;

/// Default time for reconnecting a lost line.
pub(super) const RECONNECT_PATIENCE: Duration = Duration::from_secs(10);

/// Time between two stops, until one is answered. An answer comes within a few ms.
const STOP_PERIOD: Duration = Duration::from_millis(30);

/// Number of unanswered stops after which a hello goes before the next one.
const STOPS_PER_HELLO: u32 = 4;

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
        let (reader, writer, owner) = entry::enter(path, purpose)?;
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
                Err(cause) => {
                    let reason = port.loss("read", &cause);
                    return self.lose(reason);
                }
            }
        }
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
