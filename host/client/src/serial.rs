//! A station at the end of a serial line: the board over USB or UART, or the emulated board behind
//! a pseudo-terminal.
//!
//! Two threads share the [`line`]. The caller sends commands and waits for answers. The line's own
//! thread reads the station's reports and reconnects a lost line; the caller's next call then
//! fails, and the caller decides whether to resume once the line is back. A third thread sends only
//! the heartbeat (`sender`). So the heartbeat goes on while the caller processes images, and
//! stops with the process: a host that crashed does not keep a stage moving.
//!
//! *Invariant:* a stage that moves because of this program stops before the line is closed,
//! whatever ends the run (`stop`).

mod busy;
mod line;
mod port;
mod repetition;
mod sender;
mod sharing;
mod stop;

pub use sharing::Access;

pub use busy::{Holder, OtherHost, end_other_host};
pub use stop::{Ending, ending};

use super::StationError;
use super::conversation::Client;
use super::observer::StationObserver;
use super::owner::Purpose;
use super::stage::configuration;
use line::Line;
use sender::Sender;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use trinocular_core::frame::message::{Command, Config, Denial, Hello, LastRun, Mounting, Status};
use trinocular_core::safety::Fault;
use trinocular_rig::interruption;
use trinocular_rig::rig_file::Stage;

/// Polling period of the line.
const LOOK: Duration = Duration::from_millis(1);

/// Timeout for an answer.
const PATIENCE: Duration = Duration::from_secs(2);

/// Timeout for the first answer: some boards restart when their port is opened, and a
/// pseudo-terminal takes a second to notice it.
const HELLO_PATIENCE: Duration = Duration::from_secs(3);

/// Period of hello until the first answer.
const HELLO_PERIOD: Duration = Duration::from_millis(250);

/// Timeout for a stage to come to rest.
const REST_PATIENCE: Duration = Duration::from_secs(10);

/// State that caller and thread share.
struct Shared {
    line: Mutex<Line>,
    /// Notified when the line is closed, so that the thread ends at once.
    ending: Condvar,
}

impl Shared {
    fn line(&self) -> MutexGuard<'_, Line> {
        // A panic elsewhere leaves a line that can still be used: to stop, for one.
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs the thread: serves the line until it is closed or given up.
    fn attend(&self) {
        let mut line = self.line();
        while !line.is_over() {
            line.attend();
            let (guard, _) = self
                .ending
                .wait_timeout(line, LOOK)
                .unwrap_or_else(PoisonError::into_inner);
            line = guard;
        }
    }
}

/// Borrowed client of a [`Serial`]. While this lives, no report is read from the station; the
/// heartbeat goes on.
pub struct ClientRef<'a>(MutexGuard<'a, Line>);

impl std::ops::Deref for ClientRef<'_> {
    type Target = Client;

    fn deref(&self) -> &Client {
        &self.0.client
    }
}

/// A station on a serial line. Dropping it stops any motion that its commands have started, ends
/// the heartbeat and closes the line.
///
/// ```no_run
/// use trinocular_client::ports::{AUTO, resolve};
/// use trinocular_client::serial::Serial;
/// use trinocular_client::stage::default_stage;
/// use trinocular_core::frame::message::{Command, Mounting};
///
/// let port = resolve(AUTO)?;
/// // Configures the station, zeroes its position and keeps the heartbeat.
/// let mut station = Serial::start(&port, &default_stage(), Mounting::OnStage)?;
/// station.command("home", Command::Home { axes: [true; 3] })?;
/// station.command("jog", Command::Jog { distance_um: [0, 2_000, 0] })?;
/// station.command("stop", Command::Stop)?;
/// # Ok::<(), trinocular_client::StationError>(())
/// ```
pub struct Serial {
    shared: Arc<Shared>,
    sender: Arc<Sender>,
    threads: Vec<JoinHandle<()>>,
    cleared: Option<Fault>,
    /// Keeps the host awake, because a host that sleeps stops no stage.
    _awake: interruption::Awake,
    /// True once the caller has requested a stop: signals are then no longer reported.
    stops: bool,
}

/// Handle that stops the stage of a [`Serial`] from any thread.
#[derive(Clone)]
pub struct Stopper {
    shared: Arc<Shared>,
}

impl std::fmt::Debug for Stopper {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Stopper").finish_non_exhaustive()
    }
}

impl Stopper {
    /// Stops the stage at once, in the name of `by`. The stop is repeated until it is answered, and
    /// from now on every call of the [`Serial`] that waits or moves fails with
    /// [`StationError::StoppedByOther`].
    pub fn stop(&self, by: &str) {
        self.shared.line().stop_for(by.to_owned());
    }

