use proptest::prelude::*;

use super::*;
use crate::motion::AxisConfig;
use crate::steps::WordRate;

/// 80 steps/mm, 100 mm/s, 1 m/s², ±1 m.
const CONFIG: AxisConfig = AxisConfig {
    steps_per_m: 80_000,
    max_speed_um_s: 100_000,
    max_acceleration_um_s2: 1_000_000,
    max_jerk_um_s3: 50_000_000,
    travel_um: [-1_000_000, 1_000_000],
    invert: false,
};

fn planner(configs: [AxisConfig; AXES], rate: WordRate) -> Planner {
    Planner::new(
        Limits::new(&configs, rate).unwrap(),
        [Position::centre(0); AXES],
    )
}

fn centres(steps: [i32; AXES]) -> [Position; AXES] {
    steps.map(Position::centre)
}

/// Judges segments by the physical limits of the configuration, knowing nothing of the planner's grid.
struct Judge {
    configs: [AxisConfig; AXES],
    rate: WordRate,
    /// Twice the speed at the end of the last segment, fine units per slot: the middle between two slots is halved.
    ended: [i64; AXES],
    position: [Position; AXES],
}

impl Judge {
    fn new(configs: [AxisConfig; AXES], rate: WordRate) -> Self {
        Self {
            configs,
            rate,
            ended: [0; AXES],
            position: [Position::centre(0); AXES],
        }
    }

    fn see(&mut self, segment: &Segment) {
        let slots = i64::from(segment.slots());
        let ways = segment.displacement();
        for (axis, motion) in segment.axes().iter().enumerate() {
            let sign = if motion.backward { -1 } else { 1 };
            let first = i64::from(motion.first);
            let change = i64::from(motion.change);
            // Speeds half a slot before the first increment and half a slot after the last one.
            let starts = sign * (2 * first - change);
            let ends = sign * (2 * first + (2 * slots - 1) * change);
            assert_eq!(starts, self.ended[axis], "the speed jumps on axis {axis}");
            assert!(sign * ends >= 0, "turns within the segment");

            let config = self.configs[axis];
            let slot_rate = f64::from(self.rate.slots_per_s());
            let fine_per_m = f64::from(config.steps_per_m) * 4_294_967_296.0;
            let speed_um_s = ends as f64 / 2.0 * slot_rate / fine_per_m * 1e6;
            let acceleration_um_s2 =
                (sign * change) as f64 * slot_rate * slot_rate / fine_per_m * 1e6;
            assert!(
                speed_um_s.abs() <= f64::from(config.max_speed_um_s),
                "{speed_um_s} µm/s"
            );
            let most = f64::from(config.max_acceleration_um_s2);
            assert!(
                acceleration_um_s2.abs() <= most,
                "{acceleration_um_s2} µm/s²"
            );

            self.ended[axis] = ends;
            self.position[axis] = self.position[axis].saturating_add(ways[axis]);
        }
    }
}

/// Runs until nothing moves any more and returns the segments it took.
fn run(planner: &mut Planner, judge: &mut Judge) -> u32 {
    for n in 0.. {
        assert!(n < 10_000_000, "never arrives");
        let segment = planner.plan_segment();
        judge.see(&segment);
        assert_eq!(judge.position, planner.positions());
        if segment.displacement() == [0; AXES] && planner.is_at_rest() {
            return n;
        }
    }
    unreachable!()
}

fn rates() -> impl Strategy<Value = WordRate> {
    (4..=2_000u32).prop_map(|slots| WordRate::from_hz(8_000 * slots).unwrap())
}

/// Configurations the word rate allows, from crawling to one step per slot.
fn configs() -> impl Strategy<Value = (WordRate, [AxisConfig; AXES])> {
    (
        rates(),
        prop::array::uniform3((1_000..1_000_000u32, 1..1_000u32, 1..10_000u32)),
    )
        .prop_map(|(rate, raw)| {
            let configs = raw.map(|(steps_per_m, speed, stop_ms)| {
                let most = u64::from(rate.slots_per_s()) * 1_000_000 / u64::from(steps_per_m);
                let max_speed_um_s =
                    (most * u64::from(speed) / 1_000).clamp(1, u64::from(u32::MAX)) as u32;
                let acceleration = u64::from(max_speed_um_s) * 1_000 / u64::from(stop_ms);
                AxisConfig {
                    steps_per_m,
                    max_speed_um_s,
                    max_acceleration_um_s2: acceleration.clamp(1, u64::from(u32::MAX)) as u32,
                    ..CONFIG
                }
            });
            (rate, configs)
        })
}

