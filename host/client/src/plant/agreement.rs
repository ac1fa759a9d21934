//! Agreement of planner, generator and plant: the motors get exactly the planned steps, at times
//! that their drivers accept.

use super::*;
use trinocular_core::motion::{AxisConfig, Limits, Planner};
use trinocular_core::steps::{Generator, Position};
use trinocular_rig::random::Random;

const MAP: PortMap = PortMap {
    step: [0, 1, 2],
    dir: [8, 9, 10],
    invert: [false, true, false],
};

/// Axis of 80 steps/mm, 100 mm/s, 1 m/s² and ±1 m.
const CONFIG: AxisConfig = AxisConfig {
    steps_per_m: 80_000,
    max_speed_um_s: 100_000,
    max_acceleration_um_s2: 1_000_000,
    max_jerk_um_s3: 50_000_000,
    travel_um: [-1_000_000, 1_000_000],
    invert: false,
};

struct Stage {
    planner: Planner,
    generator: Generator,
    plant: Plant,
    words: Vec<u32>,
}

impl Stage {
    fn new(configs: [AxisConfig; AXES], rate: WordRate) -> Self {
        let limits = Limits::new(&configs, rate).unwrap();
        Self {
            planner: Planner::new(limits, [Position::centre(0); AXES]),
            generator: Generator::new(MAP).unwrap(),
            plant: Plant::new(MAP, [80.0; AXES]),
            words: vec![0; 2 * usize::from(rate.slots_per_segment())],
        }
    }

    fn go_to(&mut self, steps: [i32; AXES]) {
        self.planner.set_target(steps.map(Position::centre));
    }

    /// Runs one tick from the planner through to the motors; the counts must agree at its end.
    /// Returns its words.
    fn tick(&mut self) -> Vec<u32> {
        let mut words = Vec::new();
        for segment in self.planner.plan_tick() {
            self.generator.load(&segment).unwrap();
            assert_eq!(self.generator.fill(&mut self.words), self.words.len());
            self.plant.feed(&self.words);
            words.extend_from_slice(&self.words);
            assert_eq!(self.plant.steps(), self.generator.emitted());
        }
        assert_eq!(self.generator.positions(), self.planner.positions());
        let floors = self.planner.positions().map(|p| i64::from(p.whole_steps()));
        assert_eq!(self.plant.steps(), floors);
        words
    }

    fn settle(&mut self) {
        for _ in 0..100_000 {
            if self.planner.has_arrived() {
                return;
            }
            self.tick();
        }
        panic!("never arrives");
    }
}

#[test]
fn random_retargets_match_plan() {
    let mut stage = Stage::new([CONFIG; AXES], WordRate::MHZ_1);
    let mut random = Random::seeded(7);
    let mut target = || std::array::from_fn(|_| (random.next_u64() % 4_000) as i32 - 2_000);
    for _ in 0..10_000 {
        stage.go_to(target());
        stage.tick();
    }
    stage.go_to([777, -1_500, 3]);
    stage.settle();
    assert_eq!(stage.plant.steps(), [777, -1_500, 3]);
    assert_eq!(stage.plant.stray_pins(), 0);
    let shortest = stage.plant.shortest();
    assert_eq!(shortest.step_high, Some(1));
    assert!(
        shortest.dir_setup >= Some(2) && shortest.dir_hold >= Some(2),
        "{shortest:?}"
    );
}

/// Worst case for a driver: random valid segments at every speed, which turn wherever they may.
#[test]
fn random_segments_keep_dir_times() {
    use trinocular_core::steps::{AxisMotion, Segment};
    let mut generator = Generator::new(MAP).unwrap();
    let mut plant = Plant::new(MAP, [1.0; AXES]);
    let mut words = [0; 512];
    let mut random = Random::seeded(3);
    let mut turns = 0;
    for _ in 0..20_000 {
        let slots = 2 + (random.next_u64() % 30) as u16;
        let motions = [(); AXES].map(|()| {
            // Up to half a step per slot, so that every segment may turn.
            let [first, last] = [(); 2].map(|()| (random.next_u64() % (1 << 31)) as i64);
            let change = (last - first) / i64::from(slots - 1);
            let backward = random.next_u64().is_multiple_of(2);
            AxisMotion {
                first: first as u32,
                change: change as i32,
                backward,
            }
        });
        turns += usize::from(motions[0].backward);
        generator
            .load(&Segment::new(slots, motions).unwrap())
            .unwrap();
        let made = generator.fill(&mut words);
        plant.feed(&words[..made]);
        assert_eq!(plant.steps(), generator.emitted());
    }
    assert!(turns > 5_000);
    let exact = Shortest {
        step_high: Some(1),
        step_low: Some(1),
        dir_setup: Some(2),
        dir_hold: Some(2),
    };
    // Reached, not only kept: the promise is sharp.
    assert_eq!(plant.shortest(), exact);
}

#[test]
fn three_axes_at_500_khz_are_exact() {
    let timing = DriverTiming::TMC2209;
    timing.check(WordRate::MHZ_1).unwrap();
    // 1,600 steps/mm at 312.5 mm/s: 500,000 steps/s.
    let config = AxisConfig {
        steps_per_m: 1_600_000,
        max_speed_um_s: 312_500,
        max_acceleration_um_s2: 20_000_000,
        max_jerk_um_s3: 1_000_000_000,
        ..CONFIG
    };
    let mut stage = Stage::new([config; AXES], WordRate::MHZ_1);
    stage.go_to([100_000, -100_000, 99_999]);
    let mut fullest = 0;
    while !stage.planner.has_arrived() {
        let before = stage.plant.steps();
        stage.tick();
        let made =
            std::array::from_fn::<_, AXES, _>(|i| stage.plant.steps()[i].abs_diff(before[i]));
        fullest = fullest.max(made.into_iter().min().unwrap_or(0));
    }
    // Three axes stepped in all 500 slots of a tick.
    assert_eq!(fullest, 500);
    assert_eq!(stage.plant.steps(), [100_000, -100_000, 99_999]);
    assert_eq!(stage.plant.violations(&timing, WordRate::MHZ_1), []);
    assert!(DriverTiming::DRV8825.check(WordRate::MHZ_1).is_err());
    assert!(
        !stage
            .plant
            .violations(&DriverTiming::DRV8825, WordRate::MHZ_1)
            .is_empty()
    );
}

