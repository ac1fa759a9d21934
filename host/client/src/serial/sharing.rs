//! Guests: other programs that reach the station through this one, which has its port.
//!
//! A thread waits for guests, and another serves each of them. What a guest may do depends on its
//! [`Purpose`] and on this program's [`Access`]:
//!
//! | purpose | passed on to the station |
//! |---|---|
//! | stop | stops, repeated until they are answered; this program's own motion ends by them |
//! | watch | nothing; the guest gets the station's reports |
//! | drive | every command, if this program allows it and no other guest drives; jogs at rest only |
//!
//! Pings are answered here, by this program's knowledge of the station's clock. A guest that drives
//! and leaves, or sends no ping for the heartbeat timeout, has its motion stopped.

use super::super::StationError;
use super::super::motion::moves;
use super::super::owner::{self, Guest, Listener, Purpose, Stream};
use super::super::stage::HEARTBEAT_MS;
use super::deed::{Deed, Deeds, STOP, in_words};
use super::line::Line;
use super::port::send_all;
use super::stop::Stop;
use super::{Holder, LOOK, Serial, Shared};
use std::collections::VecDeque;
use std::io::{self, Read as _};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{Command, Config, Denial, Outcome, Packet, Report};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::time::Instant as StationInstant;

/// Largest number of guests at once.
const MOST_GUESTS: usize = 16;

/// Largest number of commands of one guest that wait for their answers.
const MOST_PENDING: usize = 64;

/// Polling period of the socket for guests.
const ACCEPT_PERIOD: Duration = Duration::from_millis(5);

/// Period at which the place of the socket is compared with that of the port's device.
const PLACE_PERIOD: Duration = Duration::from_millis(200);

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
    /// This program reads a few reports and leaves; a guest that wants to drive tries again, until
    /// it has the port itself.
    Brief,
}

/// Guests of one line.
#[derive(Debug, Default)]
pub(super) struct Guests {
    pub access: Access,
    count: usize,
    driver: Option<Holder>,
    /// True if a guest has configured the station since this program did.
    pub has_reconfigured: bool,
    pub deeds: Deeds,
}

/// Socket for the guests of a port. Its place follows from the device behind the port, which may be
/// another one when a lost line comes back: then the old place may belong to another station.
struct Door {
    port: String,
    place: PathBuf,
    listener: Arc<Listener>,
}

impl Door {
    fn open(port: &str) -> io::Result<Self> {
        let place = owner::socket(port)?;
        Ok(Self {
            port: port.to_owned(),
            listener: Arc::new(Listener::bind(&place)?),
            place,
        })
    }

    /// Returns true if the socket is at the place of the device that is behind the port now.
    fn is_in_place(&self) -> bool {
        owner::socket(&self.port).is_ok_and(|place| place == self.place)
    }

    /// Moves to the place of the device that is behind the port now, unless another program
    /// receives guests there.
    fn follow_port(&mut self) {
        let Ok(place) = owner::socket(&self.port) else {
            return;
        };
        if place != self.place
            && !owner::is_answered(&place)
            && let Ok(moved) = Self::open(&self.port)
        {
            *self = moved;
        }
    }
}

/// Starts the thread that receives guests of the line on `port`, until the line is closed.
pub(super) fn start_listener(port: &str, shared: Arc<Shared>) -> io::Result<JoinHandle<()>> {
    let door = Door::open(port)?;
    std::thread::Builder::new()
        .name("guests".to_owned())
        .spawn(move || receive_guests(door, &shared))
}

fn receive_guests(mut door: Door, shared: &Arc<Shared>) {
    let mut threads: Vec<JoinHandle<()>> = Vec::new();
    let mut looked = Instant::now();
    while !shared.line().closed {
        if looked.elapsed() >= PLACE_PERIOD {
            looked = Instant::now();
            if shared.line().is_up() {
                door.follow_port();
            }
        }
        let Ok(mut stream) = door.listener.accept() else {
            std::thread::sleep(ACCEPT_PERIOD);
            continue;
        };
        let is_in_place = door.is_in_place();
        threads.retain(|thread| !thread.is_finished());
        let (listener, shared) = (Arc::clone(&door.listener), Arc::clone(shared));
        let thread = std::thread::Builder::new()
            .name("guest".to_owned())
            .spawn(move || {
                // A guest that breaks off has its own error to report.
                let _ = receive(&listener, &mut stream, &shared, is_in_place);
            });
        threads.extend(thread);
    }
    for thread in threads {
        let _ = thread.join();
    }
}

