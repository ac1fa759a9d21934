//! Guests: other programs that reach the station through this one, which has its port.
//!
//! A thread waits for guests, and another serves each of them. What a guest may do depends on its
//! [`Purpose`] and on this program's [`Access`]:
//!
//! | purpose | passed on to the station |
//! |---|---|
//! | stop | stops, repeated until they are answered; this program's own run ends by them |
//! | watch | nothing; the guest gets the station's reports |
//! | drive | every command, if this program allows it and no other guest drives |
//!
//! Pings are answered here, by this program's knowledge of the station's clock. A guest that leaves
//! while the stage moves because of it stops the stage.

use super::super::StationError;
use super::super::motion::moves;
use super::super::owner::{self, Guest, Listener, Purpose, Stream};
use super::stop::Stop;
use super::{Holder, LOOK, Serial, Shared};
use std::io::{self, Read as _, Write as _};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{Command, Outcome, Packet, Report};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::time::Instant as StationInstant;

/// Largest number of guests at once.
const MOST_GUESTS: usize = 16;

/// Polling period of the socket for guests.
const KNOCKS: Duration = Duration::from_millis(5);

/// Time for which guests are served on after this program has closed its line, so that the reports
/// of a stop reach the guest that asked for it.
const FAREWELL: Duration = Duration::from_secs(1);

/// Access of guests that want to drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Access {
    /// This program uses the station; guests may stop and watch.
    #[default]
    Busy,
    /// This program only keeps the line; one guest at a time may drive.
    Open,
}

/// Guests of one line.
#[derive(Debug, Default)]
pub(super) struct Guests {
    pub access: Access,
    count: usize,
    driver: Option<Holder>,
    /// True if a guest has configured the station since this program did.
    pub has_reconfigured: bool,
}

/// Starts the thread that receives guests of the line on `port`, until the line is closed.
pub(super) fn open_door(port: &str, shared: Arc<Shared>) -> io::Result<JoinHandle<()>> {
    let listener = Listener::bind(&owner::socket(port)?)?;
    std::thread::Builder::new()
        .name("guests".to_owned())
        .spawn(move || receive_guests(&listener, &shared))
}

fn receive_guests(listener: &Listener, shared: &Arc<Shared>) {
    let mut threads: Vec<JoinHandle<()>> = Vec::new();
    while !shared.line().closed {
        let Ok(mut stream) = listener.accept() else {
            std::thread::sleep(KNOCKS);
            continue;
        };
        threads.retain(|thread| !thread.is_finished());
        let shared = Arc::clone(shared);
        let thread = std::thread::Builder::new()
            .name("guest".to_owned())
            .spawn(move || {
                // A guest that breaks off has its own error to report.
                let _ = receive(&mut stream, &shared);
            });
        threads.extend(thread);
    }
    for thread in threads {
        let _ = thread.join();
    }
}

/// Lets a guest in, serves it, and ends the motion that it leaves behind.
fn receive(stream: &mut Stream, shared: &Shared) -> io::Result<()> {
    let guest = owner::introduction(stream)?;
    {
        let mut line = shared.line();
        if !line.is_up() {
            // The line is lost, and its name may belong to another device by now: without a reply
            // the guest opens the port itself.
            return Ok(());
        }
        if let Some(holder) = line.guests.admit(&guest) {
            drop(line);
            return owner::refuse(stream, &holder);
        }
    }
    let mut service = Service {
        by: format!("`{}` (process {})", guest.holder.command, guest.holder.pid),
        purpose: guest.purpose,
        receiver: Receiver::default(),
        wants_hello: false,
        told_tick: None,
        stops: Vec::new(),
        pending: Vec::new(),
    };
    let outcome = owner::welcome(stream).and_then(|()| service.serve(stream, shared));
    if guest.purpose == Purpose::Drive {
        leave(shared);
    }
    shared.line().guests.dismiss(&guest);
    outcome
}

/// Stops the stage if it moves because of a guest that has left, and ends the heartbeat.
fn leave(shared: &Shared) {
    let mut is_first = true;
    loop {
        {
            let mut line = shared.line();
            if line.guests.access == Access::Busy || line.closed {
                // The line belongs to this program's own run again.
                return;
            }
            if is_first && line.client.motion().may_go_on() {
                line.begin_stop();
            }
            is_first = false;
            if !matches!(line.stop, Stop::Asked { .. }) || line.is_over() {
                return line.set_pings(false);
            }
        }
        std::thread::sleep(LOOK);
    }
}

impl Serial {
    /// Returns the program through which the station is reached, if another one has the port.
    pub fn owner(&self) -> Option<Holder> {
        self.shared.line().owner.clone()
    }

    /// Sets the access of guests that want to drive.
    pub fn set_access(&mut self, access: Access) {
        self.shared.line().guests.access = access;
    }

    /// Gives the station this program's configuration again if a guest has changed it.
    ///
    /// # Errors
    /// As [`Serial::command`]; [`StationError::Denied`] if the stage moves.
    pub fn restore_configuration(&mut self) -> Result<(), StationError> {
        let configuration = {
            let line = self.shared.line();
            line.configuration.filter(|_| line.guests.has_reconfigured)
        };
        if let Some(configuration) = configuration {
            self.command("config", Command::Config(configuration))?;
            self.shared.line().guests.has_reconfigured = false;
        }
        Ok(())
    }
}

