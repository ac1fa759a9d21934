//! One random life: a target, images of it, and a stage that makes every commanded step.

use trinocular_core::safety::Fault;
use trinocular_rig::random::Random;
use trinocular_tests::chase::{Chase, RIGHT, Shot};

/// Duration beyond the end for which the target's position is known, ms.
const BEYOND_MS: usize = 10;

/// A target's path and all other conditions of a chase.
pub struct Life {
    chase: Chase,
    /// Target positions, one per ms.
    places: Vec<[f64; 3]>,
    seconds: f64,
    /// Description of the life.
    pub story: String,
}

impl Life {
    /// Returns the life of a seed, 3 to 7 s long.
    pub fn new(seed: u64) -> Self {
        let mut random = Random::new(seed, 1);
        let seconds = random.between(3.0, 7.0);
        let hidden_s: Vec<[f64; 2]> = (0..random.below(5))
            .map(|_| {
                let from = random.between(0.3, seconds);
                [from, from + random.between(0.05, 1.0)]
            })
            .collect();
        let target = Target::new(&mut random, seconds, &hidden_s);
        let places = target.places(&mut random, seconds);
        let mut chase = Chase::new(seed);
        let (shots, pictures) = shots(&mut random, seconds, &hidden_s);
        chase.shots = Some(shots);
        if random.below(2) == 0 {
            chase.mount = mount(&mut random);
        }
        if random.below(2) == 0 {
            chase.slack_mm = random.between(0.0, 0.1);
        }
        if random.below(4) == 0 {
            chase.noise = spread(&mut random, 0.2, 6.0);
        }
        // The soft limits are within reach in one life of six.
        chase.travel_mm = Some(if random.below(6) == 0 { 60.0 } else { 500.0 });
        let story = format!(
            "{:?} at up to {:.0} mm/s and {:.0} mm/s², {pictures}, hidden {hidden_s:.2?}, mount \
             {:.2?}, slack {:.3} mm, noise {:.1}",
            target.kind,
            target.speed,
            target.acceleration,
            chase.mount,
            chase.slack_mm,
            chase.noise
        );
        Self {
            chase,
            places,
            seconds,
            story,
        }
    }

    /// Follows the target to the end of the life or to a fault.
    pub fn follow(&mut self) -> Option<Fault> {
        let places = &self.places;
        let at = |time_s: f64| {
            let ms = (time_s * 1e3).max(0.0);
            let before = (ms as usize).min(places.len() - 2);
            let share = (ms - before as f64).min(1.0);
            let (a, b) = (places[before], places[before + 1]);
            std::array::from_fn(|i| a[i] + (b[i] - a[i]) * share)
        };
        let run = self.chase.follow(at, self.seconds);
        run.statuses.iter().find_map(|status| status.fault)
    }
}

/// Kind of motion of a target.
#[derive(Clone, Copy, Debug)]
enum Kind {
    /// Sudden jumps.
    Jumps,
    /// Straight lines, with sudden changes of speed and direction.
    Polygon,
    /// Straight lines with limited acceleration.
    Ramps,
    /// A sum of sines.
    Figure,
    /// A velocity that wanders.
    Wander,
    /// A straight line whose speed changes by up to 30 %.
    Line,
    /// Constant accelerations.
    Parabolas,
    /// A vibration, at rest or on a straight line.
    Vibration,
    /// Starts and stops.
    StopAndGo,
}

struct Target {
    kind: Kind,
    /// Highest speed, mm/s, and acceleration, mm/s², of the motion.
    speed: f64,
    acceleration: f64,
    /// Times of changes in the motion, s.
    events_s: Vec<f64>,
}

