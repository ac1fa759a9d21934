// Tens of thousands of moves: too many for an interpreter.
#[cfg(not(miri))]
mod backlash;
mod by_the_book;
mod judge;
#[cfg(not(miri))]
mod optimal;

use proptest::prelude::*;

use super::*;
use crate::motion::AxisConfig;
use crate::steps::WordRate;
use judge::Judge;

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

/// Runs until the target is reached and returns the ticks it took.
fn run(planner: &mut Planner, judge: &mut Judge) -> u32 {
    for n in 0..2_000_000 {
        if planner.has_arrived() {
            return n;
        }
        judge.tick(planner);
    }
    panic!("never arrives");
}

/// Generates rates up to 16 MHz, mostly low ones: the grid gets coarser with the square of the
/// rate, and refuses gentle limits.
fn rates() -> impl Strategy<Value = WordRate> {
    prop_oneof![3 => 4..=200u32, 1 => 4..=2_000u32]
        .prop_map(|slots| WordRate::from_hz(8_000 * slots).unwrap())
}

/// Generates configurations that the word rate allows, from very slow ones to one step per slot.
fn configs() -> impl Strategy<Value = (WordRate, [AxisConfig; AXES], Limits)> {
    let axis = (1_000..1_000_000u32, 1..=1_000u32, 1..1_000u32, 1..100u32);
    (rates(), prop::array::uniform3(axis)).prop_filter_map(
        "too gentle for the grid",
        |(rate, raw)| {
            let configs = raw.map(|(steps_per_m, speed, stop_ms, ease_ms)| {
                let clamp = |value: u64| value.clamp(1, u64::from(u32::MAX)) as u32;
                let most = u64::from(rate.slots_per_s()) * 1_000_000 / u64::from(steps_per_m);
                let max_speed_um_s = clamp(most * u64::from(speed) / 1_000);
                let max_acceleration_um_s2 =
                    clamp(u64::from(max_speed_um_s) * 1_000 / u64::from(stop_ms));
                AxisConfig {
                    steps_per_m,
                    max_speed_um_s,
                    max_acceleration_um_s2,
                    max_jerk_um_s3: clamp(
                        u64::from(max_acceleration_um_s2) * 1_000 / u64::from(ease_ms),
                    ),
                    travel_um: [
                        -2_000_000_000 / steps_per_m as i32,
                        2_000_000_000 / steps_per_m as i32,
                    ],
                    invert: false,
                }
            });
            Limits::new(&configs, rate)
                .ok()
                .map(|limits| (rate, configs, limits))
        },
    )
}

/// Random numbers from a seed.
struct Random(u64);

impl Random {
    /// Returns a number between -1 and 1.
    fn uniform(&mut self) -> f64 {
        let next = self.0.wrapping_mul(6_364_136_223_846_793_005);
        self.0 = next.wrapping_add(1_442_695_040_888_963_407);
        f64::from((self.0 >> 32) as u32) / 2_147_483_648.0 - 1.0
    }
}

