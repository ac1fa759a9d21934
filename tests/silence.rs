//! Loss of the host: stopping distance at the pins, from any instant of any motion.

use trinocular_client::stage::{HEARTBEAT_MS, default_stage};
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::{Command, Mounting};
use trinocular_core::safety::{Fault, State, Trust};
use trinocular_rig::random::Random;
use trinocular_rig::rig_file::Stage;

/// Longest time from the last ping to the stop, s: the heartbeat timeout, the tick that notices,
/// the tick already planned, and the one in which the ping came.
const SILENCE_S: f64 = 1e-3 * HEARTBEAT_MS as f64 + 3e-3;

/// Duration of the words queued for the pins, s.
const RING_S: f64 = 1e-3;

/// Returns a stage with fine steps, because its speed is measured at the pins.
fn stage(max_speed_mm_s: f64) -> Stage {
    Stage {
        steps_per_mm: [1_600.0; 3],
        max_speed_mm_s: [max_speed_mm_s; 3],
        travel_mm: [[-500.0, 500.0]; 3],
        ..default_stage()
    }
}

/// Returns the longest stopping distance, mm, from an instant with the speed `v`, mm/s. The axis
/// may have accelerated with `a` up to `most` for all of the silence; then it brakes with the jerk
/// `j`. On the planner's grid the jerk is up to a sixth lower.
fn bound_mm(v: f64, most: f64) -> f64 {
    let (a, j, t) = (2_000.0, 50_000.0 * 5.0 / 6.0, SILENCE_S + RING_S);
    let first = (v + a * t).min(most);
    let second = (first + a * a / (2.0 * j)).min(most);
    let silent = (v * t + 0.5 * a * t * t).min(most * t);
    let easing = first * a / j + a.powi(3) / (3.0 * j * j);
    let braking = 0.5 * second * (second / a + a / j);
    silent + easing + braking + (second + a * 1e-3) * 1e-3
}

/// Silences the host now and returns the distance that each axis moves until rest, mm.
fn silence(twin: &mut Twin) -> [f64; 3] {
    // Send the last ping now.
    let host_us = twin.now().micros();
    twin.send(Command::Ping { host_us });
    twin.set_pings(false);
    let before = twin.position_mm();
    twin.advance(twin.now().plus_micros(800_000));
    let stood = twin.position_mm();
    twin.advance(twin.now().plus_micros(200_000));
    assert_eq!(twin.position_mm(), stood, "it stands");
    std::array::from_fn(|axis| (stood[axis] - before[axis]).abs())
}

#[test]
fn silence_at_50_mm_s_stops_within_bound() {
    let mut twin = Twin::start(&stage(50.0), "twin", Mounting::OnStage).expect("it starts");
    let position_um = [400_000; 3];
    twin.command("setpoint", Command::Setpoint { position_um })
        .expect("it moves");
    twin.advance(twin.now().plus_micros(1_000_000));
    let ways = silence(&mut twin);
    let bound = bound_mm(50.0, 50.0);
    println!("50 mm/s on three axes: {ways:.3?} mm, bound {bound:.3} mm");
    for way in ways {
        assert!(way <= bound && way > 0.5 * bound, "{way} of {bound} mm");
    }
    twin.set_pings(true);
    twin.advance(twin.now().plus_micros(500_000));
    let status = *twin.status().expect("a status");
    assert_eq!(
        (status.state, status.fault, status.trust),
        (State::Faulted, Some(Fault::Heartbeat), Trust::Homed)
    );
    assert_eq!(status.position_steps.map(i64::from), twin.steps_from_zero());
}

#[test]
fn silence_at_random_times_keeps_bound() {
    let mut random = Random::seeded(11);
    let most = 50.0;
    let (mut worst, mut farthest, mut speeding) = (0.0f64, 0.0f64, 0);
    for _ in 0..1_000 {
        let mut twin = Twin::start(&stage(most), "twin", Mounting::OnStage).expect("it starts");
        // Several targets follow one another, some in mid-move.
        for _ in 0..1 + random.below(4) {
            let position_um = [(); 3].map(|()| random.between(-200e3, 200e3) as i32);
            twin.command("setpoint", Command::Setpoint { position_um })
                .expect("it moves");
            let ms = 1 + random.below(100) as u64;
            twin.advance(twin.now().plus_micros(1_000 * ms));
        }
        let speed = |twin: &mut Twin| -> [f64; 3] {
            let before = twin.position_mm();
            twin.advance(twin.now().plus_micros(1_000));
            let after = twin.position_mm();
            // The speed is measured in whole steps, each of which may just have been missed.
            std::array::from_fn(|i| ((after[i] - before[i]).abs() + 2.0 / 1_600.0) * 1e3)
        };
        let earlier = speed(&mut twin);
        let now = speed(&mut twin);
        let ways = silence(&mut twin);
        for axis in 0..3 {
            // The axis may accelerate further during the words queued for the pins.
            let bound = bound_mm((now[axis] + 2_000.0 * RING_S).min(most), most);
            assert!(
                ways[axis] <= bound,
                "{} of {bound} mm at {} mm/s",
                ways[axis],
                now[axis]
            );
            worst = worst.max(ways[axis] / bound);
            farthest = farthest.max(ways[axis]);
            speeding += usize::from(now[axis] > earlier[axis] + 1.0);
        }
    }
    println!(
        "1,000 moments, {speeding} axes accelerating: at most {farthest:.3} mm, {:.1} % of the \
         bound",
        100.0 * worst
    );
    assert!(speeding > 300, "{speeding}");
    assert!(worst > 0.6, "{worst}");
}
