//! Durations compared with those of `rsruckig`, which are optimal, from random states to random
//! targets.
//!
//! # Method
//!
//! Our acceleration is constant in each tick, that of rsruckig is linear. The line through the
//! *middles* of our ticks changes the speed by as much and keeps to the same jerk, so it represents
//! our motion: it starts half a tick before the present moment, in the middle of the last tick
//! planned, and ends half a tick after our last one. `n` ticks to rest become `n + 1` ticks, and
//! rsruckig gets the speed and position of that middle. Nothing is subtracted for our whole ticks;
//! where durations are so short that a tick counts, they are also compared with those of rsruckig
//! rounded up to whole ticks.
//!
//! rsruckig gets the limits of the grid, which are below the configured ones by less than one
//! quantum, and keeps to them relative to a moving target, as the planner does. It goes to the
//! exact target, the planner only [`near`] it, so our duration may be shorter by a tick or two.

use super::*;
use crate::motion::stopping::Pace;
use rsruckig::prelude::*;
use std::vec::Vec;

/// 80 steps/mm, 100 mm/s, 2 m/s², 50 m/s³: the stage of the experiments.
const STAGE: AxisConfig = AxisConfig {
    max_acceleration_um_s2: 2_000_000,
    ..CONFIG
};

/// Axis between two ticks: distance quanta, speed and acceleration quanta; target relative to it.
#[derive(Clone, Copy, Debug)]
struct Case {
    speed: i64,
    acceleration: i64,
    way: f64,
    drift: i64,
}

/// Returns the ticks from the middle of the last tick to rest at the target, as it moves.
fn optimum(pace: &Pace, case: &Case) -> f64 {
    // A speed of `u` quanta is 2u distance quanta per tick.
    let [top, acceleration, jerk, speed, last, drift] = [
        pace.speed,
        pace.acceleration,
        pace.jerk,
        case.speed,
        case.acceleration,
        case.drift,
    ]
    .map(|quanta| 2.0 * quanta as f64);
    let speed = speed - last / 2.0;
    let way = case.way + (speed + last / 4.0) / 2.0 - drift / 2.0;
    // In units of the highest speed, for the solver's tolerances.
    let mut input = InputParameter::<1>::new(None);
    input.current_velocity[0] = (speed - drift) / top;
    input.current_acceleration[0] = last / top;
    input.target_position[0] = way / top;
    input.max_velocity[0] = (top - drift) / top;
    input.min_velocity = Some(daov_stack![-(top + drift) / top]);
    input.max_acceleration[0] = acceleration / top;
    input.max_jerk[0] = jerk / top;
    let mut trajectory = Trajectory::new(None);
    Ruckig::<1, ThrowErrorHandler>::new(None, 1.0)
        .calculate(&input, &mut trajectory)
        .unwrap();
    trajectory.get_duration()
}

/// Generates any state that can keep to the limits, and any target within `reach` steps that moves
/// at up to `drift` of the highest speed.
fn any_case(random: &mut Random, pace: &Pace, quantum: i64, reach: f64, drift: f64) -> Case {
    loop {
        let mut up_to = |size: f64| size * random.uniform();
        let speed = up_to(pace.speed as f64) as i64;
        let acceleration = up_to(pace.acceleration as f64) as i64;
        // Speeds while the acceleration falls to zero as fast as it may.
        let falling = (1..).map(|n| acceleration.abs() - n * pace.jerk);
        let eased: i64 = falling.take_while(|a| *a > 0).sum();
        if (speed + eased * acceleration.signum()).abs() <= pace.speed {
            return Case {
                speed,
                acceleration,
                way: up_to(reach * 4_294_967_296.0).round() / quantum as f64,
                drift: up_to(drift * pace.speed as f64) as i64,
            };
        }
    }
}

/// Excess over the optimum, over all cases.
#[derive(Debug)]
struct Outcome {
    least: f64,
    median: f64,
    worst: f64,
    /// Ticks more than the optimum rounded up: the median and the most.
    late: [i64; 2],
}