    /// Returns true once the station has answered the stop.
    pub fn is_answered(&self) -> bool {
        matches!(self.shared.line().stop, stop::Stop::Answered)
    }
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
        self.end_motion();
        self.close();
    }
}

impl Serial {
    /// Opens the line and identifies the station. Sends nothing but hello; no heartbeat yet. From
    /// then on the program watches for Ctrl-C and other [signals](interruption).
    ///
    /// # Errors
    /// [`StationError::Port`] if the port cannot be used, [`StationError::Busy`] if another program
    /// has it, [`StationError::Silent`] or [`StationError::Garbled`] if no station answers. A
    /// station with other firmware is no error here: see [`Hello::mismatches`].
    ///
    /// # Example
    /// ```
    /// use trinocular_client::StationError;
    /// use trinocular_client::serial::Serial;
    ///
    /// let error = Serial::connect("/no/such/port").unwrap_err();
    /// assert!(matches!(&error, StationError::Port { .. }));
    /// assert_eq!(error.port(), Some("/no/such/port"));
    /// ```
    pub fn connect(path: &str) -> Result<Self, StationError> {
        Self::connect_observed(path, None)
    }

    /// Connects as [`Serial::connect`] does; `observer` sees every byte on the line.
    ///
    /// # Errors
    /// As [`Serial::connect`].
    pub fn connect_observed(
        path: &str,
        observer: Option<Arc<dyn StationObserver>>,
    ) -> Result<Self, StationError> {
        Self::connect_as(path, Purpose::Drive, observer)
    }

    /// Connects as [`Serial::connect`] does, only to read the station's reports: also while another
    /// program has the port.
    ///
    /// # Errors
    /// As [`Serial::connect`].
    pub fn connect_to_watch(path: &str) -> Result<Self, StationError> {
        Self::connect_as(path, Purpose::Watch, None)
    }

    fn connect_as(
        path: &str,
        purpose: Purpose,
        observer: Option<Arc<dyn StationObserver>>,
    ) -> Result<Self, StationError> {
        let serial = Self::open(path, purpose)?;
        serial.shared.line().set_observer(observer);
        serial.hello()?;
        serial.shared.line().begin_session();
        Ok(serial)
    }

    /// Connects as [`Serial::connect`] does, and stops the stage. The first stop goes out right
    /// behind the first hello, because a station may receive although its replies are lost. A
    /// station with an implausible hello is stopped all the same.
    ///
    /// # Errors
    /// As [`Serial::connect`]; [`StationError::StoppedDoubtful`] if the stop was answered, but the
    /// hello is implausible.
    pub fn connect_and_stop(path: &str) -> Result<Self, StationError> {
        let mut serial = Self::open(path, Purpose::Stop)?;
        serial.stops = true;
        {
            let mut line = serial.shared.line();
            line.greet();
            line.begin_stop();
            // Sends it, before hello is repeated.
            line.attend();
        }
        match serial.hello() {
            Err(StationError::Implausible(cause)) => {
                serial.until_stopped()?;
                return Err(StationError::StoppedDoubtful(cause));
            }
            said => said?,
        }
        serial.shared.line().begin_session();
        Ok(serial)
    }

    /// Opens the line and starts its threads; sends nothing.
    fn open(path: &str, purpose: Purpose) -> Result<Self, StationError> {
        let failed = |what: &str, cause: std::io::Error| StationError::Port {
            path: path.to_owned(),
            reason: format!("{what}: {cause}"),
        };
        interruption::watch().map_err(|cause| failed("signals", cause))?;
        let sender = Arc::new(Sender::new(Instant::now()));
        let line = Line::open(path, purpose, Arc::clone(&sender))?;
        let shared = Arc::new(Shared {
            line: Mutex::new(line),
            ending: Condvar::new(),
        });
        let mut serial = Self {
            shared,
            sender,
            threads: Vec::new(),
            cleared: None,
            _awake: interruption::Awake::begin(),
            stops: false,
        };
        let attendant = Arc::clone(&serial.shared);
        let attendant = std::thread::Builder::new()
            .name("station".to_owned())
            .spawn(move || attendant.attend());
        for thread in [attendant, serial.sender.start_heartbeat()] {
            let thread = thread.map_err(|cause| failed("cannot start its threads", cause))?;
            serial.threads.push(thread);
        }
        if serial.owner().is_none() {
            // Without a place for the socket, other programs cannot reach the station while this
            // one has the port.
            let guests = sharing::open_door(path, Arc::clone(&serial.shared));
            serial.threads.extend(guests);
        }
        Ok(serial)
    }

