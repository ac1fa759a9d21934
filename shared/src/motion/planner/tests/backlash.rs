//! Backlash, judged by a carriage that a motor pushes with two flanks, slot by slot.

use super::*;

/// Carriage that the motors push: it knows the fine positions of the steps and the width, but no
/// goals and no choice of flanks.
struct Carriage {
    motor: [i64; AXES],
    load: [i64; AXES],
    width: [i64; AXES],
    /// Number of reversals of each motor.
    turns: [u32; AXES],
    backward: [Option<bool>; AXES],
}

impl Carriage {
    fn new(steps: [u32; AXES]) -> Self {
        Self {
            motor: [Position::centre(0).fine(); AXES],
            load: [Position::centre(0).fine(); AXES],
            width: steps.map(|steps| i64::from(steps) << 32),
            turns: [0; AXES],
            backward: [None; AXES],
        }
    }

    fn tick(&mut self, planner: &mut Planner, judge: &mut Judge) {
        for segment in planner.plan_tick() {
            judge.see(&segment);
            for (axis, motion) in segment.axes().iter().enumerate() {
                if !motion.is_rest() && self.backward[axis] != Some(motion.backward) {
                    self.turns[axis] += 1;
                    self.backward[axis] = Some(motion.backward);
                }
                let mut increment = i64::from(motion.first);
                for _ in 0..segment.slots() {
                    self.motor[axis] += if motion.backward {
                        -increment
                    } else {
                        increment
                    };
                    increment += i64::from(motion.change);
                    // The rear flank pushes forwards, the front one backwards.
                    self.load[axis] = self.load[axis].max(self.motor[axis]);
                    self.load[axis] = self.load[axis].min(self.motor[axis] + self.width[axis]);
                }
            }
        }
        assert_eq!(planner.positions().map(Position::fine), self.motor);
        assert_eq!(planner.loads().map(Position::fine), self.load);
    }

    fn run(&mut self, planner: &mut Planner, judge: &mut Judge) {
        for _ in 0..2_000_000 {
            if planner.has_arrived() {
                return;
            }
            self.tick(planner, judge);
        }
        panic!("never arrives");
    }
}

/// Twice the distance that planners call near, and once more, fine units. With fast words these are
/// four distance quanta.
const NEAR: u64 = 3 << 29;

fn stage(
    configs: [AxisConfig; AXES],
    limits: Limits,
    rate: WordRate,
    width: [u32; AXES],
) -> (Planner, Judge, Carriage) {
    let limits = limits.with_backlash(width);
    (
        Planner::new(limits, centres([0; AXES])),
        Judge::new(configs, rate),
        Carriage::new(width),
    )
}

proptest! {
    /// Retargets at any moment: the load ends exactly at its target, the motor keeps every limit,
    /// the load every soft limit.
    #[test]
    fn load_ends_exactly_at_its_step(
        (rate, configs, limits) in configs(), width in prop::array::uniform3(0..40u32),
        moves in prop::collection::vec(
            (prop::array::uniform3(-300..300i32), 1..60u32, any::<bool>()),
            1..12,
        ),
        last in prop::array::uniform3(-300..300i32), stops: bool,
    ) {
        let (mut planner, mut judge, mut carriage) = stage(configs, limits, rate, width);
        judge.quanta = 4; // shares of lines are rounded
        for (targets, ticks, line) in moves {
            if line {
                planner.move_in_step(centres(targets).map(Some));
            } else {
                planner.set_target(centres(targets));
            }
            for _ in 0..ticks {
                carriage.tick(&mut planner, &mut judge);
                for (load, limits) in carriage.load.iter().zip(limits.axes()) {
                    let [low, high] = limits.ends().map(Position::fine);
                    prop_assert!(low <= *load && *load <= high);
                }
            }
        }
        if stops {
            planner.stop();
            carriage.run(&mut planner, &mut judge);
            let [targets, loads] =
                [planner.targets(), planner.loads()].map(|all| all.map(Position::whole_steps));
            prop_assert_eq!(targets, loads);
        }
        planner.set_target(centres(last));
        carriage.run(&mut planner, &mut judge);
        for axis in 0..AXES {
            let [low, high] = limits.axes()[axis].range();
            let goal = Position::centre(last[axis].clamp(low, high));
            prop_assert!(carriage.load[axis].abs_diff(goal.fine()) < NEAR);
            prop_assert_eq!(planner.loads()[axis].whole_steps(), goal.whole_steps());
            let behind = i64::from(goal.whole_steps()) - (carriage.motor[axis] >> 32);
            let is_exact = behind == 0 || behind == i64::from(width[axis]);
            prop_assert!(is_exact, "the motor is {behind} steps off");
        }
    }

    /// A line from rest leads every motor to its end without a step the other way.
    #[test]
    fn line_makes_no_step_the_other_way(
        (rate, configs, limits) in configs(), width in prop::array::uniform3(0..40u32),
        targets in prop::array::uniform3(-60..60i32),
    ) {
        let (mut planner, mut judge, carriage) = stage(configs, limits, rate, width);
        judge.quanta = 4; // shares of lines are rounded
        prop_assert_eq!(steps_back(&mut planner, &mut judge, carriage, targets), [0; AXES]);
    }

    /// Changes limits or the origin at rest: the load stays, and ends at its target.
    #[test]
    fn load_stays_when_limits_change(
        width in prop::array::uniform3(0..40u32), there in prop::array::uniform3(-300..300i32),
        back in prop::array::uniform3(-300..300i32),
        by in prop::array::uniform3(-1_000..1_000i32), ticks in 0..80u32,
    ) {
        let limits = Limits::new(&[CONFIG; AXES], WordRate::MHZ_1).unwrap();
        let (mut planner, mut judge, mut carriage) =
            stage([CONFIG; AXES], limits, WordRate::MHZ_1, width);
        planner.set_target(centres(there));
        for _ in 0..ticks {
            carriage.tick(&mut planner, &mut judge);
        }
        planner.stop();
        carriage.run(&mut planner, &mut judge);
        let stood = (carriage.motor, carriage.load);
        let mut moved = planner.relimited(limits.with_backlash(width)).shifted(by.map(i64::from));
        for _ in 0..20 {
            moved.plan_tick();
        }
        for (axis, by) in by.into_iter().enumerate() {
            let way = i64::from(by) << 32;
            prop_assert_eq!(moved.positions()[axis].fine() - way, stood.0[axis]);
            prop_assert_eq!(moved.loads()[axis].fine() - way, stood.1[axis]);
        }
        moved.set_target(centres(back));
        for _ in 0..100_000 {
            if moved.has_arrived() { break }
            moved.plan_tick();
        }
        prop_assert_eq!(moved.loads().map(Position::whole_steps), back);
    }
}

