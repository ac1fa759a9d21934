//! The host's link code talks to the flashed image over the UART; replies, and edges at the pins,
//! equal the twin's.

use station_board::board::Make;
use station_board::image::Image;
use station_board::order::{config, jog};
use station_board::reference::agreement;
use station_board::scene;
use station_board::station::Station;
use station_board::time::{Beats, MS, US};
use station_board::wiring::{STEPPERS, steps};
use trinocular_client::stage::timing;
use trinocular_core::frame::message::{Command, Denial};
use trinocular_core::safety::State;
use trinocular_rig::rig_file::Driver;

fn greeted(make: Make) -> Station {
    let mut station = Station::power_on(&Image::firmware(), make);
    station.run(20 * MS);
    station.greet();
    station
}

fn configured(driver: Driver, make: Make) -> Station {
    let mut station = greeted(make);
    station.set_up(driver);
    station
}

#[test]
fn frames_jog_and_stop_over_the_uart() {
    let mut station = configured(Driver::Tmc2209, Make::default());
    scene::follow(&mut station, 500);
    let status = station.status();
    // Noise makes outliers of a few, which the twin refuses, too.
    assert_eq!(status.frames_used + status.frames_refused, 500);
    assert!(status.frames_used >= 450, "{status:?}");
    assert_eq!(status.state, State::Following);
    assert_eq!(station.command(Command::Stop), Ok(()));
    station.run(300 * MS);
    assert_eq!(station.command(jog([100; 3])), Err(Denial::Stopped));
    assert_eq!(station.command(Command::Reset), Ok(()));
    assert_eq!(station.command(jog([5_000, -3_000, 1_234])), Ok(()));
    station.run(120 * MS);
    assert_eq!(station.command(Command::Stop), Ok(()));
    station.run(300 * MS);
    assert_eq!(station.status().state, State::Stopped);
    let (reports, edges) = agreement(&mut station);
    let (steps, rises) = steps(&station.edges());
    println!("{reports} reports and {edges} edges agree; {rises} steps, in the end {steps:?}");
    assert!(reports > 1_000 && rises > 4_000);
    assert_eq!(station.status().position_steps.map(i64::from), steps);
}

/// Cache misses and bus conflicts slow a real processor down. With 50 and 75 % more cycles for
/// everything the edges are the same.
#[test]
fn slower_processor_makes_same_edges() {
    for slowness in [6, 7] {
        let make = Make {
            slowness,
            ..Make::default()
        };
        let mut station = configured(Driver::Tmc2209, make);
        scene::follow(&mut station, 60);
        station
            .command(Command::Stop)
            .expect("a stop is never refused");
        station.run(300 * MS);
        let (_, edges) = agreement(&mut station);
        assert!(edges > 500, "{edges}");
    }
}

/// Returns the shortest times at the pins, ns: STEP high, STEP low, DIR before a rise, DIR after a
/// rise.
fn shortest(edges: &[(Beats, u16)]) -> [u64; 4] {
    let mut least = [u64::MAX; 4];
    for (step, dir) in STEPPERS.step.into_iter().zip(STEPPERS.dir) {
        let (step, dir) = (1 << step, 1 << dir);
        let [mut rise, mut fall, mut turn] = [None, None, None];
        let mut before = 0;
        for (at, after) in edges {
            let changed = before ^ after;
            let since =
                |then: Option<&Beats>| then.map_or(u64::MAX, |then| (at - then) * 1_000 / US);
            if changed & step != 0 && after & step == 0 {
                least[0] = least[0].min(since(rise.as_ref()));
                fall = Some(*at);
            }
            if changed & dir != 0 {
                least[3] = least[3].min(since(rise.as_ref()));
                turn = Some(*at);
            }
            if changed & step != 0 && after & step != 0 {
                least[1] = least[1].min(since(fall.as_ref()));
                least[2] = least[2].min(since(turn.as_ref()));
                rise = Some(*at);
            }
            before = *after;
        }
    }
    least
}

/// Back and forth on all axes, at the speed with the default stage's highest step frequency.
#[test]
fn pulses_fit_every_driver() {
    for driver in [Driver::A4988, Driver::Tmc2209] {
        let mut station = configured(driver, Make::default());
        for way in [1, -1, 1] {
            let moved = station.command(jog([way * 3_000, way * -2_000, way * 2_500]));
            assert_eq!(moved, Ok(()));
            station.run(250 * MS);
        }
        let [high, low, setup, hold] = shortest(&station.edges());
        let needs = timing(driver);
        println!(
            "{}: high {high}, low {low}, set-up {setup}, hold {hold} ns",
            driver.name()
        );
        assert!(high >= needs.step_high_ns.into() && low >= needs.step_low_ns.into());
        assert!(setup >= needs.dir_setup_ns.into() && hold >= needs.dir_hold_ns.into());
        assert_eq!(high, 1_000, "a word");
        agreement(&mut station);
    }
}

#[test]
fn too_slow_driver_is_refused_by_name() {
    let mut station = greeted(Make::default());
    let refused = station.command(Command::Config(config(Driver::Drv8825)));
    assert!(matches!(refused, Err(Denial::Config(_))), "{refused:?}");
    station.run(20 * MS);
    agreement(&mut station);
}
