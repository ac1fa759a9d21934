//! The host's half of a serial line: numbers packets, writes them, and keeps the heartbeat.
//!
//! The heartbeat has a thread of its own that does nothing else. It shares with the rest of the
//! program only this half of the line, which is locked while a packet is numbered and written and
//! no longer: neither reading the line nor a caller that looks at what was read holds it up. The
//! thread asks the system for a high priority, so that pings go out in time on a busy computer.

use super::super::conversation::Numbering;
use super::super::observer::StationObserver;
use super::port::Half;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use trinocular_core::frame::message::Command;

/// Time between two pings.
const PING: Duration = Duration::from_millis(20);

/// Sleep of the thread while the heartbeat is off.
const IDLE: Duration = Duration::from_secs(60);

/// Port, numbering and schedule of the heartbeat.
struct Writer {
    /// `None` while the line is down.
    port: Option<Half>,
    numbering: Numbering,
    /// Reason for the last failed write.
    broken: Option<String>,
    pings: bool,
    next_ping: Instant,
    over: bool,
    observer: Option<Arc<dyn StationObserver>>,
    /// Zero of the host's clock.
    epoch: Instant,
}

impl Writer {
    fn send(&mut self, command: Command) -> u16 {
        let (sequence, bytes) = self.numbering.packet(command);
        self.write(&bytes);
        sequence
    }

    fn ping(&mut self) {
        let host_us = micros_since(self.epoch);
        self.send(Command::Ping { host_us });
    }

    fn write(&mut self, bytes: &[u8]) {
        let Some(port) = &mut self.port else { return };
        if let Some(observer) = &self.observer {
            observer.sent(micros_since(self.epoch), bytes);
        }
        if let Err(cause) = port.write_all(bytes) {
            self.broken = Some(port.loss("write", &cause));
            self.port = None;
        }
    }
}

/// The writing half of a line, shared with its heartbeat.
pub(super) struct Sender {
    writer: Mutex<Writer>,
    /// Notified when the heartbeat begins or the line is closed.
    changed: Condvar,
    /// Zero of the host's clock.
    epoch: Instant,
}

impl Sender {
    /// Makes a sender without a port and without a heartbeat.
    pub fn new(epoch: Instant) -> Self {
        Self {
            writer: Mutex::new(Writer {
                port: None,
                numbering: Numbering::default(),
                broken: None,
                pings: false,
                next_ping: epoch,
                over: false,
                observer: None,
                epoch,
            }),
            changed: Condvar::new(),
            epoch,
        }
    }

    fn writer(&self) -> MutexGuard<'_, Writer> {
        // A panic elsewhere leaves a line that can still be used, to stop for one.
        self.writer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the host's clock, µs.
    pub fn now_us(&self) -> u64 {
        micros_since(self.epoch)
    }

    /// Sets the observer of everything that is written from now on.
    pub fn set_observer(&self, observer: Option<Arc<dyn StationObserver>>) {
        self.writer().observer = observer;
    }

    /// Sets the port to write to; with `None`, packets are dropped.
    pub fn set_port(&self, port: Option<Half>) {
        let mut writer = self.writer();
        writer.port = port;
        writer.broken = None;
    }

    /// Takes the reason of a write that failed since the port was set.
    pub fn broken(&self) -> Option<String> {
        self.writer().broken.take()
    }

    /// Starts or ends the heartbeat. The first ping goes out at once, so that it is ahead of a
    /// command that follows.
    pub fn set_pings(&self, on: bool) {
        let mut writer = self.writer();
        writer.pings = on;
        writer.next_ping = Instant::now();
        if on {
            writer.ping();
            writer.next_ping += PING;
        }
        self.changed.notify_all();
    }

    /// Numbers a command and writes it; returns its number.
    pub fn send(&self, command: Command) -> u16 {
        self.writer().send(command)
    }

    /// Uses up a sequence number without writing: no answer to it will come.
    pub fn skip(&self) -> u16 {
        self.writer().numbering.packet(Command::Stop).0
    }

    /// Sends a closing zero, because the line may hold half a packet, and then hello.
    pub fn greet(&self) {
        let mut writer = self.writer();
        writer.write(&[0]);
        writer.send(Command::Hello);
    }

    /// Ends the heartbeat's thread.
    pub fn close(&self) {
        self.writer().over = true;
        self.changed.notify_all();
    }

    /// Starts the heartbeat's thread.
    pub fn start_heartbeat(self: &Arc<Self>) -> std::io::Result<JoinHandle<()>> {
        let sender = Arc::clone(self);
        std::thread::Builder::new()
            .name("heartbeat".to_owned())
            .spawn(move || {
                raise_priority();
                sender.beat();
            })
    }

    fn beat(&self) {
        let mut writer = self.writer();
        while !writer.over {
            let now = Instant::now();
            let pause = match writer.pings {
                true => writer.next_ping.saturating_duration_since(now),
                false => IDLE,
            };
            if pause.is_zero() {
                writer.ping();
                // After a pause of this process one ping is enough.
                writer.next_ping = (writer.next_ping + PING).max(now);
                continue;
            }
            let (guard, _) = self
                .changed
                .wait_timeout(writer, pause)
                .unwrap_or_else(PoisonError::into_inner);
            writer = guard;
        }
    }
}

fn micros_since(epoch: Instant) -> u64 {
    u64::try_from(epoch.elapsed().as_micros()).unwrap_or(u64::MAX)
}

/// Raises the priority of the calling thread above all ordinary ones. Without the right to do so
/// the priority stays: on Linux the right is `CAP_SYS_NICE`, or a limit for nice values
/// (`ulimit -e 40`).
#[cfg(target_os = "linux")]
fn raise_priority() {
    /// The highest ordinary priority.
    const NICE: i32 = -20;
    let this_thread = rustix::thread::gettid();
    // Linux keeps a nice value for each thread and takes a thread's number here.
    let _ = rustix::process::setpriority_process(Some(this_thread), NICE);
}

#[cfg(not(target_os = "linux"))]
fn raise_priority() {}
