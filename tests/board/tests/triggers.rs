//! Triggers of cameras at the pins of the flashed image, beside its reports.

use station_board::board::Make;
use station_board::image::Image;
use station_board::order::jog;
use station_board::reference::agreement;
use station_board::scene;
use station_board::station::Station;
use station_board::time::{Beats, MS, US};
use station_board::trial::{configure, faulted, last_step, moving, recovers, switch};
use station_board::wiring::{self, C, CAMERA_PIN};
use trinocular_core::frame::message::{Command, Report, Trigger, Triggered};
use trinocular_core::safety::{Fault, State, Trust};
use trinocular_rig::rig_file::Driver;

const FAST: Trigger = Trigger {
    rate_hz: 500,
    pulse_us: 350,
    active_low: false,
    quiet_us: 0,
};

fn trigger(station: &mut Station, trigger: Trigger) {
    assert_eq!(station.command(Command::Trigger(trigger)), Ok(()));
}

/// Returns the changes of the camera pin: moments and levels.
fn changes(station: &mut Station) -> Vec<(Beats, bool)> {
    let mask = 1_u16 << CAMERA_PIN;
    let changes = station.board.changes(C);
    let of_pin = changes
        .iter()
        .filter(|change| (change.before ^ change.after) & mask != 0);
    of_pin
        .map(|change| (change.at, change.after & mask != 0))
        .collect()
}

fn triggered(station: &Station) -> Vec<Triggered> {
    let reports = station.reports.iter();
    reports
        .filter_map(|(_, report)| match report {
            Report::Triggered(triggered) => Some(*triggered),
            _ => None,
        })
        .collect()
}

/// Checks that each reported instant has its pulse, within a word and always as late as the steps,
/// and that the pulses are as long as they should be. Returns the number of triggers.
fn check(station: &mut Station, trigger: Trigger) -> usize {
    let zero = station.clock_zero();
    let changes = changes(station);
    let begins: Vec<usize> = (0..changes.len())
        .filter(|i| changes[*i].1 != trigger.active_low)
        .collect();
    let reports = triggered(station);
    let (mut delays, mut pulses) = (Vec::new(), begins.iter());
    for report in &reports {
        let due = zero + report.instant.micros() * US;
        let found = pulses.find(|i| changes[**i].0 >= due);
        let at = *found.unwrap_or_else(|| panic!("no pulse for {report:?}"));
        let begun = changes[at].0;
        delays.push(begun - due);
        let end = changes.get(at + 1).expect("the pulse ended").0;
        assert_eq!(
            (end - begun) / US,
            u64::from(trigger.pulse_us),
            "{report:?}"
        );
    }
    let first = delays[0];
    assert!(first < US, "within the microsecond: {first} beats");
    assert!(delays.iter().all(|delay| *delay == first), "no jitter");
    println!(
        "{} triggers, each {} ns after its microsecond",
        reports.len(),
        first * 1_000 / US
    );
    reports.len()
}

/// The station follows a target with images at 200 Hz and jogs, while cameras are triggered 500
/// times a second: reports and steps are the twin's, pulses where the reports say.
#[test]
fn pulses_match_reports_and_leave_steps_alone() {
    let mut station = Station::power_on(&Image::firmware(), Make::default());
    station.run(20 * MS);
    station.greet();
    trigger(&mut station, FAST);
    station.run(100 * MS);
    assert_eq!(station.status().state, State::Unconfigured);
    station.set_up(Driver::Tmc2209);
    scene::follow(&mut station, 60);
    assert_eq!(station.command(jog([5_000, -3_000, 1_234])), Ok(()));
    station.run(200 * MS);
    assert_eq!(station.command(Command::Stop), Ok(()));
    station.run(100 * MS);
    let (_, edges) = agreement(&mut station);
    assert!(edges > 1_000, "{edges}");
    let count = check(&mut station, FAST);
    assert!(count > 300, "{count}");
    let reports = triggered(&station);
    for (n, report) in (1..).zip(&reports) {
        assert_eq!((report.number, report.lost), (n, 0));
    }
}

/// Triggers that wait for a time without steps: reports and steps are the twin's, pulses where the
/// reports say.
#[test]
fn waiting_pulses_match_reports() {
    let waiting = Trigger {
        rate_hz: 200,
        quiet_us: 1_000,
        ..FAST
    };
    let mut station = Station::power_on(&Image::firmware(), Make::default());
    station.run(20 * MS);
    station.greet();
    station.set_up(Driver::Tmc2209);
    trigger(&mut station, waiting);
    station.run(20 * MS);
    scene::follow(&mut station, 60);
    station.run(100 * MS);
    agreement(&mut station);
    let count = check(&mut station, waiting);
    let reports = triggered(&station);
    assert!(count > 70 && reports.iter().all(|report| report.lost == 0));
    let waits = reports.iter().zip(0..).map(|(report, n)| {
        let us = report.instant.since(reports[0].instant);
        us - n * 5_000
    });
    let waits: Vec<u64> = waits.collect();
    assert!(waits.iter().all(|us| *us <= 313), "{waits:?}");
    assert!(waits.iter().any(|us| *us >= 100), "{waits:?}");
}

