//! The wish to end this program: Ctrl-C, SIGTERM, SIGHUP of a terminal that closes, or their like
//! on other systems.
//!
//! One flag for the whole program. The first signal sets it. What moves a stage sees the flag and
//! stops: every [`Serial`](crate::client::serial::Serial) watches for signals from its connection
//! on, so that no command can forget to. A second signal ends the program at once, with exit code
//! 3; the station then stops by itself because it hears no heartbeat.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// Signals this close together are one wish: a shell and the system may both tell of a closed
/// terminal, and `timeout` signals a program and then its group.
const ONE_WISH: Duration = Duration::from_millis(100);

/// Exit code after the second signal: the station may still be in motion.
const EXIT_CODE: i32 = 3;

static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
static INSTALLING: Mutex<()> = Mutex::new(());

/// Watches for signals from now on, if it does not yet; returns the flag that the first one sets.
///
/// # Errors
/// If the system refuses the handler.
pub fn watch() -> io::Result<Arc<AtomicBool>> {
    let _one_at_a_time = INSTALLING.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(flag) = FLAG.get() {
        return Ok(Arc::clone(flag));
    }
    let flag = Arc::new(AtomicBool::new(false));
    let (set, mut first) = (Arc::clone(&flag), None);
    ctrlc::set_handler(move || {
        set.store(true, Ordering::Relaxed);
        if first.get_or_insert_with(Instant::now).elapsed() > ONE_WISH {
            std::process::exit(EXIT_CODE);
        }
    })
    .map_err(|cause| io::Error::other(format!("cannot watch for Ctrl-C: {cause}")))?;
    Ok(Arc::clone(FLAG.get_or_init(|| flag)))
}

/// Returns true if a signal has come since the program watches for them.
pub fn is_requested() -> bool {
    FLAG.get().is_some_and(|flag| flag.load(Ordering::Relaxed))
}
