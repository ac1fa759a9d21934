//! Quality of following: figures of the closed loop, asserted without rendering an image.
//!
//! Cameras are simulated by their measurements and noise; everything from the frame's bytes to the
//! planned position is the station's own code. 60 frames/s, 20 ms from image to frame, the stage of
//! the experiments.

#[path = "following/consistency.rs"]
mod consistency;

use std::f64::consts::TAU;
use trinocular_core::frame::message::Denial;
use trinocular_core::track::pursuit::Sight;
use trinocular_tests::chase::{Chase, Run, STEPS_PER_MM, lissajous, smooth};

/// Seeds of the noise.
const SEEDS: [u64; 4] = [1, 2, 3, 4];

fn each(bound: [f64; 3], value: [f64; 3]) -> bool {
    bound
        .iter()
        .zip(value)
        .all(|(bound, value)| value <= *bound)
}

/// Returns the last time at which the error exceeded the bound, s.
fn settled(run: &Run, bound_mm: [f64; 3]) -> f64 {
    let off = run
        .samples
        .iter()
        .filter(|sample| !each(bound_mm, sample.error_mm().map(f64::abs)));
    off.map(|sample| sample.time_s).fold(0.0, f64::max)
}

/// Returns the time of the first image from `time_s` on, s.
fn first_picture(time_s: f64) -> f64 {
    (time_s * 60.0).ceil() / 60.0
}

/// Returns the highest planned acceleration of any axis, mm/s².
fn steepest(run: &Run) -> f64 {
    let ticks: Vec<[i64; 3]> = run.planned.iter().copied().step_by(4).collect();
    let of = |axis: usize| {
        let bends = ticks.windows(3).map(move |w| {
            let bend = w[2][axis] - 2 * w[1][axis] + w[0][axis];
            bend.abs() as f64 / 4_294_967_296.0 / STEPS_PER_MM * 1e6
        });
        bends.fold(0.0, f64::max)
    };
    (0..3).map(of).fold(0.0, f64::max)
}

/// The target also moves as another stage would move it, and with the frame rate of the paper's
/// experiment.
#[test]
fn step_settles_without_overshoot() {
    type Step = fn(f64) -> [f64; 3];
    let sudden: Step = |t| if t < 1.01 { [0.0; 3] } else { [4.0, 4.0, 1.0] };
    let driven: Step = |t| [4.0, 4.0, 1.0].map(|mm| mm * smooth(t - 1.01));
    for (name, step) in [("sudden", sudden), ("driven", driven)] {
        for seed in SEEDS {
            let run = Chase::new(seed).follow(step, 2.0);
            let over = run.farthest(1.01);
            let took = settled(&run, [0.03, 0.03, 0.08]) - first_picture(1.01);
            println!("{name} step: settled after {took:.3} s, overshoot {over:.4?} mm");
            assert!(took <= 0.25, "{name}: {took} s");
            // The bound is 5 % and the noise at rest.
            assert!(each([0.2, 0.2, 0.05 + 0.08], over), "{name}: {over:?}");
        }
    }
}

#[test]
fn prediction_follows_lissajous() {
    for seed in SEEDS {
        let mut chase = Chase::new(seed);
        let with = chase.follow(lissajous, 10.0);
        chase.tracking.prediction = false;
        let without = chase.follow(lissajous, 10.0);
        let ratio = without.rms_3d(1.0) / with.rms_3d(1.0);
        println!(
            "lissajous: rms {:.4?} mm, without prediction {:.4?} mm: {ratio:.1} times",
            with.rms(1.0),
            without.rms(1.0)
        );
        assert!(each([0.1, 0.1, 0.2], with.rms(1.0)));
        assert!(ratio >= 4.0, "{ratio}");
    }
}

#[test]
fn steady_motion_is_followed_without_lag() {
    for seed in SEEDS {
        let run = Chase::new(seed).follow(
            |t| [4.0, 4.0, 1.0].map(|d| d * 50.0 * t / 33f64.sqrt()),
            1.2,
        );
        let lag = run.mean_error(0.7).map(f64::abs);
        println!("50 mm/s: lag {lag:.4?} mm");
        assert!(each([0.1; 3], lag), "{lag:?}");
    }
}

#[test]
fn still_target_keeps_motors_quiet() {
    for seed in SEEDS {
        // The target rests in the middle of a step, or between two.
        let run = match seed % 2 {
            0 => Chase::new(seed).follow(|_| [0.0; 3], 20.0),
            _ => Chase::new(seed).follow(|t| [0.5 * t.min(0.0125); 3], 20.0),
        };
        let (jitter, reversals) = (run.rms(0.5), run.reversals(0.5));
        println!("still: jitter {jitter:.4?} mm, reversals {reversals:.2?} per s");
        assert!(each([0.01, 0.01, 0.03], jitter), "{jitter:?}");
        assert!(each([5.0; 3], reversals), "{reversals:?}");
    }
}

