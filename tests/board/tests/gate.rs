//! Second contact of the emergency stop, which gates the step timer in hardware.

use station_board::board::{Board, Make};
use station_board::fault_table::observed;
use station_board::image::Image;
use station_board::order::jog;
use station_board::station::Station;
use station_board::time::{MS, US};
use station_board::trial::{
    configure, drivers_are_on, faulted, last_step, moving, recovers, rises_after, switch,
};
use station_board::wiring::{self, C};
use trinocular_core::frame::message::{Command, Denial};
use trinocular_core::safety::{Fault, State, Trust};

/// Opens or closes the contact between the pin and the supply.
fn gate(station: &mut Station, open: bool) {
    let (port, pin) = wiring::GATE;
    station.board.drive(port, pin, (!open).then_some(true));
}

/// Duration of the filter, µs: eight samples at 168 MHz / 4 / 32.
const FILTER_US: u64 = 7;

#[test]
fn open_gate_stops_pulses_without_core() {
    let mut station = moving();
    station.board.hold(true);
    let at = station.board.now();
    gate(&mut station, true);
    station.run(20 * MS);
    // Without the gate the ring's words would continue for a millisecond.
    last_step(&mut station, at, FILTER_US);
    station.run(80 * MS);
    gate(&mut station, false);
    assert_eq!(station.board.last_reset().1, 1);
    station.set_pings(false);
    station.greet();
    let status = station.status();
    assert!(status.faults.contains(Fault::Restart), "{status:?}");
    observed(
        "emergency stop's second contact, processor halted",
        "its clock stopped, then the contact opens",
        "no step after 7 µs: the timer's gate",
        "watchdog: hello says watchdog; fault 9, position unknown; nothing moves before a reset",
    );
}

#[test]
fn open_gate_is_an_emergency_stop() {
    let mut station = moving();
    let at = station.board.now();
    gate(&mut station, true);
    faulted(&mut station, Fault::EmergencyStop, Trust::Degraded);
    last_step(&mut station, at, FILTER_US);
    assert_eq!(station.command(Command::Reset), Err(Denial::CauseRemains));
    // After closing again, nothing that was planned before is played.
    let at = station.board.now();
    gate(&mut station, false);
    station.run(30 * MS);
    last_step(&mut station, at, 0);
    recovers(&mut station);
    observed(
        "emergency stop's second contact",
        "opens alone, the first being welded",
        "no step after 7 µs: the timer's gate",
        "fault 1, position degraded, drivers on; reset refused while it is open; \
         after reset and zero it moves exactly again",
    );
}

/// The opening is too short for the program to see the contact itself, unless it looks at that very
/// moment: it detects that the timer lost time. At every phase of its loop the stage stops.
#[test]
fn short_gate_opening_stops_the_stage() {
    let mut unseen = 0;
    for phase in 0..4 {
        let mut station = moving();
        station.run(phase * 70 * US);
        let at = station.board.now();
        gate(&mut station, true);
        station.run(50 * US);
        gate(&mut station, false);
        station.run(30 * MS);
        let seen = station.status().fault == Some(Fault::EmergencyStop);
        let fault = match seen {
            true => Fault::EmergencyStop,
            false => Fault::Underrun,
        };
        unseen += u32::from(!seen);
        faulted(&mut station, fault, Trust::Degraded);
        last_step(&mut station, at, 500);
        recovers(&mut station);
    }
    assert!(unseen >= 2, "seen at {} of 4 phases", 4 - unseen);
}

#[test]
fn spark_on_the_gate_is_filtered() {
    let mut station = moving();
    let at = station.board.now();
    gate(&mut station, true);
    station.run(4 * US);
    gate(&mut station, false);
    station.run(20 * MS);
    assert_eq!(station.status().fault, None);
    assert!(rises_after(&mut station, at).len() > 300);
}

#[test]
fn both_contacts_act_as_one() {
    let mut station = moving();
    let at = station.board.now();
    switch(&mut station, wiring::EMERGENCY_STOP, true);
    gate(&mut station, true);
    faulted(&mut station, Fault::EmergencyStop, Trust::Degraded);
    last_step(&mut station, at, FILTER_US);
    switch(&mut station, wiring::EMERGENCY_STOP, false);
    gate(&mut station, false);
    station.run(10 * MS);
    recovers(&mut station);
}

#[test]
fn power_on_waits_for_open_gate() {
    let board = Board::power_on(&Image::firmware(), Make::default(), |fabric| {
        wiring::well(fabric);
        let (port, pin) = wiring::GATE;
        fabric.drive(port, pin, None);
    });
    let mut station = Station::of(board);
    station.run(20 * MS);
    station.greet();
    assert!(!drivers_are_on(&mut station));
    configure(&mut station);
    assert_eq!(station.command(jog([1_000; 3])), Err(Denial::Faulted));
    let busy = station.board.busy();
    station.run(100 * MS);
    let share = (station.board.busy() - busy) as f64 / (100 * MS) as f64;
    assert!(
        share < 0.5,
        "it does not start its timer again and again: {share}"
    );
    assert_eq!(station.status().state, State::Faulted);
    assert_eq!(wiring::stepper_edges(&station.board.changes(C)), []);
    gate(&mut station, false);
    station.run(10 * MS);
    recovers(&mut station);
}