fn compare(cases: usize, config: AxisConfig, reach: f64, drift: f64) -> Outcome {
    let configs = [config; AXES];
    let rate = WordRate::MHZ_1;
    let limits = Limits::new(&configs, rate).unwrap();
    let pace = Pace::of(&limits.axes()[0]);
    let mut random = Random(1);
    let (mut ratios, mut late) = (Vec::new(), Vec::new());
    while ratios.len() < cases {
        let mut planner = Planner::new(limits, centres([0; AXES]));
        let mut judge = Judge::new(configs, rate);
        let quantum = planner.distance_quantum();
        let cases = [(); AXES].map(|()| any_case(&mut random, &pace, quantum, reach, drift));
        let way = |case: Case| (case.way * quantum as f64) as i64;
        planner.follow(
            cases.map(|case| Position::centre(0).saturating_add(way(case))),
            cases.map(|case| case.drift * planner.speed_quantum()),
        );
        for ((axis, seen), case) in planner.axes.iter_mut().zip(&mut judge.axes).zip(cases) {
            (axis.speed, axis.acceleration) = (case.speed, case.acceleration);
            seen.ended = 4 * i64::from(rate.slots_per_tick()) * case.speed;
            seen.acceleration = 2 * case.acceleration;
        }
        let mut ends = [None; AXES];
        let mut ticks = 0;
        while ends.contains(&None) {
            judge.tick(&mut planner);
            ticks += 1;
            assert!(ticks < 100_000, "never arrives: {cases:?}");
            for (axis, end) in planner.axes.iter().zip(&mut ends) {
                let rests = axis.speed == axis.drift && axis.distance().abs() < near(quantum);
                // The next tick continues at the target's speed.
                if end.is_none() && rests && axis.free(quantum) == 0 {
                    *end = Some(ticks);
                }
            }
        }
        for (case, end) in cases.iter().zip(ends) {
            let (ours, best) = (end.unwrap() + 1, optimum(&pace, case));
            ratios.push(ours as f64 / best);
            late.push(ours - best.ceil() as i64);
        }
    }
    ratios.sort_by(f64::total_cmp);
    late.sort();
    Outcome {
        least: ratios[0],
        median: ratios[ratios.len() / 2],
        worst: ratios[ratios.len() - 1],
        late: [late[late.len() / 2], late[late.len() - 1]],
    }
}

#[test]
fn ten_thousand_states_take_optimal_time() {
    for (name, drift) in [("at rest", 0.0), ("moving at up to 50 mm/s", 0.5)] {
        let outcome = compare(10_000, STAGE, 4_800.0, drift);
        std::println!("targets within 60 mm, {name}: {outcome:.4?}");
        assert!(outcome.median <= 1.01 && outcome.worst <= 1.05);
        assert!(outcome.least >= 0.99, "the comparison is wrong");
        assert!(outcome.late[0] <= 0 && outcome.late[1] <= 1);
    }
}

/// The shortest of these take a dozen ticks, of which a whole one is 8 %.
#[test]
fn near_targets_take_optimal_ticks() {
    let outcome = compare(10_000, STAGE, 8.0, 0.0);
    std::println!("targets within 0.1 mm, at rest: {outcome:.4?}");
    assert!(outcome.median <= 1.01 && outcome.worst <= 1.10);
    assert!(outcome.late[0] <= 0 && outcome.late[1] <= 1);
}

#[test]
fn extreme_stages_take_optimal_time() {
    // The gentle case has three quanta of jerk. In one move of ten, quanta that coarse leave more
    // than `near` when braking ends, and up to 15 ticks more; slower words make a finer grid.
    for (acceleration, jerk, late) in [(1_000, 5_000, 15), (10_000, 1_000_000, 1)] {
        let stage = AxisConfig {
            max_acceleration_um_s2: 1_000 * acceleration,
            max_jerk_um_s3: 1_000 * jerk,
            ..CONFIG
        };
        let outcome = compare(2_000, stage, 4_800.0, 0.0);
        std::println!("{acceleration} mm/s², {jerk} mm/s³: {outcome:.4?}");
        assert!(outcome.median <= 1.01);
        assert!(outcome.late[0] <= 0 && outcome.late[1] <= late);
    }
}
