//! Trials of faults: a station in a fast move of all axes, the edges at its pins, and its state
//! afterwards.

use crate::board::Make;
use crate::image::Image;
use crate::order::{config, jog};
use crate::station::Station;
use crate::time::{Beats, MS, US};
use crate::wiring::{self, B, C, Pin};
use trinocular_core::frame::message::{Command, Denial, LastRun, ResetCause, Status};
use trinocular_core::safety::{Fault, State, Trust};
use trinocular_rig::rig_file::Driver;

/// Length of the ring of words, µs: nothing older can be played.
pub const RING_US: u64 = 1_250;

/// Length of a control tick, at which the machine samples its inputs, and of the ring, µs.
pub const TICK_AND_RING_US: u64 = 1_000 + RING_US;

/// Configures the default stage.
///
/// # Panics
/// If the station refuses.
pub fn configure(station: &mut Station) {
    let config = Command::Config(config(Driver::Tmc2209));
    assert_eq!(station.command(config), Ok(()));
}

/// Returns a station with all axes at full speed, 24,000 steps a second together.
///
/// # Panics
/// If it does not move.
pub fn moving() -> Station {
    let mut station = Station::power_on(&Image::firmware(), Make::default());
    station.run(20 * MS);
    station.greet();
    station.set_up(Driver::Tmc2209);
    assert_eq!(station.command(jog([45_000, -45_000, 45_000])), Ok(()));
    station.run(150 * MS);
    let recent = rises_after(&mut station, 140 * MS);
    assert!(recent.len() > 100, "it moves");
    station
}

/// Returns the moments at which STEP pins rose at or after `from`.
pub fn rises_after(station: &mut Station, from: Beats) -> Vec<Beats> {
    let step = (wiring::STEPPERS.step.iter()).fold(0, |mask, pin| mask | 1 << pin);
    let changes = station.board.changes(C);
    (changes.iter())
        .filter(|change| change.at >= from && !change.before & change.after & step != 0)
        .map(|change| change.at)
        .collect()
}

/// Asserts that no STEP pin rises later than `bound_us` after `from`, and prints the moment of the
/// last rise.
///
/// # Panics
/// If a STEP pin does.
pub fn last_step(station: &mut Station, from: Beats, bound_us: u64) {
    let rises = rises_after(station, from);
    let last = rises.last().map(|at| (at - from) as f64 / US as f64);
    println!(
        "{} steps, the last after {last:?} us (bound {bound_us})",
        rises.len()
    );
    assert!(
        last.is_none_or(|last| last <= bound_us as f64),
        "{last:?} us"
    );
}

/// Returns true if the drivers' enable line is on.
pub fn drivers_are_on(station: &mut Station) -> bool {
    station.board.chip(|chip| chip.fabric.ports[B].levels()) & 1 << wiring::NOT_ENABLE.1 == 0
}

/// Waits for the watchdog's reset, and reads the cause from the station that starts.
///
/// # Panics
/// If there is no reset within that time, or the station has not latched its restart.
pub fn restarted(station: &mut Station, within: Beats) -> (ResetCause, LastRun) {
    let resets = station.board.last_reset().1;
    let end = station.board.now() + within;
    while station.board.last_reset().1 == resets {
        assert!(station.board.now() < end, "no reset");
        station.run(MS);
    }
    assert!(!drivers_are_on(station));
    station.set_pings(false);
    station.run(20 * MS);
    station.greet();
    let status = station.status();
    assert_eq!(
        (status.state, status.fault, status.trust),
        (State::Faulted, Some(Fault::Restart), Trust::Unknown)
    );
    assert!(!drivers_are_on(station), "not before a configuration");
    let cause = station.client.hello().expect("hello").reset_cause;
    configure(station);
    assert!(drivers_are_on(station));
    assert_eq!(station.command(jog([1_000; 3])), Err(Denial::Faulted));
    (cause, *station.client.last_run().expect("last run"))
}

/// Asserts that the station is stopped with this fault, drivers on, and returns its status.
///
/// # Panics
/// If it is in another state.
pub fn faulted(station: &mut Station, fault: Fault, trust: Trust) -> Status {
    station.run(30 * MS);
    let status = station.status();
    assert_eq!(
        (status.state, status.fault, status.trust),
        (State::Faulted, Some(fault), trust)
    );
    assert!(drivers_are_on(station));
    assert_eq!(station.board.last_reset().1, 0);
    status
}

/// Asserts that the station moves again after a reset command, and that its pins agree with its
/// position.
///
/// # Panics
/// If it does not, or they do not.
pub fn recovers(station: &mut Station) {
    assert_eq!(station.command(Command::Reset), Ok(()));
    station.run(20 * MS);
    assert_eq!(station.command(Command::Zero), Ok(()));
    let before = wiring::steps(&station.edges()).0;
    assert_eq!(station.command(jog([1_000, 1_000, -500])), Ok(()));
    station.run(200 * MS);
    let after = wiring::steps(&station.edges()).0;
    let moved: [i64; 3] = std::array::from_fn(|i| after[i] - before[i]);
    assert_eq!(moved, [80, 80, -40]);
}

/// Opens or closes a contact to ground.
pub fn switch(station: &mut Station, pin: Pin, open: bool) {
    station.board.chip(|chip| match open {
        true => wiring::open(&mut chip.fabric, pin),
        false => wiring::close(&mut chip.fabric, pin),
    });
}
