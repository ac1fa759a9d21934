//! Motors off and on, and the status LED.

use station_board::board::Make;
use station_board::image::Image;
use station_board::order::{config, jog};
use station_board::reference::agreement;
use station_board::station::Station;
use station_board::time::{Beats, MS};
use station_board::trial::{drivers_are_on, switch};
use station_board::wiring::{self, C};
use trinocular_core::frame::message::{Command, StageConfig};
use trinocular_core::safety::{State, Trust};
use trinocular_rig::rig_file::Driver;

fn configured(motors_off_after_s: u16) -> Station {
    let mut station = Station::power_on(&Image::firmware(), Make::default());
    station.run(20 * MS);
    station.greet();
    let mut config = config(Driver::Tmc2209);
    config.stage = StageConfig {
        motors_off_after_s,
        ..config.stage
    };
    assert!(!drivers_are_on(&mut station));
    assert_eq!(station.command(Command::Config(config)), Ok(()));
    assert_eq!(station.command(Command::Zero), Ok(()));
    station
}

#[test]
fn motors_command_switches_enable() {
    let mut station = configured(0);
    assert!(drivers_are_on(&mut station));
    assert_eq!(station.command(Command::Motors { on: false }), Ok(()));
    station.run(2 * MS);
    assert!(!drivers_are_on(&mut station));
    assert!(station.command(jog([1_000, 0, 0])).is_err());
    assert_eq!(station.status().trust, Trust::Degraded);
    assert_eq!(station.command(Command::Motors { on: true }), Ok(()));
    station.run(2 * MS);
    assert!(drivers_are_on(&mut station));
    assert_eq!(station.command(Command::Zero), Ok(()));
    assert_eq!(station.command(jog([1_000, 0, 0])), Ok(()));
    station.run(200 * MS);
    assert_eq!(wiring::steps(&station.edges()).0, [80, 0, 0]);
    agreement(&mut station);
}

#[test]
fn motors_switch_off_after_rest() {
    let mut station = configured(1);
    station.run(500 * MS);
    assert_eq!(station.command(jog([1_000, 0, 0])), Ok(()));
    station.run(700 * MS);
    assert!(drivers_are_on(&mut station), "the move began the time anew");
    station.run(500 * MS);
    assert!(!drivers_are_on(&mut station));
}

/// Returns the number of flashes of the LED, and the share of the time during which it is on.
fn led(station: &mut Station, time: Beats) -> (usize, f64) {
    let from = station.board.now();
    station.run(time);
    let mask = 1 << wiring::LED.1;
    let changes = station.board.changes(C);
    let (mut on, mut dark, mut since) = (0, 0, from);
    let mut lit = changes
        .iter()
        .rfind(|change| change.at < from)
        .is_some_and(|change| change.after & mask == 0);
    for change in changes.iter().filter(|change| change.at >= from) {
        let now_lit = change.after & mask == 0;
        if now_lit != lit {
            dark += if lit { 0 } else { change.at - since };
            on += usize::from(now_lit);
            (lit, since) = (now_lit, change.at);
        }
    }
    dark += if lit { 0 } else { station.board.now() - since };
    (on, 1.0 - dark as f64 / time as f64)
}

#[test]
fn led_tells_stopped_from_faulted() {
    let mut station = Station::power_on(&Image::firmware(), Make::default());
    station.run(20 * MS);
    station.greet();
    let second = 1_000 * MS;
    let (flashes, share) = led(&mut station, second);
    assert!(
        flashes == 1 && share < 0.1,
        "not configured: {flashes}, {share}"
    );
    station.set_up(Driver::Tmc2209);
    station.run(20 * MS);
    let (flashes, share) = led(&mut station, second);
    assert!(flashes == 0 && share == 1.0, "at rest: {flashes}, {share}");
    assert_eq!(station.command(Command::Stop), Ok(()));
    station.run(20 * MS);
    let (flashes, share) = led(&mut station, second);
    assert_eq!(station.status().state, State::Stopped);
    assert!(flashes == 2 && share < 0.15, "stopped: {flashes}, {share}");
    switch(&mut station, wiring::EMERGENCY_STOP, true);
    station.run(20 * MS);
    let (flashes, share) = led(&mut station, second);
    assert_eq!(station.status().state, State::Faulted);
    assert!(
        (7..=9).contains(&flashes) && (0.4..0.6).contains(&share),
        "faulted: {flashes}, {share}"
    );
}