/// Moves in a line to `targets` and returns the greatest number of steps that each motor went back
/// on its way.
fn steps_back(
    planner: &mut Planner,
    judge: &mut Judge,
    mut carriage: Carriage,
    targets: [i32; AXES],
) -> [i64; AXES] {
    planner.move_in_step(centres(targets).map(Some));
    let mut farthest = [0; AXES];
    let mut back = [0; AXES];
    while !planner.has_arrived() {
        carriage.tick(planner, judge);
        for axis in 0..AXES {
            let forwards = if targets[axis] < 0 { -1 } else { 1 };
            let step = (carriage.motor[axis] >> 32) * forwards;
            farthest[axis] = step.max(farthest[axis]);
            back[axis] = back[axis].max(farthest[axis] - step);
        }
    }
    back
}

/// An axis of a line whose own limit of jerk is low: its share of the leader's braking is rounded to
/// more than that limit, so that the axis alone could not stop at its goal. The line still ends
/// there, and the flank stays.
#[test]
fn slow_axis_of_a_line_keeps_its_flank() {
    let leader = AxisConfig {
        steps_per_m: 243_445,
        max_speed_um_s: 5_620,
        max_acceleration_um_s2: 558_734,
        max_jerk_um_s3: 76_394_649,
        ..CONFIG
    };
    let slow = AxisConfig {
        steps_per_m: 154_668,
        max_speed_um_s: 331,
        max_acceleration_um_s2: 19_468,
        max_jerk_um_s3: 1_000_000,
        ..CONFIG
    };
    let configs = [CONFIG, slow, leader];
    let limits = Limits::new(&configs, WordRate::MHZ_1).unwrap();
    let (mut planner, mut judge, carriage) = stage(configs, limits, WordRate::MHZ_1, [0, 25, 26]);
    judge.quanta = 4;
    let back = steps_back(&mut planner, &mut judge, carriage, [0, 1, 14]);
    assert_eq!(back, [0; AXES]);
}

/// A target that oscillates, as a filter describes it with some noise: the load follows, and the
/// motor reverses when the target does and not more often.
#[test]
fn swinging_target_costs_two_reversals() {
    let limits = Limits::new(&[CONFIG; AXES], WordRate::MHZ_1).unwrap();
    let width = [0, 4, 24];
    let (mut planner, mut judge, mut carriage) =
        stage([CONFIG; AXES], limits, WordRate::MHZ_1, width);
    let slots_per_s = f64::from(WordRate::MHZ_1.slots_per_s());
    let fine = 4_294_967_296.0;
    let mut random = Random(5);
    let (amplitude, omega) = (800.0, core::f64::consts::TAU); // 10 mm, 1 Hz
    let mut worst = [0.0f64; AXES];
    let mut left = [0u32; AXES];
    for tick in 0..10_000 {
        let t = f64::from(tick) * 1e-3;
        let place = amplitude * (omega * t).sin();
        let speed = amplitude * omega * (omega * t).cos();
        let noise = [(); AXES].map(|()| 0.2 * random.uniform());
        let targets = noise.map(|n| Position::from_fine(((place + n + 0.5) * fine) as i64));
        // 0.1 mm/s.
        let speeds =
            [(); AXES].map(|()| ((speed + 8.0 * random.uniform()) * fine / slots_per_s) as i64);
        planner.follow(targets, speeds);
        carriage.tick(&mut planner, &mut judge);
        for axis in 0..AXES {
            let error = carriage.load[axis] as f64 / fine - 0.5 - place - speed * 1e-3;
            if tick > 500 {
                worst[axis] = worst[axis].max(error.abs());
                left[axis] += u32::from(error.abs() > 2.0);
            }
        }
    }
    std::println!(
        "turns {:?}, worst {worst:.2?} steps, ms beyond two steps {left:?}",
        carriage.turns
    );
    // Ten periods and the start.
    for turns in carriage.turns {
        assert!((20..=24).contains(&turns), "{turns}");
    }
    assert!(worst[0] < 2.0);
    // While the motor crosses the backlash the load stands still and the target moves on: 24 steps
    // take 35 ms at 1 m/s², in which the target moves 19 steps from where it reversed; 4 steps take
    // 14 ms and some ramps, 3 steps.
    assert!(worst[1] < 6.0 && worst[2] < 19.0, "{worst:?}");
}
