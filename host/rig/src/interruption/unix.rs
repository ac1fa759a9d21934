//! Signals of Unix.

use std::io;

use signal_hook::consts::signal::{
    SIGABRT, SIGALRM, SIGBUS, SIGHUP, SIGINT, SIGPROF, SIGQUIT, SIGSYS, SIGTERM, SIGTRAP, SIGTSTP,
    SIGUSR1, SIGUSR2, SIGVTALRM, SIGXCPU, SIGXFSZ,
};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;

/// Signals that end a program, and the one of Ctrl-Z. It does not include the signals that the
/// processor raises, because the program cannot continue after them, nor SIGPIPE, because Rust's
/// runtime ignores it.
const ENDING: [i32; 15] = [
    SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGALRM, SIGVTALRM, SIGPROF, SIGUSR1, SIGUSR2, SIGXCPU,
    SIGSYS, SIGTRAP, SIGABRT, SIGBUS, SIGTSTP,
];

/// Calls `came` with each signal that comes from now on, in a thread of its own.
pub(super) fn install(came: fn(i32)) -> io::Result<()> {
    let mut signals = Signals::new(ENDING)?;
    // Caught without effect: the write beyond the limit then fails with an error, as on a full
    // disk.
    signals.add_signal(SIGXFSZ)?;
    for signal in others() {
        // Some C libraries reserve one of them.
        let _ = signals.add_signal(signal);
    }
    let wait = move || {
        for signal in signals.forever().filter(|signal| *signal != SIGXFSZ) {
            came(signal);
        }
    };
    let thread = std::thread::Builder::new().name("signals".to_owned());
    thread.spawn(wait).map(drop)
}

/// Returns the signals that end a program on Linux only.
#[cfg(target_os = "linux")]
fn others() -> impl Iterator<Item = i32> {
    use rustix::process::Signal;
    /// Numbers of the real-time signals that programs may use.
    const REAL_TIME: std::ops::RangeInclusive<i32> = 34..=64;
    let named = [Signal::IO, Signal::POWER, Signal::STKFLT];
    named.map(Signal::as_raw).into_iter().chain(REAL_TIME)
}

#[cfg(not(target_os = "linux"))]
fn others() -> impl Iterator<Item = i32> {
    std::iter::empty()
}

/// Returns true if the signal suspends a program that does not catch it.
pub(super) fn suspends(signal: i32) -> bool {
    signal == SIGTSTP
}

/// Takes the default action of the signal.
pub(super) fn end(signal: i32) {
    let is_done = emulate_default_handler(signal).is_ok();
    if !(is_done && suspends(signal)) {
        // Exit code by which shells report a program that a signal has ended.
        std::process::exit(128 + signal);
    }
}
