//! Random configurations, from usual ones to invalid ones.

use crate::random::Random;
use trinocular_core::estimate::Gate;
use trinocular_core::frame::message::{
    Config, HomeSwitch, MATRIX_BITS, Mounting, Side, StageConfig,
};
use trinocular_core::motion::AxisConfig;
use trinocular_core::steps::{DriverTiming, WordRate};
use trinocular_core::track::pursuit::Settings;

/// The value 1 in the fixed-point format of the matrix.
pub const ONE: i32 = 1 << MATRIX_BITS;

/// Returns a stage like the project's default: 80 steps/mm, 100 mm/s, 2 m/s², ±60 mm.
pub fn usual() -> Config {
    let axis = AxisConfig {
        steps_per_m: 80_000,
        max_speed_um_s: 100_000,
        max_acceleration_um_s2: 2_000_000,
        max_jerk_um_s3: 50_000_000,
        travel_um: [-60_000, 60_000],
        invert: false,
    };
    Config {
        axes: [axis; 3],
        matrix: [[ONE, 0, 0], [0, ONE, 0], [0, 0, ONE]],
        driver: DriverTiming::TMC2209,
        gate: Gate::DEFAULT,
        heartbeat_ms: 100,
        slow_speed_um_s: 5_000,
        mounting: Mounting::OnStage,
        tracking: Settings::DEFAULT,
        stage: StageConfig::DEFAULT,
    }
}

/// Returns a usual stage that even the slowest word rate can drive.
pub fn modest() -> Config {
    let mut config = usual();
    for axis in &mut config.axes {
        axis.max_speed_um_s = 50_000;
    }
    config
}

/// Returns a random word rate, Hz.
pub fn word_rate(random: &mut Random) -> WordRate {
    let hz = match random.below(3) {
        0 => 1_000_000,
        1 => random.pick(&[64_000, 128_000, 256_000, 512_000]),
        _ => 8_000 * (8 + random.below(118) as u32),
    };
    WordRate::from_hz(hz).expect("a multiple of 8 kHz")
}

/// Returns a configuration that is mostly possible at this word rate.
pub fn likely(random: &mut Random, rate: WordRate) -> Config {
    let mut config = usual();
    let same = random.one_in(2);
    let first = likely_axis(random, rate);
    config.axes = std::array::from_fn(|_| match same {
        true => first,
        false => likely_axis(random, rate),
    });
    if random.one_in(3) {
        config.matrix = turned(random);
    }
    config.driver = driver(random, rate);
    config.heartbeat_ms = random.pick(&[20, 50, 100, 100, 100, 300, 1000]);
    config.slow_speed_um_s = random.decades(500.0, 30_000.0) as u32;
    config.mounting = random.pick(&[Mounting::OnStage, Mounting::OnStage, Mounting::Fixed]);
    config.tracking.prediction = !random.one_in(4);
    config.tracking.coast_ms = random.decades(10.0, 5_000.0) as u16;
    config.stage = likely_stage(random);
    config
}

fn likely_axis(random: &mut Random, rate: WordRate) -> AxisConfig {
    let steps_per_m = random.decades(4_000.0, 3_200_000.0);
    // Limit of the word rate, steps/s.
    let fastest = f64::from(rate.slots_per_s()) / steps_per_m * 1e6 * 0.99;
    let speed = random.decades(100.0, 300_000.0).min(fastest).max(1.0);
    let acceleration = speed * random.decades(1.0, 200.0);
    let low = -random.decades(500.0, 300_000.0);
    let high = random.decades(500.0, 300_000.0);
    let shift = match random.below(8) {
        // Travel that excludes zero.
        0 => high - low,
        1 => low - high,
        _ => 0.0,
    };
    AxisConfig {
        steps_per_m: steps_per_m as u32,
        max_speed_um_s: speed as u32,
        max_acceleration_um_s2: acceleration.max(1_000.0) as u32,
        max_jerk_um_s3: (acceleration * random.decades(5.0, 500.0)).clamp(1e6, 4e9) as u32,
        travel_um: [low + shift, high + shift].map(|um| um as i32),
        invert: random.one_in(3),
    }
}

