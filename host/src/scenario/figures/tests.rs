use super::*;
use crate::scenario::file::{Cameras, ImageSource};
use crate::scenario::motion::{Leg, Motion};
use trinocular_client::stage::default_stage;
use trinocular_core::safety::State;

fn scenario(legs: Vec<Leg>) -> Scenario {
    let seconds = legs.iter().map(|leg| leg.seconds).sum();
    Scenario {
        title: String::new(),
        seed: 1,
        cameras: Cameras {
            sight: ImageSource::Points {
                count: 100,
                noise_px: 0.0,
            },
            frames_per_s: 50.0,
            latency_ms: 20.0,
            depth_mm: 850.0,
        },
        legs,
        events: Vec::new(),
        stage: default_stage(),
        measure: Measure {
            from_s: 0.0,
            until_s: seconds,
            settle_within_mm: [0.03, 0.03, 0.08],
        },
        expect: Default::default(),
    }
}

fn leg(motion: Motion, seconds: f64) -> Leg {
    Leg {
        motion,
        seconds,
        ramps_s: [0.0; 2],
    }
}

/// Returns a trace of a stage at the position `camera` of the time.
fn trace(scenario: &Scenario, camera: impl Fn(f64) -> [f64; 3]) -> Trace {
    let way = Way::new(&scenario.legs);
    let count = (way.seconds() / SAMPLE_S).round() as u32;
    let samples = (0..=count).map(|n| {
        let time_s = f64::from(n) * SAMPLE_S;
        Sample {
            time_s,
            target_mm: way.at(time_s),
            camera_mm: camera(time_s),
            reversals: [n / 100, 0, 0],
            state: State::Following,
        }
    });
    Trace {
        samples: samples.collect(),
        captures_s: (1..=(way.seconds() * 50.0) as u32)
            .map(|n| f64::from(n) / 50.0)
            .collect(),
        ..Trace::default()
    }
}

#[test]
fn settling_starts_at_first_frame() {
    let by_mm = [4.0, 0.0, 0.0];
    let scenario = scenario(vec![
        leg(Motion::Still, 0.505),
        leg(Motion::Step { by_mm }, 1.0),
    ]);
    // There at 0.7 s, after 3 % too far; the first capture is at 0.52 s, its frame is there at 0.54
    // s.
    let camera = |t: f64| match t {
        t if t < 0.6 => [0.0; 3],
        t if t < 0.6995 => [4.12, 0.0, 0.0],
        _ => [4.02, 0.0, 0.0],
    };
    let found = Figures::of(&scenario, &trace(&scenario, camera));
    let settle_ms = found.settle_ms.expect("it settles");
    assert!((settle_ms - 160.0).abs() < 1e-6, "{settle_ms}");
    assert!((found.overshoot.expect("a jump") - 0.03).abs() < 1e-9);
    // A jump that never arrives does not settle.
    let found = Figures::of(&scenario, &trace(&scenario, |_| [0.0; 3]));
    assert_eq!(found.settle_ms, None);
}

#[test]
fn error_figures_match_trace() {
    let velocity_mm_s = [30.0, 40.0, 0.0];
    let line = scenario(vec![leg(Motion::Line { velocity_mm_s }, 2.0)]);
    let found = Figures::of(
        &line,
        &trace(&line, |t| [30.0 * t - 0.3, 40.0 * t - 0.4, 0.0]),
    );
    assert!((found.lag_mm - 0.5).abs() < 1e-9);
    assert!((found.rms_3d_mm - 0.5).abs() < 1e-9);
    assert!((found.max_mm[1] - 0.4).abs() < 1e-9);
    assert!((found.speed_mm_s[1] - 40.0).abs() < 1e-6);
    assert!(found.acceleration_mm_s2[1] < 1e-6);
    // 19 reversals within the two seconds, without that of the first sample.
    assert!((found.reversals_per_s[0] - 9.5).abs() < 0.1);
    let still = scenario(vec![leg(Motion::Still, 2.0)]);
    let wobble = |t: f64| {
        [
            1.0 + 0.01 * f64::from((t * 1e3).round() as i32 % 2),
            0.0,
            0.0,
        ]
    };
    let found = Figures::of(&still, &trace(&still, wobble));
    assert!((found.jitter_mm[0] - 0.005).abs() < 1e-5, "{found:?}");
    assert!((found.rms_mm[0] - 1.005).abs() < 1e-4);
}

#[test]
fn acceleration_skips_abrupt_stops() {
    let still = scenario(vec![leg(Motion::Still, 1.0)]);
    let camera = |t: f64| [500.0 * t.min(0.5).powi(2), 0.0, 0.0];
    let mut trace = trace(&still, camera);
    // The stage stops abruptly at 0.5 s, from 500 mm/s.
    let found = Figures::of(&still, &trace);
    assert!(found.acceleration_mm_s2[0] > 10_000.0);
    trace.abrupt_s.push(0.5);
    let found = Figures::of(&still, &trace);
    assert!(
        (found.acceleration_mm_s2[0] - 1_000.0).abs() < 1.0,
        "{found:?}"
    );
}

#[test]
fn percentiles_use_nearest_rank() {
    let latencies: Vec<u32> = (1..=200).rev().map(|n| n * 1_000).collect();
    let found = latency(&latencies);
    assert_eq!((found.p50, found.p99), (Some(100.0), Some(198.0)));
    assert_eq!(latency(&[]), Latency::default());
    assert_eq!(latency(&[7_000]).p99, Some(7.0));
}

/// Compares the bound with the worst stage: full acceleration until the stop, then the gentlest
/// ramp within the limits.
#[test]
fn silence_bound_holds_worst_case() {
    let (a, j, most) = (2_000.0_f64, 50_000.0_f64, 100.0_f64);
    for start in [0.0_f64, 20.0, 50.0, 80.0, 100.0] {
        let (mut v, mut x, mut acceleration) = (start, 0.0f64, a);
        let dt = 1e-5;
        let stop_s = f64::from(HEARTBEAT_MS) * 1e-3 + NOTICE_S;
        let mut t = 0.0;
        while v > 0.0 || t < stop_s {
            if t < stop_s {
                acceleration = if v < most - acceleration.max(0.0).powi(2) / (2.0 * j) {
                    a
                } else {
                    (acceleration - j * dt).max(0.0)
                };
            } else {
                // Down: jerk until -a or half the speed is gone, then ease off.
                let easing = acceleration.min(0.0).powi(2) / (2.0 * j);
                acceleration = match v > easing {
                    true => (acceleration - j * dt).max(-a),
                    false => (acceleration + j * dt).min(-1e-3),
                };
            }
            v = (v + acceleration * dt).clamp(0.0, most);
            x += v * dt;
            t += dt;
        }
        let bound = silence_bound_mm(start, most, a, j);
        assert!(x <= bound, "from {start}: {x} > {bound}");
        assert!(
            x > 0.5 * bound,
            "from {start}: the bound {bound} says little of {x}"
        );
    }
}