/// Lets a guest in, serves it, and ends the motion that it leaves behind. One that came to a socket
/// that is not in place, as [`Door::is_in_place`] says, is not let in.
fn receive(
    listener: &Listener,
    stream: &mut Stream,
    shared: &Shared,
    is_in_place: bool,
) -> io::Result<()> {
    let guest = owner::introduction(listener, stream)?;
    let was_pinging = {
        let mut line = shared.line();
        if line.closed || !line.is_up() || !is_in_place {
            // Without a reply the guest opens the port itself: a lost line's name may belong to
            // another device by now, and a closed line's port is about to be free.
            return Ok(());
        }
        if guest.purpose == Purpose::Drive && line.guests.access == Access::Brief {
            // Without a reply for the same reason: this program leaves.
            return Ok(());
        }
        if let Some(holder) = line.guests.admit(&guest) {
            drop(line);
            return owner::refuse(stream, &holder);
        }
        line.is_pinging()
    };
    let mut service = Service {
        by: format!("`{}` (process {})", guest.holder.command, guest.holder.pid),
        purpose: guest.purpose,
        receiver: Receiver::default(),
        wants_hello: false,
        reported_tick: None,
        stops: Vec::new(),
        pending: VecDeque::new(),
        pinged: None,
        configured_silence: None,
        has_moved: false,
    };
    let outcome = owner::welcome(stream).and_then(|()| service.serve(stream, shared));
    if guest.purpose == Purpose::Drive {
        leave(shared, was_pinging, &service);
    }
    shared.line().guests.dismiss(&guest);
    outcome
}