#[test]
fn gap_of_half_a_second_is_coasted() {
    for seed in SEEDS {
        let mut chase = Chase::new(seed);
        chase.hidden_s = Some([3.0, 3.5]);
        let run = chase.follow(lissajous, 6.0);
        let sights: Vec<Sight> = run.statuses.iter().map(|status| status.sight).collect();
        assert!(sights.contains(&Sight::Coasting) && !sights.contains(&Sight::Lost));
        let steepest = steepest(&run);
        println!(
            "hidden for 0.5 s: {:.2} mm off at most, then rms {:.4?} mm; up to {steepest:.0} mm/s²",
            run.worst(3.0).into_iter().fold(0.0, f64::max),
            run.rms(4.0)
        );
        assert!(steepest <= 2_001.0, "{steepest} mm/s²");
        assert!(each([0.1, 0.1, 0.2], run.rms(4.0)), "{:?}", run.rms(4.0));
    }
}

#[test]
fn lost_target_is_reacquired_from_rest() {
    let mut chase = Chase::new(1);
    chase.hidden_s = Some([3.0, 5.0]);
    let run = chase.follow(lissajous, 8.0);
    let lost = run.statuses.iter().find(|s| s.sight == Sight::Lost);
    let lost = lost.expect("it was lost");
    assert_eq!(lost.state, trinocular_core::safety::State::Following);
    // 800 ms after the last frame, and a ramp from 20 mm/s.
    let resting = run
        .samples
        .iter()
        .filter(|s| s.time_s > 4.0 && s.time_s < 5.0);
    let stood: Vec<_> = resting.map(|s| s.steps).collect();
    assert!(
        stood.windows(2).all(|w| w[0] == w[1]),
        "it ramps down to rest"
    );
    assert!(steepest(&run) <= 2_001.0);
    assert!(each([0.1, 0.1, 0.2], run.rms(6.0)), "{:?}", run.rms(6.0));
    assert_eq!(run.statuses.last().map(|s| s.sight), Some(Sight::Tracking));
}

#[test]
fn single_outlier_is_refused() {
    let mut chase = Chase::new(3);
    chase.wrong = Some((90, 1, [5.0, -5.0, 5.0]));
    let still = chase.follow(|_| [0.0; 3], 3.0);
    assert_eq!(still.denials, [Denial::Outlier]);
    assert!(
        each([0.02, 0.02, 0.1], still.worst(0.5)),
        "{:?}",
        still.worst(0.5)
    );
    let moving = chase.follow(lissajous, 3.0);
    assert_eq!(moving.denials, [Denial::Outlier]);
    assert!(
        each([0.1, 0.1, 0.2], moving.rms(1.0)),
        "{:?}",
        moving.rms(1.0)
    );
    // All frames from number 90 on are wrong.
    chase.wrong = Some((90, u64::MAX, [5.0, -5.0, 5.0]));
    let jumped = chase.follow(|_| [0.0; 3], 3.0);
    assert_eq!(jumped.denials, [Denial::Outlier]);
    let at = jumped.samples.last().expect("samples").stage_mm();
    assert!(
        each(
            [0.03, 0.03, 0.08],
            std::array::from_fn(|i| (at[i] - [5.0, -5.0, 5.0][i]).abs())
        ),
        "{at:?}"
    );
}

#[test]
fn target_beyond_limits_stops_at_limit() {
    // The target moves at 30 mm/s to 69 mm and back; the stage's limit is 60 mm.
    let run = Chase::new(1).follow(
        |t| {
            let way = 30.0 * t;
            [if way < 69.0 { way } else { 138.0 - way }, 0.0, 0.0]
        },
        4.0,
    );
    let farthest = run.samples.iter().map(|s| s.steps[0]).max();
    assert_eq!(farthest, Some(60 * 80));
    let last = run.samples.last().expect("samples");
    assert!(
        last.target_mm[0] < 20.0 && last.error_mm()[0].abs() < 0.1,
        "{last:?}"
    );
}

/// The target moves as if another stage followed single images: its speed varies by a sixth with
/// every image.
#[test]
fn uneven_motion_is_followed_without_lag() {
    for seed in SEEDS {
        let mut chase = Chase::new(seed);
        chase.frames_per_s = 30.0;
        let run = chase.follow(
            |t| {
                let (angle, uneven) = (TAU * t / 8.0, 0.016 * (TAU * 15.0 * t + 1.0).sin());
                [
                    10.0 * angle.sin() + uneven,
                    10.0 * (1.0 - angle.cos()) + uneven,
                    0.0,
                ]
            },
            8.0,
        );
        println!(
            "uneven circle: rms {:.4?} mm, at most {:.4?} mm",
            run.rms(1.0),
            run.worst(1.0)
        );
        assert!(each([0.1; 3], run.rms(1.0)), "{:?}", run.rms(1.0));
    }
}

