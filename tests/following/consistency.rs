//! The filter itself: against a textbook's in `f64`, against its own stated covariance, and bit for
//! bit.

use nalgebra::{Matrix2, RowVector2, Vector2};
use trinocular_core::time::Instant;
use trinocular_core::track::filter::{Filter, KinematicLimits};
use trinocular_core::track::pursuit::{Measurement, Pursuit, Settings};
use trinocular_rig::random::Random;

/// Limits of the stage of the experiments, steps and ms: 100 mm/s, 2,000 mm/s² at 80 steps/mm.
const REACH: KinematicLimits = KinematicLimits {
    speed: 8.0,
    acceleration: 0.16,
    jerk: 0.004,
};

/// Frame interval at 60 frames/s, ms.
const DT: f32 = 1000.0 / 60.0;

const STEP: f64 = 4_294_967_296.0;

fn fine(steps: f64) -> i64 {
    (steps * STEP) as i64
}

/// A textbook constant-velocity Kalman filter, with the adaptation that the module's documentation
/// states.
struct Textbook {
    state: Vector2<f64>,
    covariance: Matrix2<f64>,
    noise: f64,
    last: f64,
}

impl Textbook {
    const MOST: f64 = 32.0 * 0.16 * 0.16;

    fn new(position: f64, variance: f64) -> Self {
        Self {
            state: Vector2::new(position, 0.0),
            covariance: Matrix2::new(variance + 1.0 / 6.0, 0.0, 0.0, 16.0),
            noise: Self::MOST / 4_194_304.0,
            last: 0.0,
        }
    }

    fn update(&mut self, measured: f64, variance: f64, dt: f64) {
        let variance = variance + 1.0 / 6.0;
        let unit = Matrix2::new(dt.powi(3) / 3.0, dt * dt / 2.0, dt * dt / 2.0, dt);
        let carry = Matrix2::new(1.0, dt, 0.0, 1.0);
        self.state = carry * self.state;
        self.covariance = carry * self.covariance * carry.transpose() + unit * self.noise;
        let seen = RowVector2::new(1.0, 0.0);
        let innovation = measured - (seen * self.state)[0];
        let expected = (seen * self.covariance * seen.transpose())[0] + variance;
        let excess = innovation * innovation / 9.0 - expected;
        if excess > 0.0 {
            self.covariance += unit * (excess / unit[(0, 0)]).min(Self::MOST);
        }
        let alike = (innovation * self.last / expected).clamp(-1.0, 1.0);
        self.noise *= if alike > 0.0 {
            1.0 + 0.25 * alike
        } else {
            1.0 / (1.0 - 0.25 * alike)
        };
        self.noise = self.noise.clamp(Self::MOST / 4_194_304.0, Self::MOST);
        self.last = innovation;
        let expected = (seen * self.covariance * seen.transpose())[0] + variance;
        let gain = self.covariance * seen.transpose() / expected;
        self.state += gain * innovation;
        self.covariance = (Matrix2::identity() - gain * seen) * self.covariance;
    }
}

/// Targets that rest, drift, turn and jump in speed: within 0.005 step and 0.0002 steps/ms of the
/// textbook's filter.
#[test]
fn single_precision_is_enough() {
    let mut random = Random::seeded(11);
    let (mut worst, mut worst_speed) = (0.0f64, 0.0f64);
    for run in 0..50 {
        // Test far from zero, where a single f32 has no fraction bits left.
        let far = random.between(-4e6, 4e6).round();
        let sigma = random.between(0.05, 4.0);
        let variance = sigma * sigma;
        let mut speed = 0.0;
        let mut place = 0.0;
        let mut filter = Filter::new(fine(far), variance as f32, REACH);
        let mut textbook = Textbook::new(0.0, f64::from(variance as f32));
        for k in 0..600 {
            if k % 100 == 0 {
                speed = random.between(-2.0, 2.0) * f64::from(run % 2);
            }
            speed += 0.02 * random.gaussian() * f64::from(run % 3);
            place += speed * f64::from(DT);
            let measured = place + sigma * random.gaussian();
            filter.predict(DT);
            filter.update(fine(far + measured), variance as f32, DT, REACH);
            textbook.update(measured, f64::from(variance as f32), f64::from(DT));
            let position = (filter.position() - fine(far)) as f64 / STEP;
            worst = worst.max((position - textbook.state[0]).abs());
            worst_speed = worst_speed.max((f64::from(filter.velocity()) - textbook.state[1]).abs());
        }
    }
    println!("off by up to {worst:.2e} steps and {worst_speed:.2e} steps/ms");
    assert!(
        worst <= 0.005 && worst_speed <= 0.0002,
        "{worst} {worst_speed}"
    );
}