impl Guests {
    /// Lets a guest in, or returns the program because of which it is refused.
    fn admit(&mut self, guest: &Guest) -> Option<Holder> {
        if self.count >= MOST_GUESTS && guest.purpose != Purpose::Stop {
            return Some(owner::this_program());
        }
        if guest.purpose == Purpose::Drive {
            if self.access == Access::Busy {
                return Some(owner::this_program());
            }
            if let Some(driver) = &self.driver {
                return Some(driver.clone());
            }
            self.driver = Some(guest.holder.clone());
        }
        self.count += 1;
        None
    }

    fn dismiss(&mut self, guest: &Guest) {
        self.count = self.count.saturating_sub(1);
        if guest.purpose == Purpose::Drive {
            self.driver = None;
        }
    }
}

/// One guest's share of the line.
struct Service {
    /// Name of the guest, for messages.
    by: String,
    purpose: Purpose,
    receiver: Receiver<Packet>,
    wants_hello: bool,
    /// Control tick of the last status that the guest got.
    told_tick: Option<u32>,
    /// Sequence numbers of the guest's stops that are not answered.
    stops: Vec<u16>,
    /// Commands that are not answered: sequence numbers on the line and of the guest.
    pending: Vec<(u16, u16)>,
}

impl Service {
    fn serve(&mut self, stream: &mut Stream, shared: &Shared) -> io::Result<()> {
        let mut buffer = [0; 1024];
        let mut closed: Option<Instant> = None;
        loop {
            let count = match stream.read(&mut buffer) {
                Ok(0) => return Ok(()),
                Ok(count) => count,
                Err(cause) if cause.kind() == io::ErrorKind::WouldBlock => 0,
                Err(cause) => return Err(cause),
            };
            let mut replies = Vec::new();
            let mut bytes = &buffer[..count];
            while let Some(packet) = self.receiver.next(&mut bytes) {
                if let Ok(packet) = packet {
                    self.take(packet, shared, &mut replies);
                }
            }
            self.forward(shared, &mut replies);
            for report in &replies {
                // A report that came from a station fits a packet.
                if let Ok(bytes) = encode(report) {
                    stream.write_all(&bytes)?;
                }
            }
            if shared.line().is_over() {
                let since = *closed.get_or_insert_with(Instant::now);
                if since.elapsed() > FAREWELL {
                    return Ok(());
                }
            }
            if count == 0 {
                std::thread::sleep(LOOK);
            }
        }
    }

    /// Does what a packet of the guest asks for.
    fn take(&mut self, packet: Packet, shared: &Shared, replies: &mut Vec<Report>) {
        let mut line = shared.line();
        let command = packet.command;
        match (command, self.purpose) {
            (Command::Hello, _) => self.wants_hello = true,
            (Command::Ping { host_us }, purpose) => {
                if purpose == Purpose::Drive {
                    line.keep_pinging();
                }
                let now_us = line.now_us();
                if let Some(station_us) = line.client.clock().station_us(now_us) {
                    let now = StationInstant::from_micros(station_us);
                    replies.push(Report::Pong {
                        host_us,
                        received: now,
                        sent: now,
                    });
                }
            }
            (Command::Stop, Purpose::Watch) => {}
            (Command::Stop, purpose) => {
                match purpose {
                    Purpose::Drive => line.begin_stop(),
                    _ => line.stop_for(self.by.clone()),
                }
                self.stops.push(packet.sequence);
            }
            (_, Purpose::Stop | Purpose::Watch) => {}
            (command, Purpose::Drive) => {
                // Between admission and now this program may have begun a run of its own.
                if line.guests.access == Access::Open {
                    if moves(&command) || matches!(command, Command::Reset) {
                        line.stopped_by = None;
                    }
                    line.guests.has_reconfigured |= matches!(command, Command::Config(_));
                    let sequence = line.send(command);
                    self.pending.push((sequence, packet.sequence));
                }
            }
        }
    }

    /// Collects the reports that the guest has not had.
    fn forward(&mut self, shared: &Shared, replies: &mut Vec<Report>) {
        let mut line = shared.line();
        if let Some(hello) = line.client.hello().filter(|_| self.wants_hello) {
            replies.push(Report::Hello(hello.clone()));
            replies.extend(line.client.last_run().copied().map(Report::LastRun));
            self.wants_hello = false;
            self.told_tick = None;
        }
        let stopped = match line.stop {
            Stop::Answered => line.client.motion().stopped_tick(),
            _ => None,
        };
        if let Some(tick) = stopped {
            for sequence in self.stops.drain(..) {
                replies.push(Report::Answer {
                    sequence,
                    tick,
                    outcome: Outcome::Accepted,
                });
            }
        }
        let client = &mut line.client;
        let tick = client.answered_tick().unwrap_or_default();
        self.pending.retain(|(sequence, theirs)| {
            let Some(answer) = client.answer(*sequence) else {
                return true;
            };
            replies.push(Report::Answer {
                sequence: *theirs,
                tick,
                outcome: match answer {
                    Ok(()) => Outcome::Accepted,
                    Err(denial) => Outcome::Denied(denial),
                },
            });
            false
        });
        let status = client
            .status()
            .filter(|status| self.told_tick != Some(status.tick));
        if let Some(status) = status {
            self.told_tick = Some(status.tick);
            replies.push(Report::Status(*status));
        }
    }
}