impl Target {
    fn new(random: &mut Random, seconds: f64, hidden_s: &[[f64; 2]]) -> Self {
        use Kind::*;
        let kinds = [
            Jumps, Polygon, Ramps, Figure, Wander, Line, Parabolas, Vibration, StopAndGo,
        ];
        let kind = kinds[random.below(kinds.len())];
        let mut events_s: Vec<f64> = (0..random.below(8))
            .map(|_| random.between(0.2, seconds))
            .collect();
        // The motion changes during every occlusion.
        events_s.extend(hidden_s.iter().map(|[from, to]| random.between(*from, *to)));
        Self {
            kind,
            speed: spread(random, 2.0, 150.0),
            acceleration: spread(random, 50.0, 5_000.0),
            events_s,
        }
    }

    /// Returns the target's position at every ms.
    fn places(&self, random: &mut Random, seconds: f64) -> Vec<[f64; 3]> {
        let count = (seconds * 1e3) as usize + BEYOND_MS;
        let figure = Figure::new(random, self.speed);
        let vibration = Vibration::new(random);
        let wander_s = spread(random, 0.05, 1.0);
        let (mut place, mut speed, mut goal) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        let mut places = vec![place];
        for ms in 1..count {
            let time_s = ms as f64 * 1e-3;
            let event = self.events_s.iter().any(|s| (s * 1e3) as usize == ms);
            match self.kind {
                Kind::Jumps if event => {
                    let by = direction(random).map(|d| d * spread(random, 0.1, 8.0));
                    place = add(place, by, 1.0);
                }
                Kind::Polygon if event || ms == 500 => {
                    let mm_s = self.speed * random.unit();
                    speed = direction(random).map(|d| d * mm_s);
                }
                Kind::Ramps => {
                    if event || ms == 500 {
                        let mm_s = self.speed * random.unit();
                        goal = direction(random).map(|d| d * mm_s);
                    }
                    let change = add(goal, speed, -1.0);
                    let size = norm(change).max(1e-12);
                    let share = (self.acceleration * 1e-3 / size).min(1.0);
                    speed = add(speed, change, share);
                }
                Kind::Figure => place = figure.at(time_s),
                Kind::Wander => {
                    let kick = self.speed * 0.5 * (2e-3 / wander_s).sqrt();
                    speed = speed.map(|v| v * (1.0 - 1e-3 / wander_s) + kick * random.gaussian());
                }
                Kind::Line if ms == 300 => speed = direction(random).map(|d| d * self.speed),
                Kind::Line if event => {
                    let times = random.between(0.7, 1.3);
                    speed = speed.map(|v| v * times);
                }
                Kind::Parabolas => {
                    if event || ms == 300 {
                        let mm_s2 = self.acceleration.min(2_500.0);
                        goal = direction(random).map(|d| d * mm_s2);
                    }
                    let most = self.speed;
                    speed = add(speed, goal, 1e-3).map(|v| v.clamp(-most, most));
                }
                Kind::Vibration => {
                    if ms == 300 && self.speed > 20.0 {
                        goal = direction(random).map(|d| d * self.speed * 0.3);
                    }
                    let line = goal.map(|v| v * (time_s - 0.3).max(0.0));
                    place = add(line, vibration.at(time_s), 1.0);
                }
                Kind::StopAndGo if event => {
                    let goes = random.below(2) == 0;
                    let mm_s = if goes { self.speed * 0.5 } else { 0.0 };
                    speed = direction(random).map(|d| d * mm_s);
                }
                _ => {}
            }
            place = add(place, speed, 1e-3);
            places.push(place);
        }
        places
    }
}

/// Sines on each axis, starting at zero.
struct Figure {
    amplitude_mm: [f64; 3],
    per_s: [f64; 3],
    phase: [f64; 3],
}

impl Figure {
    fn new(random: &mut Random, speed: f64) -> Self {
        let first = std::f64::consts::TAU / spread(random, 0.3, 20.0);
        let per_s = [1.0, random.between(0.5, 3.0), random.between(0.5, 4.0)].map(|x| x * first);
        let share = [1.0, 1.0, 0.3];
        Self {
            amplitude_mm: std::array::from_fn(|i| (share[i] * speed / per_s[i]).min(100.0)),
            per_s,
            phase: [(); 3].map(|()| random.between(0.0, std::f64::consts::TAU)),
        }
    }

