//! A station at the end of a serial line: the board over USB or UART, or the emulated board behind a pseudo-terminal.
//!
//! The line is shared between the caller, who sends commands and waits for answers, and one thread, which sends the heartbeat and takes in
//! what the station says. So the heartbeat goes on while the caller looks at pictures, and stops with the process: a host that crashed
//! does not keep a stage moving. A lost line ends the thread and is reported by the next call that can fail.

use super::StationError;
use super::client::Client;
use super::stage::configuration;
use crate::rig_file::Stage;
use serialport::{SerialPort, SerialPortType};
use shared::frame::message::{Command, Denial, Hello, Mounting, Status};
use std::io::{self, Read as _, Write as _};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Speed of the line, baud. USB has none; a UART link is wired for this one.
const BAUD: u32 = 921_600;

/// USB vendor and product of our boards.
const USB_IDS: (u16, u16) = (0x1209, 0x0001);

/// The heartbeat.
const PING: Duration = Duration::from_millis(20);

/// How often the line is looked at.
const LOOK: Duration = Duration::from_millis(1);

/// How long a write may take.
const WRITE_PATIENCE: Duration = Duration::from_millis(100);

/// How long an answer may take.
const PATIENCE: Duration = Duration::from_millis(500);

/// How long the first answer may take: some boards restart when their port is opened, and a pseudo-terminal takes a second to notice it.
const HELLO_PATIENCE: Duration = Duration::from_secs(3);

/// How often hello is repeated meanwhile.
const HELLO_PERIOD: Duration = Duration::from_millis(250);

/// One line and the conversation on it.
struct Line {
    port: Box<dyn SerialPort>,
    path: String,
    client: Client,
    epoch: Instant,
    pings: bool,
    next_ping: Instant,
    /// Why the line can no longer be used.
    lost: Option<String>,
    closed: bool,
}

impl Line {
    fn now_us(&self) -> u64 {
        u64::try_from(self.epoch.elapsed().as_micros()).unwrap_or(u64::MAX)
    }

    /// Numbers and writes a command.
    fn send(&mut self, command: Command) -> u16 {
        let (sequence, bytes) = self.client.packet(command);
        self.write(&bytes);
        sequence
    }

    fn write(&mut self, bytes: &[u8]) {
        if self.lost.is_none()
            && let Err(cause) = self.port.write_all(bytes)
        {
            self.lost = Some(format!("cannot write: {cause}"));
        }
    }

    /// Takes in what has arrived, without waiting.
    fn take_in(&mut self) {
        let mut buffer = [0; 1024];
        while self.lost.is_none() {
            let waiting = match self.port.bytes_to_read() {
                Ok(0) => return,
                Ok(waiting) => (waiting as usize).min(buffer.len()),
                Err(cause) => {
                    self.lost = Some(format!("cannot read: {cause}"));
                    return;
                }
            };
            match self.port.read(&mut buffer[..waiting]) {
                Ok(count) => {
                    let now_us = self.now_us();
                    self.client.feed(now_us, &buffer[..count]);
                }
                Err(cause) if is_pause(&cause) => return,
                Err(cause) => self.lost = Some(format!("cannot read: {cause}")),
            }
        }
    }

    fn beat(&mut self) {
        let now = Instant::now();
        if self.pings && now >= self.next_ping {
            let host_us = self.now_us();
            self.send(Command::Ping { host_us });
            // After a pause of this process one ping is enough.
            self.next_ping = (self.next_ping + PING).max(now);
        }
    }

    fn check(&self) -> Result<(), StationError> {
        match &self.lost {
            None => Ok(()),
            Some(reason) => Err(StationError::Port {
                path: self.path.clone(),
                reason: reason.clone(),
            }),
        }
    }
}

fn is_pause(cause: &io::Error) -> bool {
    matches!(
        cause.kind(),
        io::ErrorKind::TimedOut | io::ErrorKind::Interrupted | io::ErrorKind::WouldBlock
    )
}

/// What caller and thread share.
struct Shared {
    line: Mutex<Line>,
    /// Told when the line is closed, so that the thread ends at once.
    ending: Condvar,
}