/// Mean normalised squared error of position and speed for targets of different process noise. A
/// filter with the true noise would have 2.
#[test]
fn covariance_matches_true_error() {
    let mut random = Random::seeded(12);
    for acceleration in [0.0, 0.0002, 0.001, 0.005, 0.02] {
        let (mut sum, mut count) = (0.0, 0);
        for _ in 0..40 {
            let sigma = random.between(0.3, 3.0);
            let (mut place, mut speed) = (0.0, 0.0);
            let dt = f64::from(DT);
            let mut filter = Filter::new(0, (sigma * sigma) as f32, REACH);
            for k in 0..600 {
                // White acceleration, constant over a frame.
                let a = acceleration * random.gaussian();
                place += speed * dt + 0.5 * a * dt * dt;
                speed += a * dt;
                let measured = place + (sigma * sigma + 1.0 / 6.0f64).sqrt() * random.gaussian();
                filter.predict(DT);
                filter.update(fine(measured), (sigma * sigma) as f32, DT, REACH);
                if k >= 120 {
                    let known = filter.covariance();
                    let covariance =
                        Matrix2::new(known.position, known.cross, known.cross, known.velocity)
                            .map(f64::from);
                    let error = Vector2::new(
                        filter.position() as f64 / STEP - place,
                        f64::from(filter.velocity()) - speed,
                    );
                    let inverse = covariance.try_inverse().expect("positive");
                    sum += (error.transpose() * inverse * error)[0];
                    count += 1;
                }
            }
        }
        let nees = sum / f64::from(count);
        println!("acceleration {acceleration} steps/ms²: normalised squared error {nees:.2}");
        assert!((0.8..=3.0).contains(&nees), "{acceleration}: {nees}");
    }
}

/// Ten thousand measurements, including outliers, give these bits on every machine.
#[test]
fn filter_has_same_bits_everywhere() {
    let mut random = Random::seeded(13);
    let mut pursuit = Pursuit::default();
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    let (mut outliers, mut swinging) = (0, 0);
    let mut swing = [0.0; 3];
    let (mut now, mut speed, mut place) = (0, [0.0; 3], [0.0; 3]);
    for k in 0..10_000 {
        let us = 1_000 + random.below(30_000) as u64;
        now += us;
        if k % 200 == 0 {
            speed = [0.0; 3].map(|_| random.between(-3.0, 3.0) * f64::from(k / 200 % 3 % 2));
        }
        for (place, speed) in place.iter_mut().zip(speed) {
            *place += speed * us as f64 * 1e-3;
        }
        // In every second thousand frames, the target swings as well.
        if k / 1_000 % 2 == 1 {
            let turn = now as f64 * 1e-6 * std::f64::consts::TAU;
            for (swing, per_s) in swing.iter_mut().zip([0.3, 1.0, 4.0]) {
                *swing = 40.0 * (turn * per_s).sin();
            }
        }
        let wild = if random.below(100) == 0 { 1_000.0 } else { 1.0 };
        let measurement = Measurement {
            capture: Instant::from_micros(now),
            position: std::array::from_fn(|i| fine(place[i] + swing[i] + wild * random.gaussian())),
            variance: [0.5 + random.unit() as f32; 3],
        };
        let arrived = Instant::from_micros(now + 20_000);
        let taken = pursuit.measure(arrived, &measurement, &[REACH; 3], &Settings::DEFAULT);
        outliers += u32::from(taken.is_err());
        let aims = pursuit.aim(arrived, &[REACH; 3], &Settings::DEFAULT);
        let mut aims = aims.expect("a target is in sight").to_vec();
        for tick in 1..us / 1_000 {
            let at = arrived.plus_micros(1_000 * tick);
            let stage = measurement.position;
            pursuit.work(&[REACH; 3]);
            let swings = pursuit.swing(at, stage, &[REACH; 3], &Settings::DEFAULT);
            aims.extend(swings.into_iter().flatten());
        }
        swinging += aims.len() - 3;
        for aim in aims {
            let words = [
                aim.position.cast_unsigned(),
                u64::from(aim.velocity.to_bits()),
            ];
            for byte in words.map(u64::to_le_bytes).as_flattened() {
                hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }
    println!("{outliers} outliers, {swinging} goals of oscillators, {hash:#018x}");
    assert!(swinging > 1_000);
    assert!((20..1_000).contains(&outliers));
    assert_eq!(hash, GOLDEN, "{hash:#018x}");
}

/// FNV-1a hash of all aims, computed on an x86-64.
const GOLDEN: u64 = 0xaab6_2cb0_2cc7_a925;