fn driver(random: &mut Random, rate: WordRate) -> DriverTiming {
    let kinds = [
        DriverTiming::A4988,
        DriverTiming::DRV8825,
        DriverTiming::TMC2209,
    ];
    let word_ns = 1e9 / f64::from(rate.hz());
    match random.below(4) {
        3 => {
            // Up to exactly the limit of the word rate.
            let mut ns = |words: f64| (word_ns * words * random.unit()) as u32;
            DriverTiming {
                step_high_ns: ns(1.0),
                step_low_ns: ns(1.0),
                dir_setup_ns: ns(2.0),
                dir_hold_ns: ns(1.0),
            }
        }
        _ => random.pick(&kinds),
    }
}

fn likely_stage(random: &mut Random) -> StageConfig {
    let mut stage = StageConfig::DEFAULT;
    if random.one_in(3) {
        stage.backlash_um = std::array::from_fn(|_| random.below(200) as u16);
    }
    if random.one_in(2) {
        stage.home = std::array::from_fn(|_| {
            (!random.one_in(4)).then(|| HomeSwitch {
                side: random.pick(&[Side::Negative, Side::Positive]),
                position_um: random.range(-50_000.0, 50_000.0) as i32,
            })
        });
    }
    stage.home_speed_um_s = [
        random.decades(1_000.0, 50_000.0),
        random.decades(100.0, 5_000.0),
    ]
    .map(|v| v as u32);
    stage.back_off_um = random.decades(50.0, 5_000.0) as u32;
    stage.window_um = random.decades(50.0, 20_000.0) as u32;
    if random.one_in(4) {
        stage.largest_error_um = random.decades(50.0, 50_000.0) as u32;
        stage.longest_error_ms = random.decades(1.0, 2_000.0) as u16;
    }
    if random.one_in(10) {
        stage.motors_off_after_s = 1;
    }
    if random.one_in(3) {
        stage.unseen_um = random.decades(100.0, 20_000.0) as u32;
    }
    stage
}

/// Returns a scaled rotation about a random axis.
fn turned(random: &mut Random) -> [[i32; 3]; 3] {
    let axis: [f64; 3] = std::array::from_fn(|_| random.normal());
    let matrix = rotation(axis, random.range(-3.2, 3.2));
    let scale = random.decades(0.3, 1.7) * f64::from(ONE);
    matrix.map(|row| row.map(|element| (element * scale) as i32))
}

/// Returns the rotation by `angle` about `axis` (Rodrigues).
pub fn rotation(axis: [f64; 3], angle: f64) -> [[f64; 3]; 3] {
    let length = axis.iter().map(|a| a * a).sum::<f64>().sqrt().max(1e-9);
    let [x, y, z] = axis.map(|a| a / length);
    let (sine, cosine) = angle.sin_cos();
    let rest = 1.0 - cosine;
    [
        [
            cosine + x * x * rest,
            x * y * rest - z * sine,
            x * z * rest + y * sine,
        ],
        [
            y * x * rest + z * sine,
            cosine + y * y * rest,
            y * z * rest - x * sine,
        ],
        [
            z * x * rest - y * sine,
            z * y * rest + x * sine,
            cosine + z * z * rest,
        ],
    ]
}

/// Returns any configuration: a likely one with some fields replaced by random values.
pub fn wild(random: &mut Random, rate: WordRate) -> Config {
    let mut config = likely(random, rate);
    for _ in 0..=random.below(3) {
        let axis = &mut config.axes[random.below(3) as usize];
        let any = match random.below(4) {
            0 => random.pick(&[0, 1, 2, u32::MAX, u32::MAX - 1, 1 << 31]),
            _ => random.decades(1.0, 4.29e9) as u32,
        };
        match random.below(16) {
            0 => axis.steps_per_m = any,
            1 => axis.max_speed_um_s = any,
            2 => axis.max_acceleration_um_s2 = any,
            3 => axis.max_jerk_um_s3 = any,
            4 => axis.travel_um = [random.bits() as i32, random.bits() as i32],
            5 => axis.travel_um = [0, any as i32],
            6 => {
                config.matrix =
                    std::array::from_fn(|_| std::array::from_fn(|_| random.bits() as i32))
            }
            7 => config.matrix = [[0; 3]; 3],
            8 => config.heartbeat_ms = any as u16,
            9 => config.slow_speed_um_s = any,
            10 => config.tracking.coast_ms = any as u16,
            11 => config.stage.backlash_um = [any as u16; 3],
            12 => config.stage.back_off_um = any,
            13 => config.stage.window_um = any,
            14 => config.stage.home_speed_um_s = [any, random.bits() as u32],
            _ => {
                config.gate.max_displacement_nm = any;
                config.gate.min_points = any as u16;
            }
        }
    }
    config
}