/// Stops the stage if it moves because of a guest that has left. A guest that has not moved it leaves
/// a motion of this program alone. Then the heartbeat is as it was before the guest came: on if
/// `was_pinging`.
fn leave(shared: &Shared, was_pinging: bool, guest: &Service) {
    let mut is_first = guest.has_moved;
    loop {
        {
            let mut line = shared.line();
            if is_first && line.client.motion().may_go_on() {
                line.stop_again();
                let what = "stop, because a program left the stage in motion".to_owned();
                line.guests.deeds.add(what, &guest.by);
            }
            is_first = false;
            if line.is_over() {
                return;
            }
            if !matches!(line.stop, Stop::Asked { .. }) {
                let is_unanswered = matches!(line.stop, Stop::Unanswered { .. });
                return line.set_pings(was_pinging && !is_unanswered);
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
    ///
    /// # Errors
    /// [`StationError::Busy`] for [`Access::Busy`] while a guest drives.
    pub fn set_access(&mut self, access: Access) -> Result<(), StationError> {
        let mut line = self.shared.line();
        if let (Access::Busy, Some(driver)) = (access, &line.guests.driver) {
            return Err(StationError::Busy {
                path: line.path.clone(),
                holder: Some(driver.clone()),
            });
        }
        line.guests.access = access;
        Ok(())
    }

    /// Returns the guest that drives the station, if there is one.
    pub fn driver(&self) -> Option<Holder> {
        self.shared.line().guests.driver.clone()
    }

    /// Takes what guests have done at the station since the last call, the oldest first.
    pub fn take_deeds(&self) -> Vec<Deed> {
        self.shared.line().guests.deeds.take()
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

/// Command of a guest that is not answered.
struct Pending {
    /// Sequence number on the line.
    sequence: u16,
    /// Sequence number of the guest.
    theirs: u16,
    command: Command,
}

/// One guest's share of the line.
struct Service {
    /// Name of the guest, for messages.
    by: String,
    purpose: Purpose,
    receiver: Receiver<Packet>,
    wants_hello: bool,
    /// Control tick of the last status that the guest got.
    reported_tick: Option<u32>,
    /// Sequence numbers of the guest's stops that are not answered.
    stops: Vec<u16>,
    /// Commands that are not answered.
    pending: VecDeque<Pending>,
    /// Arrival of the guest's last ping, once it has driven.
    pinged: Option<Instant>,
    /// Heartbeat timeout of the configuration that the guest has given.
    configured_silence: Option<Duration>,
    /// True once a command of the guest that may move the stage has gone to the station.
    has_moved: bool,
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
            if self.is_silent(shared) {
                // As the station does with a host that is suspended or hangs.
                return Ok(());
            }
            self.forward(shared, &mut replies);
            for report in &replies {
                // A report that came from a station fits a packet.
                if let Ok(bytes) = encode(report) {
                    send_all(stream, &bytes)?;
                }
            }
            let mut line = shared.line();
            if line.closed {
                // The line's own thread has ended, but a stop may not be answered yet.
                line.attend();
            }
            let is_over = line.is_over();
            drop(line);
            if is_over {
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

    /// Returns true if a guest that drives has sent no ping for the heartbeat timeout.
    fn is_silent(&self, shared: &Shared) -> bool {
        let Some(pinged) = self.pinged else {
            return false;
        };
        let of = |config: Config| Duration::from_millis(config.heartbeat_ms.into());
        let timeout = self.configured_silence.or_else(|| {
            let configuration = shared.line().configuration;
            configuration.map(of)
        });
        pinged.elapsed() > timeout.unwrap_or(Duration::from_millis(HEARTBEAT_MS.into()))
    }

    /// Does what a packet of the guest asks for.
    fn take(&mut self, packet: Packet, shared: &Shared, replies: &mut Vec<Report>) {
        let mut line = shared.line();
        let command = packet.command;
        match (command, self.purpose) {
            (Command::Hello, _) => self.wants_hello = true,
            (Command::Ping { host_us }, purpose) => {
                if purpose == Purpose::Drive {
                    self.pinged = Some(Instant::now());
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
                    Purpose::Drive => {
                        line.stop_again();
                        line.guests.deeds.add(STOP.to_owned(), &self.by);
                    }
                    _ => line.stop_for(self.by.clone()),
                }
                self.stops.push(packet.sequence);
            }
            (_, Purpose::Stop | Purpose::Watch) => {}
            (command, Purpose::Drive) => {
                if matches!(command, Command::Reset) && !matches!(line.stop, Stop::Asked { .. }) {
                    line.stopped_by = None;
                }
                let denial = match &command {
                    _ if line.stopped_by.is_some() => Some(Denial::Stopped),
                    // The station would replace the rest of the earlier motion.
                    Command::Jog { .. } if line.is_moving() => Some(Denial::Moving),
                    _ => None,
                };
                if let Some(denial) = denial {
                    replies.push(Report::Answer {
                        sequence: packet.sequence,
                        tick: line.client.answered_tick().unwrap_or_default(),
                        outcome: Outcome::Denied(denial),
                    });
                    return;
                }
                if let Command::Config(config) = &command {
                    line.guests.has_reconfigured = true;
                    let silence = Duration::from_millis(config.heartbeat_ms.into());
                    self.configured_silence = Some(silence);
                }
                self.has_moved |= moves(&command);
                let sequence = line.send(command);
                if self.pending.len() == MOST_PENDING {
                    // Some are never answered.
                    self.pending.pop_front();
                }
                self.pending.push_back(Pending {
                    sequence,
                    theirs: packet.sequence,
                    command,
                });
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
            self.reported_tick = None;
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
        let Line { client, guests, .. } = &mut *line;
        self.pending.retain(|pending| {
            let Some((tick, answer)) = client.answer_with_tick(pending.sequence) else {
                return true;
            };
            if let Some(what) = in_words(&pending.command).filter(|_| answer.is_ok()) {
                guests.deeds.add(what, &self.by);
            }
            replies.push(Report::Answer {
                sequence: pending.theirs,
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
            .filter(|status| self.reported_tick != Some(status.tick));
        if let Some(status) = status {
            self.reported_tick = Some(status.tick);
            replies.push(Report::Status(*status));
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    /// After an unplugging, a by-id link may lead to another device, and the name of the first one
    /// to another station.
    #[test]
    fn door_follows_the_device_behind_its_port() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        let (first, second, link) = (path("first"), path("second"), path("link"));
        for device in [&first, &second] {
            std::fs::write(device, "").unwrap();
        }
        symlink(&first, &link).unwrap();
        let mut door = Door::open(&link).unwrap();
        assert!(door.is_in_place() && owner::socket(&first).unwrap().exists());
        std::fs::remove_file(&link).unwrap();
        assert!(!door.is_in_place());
        symlink(&second, &link).unwrap();
        assert!(!door.is_in_place());
        // Another program may have that device.
        let other = Door::open(&second).unwrap();
        door.follow_port();
        assert!(!door.is_in_place() && other.is_in_place());
        drop(other);
        door.follow_port();
        assert!(door.is_in_place());
        assert!(!owner::socket(&first).unwrap().exists());
        assert!(owner::socket(&second).unwrap().exists());
    }
}
