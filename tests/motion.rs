//! Motion as the motors get it: planner and step generator together, judged by the edges at the
//! pins alone.

#[path = "motion/edges.rs"]
mod edges;

use edges::{Bounds, Edges};
use trinocular_core::motion::{AxisConfig, Limits, Planner};
use trinocular_core::replay::Probe;
use trinocular_core::steps::{AXES, Generator, PortMap, Position, WordRate};
use trinocular_rig::random::Random;

const MAP: PortMap = PortMap {
    step: [0, 1, 2],
    dir: [3, 4, 5],
    invert: [false; AXES],
};

/// Axis with 80 steps/mm, 100 mm/s, 2 m/s², 50 m/s³.
const STAGE: AxisConfig = AxisConfig {
    steps_per_m: 80_000,
    max_speed_um_s: 100_000,
    max_acceleration_um_s2: 2_000_000,
    max_jerk_um_s3: 50_000_000,
    travel_um: [-60_000, 60_000],
    invert: false,
};

/// A planner whose segments go through the generator to pins.
struct Station {
    planner: Planner,
    generator: Generator,
    probe: Probe,
    words: Vec<u32>,
}

impl Station {
    fn new(config: AxisConfig, rate: WordRate) -> Self {
        let limits = Limits::new(&[config; AXES], rate).unwrap();
        Self {
            planner: Planner::new(limits, [Position::centre(0); AXES]),
            generator: Generator::new(MAP).unwrap(),
            probe: Probe::new(MAP),
            words: vec![0; 2 * usize::from(rate.slots_per_segment())],
        }
    }

    /// Plays one tick and calls `edge(word of the tick, pins before, pins after)` for every edge.
    fn tick(&mut self, mut edge: impl FnMut(usize, u32, u32)) {
        for (n, segment) in self.planner.plan_tick().iter().enumerate() {
            self.generator.load(segment).unwrap();
            assert_eq!(self.generator.fill(&mut self.words), self.words.len());
            let first = n * self.words.len();
            self.probe.feed(&self.words, |word, before, after| {
                edge(first + word, before, after);
            });
        }
    }

    /// Checks that the pins made as many steps as were planned.
    fn check_counts(&self) {
        let planned = self.planner.positions().map(Position::whole_steps);
        assert_eq!(self.probe.steps(), planned);
    }
}

/// Every millisecond brings a new target, at rest or moving: mostly near the last one, sometimes
/// anywhere in the travel.
#[test]
fn retargets_at_1_khz_keep_limits() {
    let mut random = Random::seeded(1);
    let mut station = Station::new(STAGE, WordRate::MHZ_1);
    let mut edges = [(); AXES].map(|()| Edges::default());
    let mut places = [0.0; AXES];
    let mut now = 0;
    let mut play = |station: &mut Station| {
        station.tick(|word, before, after| {
            for (axis, edges) in edges.iter_mut().enumerate() {
                let bit = |pin: u8| 1 << pin;
                if after & !before & bit(MAP.step[axis]) != 0 {
                    edges.step(now + word as u64 / 2, after & bit(MAP.dir[axis]) != 0);
                }
            }
        });
        now += 500;
    };
    for _ in 0..10_000 {
        for place in &mut places {
            if random.unit() < 0.005 {
                *place = random.between(-4_800.0, 4_800.0);
            }
        }
        let near = |place: f64, random: &mut Random| {
            let steps = place + random.between(-1.0, 1.0);
            Position::from_fine((steps * 4_294_967_296.0) as i64)
        };
        let targets = places.map(|place| near(place, &mut random));
        // Up to 30 mm/s, 2⁻³² step per slot.
        let speed = |random: &mut Random| (random.between(-1.0, 1.0) * 20_615_843.0) as i64;
        let moves = random.unit() < 0.5;
        let speeds = [(); AXES].map(|()| if moves { speed(&mut random) } else { 0 });
        station.planner.follow(targets, speeds);
        play(&mut station);
        station.check_counts();
    }
    let last = [1_234, -4_321, 0];
    station.planner.set_target(last.map(Position::centre));
    while !station.planner.has_arrived() {
        play(&mut station);
    }
    assert_eq!(station.probe.steps(), last);
    let bounds = Bounds {
        steps_per_m: STAGE.steps_per_m,
        slots_per_s: WordRate::MHZ_1.slots_per_s(),
        speed_um_s: STAGE.max_speed_um_s,
        acceleration_um_s2: STAGE.max_acceleration_um_s2,
        jerk_um_s3: STAGE.max_jerk_um_s3,
    };
    for edges in &edges {
        let reached = edges.check(&bounds);
        println!(
            "{} steps; speed, acceleration, jerk of the limits: {reached:.3?}",
            edges.len()
        );
        // The motion reached the limits, so they were tested.
        assert!(edges.len() > 20_000 && reached.iter().all(|share| *share > 0.9));
    }
}

/// The axis moves to and fro at up to one step per slot, with reversals in mid-move.
#[test]
fn no_step_is_lost_in_1e9_steps() {
    let config = AxisConfig {
        max_speed_um_s: 6_250_000,
        max_acceleration_um_s2: 50_000_000,
        max_jerk_um_s3: 4_000_000_000,
        travel_um: [-2_000_000_000, 2_000_000_000],
        ..STAGE
    };
    let mut random = Random::seeded(2);
    let mut station = Station::new(config, WordRate::MHZ_1);
    let mut made = 0u64;
    let steps = MAP.step.map(|pin| 1u32 << pin).iter().sum::<u32>();
    while made < 1_000_000_000 {
        let targets = [(); AXES].map(|()| random.between(-1e7, 1e7) as i32);
        station.planner.set_target(targets.map(Position::centre));
        for _ in 0..10_000 {
            station
                .tick(|_, before, after| made += u64::from((after & !before & steps).count_ones()));
        }
        station.check_counts();
    }
    station.planner.set_target([Position::centre(0); AXES]);
    while !station.planner.has_arrived() {
        station.tick(|_, _, _| {});
    }
    assert_eq!(station.probe.steps(), [0; AXES]);
    println!("{made} steps");
}
