//! Stalled motors, and targets that only look like them: the station's handling of commanded motion
//! that the cameras do not see.

use trinocular_core::frame::message::Denial;
use trinocular_core::safety::{Fault, State, Trust};
use trinocular_rig::rig_file::Care;
use trinocular_tests::chase::{Chase, Run, Target, lissajous, smooth};

/// Limit of commanded motion that the cameras do not see, mm.
const UNSEEN_MM: f64 = 10.0;

/// Stricter limit within which real motion stays, mm.
const STRICT_MM: f64 = 8.0;

/// Longest distance from the stall to rest, mm, at 20 frames per second and more: half of the
/// unseen limit, a ramp, the same again if one trial is not enough, and the target's own motion.
const STALLED_MM: f64 = UNSEEN_MM + 15.0;

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

/// Returns a target that leaves rest at 100 mm/s, as fast as the stage, so that the stage never
/// catches up.
fn dash(t: f64) -> [f64; 3] {
    let x = (100.0 * (t - 0.5)).clamp(0.0, 50.0);
    [x, -x, 0.0]
}

/// Returns a swing of 10 mm at 0.8 Hz: up to 50 mm/s and 253 mm/s² on two axes.
fn swing(t: f64) -> [f64; 3] {
    let angle = 0.8 * std::f64::consts::TAU * t;
    [
        10.0 * angle.sin(),
        10.0 * angle.cos() - 10.0,
        3.0 * angle.sin(),
    ]
}

#[test]
fn real_motion_is_no_fault() {
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
fn unreachable_target_is_following_error() {
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
    // The stage stopped on the way.
    let stood = run.samples.last().expect("samples").stage_mm();
    assert!(stood[0] > 5.0 && stood[0] < 45.0, "{stood:?}");
    // Over a longer time the stage may be this far away.
    chase.care.longest_error_s = 2.0;
    assert_eq!(fault(&chase.follow(dash, 2.0)), None);
}

#[test]
fn stalled_motor_is_fault_within_25_mm() {
    let step: Target = |t| if t < 1.0 { [0.0; 3] } else { [4.0, 3.0, 2.0] };
    for (name, target, stalls_s) in [("step", step, 0.5), ("lissajous", lissajous as Target, 3.0)] {
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
            assert!((stood - from).abs() <= STALLED_MM, "{name}, axis {axis}");
        }
    }
}

/// The target reverses every 0.6 s, so the trials do not always agree. The stall begins at 16
/// moments of a period and on each axis.
#[test]
fn most_stalls_on_fast_swing_are_found() {
    let (mut far, mut found) = (Vec::new(), 0);
    for axis in 0..3 {
        for moment in 0..16 {
            let stalls_s = 2.05 + 0.08 * f64::from(moment);
            let mut chase = Chase::new(7);
            chase.care = care();
            chase.stalled = Some((stalls_s, std::array::from_fn(|i| i == axis)));
            let run = chase.follow(swing, 8.0);
            let places = run.samples.iter().skip((stalls_s * 1e3) as usize);
            let mm: Vec<f64> = places.map(|sample| sample.stage_mm()[axis]).collect();
            let ways = mm.iter().map(|place| (place - mm[0]).abs());
            far.push(ways.fold(0.0, f64::max));
            found += u32::from(fault(&run) == Some(Fault::LostSteps));
        }
    }
    far.sort_by(f64::total_cmp);
    println!("{found} of 48 found; {far:.1?} mm after the stall");
    assert!(found >= 44, "{found}");
    assert!(far[24] <= STALLED_MM && far[47] <= 80.0, "{far:?}");
}

/// A motor that is off, or that makes a twentieth of its steps, from the start and in mid-run.
#[test]
fn stall_is_found_at_20_to_1000_fps() {
    let step: Target = |t| if t < 0.5 { [0.0; 3] } else { [4.0, 4.0, 2.0] };
    for frames_per_s in [20.0, 60.0, 200.0, 1_000.0] {
        for (name, target, stalls_s) in
            [("step", step, 0.0), ("lissajous", lissajous as Target, 3.0)]
        {
            // At 20 frames per second a twentieth of the steps first brings the target nearer.
            let slips = if frames_per_s < 60.0 {
                vec![0.0]
            } else {
                vec![0.0, 0.05]
            };
            for slips in slips {
                for axis in 0..2 {
                    let run = stall(frames_per_s, target, (stalls_s, axis), slips);
                    let last = run.statuses.last().expect("a status");
                    let stood = run.samples.last().expect("samples").stage_mm()[axis];
                    let from = run.samples[(stalls_s * 1e3) as usize].stage_mm()[axis];
                    let way = (stood - from).abs();
                    let what = format!("{name}, axis {axis}, {frames_per_s}/s, slips {slips}");
                    println!("{what}: {:?}, {way:.2} mm after the stall", last.fault);
                    assert_eq!(last.fault, Some(Fault::LostSteps), "{what}");
                    assert_eq!(last.trust, Trust::Degraded, "{what}");
                    assert!(way <= 1.5 * STALLED_MM, "{what}: {way} mm");
                }
            }
        }
    }
}

