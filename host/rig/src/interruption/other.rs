//! Ctrl-C and similar requests on systems other than Unix.

use std::io;

/// Calls `came` with each request to end, in a thread of its own.
pub(super) fn install(came: fn(i32)) -> io::Result<()> {
    ctrlc::set_handler(move || came(0)).map_err(io::Error::other)
}

pub(super) fn suspends(_: i32) -> bool {
    false
}

/// Ends the program.
pub(super) fn end(_: i32) {
    std::process::exit(super::EXIT_CODE);
}
