//! The host's link code talks to the flashed image over the UART; replies, and edges at the pins, equal the twin's.

use host::rig_file::Driver;
use host::station::stage::{configuration, default_stage, timing};
use host::sums::Estimator;
use shared::frame::message::{Command, Config, Denial, Mounting, Report};
use shared::safety::State;
use shared::time::Instant;
use station_board::board::Make;
use station_board::image::Image;
use station_board::reference::{comparable, expected};
use station_board::scene::Scene;
use station_board::station::Station;
use station_board::time::{Beats, MS, US};
use station_board::wiring::{STEPPERS, steps};

fn config(driver: Driver) -> Config {
    let mut stage = default_stage();
    stage.driver = driver;
    configuration(&stage, Mounting::OnStage).expect("the default fits")
}

fn jog(um: [i32; 3]) -> Command {
    Command::Jog { distance_um: um }
}

fn greeted(make: Make) -> Station {
    let mut station = Station::power_on(&Image::firmware(), make);
    station.run(20 * MS);
    station.greet();
    station
}

fn configured(driver: Driver, make: Make) -> Station {
    let mut station = greeted(make);
    assert_eq!(station.command(Command::Config(config(driver))), Ok(()));
    assert_eq!(station.command(Command::Zero), Ok(()));
    station
}

/// Where the station's clock is, µs.
fn clock_us(station: &mut Station) -> u64 {
    (station.board.now() - station.clock_zero()) / US
}

/// 500 frames at 200 Hz of a swinging target, seen from where the edges at the pins have brought the stage.
fn follow(station: &mut Station, frames: usize) {
    let mut scene = Scene::new(7);
    let now = Instant::from_micros(clock_us(station));
    let first = scene.picture(now, steps(&station.edges()).0);
    for number in 0..frames {
        station.run(4 * MS);
        let now = Instant::from_micros(clock_us(station));
        let picture = scene.picture(now, steps(&station.edges()).0);
        // The image processing takes a millisecond.
        station.run(MS);
        let estimator = match number % 4 {
            0 => Estimator::ClosedForm,
            _ => Estimator::Midpoint,
        };
        let frame = scene.frame(first, picture, estimator);
        station.send(frame);
    }
}

/// Everything the board said and did is what the twin says and does with the same inputs. Returns how many reports and edges that were.
fn agrees_with_the_twin(station: &mut Station) -> (usize, usize) {
    // Reports on their way and words in the ring still come.
    station.set_pings(false);
    station.run(3 * MS);
    let zero = station.clock_zero();
    let end_us = clock_us(station);
    let expected = expected(station, end_us);

    let said: Vec<Report> = station
        .reports
        .iter()
        .map(|(_, report)| comparable(report))
        .collect();
    let should: Vec<Report> = expected.reports.iter().map(comparable).collect();
    let differ = said.iter().zip(&should).position(|(a, b)| a != b);
    if let Some(at) = differ {
        panic!(
            "report {at}: board\n  {:?}\ntwin\n  {:?}",
            said[at], should[at]
        );
    }
    assert_eq!(said.len(), should.len(), "reports");

    let edges = station.edges();
    let levels = |edges: &[(u64, u16)]| edges.iter().map(|(_, levels)| *levels).collect::<Vec<_>>();
    // What the twin plays after the end is not on the pins yet.
    let due = expected.edges.partition_point(|(at, _)| *at < end_us);
    let should = &expected.edges[..due];
    let differ = levels(&edges)
        .iter()
        .zip(levels(should))
        .position(|(a, b)| *a != b);
    assert_eq!(
        differ,
        None,
        "edges in another order: {:?}",
        differ.map(|at| (edges[at], should[at]))
    );
    assert_eq!(edges.len(), should.len(), "edges");
    // From the word's moment to the pin it is always the same time: less than a word, without jitter.
    let delays: Vec<Beats> = (edges.iter().zip(should))
        .map(|((at, _), (us, _))| (at - zero).wrapping_sub(us * US))
        .collect();
    if let Some(first) = delays.first() {
        assert!(*first < US, "{first} beats late");
        assert!(
            delays.iter().all(|delay| delay == first),
            "jitter: {delays:?}"
        );
    }
    (said.len(), edges.len())
}

#[test]
fn five_hundred_frames_then_a_jog_and_a_stop() {
    let mut station = configured(Driver::Tmc2209, Make::default());
    follow(&mut station, 500);
    let status = station.status();
    assert!(status.frames_used >= 490, "{status:?}");
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
    let (reports, edges) = agrees_with_the_twin(&mut station);
    let (steps, rises) = steps(&station.edges());
    println!("{reports} reports and {edges} edges agree; {rises} steps, in the end {steps:?}");
    assert!(reports > 1_000 && rises > 4_000);
    assert_eq!(station.status().position_steps.map(i64::from), steps);
}

/// Cache misses and bus conflicts slow a real processor down. With half as many cycles again for everything the edges are the same.
#[test]
fn a_slower_processor_makes_the_same_edges() {
    let make = Make {
        slowness: 6,
        ..Make::default()
    };
    let mut station = configured(Driver::Tmc2209, make);
    follow(&mut station, 60);
    station
        .command(Command::Stop)
        .expect("a stop is never refused");
    station.run(300 * MS);
    let (_, edges) = agrees_with_the_twin(&mut station);
    assert!(edges > 500, "{edges}");
}

/// Shortest times at the pins, ns: STEP high, STEP low, DIR before a rise, DIR after a rise.
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

/// To and fro on all axes, at the speed at which the default stage's step frequency is highest.
#[test]
fn pulses_are_as_long_as_each_driver_asks() {
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
        agrees_with_the_twin(&mut station);
    }
}

#[test]
fn a_driver_that_is_too_slow_is_refused_by_name() {
    let mut station = greeted(Make::default());
    let refused = station.command(Command::Config(config(Driver::Drv8825)));
    assert!(matches!(refused, Err(Denial::Config(_))), "{refused:?}");
    station.run(20 * MS);
    agrees_with_the_twin(&mut station);
}
