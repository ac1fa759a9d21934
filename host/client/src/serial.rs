//! A station at the end of a serial line: the board over USB or UART, or the emulated board behind
//! a pseudo-terminal.
//!
//! Two threads share the [`line`]. The caller sends commands and waits for answers. The line's own
//! thread reads the station's reports and reconnects a lost line; the caller's next call then
//! fails, and the caller decides whether to resume once the line is back. A third thread sends only
//! the heartbeat (`sender`). So the heartbeat goes on while the caller processes images, and
//! stops with the process: a host that crashed does not keep a stage moving. A thread waits for
//! guests, and one more serves each of them (`sharing`).
//!
//! *Invariant:* a stage that moves because of this program stops before the line is closed,
//! whatever ends the run (`stop`).

mod busy;
mod connecting;
mod deed;
mod holder;
mod line;
mod port;
mod repetition;
mod sender;
mod sharing;
mod stop;
mod terminal;

pub(crate) use busy::owner_of;
pub use busy::{OtherHost, end_other_host};
pub use deed::{Deed, in_words};
pub use holder::Holder;
pub(crate) use port::TCP;
pub use sharing::Access;
pub use stop::{Ending, Stopper, ending};

use super::StationError;
use super::conversation::Client;
use super::observer::StationObserver;
use line::Line;
use sender::Sender;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use trinocular_core::frame::message::{Command, Denial, Hello, LastRun, Status};
use trinocular_core::safety::Fault;
use trinocular_core::time::Instant as StationInstant;
use trinocular_rig::interruption;

/// Polling period of the line.
const LOOK: Duration = Duration::from_millis(1);

/// Timeout for an answer.
const PATIENCE: Duration = Duration::from_secs(2);

/// Timeout for a status while the heartbeat is on: longer than the silence by which a line counts
/// as lost, so that the error says what became of the station.
const STATUS_PATIENCE: Duration = Duration::from_secs(4);

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
    found: Option<Status>,
    is_zeroed: bool,
    /// True if the station ends with this program: then it needs no advice for later.
    ends_with_station: bool,
    /// Keeps the host awake, because a host that sleeps stops no stage.
    _awake: interruption::Awake,
    /// True once the caller has requested a stop: signals are then no longer reported.
    stops: bool,
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
    /// Sets the observer of every byte on the line from now on.
    pub fn set_observer(&self, observer: Option<Arc<dyn StationObserver>>) {
        self.shared.line().set_observer(observer);
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

    /// Returns the fault that was latched before [`Serial::start`] and cleared by it.
    pub fn cleared(&self) -> Option<Fault> {
        self.found.and_then(|status| status.fault)
    }

    /// Returns the status at rest before [`Serial::start`], which has made the present position
    /// zero.
    pub fn found(&self) -> Option<Status> {
        self.found
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
        let patience = match self.shared.line().is_pinging() {
            true => STATUS_PATIENCE,
            false => PATIENCE,
        };
        let status = self.wait_until(Instant::now() + patience, |client| match answered {
            true => client.status_since_answer().copied(),
            false => client.status_since_hello().copied(),
        })?;
        status.ok_or_else(|| self.silence("status", patience))
    }

    /// Returns the position of the stage at an instant of the station's clock, as
    /// [`Client::position_steps_at`] does.
    pub fn position_steps_at(&self, at: StationInstant) -> Option<[f64; 3]> {
        self.client().position_steps_at(at)
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

    /// Sends hello again: a station that has restarted takes no command before it.
    pub fn greet(&self) {
        self.shared.line().greet();
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

    /// Marks the station as one that ends with this program, so that the end of a run in motion
    /// advises no reset.
    pub fn set_ends_with_station(&mut self) {
        self.ends_with_station = true;
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

    /// Returns true if the stage moves, or may move because of a command or a stop of this program
    /// or of a guest.
    pub fn is_moving(&self) -> bool {
        let mut line = self.shared.line();
        line.take_in();
        line.is_moving()
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