/// A processor that takes 75 % longer for everything, and pulses that are low.
#[test]
fn low_pulses_of_a_slow_processor_are_right() {
    let make = Make {
        slowness: 7,
        ..Make::default()
    };
    let low = Trigger {
        rate_hz: 1_000,
        pulse_us: 750,
        active_low: true,
        quiet_us: 0,
    };
    let mut station = Station::power_on(&Image::firmware(), make);
    station.run(20 * MS);
    station.greet();
    station.set_up(Driver::Tmc2209);
    assert_eq!(station.command(jog([5_000, -3_000, 1_234])), Ok(()));
    trigger(&mut station, low);
    station.run(8 * MS);
    let (_, at_rest) = *changes(&mut station).last().expect("its level at rest");
    assert!(at_rest);
    station.run(200 * MS);
    agreement(&mut station);
    assert!(check(&mut station, low) > 150);
    assert_eq!(triggered(&station).last().expect("reports").lost, 0);
}

/// The first contact of the stop button ends the steps, and not the triggers.
#[test]
fn stop_button_ends_no_trigger() {
    let mut station = moving();
    trigger(&mut station, FAST);
    station.run(30 * MS);
    let at = station.board.now();
    switch(&mut station, wiring::EMERGENCY_STOP, true);
    faulted(&mut station, Fault::EmergencyStop, Trust::Degraded);
    last_step(&mut station, at, 100);
    station.run(100 * MS);
    switch(&mut station, wiring::EMERGENCY_STOP, false);
    station.run(10 * MS);
    check(&mut station, FAST);
    let last = *triggered(&station).last().expect("reports");
    assert!(last.number >= 75 && last.lost == 0, "{last:?}");
    // The step engine starts anew after a fault of its own; here it never stopped.
    recovers(&mut station);
    check(&mut station, FAST);
}

/// The second contact stops the step timer, and the triggers with it: they are counted as lost, the
/// pin is at rest, and later triggers are exact again.
#[test]
fn gate_loses_triggers_and_says_so() {
    let mut station = moving();
    trigger(&mut station, FAST);
    station.run(30 * MS);
    let (port, pin) = wiring::GATE;
    station.board.drive(port, pin, None);
    station.run(2 * MS);
    let opened = station.board.now();
    station.run(98 * MS);
    let later = |station: &mut Station| {
        let changes = changes(station).into_iter();
        changes.filter(|(at, _)| *at > opened).count()
    };
    assert_eq!(later(&mut station), 0);
    assert!(changes(&mut station).last().is_some_and(|(_, high)| !high));
    station.board.drive(port, pin, Some(true));
    station.run(100 * MS);
    assert!(later(&mut station) > 0, "triggers come back by themselves");
    let before = triggered(&station);
    let first = *before.iter().find(|t| t.lost > 0).expect("losses");
    let last = *before.last().expect("reports");
    assert!((48..=54).contains(&last.lost), "{first:?} {last:?}");
    let due = (last.instant.since(before[0].instant) + 1_000) / 2_000 + 1;
    assert_eq!(u64::from(last.number + last.lost), due);
    check_all_but_cut(&mut station);
    recovers(&mut station);
    assert_eq!(triggered(&station).last().expect("reports").lost, last.lost);
}

/// Every report has its pulse; the pulse that the gate cut is none of them.
fn check_all_but_cut(station: &mut Station) {
    let zero = station.clock_zero();
    let changes = changes(station);
    for report in triggered(station) {
        let due = zero + report.instant.micros() * US;
        let begun = |change: &(Beats, bool)| change.1 && (due..due + US).contains(&change.0);
        assert!(changes.iter().any(begun), "{report:?}");
    }
}

#[test]
fn no_trigger_before_command_or_after_off() {
    let mut station = Station::power_on(&Image::firmware(), Make::default());
    station.run(20 * MS);
    station.greet();
    configure(&mut station);
    station.run(50 * MS);
    assert_eq!(changes(&mut station), []);
    trigger(&mut station, FAST);
    station.run(50 * MS);
    trigger(&mut station, Trigger::OFF);
    station.run(5 * MS);
    let count = changes(&mut station).len();
    assert!(count > 30 && count.is_multiple_of(2), "{count}");
    station.run(50 * MS);
    assert_eq!(changes(&mut station).len(), count);
}