proptest! {
    #[test]
    fn next_speed_is_the_largest_that_can_stop(
        acceleration in 1..2_000u32, speed in 1..3_000u32, now in 0..3_000u32, ahead in -10..60_000i64,
    ) {
        let pace = Pace { speed, acceleration };
        let slow_stop = |mut m: u32| {
            let mut way = 0;
            while m > 0 {
                let next = m.saturating_sub(acceleration);
                way += i64::from(m) + i64::from(next);
                m = next;
            }
            way
        };
        prop_assert_eq!(pace.stopping_distance(now), slow_stop(now));
        let slowest = now.saturating_sub(acceleration);
        let fastest = (now + acceleration).min(speed).max(slowest);
        let can_stop = |m: &u32| i64::from(now + m) + slow_stop(*m) <= ahead;
        let expected = (slowest..=fastest).rev().find(can_stop).unwrap_or(slowest);
        prop_assert_eq!(pace.next_speed(now, ahead), expected);
    }

    #[test]
    fn every_move_ends_in_its_step_within_limits_and_without_overshoot(
        (rate, configs) in configs(), targets: [i16; AXES], in_step: bool,
    ) {
        let Ok(limits) = Limits::new(&configs, rate) else { return Ok(()) };
        let mut planner = Planner::new(limits, centres([0; AXES]));
        let mut judge = Judge::new(configs, rate);
        let targets = targets.map(i32::from);
        if in_step {
            planner.move_in_step(centres(targets));
        } else {
            planner.set_target(centres(targets));
        }
        let goals: [i32; AXES] = core::array::from_fn(|i| {
            let [low, high] = limits.axes()[i].range();
            targets[i].clamp(low, high)
        });
        let mut segments = 0;
        loop {
            let segment = planner.plan_segment();
            judge.see(&segment);
            for ((goal, motion), position) in goals.iter().zip(segment.axes()).zip(judge.position) {
                prop_assert!(motion.is_rest() || motion.backward == (*goal < 0), "overshoot");
                let [near, far] = [Position::centre(0).min(Position::centre(*goal)), Position::centre(0).max(Position::centre(*goal))];
                prop_assert!(near <= position && position <= far);
            }
            segments += 1;
            if segment.displacement() == [0; AXES] {
                break;
            }
            prop_assert!(segments < 3_000_000);
        }
        prop_assert!(planner.has_arrived());
        prop_assert_eq!(planner.positions().map(Position::whole_steps), goals);
    }

    #[test]
    fn nothing_panics_for_any_numbers(
        raw in prop::array::uniform3((any::<u32>(), any::<u32>(), any::<u32>(), any::<[i32; 2]>())),
        hz: u32,
        starts in prop::array::uniform3(any::<i64>()),
        inputs in prop::collection::vec((0..5u8, prop::array::uniform3(any::<i64>()), prop::array::uniform3(any::<i64>())), 1..40),
    ) {
        let configs = raw.map(|(steps_per_m, max_speed_um_s, max_acceleration_um_s2, travel_um)| AxisConfig {
            steps_per_m, max_speed_um_s, max_acceleration_um_s2, travel_um, ..CONFIG
        });
        let rate = WordRate::from_hz(hz).unwrap_or(WordRate::MHZ_1);
        let mut limits = Limits::new(&[CONFIG; AXES], WordRate::MHZ_1).unwrap();
        if let Ok(wild) = Limits::new(&configs, rate) {
            limits = wild;
        }
        let mut planner = Planner::new(limits, starts.map(Position::from_fine));
        for (kind, targets, speeds) in inputs {
            let targets = targets.map(Position::from_fine);
            match kind {
                0 => planner.set_target(targets),
                1 => planner.follow(targets, speeds),
                2 => planner.move_in_step(targets),
                3 => planner.stop(),
                _ => planner.resume_at(targets),
            }
            for _ in 0..8 {
                planner.plan_segment();
            }
            planner.has_arrived();
            planner.stopping_ways();
        }
    }

    #[test]
    fn following_anything_keeps_all_limits(
        (rate, configs) in configs(),
        inputs in prop::collection::vec((prop::array::uniform3(-1_000..1_000i32), prop::array::uniform3(any::<i32>()), 1..300u32), 1..30),
    ) {
        let configs = configs.map(|config| AxisConfig { travel_um: [-1_000_000_000 / config.steps_per_m as i32 - 1, 500_000_000 / config.steps_per_m as i32 + 1], ..config });
        let Ok(limits) = Limits::new(&configs, rate) else { return Ok(()) };
        let mut planner = Planner::new(limits, centres([0; AXES]));
        let mut judge = Judge::new(configs, rate);
        for (targets, speeds, segments) in inputs {
            planner.follow(centres(targets), speeds.map(i64::from));
            for _ in 0..segments {
                judge.see(&planner.plan_segment());
                for (position, limits) in judge.position.iter().zip(limits.axes()) {
                    let [low, high] = limits.ends();
                    prop_assert!((low..=high).contains(position));
                }
            }
        }
    }

    #[test]
    fn stop_takes_the_way_it_says_and_no_longer_than_the_bound(
        (rate, configs) in configs(), target: i16, segments in 0..2_000usize,
    ) {
        let Ok(limits) = Limits::new(&configs, rate) else { return Ok(()) };
        let mut planner = Planner::new(limits, centres([0; AXES]));
        let mut judge = Judge::new(configs, rate);
        planner.set_target(centres([i32::from(target); AXES]));
        for _ in 0..segments {
            judge.see(&planner.plan_segment());
        }
        let speeds = planner.speeds();
        let ways = planner.stopping_ways();
        let before = planner.positions();
        planner.stop();
        run(&mut planner, &mut judge);
        let slots = i128::from(rate.slots_per_segment());
        for axis in 0..AXES {
            let gone = planner.positions()[axis].fine() - before[axis].fine();
            prop_assert_eq!(gone, ways[axis]);
            // In segments as the unit of time: v² / 2a + a / 8.
            let v = i128::from(speeds[axis].unsigned_abs()) * slots;
            let a = i128::from(limits.accelerations()[axis]) * slots;
            prop_assert!(i128::from(gone.unsigned_abs()) <= v * v / (2 * a) + a / 8 + 1);
        }
    }
}

