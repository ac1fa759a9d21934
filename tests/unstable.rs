//! Wrong mounts, scales and time stamps: an unstable loop ends in a named fault, and a loop that is
//! only slower settles.

#[path = "unstable/wrong.rs"]
mod wrong;

use trinocular_core::safety::{Fault, State, Trust};
use trinocular_tests::chase::{Chase, Run, Target};
use wrong::{Wrong, signs, turned};

/// Time of the target's step, s.
const STEP_S: f64 = 0.5;

/// Largest distance of the stage from the target, mm: the motion to the first and to the second
/// trial, and two ramps from full speed.
const FARTHEST_MM: f64 = 27.0;

const MOTIONS: [(&str, Target); 3] = [("step", step), ("line", line), ("figure", figure)];

fn step(time_s: f64) -> [f64; 3] {
    if time_s < STEP_S {
        [0.0; 3]
    } else {
        [4.0, -3.0, 1.5]
    }
}

fn line(time_s: f64) -> [f64; 3] {
    [20.0 * time_s, -10.0 * time_s, 5.0 * time_s]
}

/// Returns a target with speeds up to 19 and 38 mm/s.
fn figure(time_s: f64) -> [f64; 3] {
    let angle = 0.94 * time_s;
    [
        20.0 * angle.sin(),
        20.0 * (2.0 * angle).sin(),
        5.0 * (3.0 * angle).sin(),
    ]
}

fn follow(wrong: &Wrong, target: Target, seed: u64) -> Run {
    let mut chase = Chase::new(seed);
    chase.mount = wrong.mount;
    chase.late_us = wrong.late_us;
    chase.latency_us = wrong.latency_us;
    chase.travel_mm = Some(500.0);
    chase.follow(target, 8.0)
}

/// Returns the time from the stage's first motion to the fault, s.
fn lasted_s(run: &Run) -> f64 {
    let moved = run.samples.iter().find(|sample| sample.steps != [0; 3]);
    let moved_s = moved.map_or(0.0, |sample| sample.time_s);
    run.faulted_s
        .map_or(f64::INFINITY, |faulted_s| faulted_s - moved_s)
}

/// Checks that the fault is named within a time from the stage's first motion.
fn judge_unstable(wrong: &Wrong, most_s: f64) {
    for (motion, target) in MOTIONS {
        let run = follow(wrong, target, 1);
        let last = run.statuses.last().expect("a status");
        let lasted_s = lasted_s(&run);
        println!(
            "{}, {motion}: {:?} after {:.1} s",
            wrong.name, last.fault, lasted_s
        );
        assert_eq!(last.state, State::Faulted, "{}, {motion}", wrong.name);
        assert_eq!(
            last.fault,
            Some(Fault::Unstable),
            "{}, {motion}",
            wrong.name
        );
        assert_eq!(last.trust, Trust::Homed, "{}, {motion}", wrong.name);
        assert!(lasted_s <= most_s, "{}, {motion}: {lasted_s} s", wrong.name);
        if motion == "step" {
            let farthest = run.worst(STEP_S).into_iter().fold(0.0, f64::max);
            assert!(farthest <= FARTHEST_MM, "{}: {farthest} mm", wrong.name);
        }
    }
}

#[test]
fn wrong_signs_are_named() {
    for wrong in signs() {
        judge_unstable(&wrong, 2.0);
    }
}

#[test]
fn rotations_from_60_degrees_are_named() {
    // At 60 degrees the oscillation grows slowly.
    for (degrees, most_s) in [
        (60.0, 4.0),
        (75.0, 3.0),
        (90.0, 2.0),
        (120.0, 2.0),
        (180.0, 2.0),
    ] {
        for axis in [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]] {
            judge_unstable(&turned(axis, degrees), most_s);
        }
    }
}

#[test]
fn scales_from_2_are_named() {
    for scale in [2.0, 2.2, 2.5, 3.0, 4.0] {
        judge_unstable(&wrong::scaled([scale; 3]), 2.0);
    }
    for scale in [2.2, 2.5, 3.0, 4.0] {
        judge_unstable(&wrong::scaled([1.0, 1.0, scale]), 2.4);
    }
}

#[test]
fn wrong_time_stamps_are_named() {
    for late_ms in [-70, -60, -50, -40, -30] {
        judge_unstable(&wrong::late(late_ms, 20), 3.0);
    }
    for late_ms in [30, 40, 50, 58] {
        judge_unstable(&wrong::late(late_ms, 60), 4.0);
    }
}

/// The loop rests until noise sets it off, and then behaves the same.
#[test]
fn resting_target_hides_no_wrong_loop() {
    for wrong in signs() {
        let runs = (0..4).map(|seed| follow(&wrong, |_| [0.0; 3], seed));
        let named = runs.filter(|run| {
            let last = run.statuses.last().expect("a status");
            let rests = run.samples.iter().all(|sample| {
                let steps = sample.steps.into_iter().map(i64::abs).max();
                steps.unwrap_or(0) < 8
            });
            let named = last.fault == Some(Fault::Unstable);
            assert!(named || rests, "{}: {last:?}", wrong.name);
            named
        });
        assert!(named.count() > 0, "{}", wrong.name);
    }
}

/// After 10 s a loop is at rest, or its fault has been named.
#[test]
fn small_shaking_is_named_or_ends() {
    let mut wrongs: Vec<Wrong> = [-20, -15, -10].map(|ms| wrong::late(ms, 20)).into();
    wrongs.extend([10, 20, 30].map(|ms| wrong::late(ms, 60)));
    wrongs.push(wrong::scaled([1.9; 3]));
    wrongs.push(turned([1, 1, 1], 55.0));
    for wrong in wrongs {
        for seed in 0..4 {
            let run = follow(&wrong, step, seed);
            let last = run.statuses.last().expect("a status");
            let shakes = range_mm(&run, 7.0);
            println!("{}: {:?}, shakes by {shakes:.3} mm", wrong.name, last.fault);
            assert!(
                last.fault.is_some() || shakes < 0.1,
                "{}: {shakes} mm",
                wrong.name
            );
        }
    }
}

#[test]
fn stable_variants_settle() {
    let mut wrongs: Vec<Wrong> = [0.1, 0.3, 0.5, 1.5, 1.8]
        .map(|scale| wrong::scaled([scale; 3]))
        .into();
    for degrees in [30.0, 45.0] {
        let axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]];
        wrongs.extend(axes.map(|axis| turned(axis, degrees)));
    }
    wrongs.extend([-5, -2, 5].map(|ms| wrong::late(ms, 20)));
    for wrong in wrongs {
        for seed in 0..2 {
            let run = follow(&wrong, step, seed);
            let last = run.statuses.last().expect("a status");
            assert_eq!(last.fault, None, "{}", wrong.name);
            let shakes = range_mm(&run, 7.0);
            assert!(shakes < 0.1, "{}: {shakes} mm", wrong.name);
        }
    }
}

/// Returns the peak-to-peak motion from a time on, mm, of the axis that moves most.
fn range_mm(run: &Run, from_s: f64) -> f64 {
    let of = |axis: usize| {
        let samples = run.samples.iter().filter(|sample| sample.time_s >= from_s);
        let places = samples.map(|sample| sample.stage_mm()[axis]);
        let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), mm| {
            (low.min(mm), high.max(mm))
        });
        high - low
    };
    (0..3).map(of).fold(0.0, f64::max)
}