/// A target at rest, with frames so rare that the stage moves 10 to 20 mm from one to the next.
#[test]
fn stall_is_found_at_5_fps() {
    let step: Target = |t| if t < 0.5 { [0.0; 3] } else { [4.0, 4.0, 2.0] };
    for frames_per_s in [5.0, 10.0] {
        let run = stall(frames_per_s, step, (0.0, 0), 0.0);
        let last = run.statuses.last().expect("a status");
        let stood = run.samples.last().expect("samples").stage_mm()[0];
        println!("{frames_per_s}/s: {:?}, {stood:.2} mm", last.fault);
        assert_eq!(last.fault, Some(Fault::LostSteps), "{frames_per_s}/s");
        assert!(stood <= 30.0, "{frames_per_s}/s: {stood} mm");
    }
}

/// Follows for 10 s; from `stalls_s` on, one axis makes only a share of its steps.
fn stall(frames_per_s: f64, target: Target, (stalls_s, axis): (f64, usize), slips: f64) -> Run {
    let mut chase = Chase::new(7);
    chase.care = Care {
        largest_error_mm: None,
        ..care()
    };
    chase.travel_mm = Some(300.0);
    chase.frames_per_s = frames_per_s;
    let mut axes = [false; 3];
    axes[axis] = true;
    chase.stalled = Some((stalls_s, axes));
    chase.slips = slips;
    chase.follow(target, 10.0)
}

/// The target moves 25 mm at 45 mm/s, with so few frames that the stage lags by 1.6 mm in every
/// turn.
#[test]
fn few_frames_of_swing_are_no_fault() {
    let swing = |per_s: f64| {
        move |t: f64| {
            let angle = per_s * t;
            [
                25.0 * angle.sin(),
                12.0 * (2.0 * angle).sin(),
                3.0 * (3.0 * angle).sin(),
            ]
        }
    };
    for (frames_per_s, per_s) in [(60.0, 1.8), (10.0, 1.8), (5.0, 1.0)] {
        for seed in 0..4 {
            let mut chase = Chase::new(seed);
            chase.frames_per_s = frames_per_s;
            let run = chase.follow(swing(per_s), 8.0);
            assert_eq!(fault(&run), None, "{frames_per_s}/s");
        }
    }
}

/// The target changes its speed while it is hidden.
#[test]
fn unseen_speed_change_is_no_fault() {
    for (before, after, hidden_s) in [
        (50.0, 55.0, 0.4),
        (40.0, 43.0, 0.7),
        (90.0, 98.0, 0.2),
        (60.0, -30.0, 0.5),
        (30.0, 0.0, 1.0),
    ] {
        for seed in 0..4 {
            let mut chase = Chase::new(seed);
            chase.travel_mm = Some(500.0);
            chase.hidden_s = Some([0.9, 0.9 + hidden_s]);
            let target = move |t: f64| {
                let x = before * t.clamp(0.0, 1.0) + after * (t - 1.0).max(0.0);
                [x, 0.3 * x, 0.0]
            };
            let run = chase.follow(target, 4.0);
            assert_eq!(
                fault(&run),
                None,
                "{before} to {after} mm/s in {hidden_s} s"
            );
        }
    }
}

/// Frames contradict each other: the stage moves no farther on them than a quarter of the bound,
/// the motion of two frames, and a ramp.
#[test]
fn outliers_do_not_keep_stage_moving() {
    let mut chase = Chase::new(1);
    chase.travel_mm = Some(300.0);
    let target = |t: f64| {
        let picture = (60.0 * t + 0.5).floor() as i64;
        let aside = [0.0, 9.0, -7.0, 16.0][picture.rem_euclid(4) as usize];
        let x = 60.0 * t.min(1.0);
        [x, if t < 1.0 { 0.0 } else { aside }, 0.0]
    };
    let run = chase.follow(target, 2.0);
    let outliers = run
        .denials
        .iter()
        .filter(|denial| **denial == Denial::Outlier);
    let farthest = run.samples.iter().map(|sample| sample.stage_mm()[0]);
    let farthest = farthest.fold(0.0, f64::max);
    println!(
        "{farthest:.2} mm after {} outliers",
        outliers.clone().count()
    );
    assert!(outliers.count() >= 50, "{:?}", run.denials);
    assert!(
        farthest <= 60.0 + 0.25 * UNSEEN_MM + 2.0 + 4.0,
        "{farthest} mm"
    );
}

#[test]
fn watch_needs_bound_and_prediction() {
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
