//! A station under any commands, bytes, switches and waits.
//!
//! Laws: no panic; the generator takes every segment; the pins make exactly the steps of the
//! planned position; no axis is faster than its configuration allows; a station without
//! configuration, or at rest with an emergency stop, makes no step; every packet it sends is a
//! report.
#![no_main]

use libfuzzer_sys::fuzz_target;
use station_fuzz::life::{Event, Start, live};

fuzz_target!(|life: (Start, Vec<Event>)| live(life.0, &life.1));