proptest! {
    #[test]
    fn moves_end_exactly_without_overshoot(
        (rate, configs, limits) in configs(), targets: [i16; AXES], in_step: bool,
    ) {
        let mut planner = Planner::new(limits, centres([0; AXES]));
        let mut judge = Judge::new(configs, rate);
        let targets = targets.map(i32::from);
        if in_step {
            judge.quanta = 4;
            planner.move_in_step(centres(targets).map(Some));
        } else {
            planner.set_target(centres(targets));
        }
        let goals: [i32; AXES] = core::array::from_fn(|i| {
            let [low, high] = limits.axes()[i].range();
            targets[i].clamp(low, high)
        });
        let mut ticks = 0;
        while !planner.has_arrived() {
            for segment in planner.plan_tick() {
                judge.see(&segment);
                for (i, (goal, motion)) in goals.iter().zip(segment.axes()).enumerate() {
                    let (start, goal) = (Position::centre(0), Position::centre(*goal));
                    let position = judge.position[i];
                    if in_step {
                        // Rounding of shares and their last correction.
                        let slack = 4 * i64::from(rate.slots_per_tick()).pow(2);
                        prop_assert!(start.min(goal).saturating_add(-slack) <= position);
                        prop_assert!(position <= start.max(goal).saturating_add(slack));
                    } else {
                        let approaches = motion.is_rest() || motion.backward == (goal < start);
                        prop_assert!(approaches, "overshoot");
                        prop_assert!(start.min(goal) <= position && position <= start.max(goal));
                    }
                }
            }
            ticks += 1;
            prop_assert!(ticks < 2_000_000);
        }
        prop_assert_eq!(planner.positions().map(Position::whole_steps), goals);
        let arrived = planner.positions();
        for _ in 0..10 {
            judge.tick(&mut planner);
        }
        // Less than the quanta that the planner calls near.
        for (before, after) in arrived.iter().zip(planner.positions()) {
            prop_assert!(before.fine().abs_diff(after.fine()) < 1 << 29);
        }
    }

    #[test]
    fn nothing_panics_for_any_numbers(
        raw in prop::array::uniform3((any::<[u32; 4]>(), any::<[i32; 2]>())),
        hz: u32,
        starts in prop::array::uniform3(any::<i64>()),
        inputs in prop::collection::vec(
            (
                0..5u8,
                prop::array::uniform3(any::<i64>()),
                prop::array::uniform3(any::<i64>()),
            ),
            1..40,
        ),
    ) {
        let configs = raw.map(|([steps_per_m, speed, acceleration, jerk], travel_um)| AxisConfig {
            steps_per_m,
            max_speed_um_s: speed,
            max_acceleration_um_s2: acceleration,
            max_jerk_um_s3: jerk,
            travel_um,
            invert: false,
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
                2 => planner.move_in_step(targets.map(Some)),
                3 => planner.stop(),
                _ => planner = Planner::new(*planner.limits(), targets),
            }
            for _ in 0..3 {
                planner.plan_tick();
            }
            planner.has_arrived();
            planner.stopping_distances();
        }
    }

    #[test]
    fn following_keeps_all_limits(
        (rate, configs, _) in configs(),
        inputs in prop::collection::vec(
            (
                prop::array::uniform3(-1_000..1_000i32),
                prop::array::uniform3(any::<i32>()),
                1..100u32,
                any::<bool>(),
            ),
            1..30,
        ),
    ) {
        let travel = |config: AxisConfig| {
            let steps = |n: i32| (i64::from(n) * 1_000_000 / i64::from(config.steps_per_m)) as i32;
            AxisConfig { travel_um: [steps(-1_000) - 1, steps(500) + 1], ..config }
        };
        let configs = configs.map(travel);
        let limits = Limits::new(&configs, rate).unwrap();
        let mut planner = Planner::new(limits, centres([0; AXES]));
        let mut judge = Judge::new(configs, rate);
        for (targets, speeds, ticks, still) in inputs {
            planner.follow(centres(targets), if still { [0; AXES] } else { speeds.map(i64::from) });
            for _ in 0..ticks {
                judge.tick(&mut planner);
                for (position, limits) in judge.position.iter().zip(limits.axes()) {
                    let [low, high] = limits.ends();
                    prop_assert!((low..=high).contains(position));
                }
            }
        }
    }

    #[test]
    fn stop_keeps_distance_and_time_bound(
        (rate, configs, limits) in configs(), target: i16, ticks in 0..500usize,
    ) {
        let mut planner = Planner::new(limits, centres([0; AXES]));
        let mut judge = Judge::new(configs, rate);
        planner.set_target(centres([i32::from(target); AXES]));
        for _ in 0..ticks {
            judge.tick(&mut planner);
        }
        let sign = if target < 0 { -1.0 } else { 1.0 };
        let speeds = planner.speeds();
        let accelerations = planner.axes.map(|axis| axis.acceleration);
        let ways = planner.stopping_distances();
        let before = planner.positions();
        planner.stop();
        run(&mut planner, &mut judge);
        // In fine units and ticks.
        let slots = f64::from(rate.slots_per_tick());
        for axis in 0..AXES {
            let gone = planner.positions()[axis].fine() - before[axis].fine();
            prop_assert_eq!(gone, ways[axis]);
            let v = sign * speeds[axis] as f64 * slots;
            let a0 = (sign * accelerations[axis] as f64 * 2.0 * slots * slots).max(0.0);
            let a = f64::from(limits.accelerations()[axis]) * slots;
            let j = f64::from(limits.jerks()[axis]) * slots;
            let v1 = v + a0 * a0 / (2.0 * j);
            let rise = v * a0 / j + a0 * a0 * a0 / (3.0 * j * j);
            let bound = rise + v1 / 2.0 * (v1 / a + a / j) + v1 + a;
            prop_assert!(sign * gone as f64 <= bound, "{} {}", gone, bound);
        }
    }
}

