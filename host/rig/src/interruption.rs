//! Signals that end this program: Ctrl-C, SIGTERM, a terminal that closes, and all others that can
//! be caught.
//!
//! The first signal sets one flag for the whole program. Code that moves a stage sees the flag and
//! stops the stage: every connection (`trinocular_client::serial::Serial`) watches for signals from
//! its connection on, so that no command can forget to. A second signal ends the program at once,
//! with exit code 3; the station then stops by itself because it hears no heartbeat.
//!
//! | Signal (Unix) | While a station is connected |
//! |---|---|
//! | SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGALRM, SIGUSR1 and every other that ends a program | the stage is stopped, then the program ends |
//! | SIGTSTP (Ctrl-Z) | the same: a suspended host could not stop its stage |
//! | SIGXFSZ, SIGPIPE | ignored: the write that caused it fails, which ends the run as a full disk does |
//! | SIGKILL, SIGSEGV, SIGILL, SIGFPE | the program ends at once, and with it the heartbeat: the station ramps down with fault 0 |
//! | SIGSTOP, SIGTTIN, SIGTTOU | the program stands still, and with it the heartbeat: the same; the run ends with that fault when it is continued |
//!
//! A library inside another program may [leave signals to it](leave_to_caller).
//!
//! Without a station and without a watcher, signals have their default effect, except while files
//! are written (`Hold`).

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

#[cfg_attr(unix, path = "interruption/unix.rs")]
#[cfg_attr(not(unix), path = "interruption/other.rs")]
mod system;

/// Time within which several signals count as one request: a shell and the system may both report a
/// closed terminal, and `timeout` signals a program and then its group.
const ONE_WISH: Duration = Duration::from_millis(100);

/// Longest wait of a second signal for files that are being written.
const WRITING_PATIENCE: Duration = Duration::from_secs(2);

/// Exit code after the second signal: the station may still be in motion.
const EXIT_CODE: i32 = 3;

static STATE: Mutex<State> = Mutex::new(State {
    flag: None,
    is_installed: false,
    holds: 0,
    lines: 0,
    first: None,
    held: None,
    is_left: false,
});

struct State {
    /// Flag that the first signal sets; `None` while nothing watches.
    flag: Option<Arc<AtomicBool>>,
    is_installed: bool,
    /// Number of living [`Hold`]s.
    holds: usize,
    /// Number of living [`Awake`]s.
    lines: usize,
    /// Time of the first signal.
    first: Option<Instant>,
    /// Signal that came during a hold and has had no effect yet.
    held: Option<i32>,
    /// True if signals are the business of the program around this library.
    is_left: bool,
}

fn state() -> MutexGuard<'static, State> {
    STATE.lock().unwrap_or_else(PoisonError::into_inner)
}

impl State {
    fn install(&mut self) -> io::Result<()> {
        if !self.is_installed && !self.is_left {
            system::install(came).map_err(|cause| {
                io::Error::new(cause.kind(), format!("cannot watch for Ctrl-C: {cause}"))
            })?;
            self.is_installed = true;
        }
        Ok(())
    }
}

/// Leaves all signals to the program around this library, such as an interpreter that has handlers
/// of its own. Call it first: nothing here watches for signals after that, and the caller must stop
/// a stage that is in motion.
pub fn leave_to_caller() {
    state().is_left = true;
}

/// Watches for signals from now on, if it does not yet; returns the flag that the first signal
/// sets.
///
/// # Errors
/// [`io::Error`] if the system refuses the handler.
pub fn watch() -> io::Result<Arc<AtomicBool>> {
    let mut state = state();
    state.install()?;
    Ok(Arc::clone(state.flag.get_or_insert_default()))
}

/// Returns true if a signal has come since the program started to watch for signals.
pub fn is_requested() -> bool {
    let state = state();
    let flag = state.flag.as_ref();
    flag.is_some_and(|flag| flag.load(Ordering::Relaxed))
}

/// Returns the number of the first signal that has come, if this program watches for signals.
pub fn signal() -> Option<i32> {
    let state = state();
    state.held.filter(|_| state.flag.is_some())
}

/// Delay of the end of the program by a signal, while the value lives. Without it temporary files
/// would stay, or old and new files side by side.
#[derive(Debug)]
pub struct Hold(());

impl Hold {
    /// Delays the end of the program from now on.
    pub fn begin() -> Self {
        let mut state = state();
        // If the system refuses the handler, a signal ends the program by default.
        let _ = state.install();
        state.holds += 1;
        Self(())
    }
}

impl Drop for Hold {
    fn drop(&mut self) {
        let mut state = state();
        state.holds -= 1;
        if state.holds == 0
            && state.flag.is_none()
            && let Some(signal) = state.held
        {
            system::end(signal);
        }
    }
}

/// Guard that makes Ctrl-Z end the program as Ctrl-C does, while the value lives.
#[derive(Debug)]
pub struct Awake(());

impl Awake {
    /// Watches for Ctrl-Z from now on.
    pub fn begin() -> Self {
        state().lines += 1;
        Self(())
    }
}

impl Drop for Awake {
    fn drop(&mut self) {
        state().lines -= 1;
    }
}

/// Handles a signal, in the thread that waits for signals, not in a signal handler.
fn came(signal: i32) {
    let mut state = state();
    if system::suspends(signal) && state.lines == 0 {
        drop(state);
        return system::end(signal);
    }
    if state.flag.is_none() && state.holds == 0 {
        // Ends while holding the lock, so that no file is begun meanwhile.
        return system::end(signal);
    }
    if let Some(flag) = &state.flag {
        flag.store(true, Ordering::Relaxed);
    }
    state.held.get_or_insert(signal);
    if state.first.get_or_insert_with(Instant::now).elapsed() > ONE_WISH {
        drop(state);
        end_at_once();
    }
}

fn end_at_once() {
    let patience = Instant::now() + WRITING_PATIENCE;
    while state().holds > 0 && Instant::now() < patience {
        std::thread::sleep(Duration::from_millis(1));
    }
    std::process::exit(EXIT_CODE);
}