impl Shared {
    fn line(&self) -> MutexGuard<'_, Line> {
        // A panic elsewhere leaves a line that can still be used: to stop, for one.
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The thread: takes in and pings until the line is closed or lost.
    fn attend(&self) {
        let mut line = self.line();
        while !line.closed && line.lost.is_none() {
            line.take_in();
            line.beat();
            let (guard, _) = self
                .ending
                .wait_timeout(line, LOOK)
                .unwrap_or_else(PoisonError::into_inner);
            line = guard;
        }
    }
}

/// The client of a [`Serial`], borrowed. While this lives the heartbeat waits: use it and let it go.
pub struct ClientRef<'a>(MutexGuard<'a, Line>);

impl std::ops::Deref for ClientRef<'_> {
    type Target = Client;

    fn deref(&self) -> &Client {
        &self.0.client
    }
}

/// A station on a serial line. Dropping it ends the heartbeat and closes the line.
pub struct Serial {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for Serial {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Serial")
            .field("path", &self.shared.line().path)
            .finish_non_exhaustive()
    }
}

impl Drop for Serial {
    fn drop(&mut self) {
        self.shared.line().closed = true;
        self.shared.ending.notify_all();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Serial {
    /// Opens the line and asks who is there. Sends nothing but hello; no heartbeat yet.
    ///
    /// # Errors
    /// [`StationError::Port`] if the port cannot be used, [`StationError::Silent`] or [`StationError::Garbled`] if no station answers.
    /// A station with other firmware is no error here: see [`Hello::mismatches`].
    pub fn connect(path: &str) -> Result<Self, StationError> {
        let opened = serialport::new(path, BAUD).timeout(WRITE_PATIENCE).open();
        let mut port = opened.map_err(|cause| StationError::Port {
            path: path.to_owned(),
            reason: format!("cannot open: {cause}"),
        })?;
        // Tells a board with USB that somebody listens. A pseudo-terminal has no such line and says so.
        let _ = port.write_data_terminal_ready(true);
        let now = Instant::now();
        let line = Line {
            port,
            path: path.to_owned(),
            client: Client::default(),
            epoch: now,
            pings: false,
            next_ping: now,
            lost: None,
            closed: false,
        };
        let shared = Arc::new(Shared {
            line: Mutex::new(line),
            ending: Condvar::new(),
        });
        let attendant = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("station".to_owned())
            .spawn(move || attendant.attend())
            .map_err(|cause| StationError::Port {
                path: path.to_owned(),
                reason: format!("cannot start its thread: {cause}"),
            })?;
        let mut serial = Self {
            shared,
            thread: Some(thread),
        };
        serial.hello()?;
        Ok(serial)
    }

    /// Connects to the station, starts the heartbeat, configures the stage and declares its present position to be zero.
    ///
    /// # Errors
    /// As [`Serial::connect`]; [`StationError::Mismatch`] for other firmware; if the stage does not fit the configuration or the station
    /// refuses it.
    pub fn start(path: &str, stage: &Stage, mounting: Mounting) -> Result<Self, StationError> {
        let configuration = configuration(stage, mounting)?;
        let mut serial = Self::connect(path)?;
        let mismatches = serial.who().map(|hello| hello.mismatches());
        let mismatches = mismatches.unwrap_or_default();
        if !mismatches.is_empty() {
            return Err(StationError::Mismatch(mismatches.to_vec()));
        }
        serial.set_pings(true);
        serial.command("config", Command::Config(configuration))?;
        serial.command("zero", Command::Zero)?;
        Ok(serial)
    }

    fn hello(&mut self) -> Result<(), StationError> {
        let end = Instant::now() + HELLO_PATIENCE;
        loop {
            {
                let mut line = self.shared.line();
                // A closing zero first: the line may hold half a packet.
                line.write(&[0]);
                line.send(Command::Hello);
            }
            let again = (Instant::now() + HELLO_PERIOD).min(end);
            let heard = self.wait_until(again, |client| client.hello().map(|_| ()))?;
            if heard.is_some() {
                return Ok(());
            }
            if Instant::now() >= end {
                return Err(self.silence("hello", HELLO_PATIENCE));
            }
        }
    }

    /// Waits for the client to know something.
    fn wait_until<T>(
        &mut self,
        end: Instant,
        mut got: impl FnMut(&mut Client) -> Option<T>,
    ) -> Result<Option<T>, StationError> {
        loop {
            {
                let mut line = self.shared.line();
                line.take_in();
                if let Some(value) = got(&mut line.client) {
                    return Ok(Some(value));
                }
                line.check()?;
            }
            if Instant::now() >= end {
                return Ok(None);
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Why nothing came: nobody spoke, or nobody was understood.
    fn silence(&self, command: &'static str, waited: Duration) -> StationError {
        let line = self.shared.line();
        let understood = line.client.hello().is_some();
        match line.client.rejects() {
            rejects if rejects.total() > 0 && !understood => StationError::Garbled(rejects),
            _ => StationError::Silent {
                command,
                waited_ms: waited.as_millis() as u64,
            },
        }
    }

    /// What the station said of itself.
    pub fn who(&self) -> Option<Hello> {
        self.client().hello().cloned()
    }

    /// Sends a command without waiting; returns its sequence number. A lost line shows when the answer is waited for.
    pub fn send(&mut self, command: Command) -> u16 {
        self.shared.line().send(command)
    }

    /// Sends a command and waits for the answer.
    ///
    /// # Errors
    /// [`StationError::Denied`] with the station's reason, [`StationError::Silent`] without an answer, [`StationError::Port`] if the
    /// line is lost.
    pub fn command(&mut self, name: &'static str, command: Command) -> Result<(), StationError> {
        let sequence = self.send(command);
        let end = Instant::now() + PATIENCE;
        match self.wait_until(end, |client| client.answer(sequence))? {
            Some(Ok(())) => Ok(()),
            Some(Err(denial)) => Err(StationError::Denied {
                command: name,
                denial,
            }),
            None => Err(self.silence(name, PATIENCE)),
        }
    }

    /// The station's answer to a sent command, if it has come.
    pub fn answer(&mut self, sequence: u16) -> Option<Result<(), Denial>> {
        let mut line = self.shared.line();
        line.take_in();
        line.client.answer(sequence)
    }

    /// Whether the line still works.
    ///
    /// # Errors
    /// [`StationError::Port`] if not.
    pub fn check(&self) -> Result<(), StationError> {
        self.shared.line().check()
    }

    /// Starts or stops the heartbeat.
    pub fn set_pings(&mut self, on: bool) {
        let mut line = self.shared.line();
        line.pings = on;
        line.next_ping = Instant::now();
    }

    /// The station's latest status.
    pub fn status(&self) -> Option<Status> {
        let mut line = self.shared.line();
        line.take_in();
        line.client.status().copied()
    }

    /// The conversation. Let it go at once: the heartbeat waits for it.
    pub fn client(&self) -> ClientRef<'_> {
        ClientRef(self.shared.line())
    }

    /// The host's clock that the time sync uses, µs since the line was opened.
    pub fn now_us(&self) -> u64 {
        self.shared.line().now_us()
    }
}

/// A serial port of this computer.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Candidate {
    /// What `--port` takes.
    pub path: String,
    /// USB vendor and product, if it is a USB port.
    pub usb: Option<(u16, u16)>,
    /// What the device calls itself.
    pub product: Option<String>,
    /// Its serial number.
    pub serial_number: Option<String>,
    /// Whether vendor and product are those of our boards.
    pub is_station: bool,
}

/// The serial ports of this computer, ours first. Opens none, hence writes to none. Pseudo-terminals are not listed.
///
/// # Errors
/// [`StationError::Port`] if the system does not tell.
pub fn candidates() -> Result<Vec<Candidate>, StationError> {
    let ports = serialport::available_ports().map_err(|cause| StationError::Port {
        path: "serial ports".to_owned(),
        reason: format!("cannot list: {cause}"),
    })?;
    let candidate = |port: serialport::SerialPortInfo| {
        let usb = match port.port_type {
            SerialPortType::UsbPort(usb) => Some(usb),
            _ => None,
        };
        let ids = usb.as_ref().map(|usb| (usb.vid, usb.pid));
        Candidate {
            path: port.port_name,
            usb: ids,
            is_station: ids == Some(USB_IDS),
            product: usb.as_ref().and_then(|usb| usb.product.clone()),
            serial_number: usb.and_then(|usb| usb.serial_number),
        }
    };
    let mut list: Vec<Candidate> = ports.into_iter().map(candidate).collect();
    list.sort_by(|a, b| (!a.is_station, &a.path).cmp(&(!b.is_station, &b.path)));
    Ok(list)
}