#[test]
fn drivers_accept_highest_word_rate() {
    for (timing, hz) in [
        (DriverTiming::A4988, 1_000_000),
        (DriverTiming::DRV8825, 520_000),
        (DriverTiming::TMC2209, 10_000_000),
    ] {
        let rate = WordRate::from_hz(hz).unwrap();
        timing.check(rate).unwrap();
        // 8 kHz more and the driver is refused.
        assert!(
            timing
                .check(WordRate::from_hz(hz + 8_000).unwrap())
                .is_err()
        );
        let fast = AxisConfig {
            steps_per_m: 1_000_000,
            max_speed_um_s: rate.slots_per_s(),
            max_acceleration_um_s2: 500_000_000,
            max_jerk_um_s3: u32::MAX,
            ..CONFIG
        };
        let mut stage = Stage::new([fast; AXES], rate);
        let mut random = Random::seeded(u64::from(hz));
        for _ in 0..200 {
            stage.go_to(std::array::from_fn(|_| {
                (random.next_u64() % 2_000) as i32 - 1_000
            }));
            for _ in 0..5 {
                stage.tick();
            }
        }
        assert_eq!(stage.plant.violations(&timing, rate), []);
        let shortest = stage.plant.shortest();
        assert!(shortest.dir_setup.is_some() && shortest.dir_hold.is_some());
    }
}

/// Computes speed and acceleration from the times of the edges alone.
#[test]
fn edges_keep_the_limits() {
    let mut stage = Stage::new([CONFIG; AXES], WordRate::MHZ_1);
    stage.go_to([3_000, 0, 0]);
    let mut rises = Vec::new();
    let mut word = 0u64;
    while !stage.planner.has_arrived() {
        for value in stage.tick() {
            if value & 1 != 0 {
                rises.push(word as f64 * 1e-6);
            }
            word += 1;
        }
    }
    assert_eq!(rises.len(), 3_000);
    // An edge is at most one slot (2 µs) later than the position reached its step.
    let late = 2e-6;
    let fastest = rises
        .windows(2)
        .map(|w| 1.0 / (w[1] - w[0] + late))
        .fold(0.0, f64::max);
    assert!((7_800.0..=8_000.0).contains(&fastest), "{fastest} steps/s");
    // Second differences over 100 steps.
    for w in rises.windows(201) {
        let (t1, t2) = (w[100] - w[0], w[200] - w[100]);
        let change = (100.0 / t2 - 100.0 / t1).abs();
        let error = 2.0 * late * 8_000.0 * 8_000.0 / 100.0;
        assert!(
            (change - error) / (0.5 * (t1 + t2)) <= 80_000.0,
            "{change} steps/s in {t1} + {t2} s"
        );
    }
}

/// Measures the time from the tick that takes a new setpoint to the first STEP edge that the old
/// one would not have made.
#[test]
fn setpoint_takes_effect_within_2_ms() {
    // The segment queue and the word ring hold up to 1 ms that cannot be called back.
    let queue_us = 1_000;
    // 1,600 steps/mm, 312 mm/s, 10 m/s², 4,000 m/s³; and gentler.
    for (acceleration, jerk) in [(10_000_000, 4_000_000_000), (1_000_000, 50_000_000)] {
        let config = AxisConfig {
            steps_per_m: 1_600_000,
            max_speed_um_s: 312_000,
            max_acceleration_um_s2: acceleration,
            max_jerk_um_s3: jerk,
            ..CONFIG
        };
        for warm_up in [0, 10, 30, 100, 300] {
            let mut old = Stage::new([config; AXES], WordRate::MHZ_1);
            if warm_up > 0 {
                old.go_to([1_000_000; AXES]);
            }
            for _ in 0..warm_up {
                old.tick();
            }
            let mut new = Stage {
                planner: old.planner.clone(),
                generator: old.generator.clone(),
                plant: old.plant.clone(),
                words: old.words.clone(),
            };
            new.go_to([-30_000; AXES]);
            let mut words = 0;
            let first_us = loop {
                let (a, b) = (old.tick(), new.tick());
                if let Some(at) = a.iter().zip(&b).position(|(a, b)| (a ^ b) & 0b111 != 0) {
                    break words + at;
                }
                words += a.len();
            };
            println!(
                "{jerk} µm/s³, in motion for {warm_up} ms: first changed step after {first_us} µs \
                 + queue"
            );
            // From rest half a step must be made first: (6 · ½ / j)^(1/3), a whole tick at each
            // jerk.
            let half_step_us = 1e6 * (3.0 / (f64::from(jerk) * 1.6)).cbrt();
            let allowed = if warm_up == 0 {
                1.1 * half_step_us
            } else {
                1_000.0
            };
            assert!(first_us as f64 <= allowed, "{first_us} µs");
            assert!(
                jerk < 1_000_000_000 || first_us + queue_us <= 2_000,
                "{first_us} µs"
            );
        }
    }
}