#[test]
fn retargets_at_1_khz_end_exactly() {
    let configs = [CONFIG; AXES];
    let mut planner = planner(configs, WordRate::MHZ_1);
    let mut judge = Judge::new(configs, WordRate::MHZ_1);
    let mut random = Random(1);
    let mut random = || (2_000.0 * random.uniform()) as i32;
    let mut turns = 0;
    for _ in 0..10_000 {
        planner.set_target([random(), random(), random()].map(Position::centre));
        for segment in planner.plan_tick() {
            turns += usize::from(segment.axes()[0].backward);
            judge.see(&segment);
        }
    }
    // The motor really reversed often.
    assert!((5_000..35_000).contains(&turns), "{turns}");
    planner.set_target(centres([1_234, -4_321, 0]));
    run(&mut planner, &mut judge);
    assert!(planner.has_arrived());
    assert_eq!(
        judge.position.map(Position::whole_steps),
        [1_234, -4_321, 0]
    );
}

#[test]
fn state_follows_the_segments() {
    let mut planner = planner([CONFIG; AXES], WordRate::MHZ_1);
    planner.set_target(centres([100, -100, 7]));
    let mut positions = planner.positions();
    for n in 0..400 {
        if n % 7 == 3 {
            // In the middle of a tick: takes effect with the next one.
            planner.set_target(centres([n, -n, 3]));
        }
        let segment = planner.plan_segment();
        for (axis, way) in segment.displacement().into_iter().enumerate() {
            positions[axis] = positions[axis].saturating_add(way);
            let motion = segment.axes()[axis];
            // Half a slot after the last increment, unless the axis reversed.
            let last = 2 * i64::from(motion.first) + 249 * i64::from(motion.change);
            let speed = planner.speeds()[axis];
            if motion.change != 0 {
                assert_eq!(2 * speed, if motion.backward { -last } else { last });
            }
        }
        assert_eq!(planner.positions(), positions);
    }
    // An abrupt stop drops what is left of the tick.
    planner = planner.relimited(*planner.limits());
    assert!(planner.is_at_rest() && planner.has_arrived());
    assert_eq!(planner.plan_segment(), Segment::pause(125));
}

#[test]
fn target_too_close_is_overshot() {
    let configs = [CONFIG; AXES];
    let mut planner = planner(configs, WordRate::MHZ_1);
    let mut judge = Judge::new(configs, WordRate::MHZ_1);
    planner.set_target(centres([10_000; AXES]));
    for _ in 0..200 {
        judge.tick(&mut planner);
    }
    let here = planner.positions()[0].whole_steps();
    let way = (planner.stopping_distances()[0] >> 32) as i32;
    assert!(way > 390, "{way}");
    planner.set_target(centres([here + 10; AXES]));
    let mut farthest = here;
    while !planner.has_arrived() {
        judge.tick(&mut planner);
        farthest = farthest.max(planner.positions()[0].whole_steps());
    }
    // Shorter than the braking distance, because the axis keeps accelerating through standstill.
    assert!(
        (here + 300..=here + way).contains(&farthest),
        "{here} {way} {farthest}"
    );
    assert_eq!(planner.positions()[0].whole_steps(), here + 10);
}