    /// Closes the line without sending anything, as a crash does: a stage in motion goes on until
    /// its station misses the heartbeat.
    pub fn abandon(mut self) {
        self.close();
        self.shared.line().client.motion_mut().ended();
    }

    fn close(&mut self) {
        self.sender.close();
        self.shared.line().closed = true;
        self.shared.ending.notify_all();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }

    /// Connects to the station, brings it to rest whatever the last host left behind, starts the
    /// heartbeat, configures the stage and declares its present position to be zero.
    ///
    /// # Errors
    /// As [`Serial::connect`]; [`StationError::Mismatch`] for other firmware;
    /// [`StationError::Faulted`] with [`Fault::Restart`], which must be acknowledged by hand;
    /// if the stage does not fit the configuration or the station refuses it.
    pub fn start(path: &str, stage: &Stage, mounting: Mounting) -> Result<Self, StationError> {
        Self::start_as(path, configuration(stage, mounting)?)
    }

    /// Starts the station as [`Serial::start`] does, with a configuration of the caller's.
    ///
    /// # Errors
    /// As [`Serial::start`].
    pub fn start_as(path: &str, configuration: Config) -> Result<Self, StationError> {
        Self::start_observed(path, configuration, None)
    }

    /// Starts the station as [`Serial::start_as`] does; `observer` sees every byte on the line.
    ///
    /// # Errors
    /// As [`Serial::start`].
    pub fn start_observed(
        path: &str,
        configuration: Config,
        observer: Option<Arc<dyn StationObserver>>,
    ) -> Result<Self, StationError> {
        let mut serial = Self::connect_observed(path, observer)?;
        let mismatches = serial.who().map(|hello| hello.mismatches());
        let mismatches = mismatches.unwrap_or_default();
        if !mismatches.is_empty() {
            return Err(StationError::Mismatch(mismatches.to_vec()));
        }
        // Without the heartbeat, which would keep a motion of a crashed host alive.
        serial.stop()?;
        serial.stops = false;
        serial.cleared = serial.fresh_status(true)?.fault;
        if let Some(fault @ Fault::Restart) = serial.cleared {
            // The operator has to look at the stage first.
            return Err(StationError::Faulted(fault));
        }
        let end = Instant::now() + REST_PATIENCE;
        loop {
            match serial.command("reset", Command::Reset) {
                Err(StationError::Denied {
                    denial: Denial::Moving | Denial::FaultUnread,
                    ..
                }) if Instant::now() < end => std::thread::sleep(10 * LOOK),
                outcome => break outcome?,
            }
        }
        serial.start_heartbeat()?;
        serial.command("config", Command::Config(configuration))?;
        serial.command("zero", Command::Zero)?;
        {
            let mut line = serial.shared.line();
            line.configured = true;
            line.configuration = Some(configuration);
        }
        Ok(serial)
    }

    /// Returns the fault that was latched before [`Serial::start`] and cleared by it.
    pub fn cleared(&self) -> Option<Fault> {
        self.cleared
    }

    fn hello(&self) -> Result<(), StationError> {
        let end = Instant::now() + HELLO_PATIENCE;
        loop {
            self.shared.line().greet();
            let again = (Instant::now() + HELLO_PERIOD).min(end);
            if self.wait_until(again, |client| client.hello().map(|_| ()))? == Some(()) {
                return Ok(());
            }
            if Instant::now() >= end {
                return Err(self.silence("hello", HELLO_PATIENCE));
            }
        }
    }