    fn at(&self, time_s: f64) -> [f64; 3] {
        std::array::from_fn(|i| {
            let phase = self.phase[i];
            self.amplitude_mm[i] * ((self.per_s[i] * time_s + phase).sin() - phase.sin())
        })
    }
}

/// A vibration along a line, 1 to 15 Hz, 0.02 to 3 mm.
struct Vibration {
    amplitude_mm: [f64; 3],
    per_s: f64,
}

impl Vibration {
    fn new(random: &mut Random) -> Self {
        let mm = spread(random, 0.02, 3.0);
        Self {
            amplitude_mm: direction(random).map(|d| d * mm),
            per_s: std::f64::consts::TAU * spread(random, 1.0, 15.0),
        }
    }

    fn at(&self, time_s: f64) -> [f64; 3] {
        let sine = (self.per_s * time_s).sin();
        self.amplitude_mm.map(|mm| mm * sine)
    }
}

/// Returns the exposures with the latency of their frames, and a description of them.
fn shots(random: &mut Random, seconds: f64, hidden_s: &[[f64; 2]]) -> (Vec<Shot>, String) {
    let per_s = match random.below(3) {
        0 => 60.0,
        _ => spread(random, 5.0, 1_000.0),
    };
    let latency_us = random.between(2_000.0, 60_000.0);
    let jitter_us = match random.below(2) {
        0 => 0.0,
        _ => random.between(0.0, latency_us),
    };
    let style = random.below(3);
    let mut shots = vec![Shot {
        capture_us: 0,
        latency_us: 0,
    }];
    let mut time_s = 0.0;
    loop {
        time_s += match style {
            0 => 1.0 / per_s,
            1 => -(1.0 - random.unit()).ln() / per_s,
            _ => random.between(0.6, 1.4) / per_s,
        };
        if time_s >= seconds {
            break;
        }
        if hidden_s
            .iter()
            .any(|[from, to]| (*from..*to).contains(&time_s))
        {
            continue;
        }
        shots.push(Shot {
            capture_us: (time_s * 1e6) as u64,
            latency_us: (latency_us + random.between(-0.5, 0.5) * jitter_us) as u64,
        });
    }
    let style = ["even", "exponential", "uneven"][style];
    let story = format!(
        "{per_s:.0} {style} frame sets/s, {:.0} ms late, jitter {:.0} ms",
        latency_us * 1e-3,
        jitter_us * 1e-3
    );
    (shots, story)
}

/// Returns a mount with scale errors up to 20 % per axis, rotated by up to 8 degrees.
fn mount(random: &mut Random) -> [[f64; 3]; 3] {
    let axis = nalgebra::Unit::new_normalize(nalgebra::Vector3::from(direction(random)));
    let turn = nalgebra::Rotation3::from_axis_angle(&axis, random.between(0.0, 0.14));
    let scale = [(); 3].map(|()| random.between(0.8, 1.2));
    let mut mount = RIGHT;
    for (i, row) in mount.iter_mut().enumerate() {
        for (j, element) in row.iter_mut().enumerate() {
            *element = turn.matrix()[(i, j)] * scale[j];
        }
    }
    mount
}

/// Returns a direction: along x once in three times, otherwise random with less along z.
fn direction(random: &mut Random) -> [f64; 3] {
    if random.below(3) == 0 {
        return [if random.below(2) == 0 { 1.0 } else { -1.0 }, 0.0, 0.0];
    }
    let to = [
        random.gaussian(),
        random.gaussian(),
        0.5 * random.gaussian(),
    ];
    let size = norm(to).max(1e-9);
    to.map(|d| d / size)
}

/// Returns a random number uniform in its logarithm.
fn spread(random: &mut Random, low: f64, high: f64) -> f64 {
    random.between(low.ln(), high.ln()).exp()
}

fn norm([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

fn add(a: [f64; 3], b: [f64; 3], times: f64) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + times * b[i])
}
