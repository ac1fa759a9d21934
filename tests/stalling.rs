//! Motors that stall, and targets that only look like it: what the station makes of commanded motion that the cameras do not see.

use host::rig_file::Care;
use shared::safety::{Fault, State, Trust};
use trinocular_tests::chase::{Chase, Run, Target, lissajous, smooth};

/// Steps in vain until the fault, mm.
const UNSEEN_MM: f64 = 10.0;

/// Real motion keeps within less.
const STRICT_MM: f64 = 8.0;

fn care() -> Care {
    Care {
        largest_unseen_mm: Some(UNSEEN_MM),
        largest_error_mm: Some(15.0),
        longest_error_s: 0.5,
        ..Care::default()
    }
}

fn fault(run: &Run) -> Option<Fault> {
    run.statuses.last().expect("a status").fault
}

/// 100 mm/s, as fast as the stage, from rest: it is never caught up with.
fn dash(t: f64) -> [f64; 3] {
    let x = (100.0 * (t - 0.5)).clamp(0.0, 50.0);
    [x, -x, 0.0]
}

/// 10 mm at 0.8 Hz: up to 50 mm/s and 253 mm/s² on two axes.
fn swing(t: f64) -> [f64; 3] {
    let angle = 0.8 * std::f64::consts::TAU * t;
    [
        10.0 * angle.sin(),
        10.0 * angle.cos() - 10.0,
        3.0 * angle.sin(),
    ]
}

#[test]
fn real_motion_is_never_taken_for_a_fault() {
    let motions: [(&str, Target, f64); 6] = [
        ("still", |_| [0.0; 3], 5.0),
        (
            "step",
            |t| if t < 1.0 { [0.0; 3] } else { [4.0, -4.0, 1.0] },
            3.0,
        ),
        (
            "driven step",
            |t| [4.0, 4.0, 1.0].map(|mm| mm * smooth(t - 1.0)),
            3.0,
        ),
        ("line at 50 mm/s", |t| [0.0, 50.0 * t.min(1.1), 0.0], 2.0),
        ("lissajous", lissajous, 14.0),
        ("swing", swing, 6.0),
    ];
    for (name, target, seconds) in motions {
        for seed in 1..=3 {
            let mut chase = Chase::new(seed);
            chase.care = care();
            chase.care.largest_unseen_mm = Some(STRICT_MM);
            let run = chase.follow(target, seconds);
            let largest = run.worst(0.0).into_iter().fold(0.0, f64::max);
            println!("{name}: at most {largest:.3} mm off");
            assert_eq!(fault(&run), None, "{name}");
            let last = run.statuses.last().expect("a status");
            assert!(last.frames_used > 50, "{name}");
        }
    }
}

#[test]
fn a_target_that_is_never_caught_up_with_is_a_following_error() {
    let mut chase = Chase::new(1);
    chase.care = Care {
        largest_unseen_mm: None,
        largest_error_mm: Some(3.0),
        longest_error_s: 0.2,
        ..Care::default()
    };
    let run = chase.follow(dash, 2.0);
    let last = run.statuses.last().expect("a status");
    assert_eq!(
        (last.fault, last.state, last.trust),
        (Some(Fault::FollowingError), State::Faulted, Trust::Homed)
    );
    // It stopped on the way.
    let stood = run.samples.last().expect("samples").stage_mm();
    assert!(stood[0] > 5.0 && stood[0] < 45.0, "{stood:?}");
    // For a longer time it may be so far away.
    chase.care.longest_error_s = 2.0;
    assert_eq!(fault(&chase.follow(dash, 2.0)), None);
}

#[test]
fn a_stalled_motor_is_a_fault_before_the_stage_went_far() {
    let step: Target = |t| if t < 1.0 { [0.0; 3] } else { [4.0, 3.0, 2.0] };
    for (name, target, stalls_s) in [
        ("step", step, 0.5),
        ("lissajous", lissajous as Target, 3.0),
        ("swing", swing, 2.05),
    ] {
        for axis in 0..3 {
            let mut chase = Chase::new(7);
            chase.care = care();
            let mut axes = [false; 3];
            axes[axis] = true;
            chase.stalled = Some((stalls_s, axes));
            let run = chase.follow(target, 8.0);
            let last = run.statuses.last().expect("a status");
            let stood = run.samples.last().expect("samples").stage_mm()[axis];
            let from = run.samples[(stalls_s * 1e3) as usize].stage_mm()[axis];
            println!(
                "{name}, axis {axis}: {:?} {:?}, {:.2} mm after the stall",
                last.fault,
                last.state,
                stood - from
            );
            assert_eq!(
                (last.fault, last.state, last.trust),
                (Some(Fault::LostSteps), State::Faulted, Trust::Degraded),
                "{name}, axis {axis}"
            );
            // Steps in vain, then some more in 20 ms and 50 ms of ramp at up to 100 mm/s, and what the target itself had to do with it.
            assert!(
                (stood - from).abs() <= UNSEEN_MM + 15.0,
                "{name}, axis {axis}"
            );
        }
    }
}

#[test]
fn it_can_be_switched_off_and_is_without_prediction() {
    let mut chase = Chase::new(7);
    chase.stalled = Some((0.5, [true; 3]));
    let step: Target = |t| if t < 1.0 { [0.0; 3] } else { [4.0, 3.0, 2.0] };
    chase.care.largest_unseen_mm = None;
    assert_eq!(fault(&chase.follow(step, 3.0)), None);
    chase.care = care();
    chase.care.largest_error_mm = None;
    chase.tracking.prediction = false;
    assert_eq!(fault(&chase.follow(step, 3.0)), None);
}
