//! Connecting to a station, and starting it: from the open line to a stage that may move.

use super::super::StationError;
use super::super::observer::StationObserver;
use super::super::owner::Purpose;
use super::super::stage::configuration;
use super::line::Line;
use super::sender::Sender;
use super::{Access, LOOK, REST_PATIENCE, Serial, Shared, sharing};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};
use trinocular_core::frame::message::{Command, Config, Mounting, Status};
use trinocular_core::safety::{Fault, State, Trust};
use trinocular_rig::interruption;
use trinocular_rig::rig_file::Stage;

/// Timeout for the first answer: some boards restart when their port is opened, and a
/// pseudo-terminal takes a second to notice it.
const HELLO_PATIENCE: Duration = Duration::from_secs(3);

/// Timeout for a program that only reads to find an owner that stays, or none.
const OWNER_PATIENCE: Duration = Duration::from_secs(3);

/// Period of hello until the first answer.
const HELLO_PERIOD: Duration = Duration::from_millis(250);

/// Timeout for a stage that no host drives to come to rest: the longest heartbeat timeout, and a
/// ramp.
const LONE_PATIENCE: Duration = Duration::from_secs(20);

impl Serial {
    /// Opens the line and identifies the station. Sends nothing but hello; no heartbeat yet. From
    /// then on the program watches for Ctrl-C and other [signals](interruption).
    ///
    /// # Errors
    /// [`StationError::Port`] if the port cannot be used, [`StationError::Busy`] if another program
    /// has it, [`StationError::Silent`] or [`StationError::Garbled`] if no station answers. A
    /// station with other firmware is no error here: see [`Hello::mismatches`].
    ///
    /// [`Hello::mismatches`]: trinocular_core::frame::message::Hello::mismatches
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
        let end = Instant::now() + OWNER_PATIENCE;
        loop {
            match Self::connect_as(path, Purpose::Watch, None) {
                // The program that has let this one in has left: now the port may be free.
                Err(StationError::Lost { .. })
                    if Instant::now() < end && !interruption::is_requested() => {}
                Err(error) => return Err(error),
                Ok(serial) => {
                    serial.shared.line().guests.access = Access::Brief;
                    return Ok(serial);
                }
            }
        }
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
            found: None,
            is_zeroed: false,
            ends_with_station: false,
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
            let guests = sharing::start_listener(path, Arc::clone(&serial.shared));
            serial.threads.extend(guests);
        }
        Ok(serial)
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
        serial.check_firmware()?;
        // Without the heartbeat, which would keep a motion of a crashed host alive.
        serial.stop()?;
        serial.stops = false;
        serial.found = Some(serial.fresh_status(true)?);
        if let Some(fault @ Fault::Restart) = serial.cleared() {
            // The operator has to look at the stage first.
            return Err(StationError::Faulted(fault));
        }
        let end = Instant::now() + REST_PATIENCE;
        loop {
            match serial.command("reset", Command::Reset) {
                Err(error) if error.is_passing() && Instant::now() < end => {
                    std::thread::sleep(10 * LOOK);
                }
                outcome => break outcome?,
            }
        }
        serial.start_heartbeat()?;
        serial.command("config", Command::Config(configuration))?;
        serial.command("zero", Command::Zero)?;
        serial.shared.line().configuration = Some(configuration);
        Ok(serial)
    }

    /// Connects to a station only to show it: sends hello and the heartbeat, which gives the
    /// station's time, and changes nothing. If another program has the port, the reports come
    /// through that program.
    ///
    /// The heartbeat begins when the stage stands, because it would keep a motion of a crashed host
    /// alive.
    ///
    /// # Errors
    /// As [`Serial::connect`]; [`StationError::Mismatch`] for other firmware;
    /// [`StationError::Restless`] if the stage does not come to rest without a host.
    pub fn show(
        path: &str,
        observer: Option<Arc<dyn StationObserver>>,
    ) -> Result<Self, StationError> {
        let mut serial = Self::connect_as(path, Purpose::Watch, observer)?;
        serial.check_firmware()?;
        if serial.owner().is_none() {
            serial.wait_for_lone_stage()?;
        }
        serial.start_heartbeat()?;
        Ok(serial)
    }

    /// Waits until a stage that no host drives has come to rest.
    fn wait_for_lone_stage(&self) -> Result<(), StationError> {
        let is_at_rest = |status: &Status| (!status.state.is_moving()).then_some(());
        let end = Instant::now() + LONE_PATIENCE;
        let rest = self.wait_until(end, |client| {
            client.status_since_hello().and_then(is_at_rest)
        })?;
        let waited_s = LONE_PATIENCE.as_secs();
        rest.ok_or(StationError::Restless { waited_s })
    }

    /// Connects to the station, starts the heartbeat and configures the stage. A stop and faults
    /// stay latched, and a known position stays known; the present position becomes zero only if
    /// it was never known and the station is ready ([`Serial::is_zeroed`]). A stage that moves is
    /// stopped first.
    ///
    /// # Errors
    /// As [`Serial::start`], except that a latched fault is none.
    pub fn take_over(
        path: &str,
        configuration: Config,
        observer: Option<Arc<dyn StationObserver>>,
    ) -> Result<Self, StationError> {
        let mut serial = Self::connect_observed(path, observer)?;
        serial.check_firmware()?;
        if serial.fresh_status(false)?.state.is_moving() {
            // Without the heartbeat, which would keep a motion of a crashed host alive.
            serial.stop()?;
            serial.until_rest()?;
            serial.stops = false;
        }
        serial.start_heartbeat()?;
        serial.command("config", Command::Config(configuration))?;
        serial.shared.line().configuration = Some(configuration);
        let status = serial.fresh_status(true)?;
        let is_ready = status.state == State::Idle && status.motors;
        if is_ready && status.trust == Trust::Unknown {
            serial.command("zero", Command::Zero)?;
            serial.is_zeroed = true;
        }
        Ok(serial)
    }

    /// Returns true if [`Serial::take_over`] has made the present position zero.
    pub fn is_zeroed(&self) -> bool {
        self.is_zeroed
    }

    fn check_firmware(&self) -> Result<(), StationError> {
        let mismatches = self.who().map(|hello| hello.mismatches());
        match mismatches.unwrap_or_default() {
            none if none.is_empty() => Ok(()),
            list => Err(StationError::Mismatch(list.to_vec())),
        }
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
}