#[test]
fn soft_limits_clamp_every_motion() {
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
    for _ in 0..1_000 {
        judge.tick(&mut planner);
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
fn moving_target_has_no_lag() {
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
        judge.tick(&mut planner);
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
fn axes_in_step_stay_on_the_line() {
    let fast = AxisConfig {
        max_speed_um_s: 200_000,
        max_acceleration_um_s2: 3_000_000,
        ..CONFIG
    };
    let configs = [CONFIG, fast, CONFIG];
    let mut planner = planner(configs, WordRate::MHZ_1);
    let mut judge = Judge::new(configs, WordRate::MHZ_1);
    let targets = [4_000, -3_000, 1_000];
    planner.move_in_step(centres(targets).map(Some));
    let mut arrival = [0; AXES];
    let mut worst: f64 = 0.0;
    let mut n = 0;
    while !planner.has_arrived() {
        for segment in planner.plan_tick() {
            judge.see(&segment);
            // Distance from the line through both ends, steps.
            let gone =
                |axis: usize| (judge.position[axis].fine() - (1 << 31)) as f64 / 4_294_967_296.0;
            for (axis, arrival) in arrival.iter_mut().enumerate() {
                if !segment.axes()[axis].is_rest() {
                    *arrival = n;
                }
                let line = gone(0) * f64::from(targets[axis]) / f64::from(targets[0]);
                worst = worst.max((gone(axis) - line).abs());
            }
            n += 1;
        }
    }
    std::println!("arrivals {arrival:?} segments, farthest from the line {worst:.4} steps");
    let [first, last] = [arrival.iter().min().unwrap(), arrival.iter().max().unwrap()];
    assert!(last - first <= 80, "{arrival:?}");
    assert!(worst < 0.01, "{worst}");
    assert_eq!(planner.positions().map(Position::whole_steps), targets);
    // Once moving, each axis goes on its own.
    planner.move_in_step(centres([0, 0, 0]).map(Some));
    judge.tick(&mut planner);
    planner.move_in_step(centres([0, -2_000, 0]).map(Some));
    run(&mut planner, &mut judge);
    assert_eq!(judge.position.map(Position::whole_steps), [0, -2_000, 0]);
}

/// In the last quarter of a tick and, braking, in the first one of the next.
#[test]
fn axis_reverses_in_adjacent_segments() {
    // The highest jerk is 136 quanta.
    let config = AxisConfig {
        steps_per_m: 1_745,
        max_speed_um_s: 31_935_816,
        max_acceleration_um_s2: 129_294_801,
        max_jerk_um_s3: u32::MAX,
        travel_um: [-573_067, 286_533],
        invert: false,
    };
    let rate = WordRate::from_hz(688_000).unwrap();
    let mut judge = Judge::new([config; AXES], rate);
    let (mut speed, mut turns) = (0, std::vec![]);
    for acceleration in [49, 41, -95, 41] {
        let ramp = Ramp {
            speed,
            acceleration,
        };
        for quarter in 0..4 {
            let motion = ramp.quarter(rate.slots_per_segment(), quarter);
            let before = judge.axes[0].ended;
            judge.see(&Segment::new(rate.slots_per_segment(), [motion; AXES]).unwrap());
            turns.push(before * judge.axes[0].ended < 0);
        }
        speed += acceleration;
    }
    let turned: std::vec::Vec<_> = (0..turns.len()).filter(|n| turns[*n]).collect();
    assert_eq!(turned, [11, 12]);
    // To the half slot: N² fine units for each sum of a tick's two speeds, and less than N/4 for
    // each turn.
    let n = i64::from(rate.slots_per_tick());
    let exact = n * n * (49 + (49 + 90) + (90 - 5) + (36 - 5));
    let gone = judge.position[0].fine() - Position::centre(0).fine();
    assert!((gone - exact).abs() < n / 2, "{gone} {exact}");
}
