//! A station's run that can be repeated, bit for bit, on any machine.
//!
//! A [`Log`] says what went into a station and when. [`Replay`] feeds it to a [`Station`] on
//! virtual time and hands out what the station does: packets for the host, and segments with the
//! port words made of them. A [`Trace`] of that is small enough for a slow link: one record of
//! checksums and edge counts per segment. Two machines that run the same log agree when their
//! traces are equal, byte for byte; the first record that differs names the message or segment to
//! look at.
//!
//! The emulated board (`tests/qemu`) runs this very code, with the log read from a file instead of
//! a serial line, whose arrival times nobody can repeat.
//!
//! *Invariant:* time passes only as the log says, and words leave the step engine exactly at the
//! word rate. So nothing here depends on how fast the machine is.

mod log;
mod probe;
mod station;
mod trace;

pub use log::{Entry, Log, LogFault, Writer};
pub use probe::{Edges, Probe};
pub use station::{Event, Replay, Station};
pub use trace::{Digest, Edge, Record, Trace};
