//! A station's run that can be repeated, bit for bit, on any machine.
//!
//! A [`Log`] holds the inputs of a station with their instants. [`Replay`] feeds it to a
//! [`Station`] on virtual time and returns what the station does: packets for the host, and
//! segments with the port words made of them. A [`Trace`] of that is small enough for a slow link:
//! one record of checksums and edge counts per segment. Two machines that run the same log agree
//! when their traces are equal, byte for byte; the first record that differs names the message or
//! segment to examine.
//!
//! The emulated board (`tests/qemu`) runs the same code, with the log read from a file instead of a
//! serial line, whose arrival times cannot be repeated.
//!
//! *Invariant:* time passes only as the log says, and words leave the step engine exactly at the
//! word rate. So nothing here depends on the speed of the machine.

mod log;
mod probe;
mod station;
mod trace;

pub use log::{Entry, Log, LogFault, Writer};
pub use probe::{Edges, Probe};
pub use station::{Event, Replay, Station, Station as EmulatedStation};
pub use trace::{Digest, Edge, Record, Trace};
