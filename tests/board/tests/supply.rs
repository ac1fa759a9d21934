//! Dips of the supply, and the report of the next start.

use station_board::board::{Board, Make};
use station_board::fault_table::observed;
use station_board::image::Image;
use station_board::station::Station;
use station_board::time::{MS, US};
use station_board::trial::{drivers_are_on, last_step, moving, restarted, rises_after};
use station_board::wiring;
use trinocular_core::frame::message::{End, ResetCause};
use trinocular_core::safety::{Fault, State};

#[test]
fn dip_ends_pulses_as_brown_out() {
    let mut station = moving();
    let at = station.board.now();
    station.board.chip(|chip| chip.set_supply(2_850));
    station.run(20 * US);
    assert!(!drivers_are_on(&mut station), "off at once");
    station.run(2 * MS);
    station.board.chip(|chip| chip.set_supply(3_300));
    let (cause, last_run) = restarted(&mut station, 80 * MS);
    last_step(&mut station, at, 5);
    assert_eq!((cause, last_run.end), (ResetCause::BrownOut, End::Outside));
    observed(
        "supply dips",
        "2.85 V for 2 ms",
        "no step after 5 µs; drivers off",
        "watchdog: hello says brown-out; fault 9, position unknown; nothing moves before a reset",
    );
}

#[test]
fn sag_above_threshold_is_harmless() {
    let mut station = moving();
    let at = station.board.now();
    station.board.chip(|chip| chip.set_supply(2_950));
    station.run(20 * MS);
    assert_eq!(station.status().fault, None);
    assert!(rises_after(&mut station, at).len() > 300);
}

/// The supply stays low: each start ends again, with drivers off, until it recovers.
#[test]
fn low_supply_keeps_drivers_off() {
    let mut station = moving();
    station.board.chip(|chip| chip.set_supply(2_800));
    station.set_pings(false);
    let at = station.board.now();
    station.run(300 * MS);
    last_step(&mut station, at, 5);
    assert!(
        station.board.last_reset().1 >= 2,
        "it starts again and again"
    );
    assert!(!drivers_are_on(&mut station));
    station.board.chip(|chip| chip.set_supply(3_300));
    station.run(150 * MS);
    station.greet();
    let hello = station.client.hello().expect("hello");
    assert_eq!(hello.reset_cause, ResetCause::BrownOut);
    assert_eq!(station.status().fault, Some(Fault::Restart));
}

/// The loss is so short that memory is intact, and so deep that the power-on detector resets the
/// chip before the program writes a word.
#[test]
fn short_power_loss_is_a_brown_out() {
    let mut station = moving();
    let at = station.board.now();
    station.board.lose_power();
    station.set_pings(false);
    station.run(20 * MS);
    station.greet();
    last_step(&mut station, at, 0);
    let hello = station.client.hello().expect("hello");
    assert_eq!(hello.reset_cause, ResetCause::BrownOut);
    let status = station.status();
    assert_eq!(
        (status.state, status.fault),
        (State::Faulted, Some(Fault::Restart))
    );
    observed(
        "short loss of power",
        "power-on reset with memory intact",
        "no step; pins are inputs, drivers off",
        "hello says brown-out; fault 9, position unknown; nothing moves before a reset",
    );
}

#[test]
fn power_on_waits_for_the_supply() {
    let board = Board::power_on(&Image::firmware(), Make::default(), wiring::well);
    let mut station = Station::of(board);
    station.board.chip(|chip| chip.set_supply(2_700));
    station.run(150 * MS);
    assert!(station.board.last_reset().1 >= 1, "each start ends");
    station.board.chip(|chip| chip.set_supply(3_300));
    station.run(150 * MS);
    station.greet();
    assert_eq!(wiring::stepper_edges(&station.board.changes(wiring::C)), []);
}