#[test]
fn ten_thousand_retargets_at_1_khz_end_exactly() {
    let configs = [CONFIG; AXES];
    let mut planner = planner(configs, WordRate::MHZ_1);
    let mut judge = Judge::new(configs, WordRate::MHZ_1);
    let mut seed = 1u64;
    let mut random = move || {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (seed >> 40) as i32 % 4_000 - 2_000
    };
    let mut turns = 0;
    for _ in 0..10_000 {
        planner.set_target([random(), random(), random()].map(Position::centre));
        for _ in 0..4 {
            let segment = planner.plan_segment();
            turns += usize::from(segment.axes()[0].backward);
            judge.see(&segment);
        }
    }
    // It really went to and fro.
    assert!((5_000..35_000).contains(&turns), "{turns}");
    planner.set_target(centres([1_234, -4_321, 0]));
    run(&mut planner, &mut judge);
    assert!(planner.has_arrived());
    assert_eq!(
        judge.position.map(Position::whole_steps),
        [1_234, -4_321, 0]
    );
}

/// Within three segments of the continuous optimum `d/v + v/a` or `2 sqrt(d/a)`, where quantisation of the limits
/// (at most 1/68 of the acceleration here) is allowed for.
#[test]
fn moves_take_the_optimal_time() {
    for steps in [1, 2, 10, 100, 639, 641, 5_000, 80_000] {
        let mut planner = planner([CONFIG; AXES], WordRate::MHZ_1);
        let mut judge = Judge::new([CONFIG; AXES], WordRate::MHZ_1);
        planner.set_target(centres([steps, 0, -steps]));
        let segments = f64::from(run(&mut planner, &mut judge));
        let (v, a, d) = (8_000.0, 80_000.0, f64::from(steps));
        let optimum_s: f64 = if d >= v * v / a {
            d / v + v / a
        } else {
            2.0 * (d / a).sqrt()
        };
        let optimum = optimum_s * 4_000.0;
        assert!(
            segments >= optimum - 1.0,
            "{steps} steps: {segments} segments, optimum {optimum}"
        );
        assert!(
            segments <= optimum * 1.0075 + 3.0,
            "{steps} steps: {segments} segments, optimum {optimum}"
        );
    }
}