    /// Waits until `got` returns a value from the client, at most until `end`; on a lost line,
    /// until it is back or given up.
    ///
    /// # Errors
    /// If the line is or was lost; [`StationError::Cancelled`] after a signal, unless the caller
    /// has requested a stop.
    pub fn wait_until<T>(
        &self,
        end: Instant,
        mut got: impl FnMut(&mut Client) -> Option<T>,
    ) -> Result<Option<T>, StationError> {
        loop {
            self.check_signals()?;
            {
                let mut line = self.shared.line();
                line.attend();
                if !line.is_down() {
                    line.check()?;
                    if let Some(value) = got(&mut line.client) {
                        return Ok(Some(value));
                    }
                    if Instant::now() >= end {
                        return Ok(None);
                    }
                }
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Returns the error for a missing reply: nothing arrived, or nothing that could be decoded.
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

    /// Returns the station's hello.
    pub fn who(&self) -> Option<Hello> {
        self.client().hello().cloned()
    }

    /// Returns the station's report of its previous run. `None` if its firmware does not fit or the
    /// report did not come.
    ///
    /// # Errors
    /// If the line is or was lost.
    pub fn last_run(&self) -> Result<Option<LastRun>, StationError> {
        let fits = |hello: Hello| hello.mismatches().is_empty();
        if !self.who().is_some_and(fits) {
            return Ok(None);
        }
        // It comes right behind the hello.
        self.wait_until(Instant::now() + PATIENCE, |client| {
            client.last_run().copied()
        })
    }

    /// Waits for a status that is later than the hello or, with `answered`, one that shows the
    /// effect of the last answered command. It comes within a tenth of a second.
    ///
    /// # Errors
    /// [`StationError::Silent`] without one; if the line is or was lost.
    pub fn fresh_status(&self, answered: bool) -> Result<Status, StationError> {
        let status = self.wait_until(Instant::now() + PATIENCE, |client| match answered {
            true => client.status_since_answer().copied(),
            false => client.status_since_hello().copied(),
        })?;
        status.ok_or_else(|| self.silence("status", PATIENCE))
    }

    /// Returns a handle that stops the stage from any thread.
    pub fn stopper(&self) -> Stopper {
        Stopper {
            shared: Arc::clone(&self.shared),
        }
    }

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

    /// Lets commands move the stage again after a [`Stopper`] has stopped it. The station itself
    /// stays stopped until a reset.
    pub fn forgive_stop(&mut self) {
        self.shared.line().stopped_by = None;
    }

    /// Returns the path of the port.
    pub fn path(&self) -> String {
        self.shared.line().path.clone()
    }

    /// Sends a command without waiting; returns its sequence number. On a lost line nothing is
    /// sent; waiting for the answer then fails.
    pub fn send(&mut self, command: Command) -> u16 {
        self.shared.line().send(command)
    }

    /// Takes the station's answer to a sent command, if it has come.
    pub fn answer(&mut self, sequence: u16) -> Option<Result<(), Denial>> {
        let mut line = self.shared.line();
        line.take_in();
        line.client.answer(sequence)
    }

    /// Checks that commands reach the station and the run may go on.
    ///
    /// # Errors
    /// As [`Serial::command`] on a line that is or was lost; [`StationError::Cancelled`] after a
    /// signal, unless the caller has requested a stop.
    pub fn check(&self) -> Result<(), StationError> {
        self.check_signals()?;
        self.shared.line().check()
    }

    fn check_signals(&self) -> Result<(), StationError> {
        match interruption::is_requested() && !self.stops {
            true => Err(StationError::Cancelled),
            false => Ok(()),
        }
    }

    /// Resumes after the line was lost and is back, only with a station that lost no state and has
    /// latched no fault. A station that moved or followed has latched one, because its heartbeat
    /// failed.
    ///
    /// # Errors
    /// [`StationError::Faulted`] with that fault; as [`Serial::check`] if the line is not back or
    /// the station is not the same.
    pub fn resume(&mut self) -> Result<(), StationError> {
        self.shared.line().resume()
    }

    /// Sets the time for reconnecting a lost line; default 10 s.
    pub fn set_reconnect_patience(&mut self, patience: Duration) {
        self.shared.line().patience = patience;
    }

    /// Starts the heartbeat and waits until the station has answered a ping. Before that the
    /// station accepts no command to move.
    ///
    /// # Errors
    /// [`StationError::Silent`] without an answer; as [`Serial::check`].
    pub fn start_heartbeat(&mut self) -> Result<(), StationError> {
        self.set_pings(true);
        let end = Instant::now() + REST_PATIENCE;
        let heard = self.wait_until(end, |client| client.clock().offset_us(0))?;
        match heard {
            Some(_) => Ok(()),
            None => Err(self.silence("ping", REST_PATIENCE)),
        }
    }

    /// Starts or stops the heartbeat.
    pub fn set_pings(&mut self, on: bool) {
        self.shared.line().set_pings(on);
    }

    /// Returns the station's latest status.
    pub fn status(&self) -> Option<Status> {
        let mut line = self.shared.line();
        line.take_in();
        line.client.status().copied()
    }

    /// Locks the line and returns its client. Drop it at once, because no report is read meanwhile.
    pub fn client(&self) -> ClientRef<'_> {
        ClientRef(self.shared.line())
    }

    /// Returns station time minus host time now, and the bound of its error, µs. `None` before the
    /// first reply to a ping.
    pub fn offset_us(&self) -> Option<(i64, u64)> {
        let now_us = self.now_us();
        self.client().clock().offset_us(now_us)
    }

    /// Returns the host's clock that the time sync uses, µs since the line was opened.
    pub fn now_us(&self) -> u64 {
        self.sender.now_us()
    }
}
