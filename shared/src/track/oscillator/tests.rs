use super::*;
use proptest::prelude::*;

const REACH: KinematicLimits = KinematicLimits {
    speed: 8.0,
    acceleration: 0.16,
    jerk: 0.004,
};

const STEP: f64 = 4_294_967_296.0;

fn position(steps: f64) -> i64 {
    (steps * STEP) as i64
}

/// Returns the oscillator of a target that is measured every 16 ms, and the time of the last
/// measurement, ms.
fn followed(target: impl Fn(f64) -> f64, variance: f32, frames: u32) -> (Oscillator, f64) {
    let first = Filter::new(position(target(0.0)), variance, REACH);
    let (mut oscillator, mut time) = (Oscillator::new(&first, REACH), 0.0);
    for _ in 0..frames {
        time += 16.0;
        let measured = position(target(time));
        oscillator.predict(16.0);
        oscillator.update(measured, variance, 16.0, REACH);
    }
    (oscillator, time)
}

fn off(oscillator: &Oscillator, target: impl Fn(f64) -> f64, time: f64, ahead: f32) -> f64 {
    let predicted = oscillator.motion().ahead(ahead).position as f64 / STEP;
    predicted - target(time + f64::from(ahead))
}

proptest! {
    /// Up to 5 turns, against the functions in `f64`.
    #[test]
    fn waves_match_sine_and_cosine(turns in 0.0f64..5.0, t in 1.0f32..1_000.0) {
        let root = turns * core::f64::consts::TAU / f64::from(t);
        let stiffness = (root * root) as f32;
        let (w, time) = (f64::from(stiffness), f64::from(t));
        let angle = libm::sqrt(w) * time;
        let Waves { s, c, ds, dc } = Waves::new(stiffness, t);
        let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
        // Below, the quotients lose their digits in `f64` as well.
        prop_assume!(angle > 0.01);
        let scale = 1e-5 * (1.0 + angle * angle);
        let close = |got: f32, want: f64, unit: f64| (f64::from(got) - want).abs() <= scale * unit;
        prop_assert!(close(s, sine / libm::sqrt(w), time));
        prop_assert!(close(c, (1.0 - cosine) / w, time * time));
        let cube = time * time * time;
        prop_assert!(close(ds, (angle * cosine - sine) / (2.0 * w * libm::sqrt(w)), cube));
        let slope = (0.5 * angle * sine - (1.0 - cosine)) / (w * w);
        prop_assert!(close(dc, slope, cube * time) || angle < 0.2);
    }

    /// Feeds any values, including infinities and NaN.
    #[test]
    fn every_number_stays_finite(
        start: (i64, f32), limits: [f32; 3],
        measurements in prop::collection::vec(any::<(i64, f32, f32, f32)>(), 0..60),
    ) {
        let [speed, acceleration, jerk] = limits;
        let reach = KinematicLimits { speed, acceleration, jerk };
        let filter = Filter::new(start.0, start.1, reach);
        let mut oscillator = Oscillator::new(&filter, reach);
        for (measured, variance, dt, ahead) in measurements {
            oscillator.predict(dt);
            if !oscillator.admits(measured, variance) {
                oscillator = Oscillator::new(&filter, reach);
            }
            oscillator.update(measured, variance, dt, reach);
            let motion = oscillator.motion();
            let motions = [*motion, motion.ahead(ahead)];
            let numbers = motions.map(|m| [m.velocity, m.acceleration, m.stiffness]);
            prop_assert!(numbers.as_flattened().iter().all(|number| number.is_finite()));
        }
    }
}

/// 5 Hz and 80 steps: after a second, 40 ms ahead.
#[test]
fn sine_is_predicted() {
    let target = |ms: f64| 80.0 * libm::sin(ms * core::f64::consts::TAU / 200.0);
    let (oscillator, time) = followed(target, 0.1, 63);
    let off = off(&oscillator, target, time, 40.0);
    assert!(off.abs() < 0.2, "{off}");
    let root = libm::sqrt(f64::from(oscillator.motion().stiffness));
    let per_s = root * 1_000.0 / core::f64::consts::TAU;
    assert!((per_s - 5.0).abs() < 0.01, "{per_s}");
}

/// 20 s for a turn, 1,600 steps: it is an acceleration rather than a swing.
#[test]
fn slow_curve_is_predicted() {
    let target = |ms: f64| 1_600.0 * libm::sin(ms * core::f64::consts::TAU / 20_000.0);
    let (oscillator, time) = followed(target, 0.1, 120);
    let off = off(&oscillator, target, time, 40.0);
    assert!(off.abs() < 0.1, "{off}");
}

/// A parabola has no stiffness.
#[test]
fn constant_acceleration_is_predicted() {
    let target = |ms: f64| 0.5 * 0.004 * ms * ms;
    let (oscillator, time) = followed(target, 0.1, 60);
    let off = off(&oscillator, target, time, 40.0);
    assert!(off.abs() < 0.2, "{off}");
    let acceleration = oscillator.motion().acceleration;
    assert!((acceleration - 0.004).abs() < 1e-4, "{acceleration}");
}

#[test]
fn gate_refuses_what_does_not_fit() {
    let target = |ms: f64| 2.0 * ms;
    let (mut oscillator, time) = followed(target, 0.1, 60);
    oscillator.predict(16.0);
    let expected = target(time + 16.0);
    assert!(oscillator.admits(position(expected + 1.0), 0.1));
    assert!(!oscillator.admits(position(expected + 20.0), 0.1));
}

/// At a target at rest, whose stiffness has no effect, the variance is that of a prediction: with
/// little noise and with much.
#[test]
fn variance_ahead_is_that_of_prediction() {
    for noise in [0.0, 1e-9, 1e-6] {
        let (mut oscillator, _) = followed(|_| 0.0, 0.1, 60);
        oscillator.process_noise = noise;
        for ahead in [5.0, 20.0, 50.0] {
            let mut later = oscillator;
            later.predict(ahead);
            let (got, want) = (oscillator.variance(ahead), later.covariance.xx);
            assert!(
                (got / want - 1.0).abs() < 1e-4,
                "{noise} {ahead}: {got} {want}"
            );
        }
    }
}