#[test]
fn a_target_inside_the_braking_way_is_overrun_and_come_back_to() {
    let configs = [CONFIG; AXES];
    let mut planner = planner(configs, WordRate::MHZ_1);
    let mut judge = Judge::new(configs, WordRate::MHZ_1);
    planner.set_target(centres([10_000; AXES]));
    for _ in 0..800 {
        judge.see(&planner.plan_segment());
    }
    let here = planner.positions()[0].whole_steps();
    let way = (planner.stopping_ways()[0] >> 32) as i32;
    assert!(way > 390, "{way}");
    planner.set_target(centres([here + 10; AXES]));
    let mut farthest = here;
    while !planner.has_arrived() {
        judge.see(&planner.plan_segment());
        farthest = farthest.max(planner.positions()[0].whole_steps());
    }
    // Not a step farther than braking takes.
    assert!((here + way..=here + way + 1).contains(&farthest));
    assert_eq!(planner.positions()[0].whole_steps(), here + 10);
}

#[test]
fn soft_limits_clamp_targets_and_following() {
    let configs = [AxisConfig {
        travel_um: [-1_000, 2_500],
        ..CONFIG
    }; AXES];
    let mut planner = planner(configs, WordRate::MHZ_1);
    let mut judge = Judge::new(configs, WordRate::MHZ_1);
    planner.set_target([
        Position::from_fine(i64::MAX),
        Position::from_fine(i64::MIN),
        Position::centre(200),
    ]);
    run(&mut planner, &mut judge);
    assert_eq!(
        planner.positions().map(Position::whole_steps),
        [200, -80, 200]
    );
    planner.follow(centres([0; AXES]), [-1 << 26, 1 << 26, i64::MAX]);
    for _ in 0..4_000 {
        judge.see(&planner.plan_segment());
        for position in judge.position {
            assert!((Position::centre(-80)..=Position::centre(200)).contains(&position));
        }
    }
    assert_eq!(
        planner.positions().map(Position::whole_steps),
        [-80, 200, 200]
    );
}

#[test]
fn following_a_moving_target_has_no_lag() {
    let configs = [CONFIG; AXES];
    let mut planner = planner(configs, WordRate::MHZ_1);
    let mut judge = Judge::new(configs, WordRate::MHZ_1);
    // 50 mm/s, not a multiple of the speed quantum; a new prediction each tick.
    let speed = 4_000 * (1i64 << 32) / 500_000;
    let per_tick = speed * 500;
    let mut target = Position::centre(0);
    let mut worst = 0;
    for tick in 0..1_000 {
        planner.follow([target; AXES], [speed; AXES]);
        if tick > 300 {
            worst = worst.max((target.fine() - planner.positions()[0].fine()).abs());
        }
        for _ in 0..4 {
            judge.see(&planner.plan_segment());
        }
        target = target.saturating_add(per_tick);
    }
    // A hundredth of a step.
    assert!(
        worst * 100 < 1 << 32,
        "lag {} step",
        worst as f64 / 4_294_967_296.0
    );
}

#[test]
fn axes_in_step_stay_on_the_line_and_arrive_together() {
    let fast = AxisConfig {
        max_speed_um_s: 200_000,
        max_acceleration_um_s2: 3_000_000,
        ..CONFIG
    };
    let configs = [CONFIG, fast, CONFIG];
    let mut planner = planner(configs, WordRate::MHZ_1);
    let mut judge = Judge::new(configs, WordRate::MHZ_1);
    let targets = [4_000, -3_000, 1_000];
    planner.move_in_step(centres(targets));
    let mut arrival = [0; AXES];
    let mut worst: f64 = 0.0;
    for n in 0..10_000 {
        let segment = planner.plan_segment();
        judge.see(&segment);
        let part = |axis: usize| {
            (judge.position[axis].fine() - (1 << 31)) as f64
                / 4_294_967_296.0
                / f64::from(targets[axis])
        };
        for (axis, arrival) in arrival.iter_mut().enumerate() {
            if !segment.axes()[axis].is_rest() {
                *arrival = n;
            }
            worst = worst.max((part(axis) - part(0)).abs());
        }
    }
    assert!(planner.has_arrived());
    let [first, last] = [arrival.iter().min().unwrap(), arrival.iter().max().unwrap()];
    std::println!(
        "arrivals {arrival:?} segments, farthest from the line {:.3} % of the way",
        100.0 * worst
    );
    assert!(last - first <= last / 100, "{arrival:?}");
    assert!(worst < 0.01, "{worst}");
    // Once moving, each goes on its own.
    planner.move_in_step(centres([0, 0, 0]));
    judge.see(&planner.plan_segment());
    planner.move_in_step(centres([0, -2_000, 0]));
    run(&mut planner, &mut judge);
    assert_eq!(judge.position.map(Position::whole_steps), [0, -2_000, 0]);
}