/// Position on a figure of 25, 12 and 3 mm in mm, with up to 45 mm/s along an axis.
fn fast_figure(time_s: f64) -> [f64; 3] {
    let phase = 1.8 * time_s;
    [
        25.0 * phase.sin(),
        12.0 * (2.0 * phase).sin(),
        3.0 * (3.0 * phase).sin(),
    ]
}

/// The time stamps are 5 ms wrong. With the default bound of 10 mm on unseen motion, the station
/// suspects a stage that chases a target this fast, and pauses for trials. A bound of 20 mm avoids
/// the pauses.
#[test]
fn fast_figure_needs_a_wider_unseen_bound() {
    let farthest = |unseen_mm: Option<f64>| {
        let of = SEEDS.map(|seed| {
            let mut chase = Chase::new(seed);
            chase.care.largest_unseen_mm = unseen_mm;
            chase.late_us = 5_000;
            let run = chase.follow(fast_figure, 10.0);
            assert_eq!(run.faulted_s, None);
            run.worst(1.0).into_iter().fold(0.0, f64::max)
        });
        of.into_iter().fold(0.0, f64::max)
    };
    let [default, wide, none] = [Some(10.0), Some(20.0), None].map(farthest);
    println!("45 mm/s: {default:.1} mm by default, {wide:.1} with 20 mm, {none:.1} with none");
    assert!(wide < 5.0 && default > 10.0, "{wide} {default}");
    assert_eq!(wide.to_bits(), none.to_bits());
}

/// Breathing: up and down in a third of the period, and rest.
#[test]
fn motion_that_is_no_sine_is_followed() {
    for seed in SEEDS {
        let run = Chase::new(seed).follow(
            |t| {
                let mm = 6.0 * (0.3 * TAU * t).sin().powi(4);
                [mm, mm, 0.0]
            },
            14.0,
        );
        let rms = run.rms(1.0);
        println!("breathing: rms {rms:.4?} mm");
        assert!(each([0.1; 3], rms), "{rms:?}");
    }
}

/// Returns a Lissajous figure with these frequencies, relative to each other, that starts with
/// `peak_mm_s`.
fn figure(
    amplitude_mm: [f64; 3],
    ratio: [f64; 3],
    peak_mm_s: f64,
) -> impl Fn(f64) -> [f64; 3] + Copy {
    let length = |i: usize| (amplitude_mm[i] * ratio[i]).powi(2);
    let omega = peak_mm_s / (0..3).map(length).sum::<f64>().sqrt();
    move |t| std::array::from_fn(|i| amplitude_mm[i] * (ratio[i] * omega * t).sin())
}

/// The target always accelerates, by up to 50 mm/s². With measurements good to a few µm, and with
/// the usual ones, whose sigma of z is 0.03 mm.
#[test]
fn turning_points_are_followed() {
    for (noise, bound) in [(0.1, [0.01; 3]), (1.0, [0.04, 0.06, 0.05])] {
        for seed in SEEDS {
            let mut chase = Chase::new(seed);
            chase.noise = noise;
            let run = chase.follow(figure([15.0, 10.0, 8.0], [2.0, 3.0, 1.0], 40.0), 10.0);
            let rms = run.rms(1.0);
            println!("40 mm/s, noise {noise}: rms {rms:.4?} mm");
            assert!(each(bound, rms), "{rms:?}");
        }
    }
}

/// At turning points the filter errs by 0.3 mm, so every oscillator must take the lead in time and
/// keep it. With sigmas of 0.002 and 0.012 mm (z), and with the usual ones.
#[test]
fn figure_is_followed_at_30_late_frames_per_s() {
    for noise in [0.4, 1.0] {
        let off = (1..=80).map(|seed| {
            let mut chase = Chase::new(seed);
            chase.noise = noise;
            chase.frames_per_s = 30.0;
            chase.latency_us = 40_000;
            chase.follow(lissajous, 14.8).rms(1.0)
        });
        let off: Vec<_> = off.filter(|rms| !each([0.03, 0.06, 0.06], *rms)).collect();
        println!(
            "30 frames per second, noise {noise}: {} of 80 off",
            off.len()
        );
        assert!(off.len() <= 1, "{off:.4?}");
    }
}

/// From ten periods on, along x and y. Among 60 seeds some measurements are three to four sigma
/// off; an oscillator that lost the lead over them would break the bound.
#[test]
fn vibration_is_learned_within_ten_periods() {
    for (per_s, mm) in [(5.0, 1.0), (4.0, 1.0), (3.0, 1.0)] {
        for seed in 1..=60 {
            let run = Chase::new(seed).follow(
                move |t| {
                    [
                        mm * (TAU * per_s * t).sin(),
                        mm * (TAU * per_s * t).sin(),
                        0.0,
                    ]
                },
                10.0 / per_s + 3.0,
            );
            let rms = run.rms(10.0 / per_s);
            println!("±{mm} mm at {per_s} Hz: rms {rms:.4?} mm");
            assert!(each([0.02; 3], rms), "{rms:?}");
        }
    }
}
