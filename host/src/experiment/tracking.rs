//! The paper's section 4.3 in closed loop: A moves five times by (4, 4, 1) mm, B follows what its
//! cameras see.

use super::Error;
use super::follower::Place;
use super::servo::{Outcome, Servo, Step, Timing};
use super::world::World;
use crate::images::{SceneSettings, Texture, TextureKind};
use crate::rig_file::Stage;
use crate::station::serial::Serial;
use crate::station::stage::setpoint;
use crate::sums::Estimator;
use serde::Serialize;
use shared::frame::message::{Command, Status};
use shared::rig::Rig;
use shared::safety::Fault;

/// One move of station A, mm.
pub const MOVE_MM: [f64; 3] = [4.0, 4.0, 1.0];

/// How many moves.
pub const MOVES: usize = 5;

/// Where the paper's station B stood after each move, mm (its Table 6).
pub const PAPER_MM: [[f64; 3]; MOVES] = [
    [4.1351, 4.1724, 1.0168],
    [7.7655, 7.7374, 1.8914],
    [11.8837, 11.963, 2.8144],
    [15.9714, 15.974, 4.1645],
    [19.9192, 19.7846, 4.9699],
];

/// Largest error of the paper's station B over its stops, mm.
pub fn paper_worst_mm() -> [f64; 3] {
    let error = |stop: usize, i: usize| PAPER_MM[stop][i] - MOVE_MM[i] * (stop + 1) as f64;
    std::array::from_fn(|i| {
        (0..MOVES)
            .map(|stop| error(stop, i).abs())
            .fold(0.0, f64::max)
    })
}

/// Bounds on |B - A| at each stop, mm.
pub const BOUND_MM: [f64; 3] = [0.02, 0.02, 0.05];

/// A stop ends after so many used pictures at the earliest. That is half of what the usual rest has
/// time for, and matters only where the time is real and the computer busy.
const LEAST_PICTURES: usize = 15;

/// A stop ends after so many rests at the latest.
const LONGEST_RESTS: f64 = 10.0;

/// What is free to choose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The poster on A.
    pub texture: TextureKind,
    /// Seed of poster and noise.
    pub seed: u64,
    /// Depth, tilt, blur, noise.
    pub scene: SceneSettings,
    /// Rate and latency.
    pub timing: Timing,
    /// How long A rests after each move, s.
    pub rest_s: f64,
    /// The station's estimator.
    pub estimator: Estimator,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            texture: TextureKind::Natural,
            seed: 1,
            scene: SceneSettings::default(),
            timing: Timing::default(),
            rest_s: 1.0,
            estimator: Estimator::Midpoint,
        }
    }
}

/// Target and cameras at one stop, mm from the keyframe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stop {
    /// Where A was sent.
    #[serde(rename = "true")]
    pub true_mm: [f64; 3],
    /// The paper's B.
    #[serde(rename = "paper")]
    pub paper_mm: [f64; 3],
    /// Our B: edges counted at its step pins, or its own report if it is on a serial line.
    #[serde(rename = "tracked")]
    pub tracked_mm: [f64; 3],
}

impl Stop {
    /// Tracked minus true, mm.
    pub fn error_mm(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.tracked_mm[i] - self.true_mm[i])
    }
}

/// Where both stations were at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Since the keyframe, s.
    pub time_s: f64,
    /// Poster, mm.
    pub target_mm: [f64; 3],
    /// Cameras, mm.
    pub camera_mm: [f64; 3],
}

/// What happened.
#[derive(Clone, Debug)]
pub struct Run {
    /// After each move.
    pub stops: Vec<Stop>,
    /// Every picture.
    pub steps: Vec<Step>,
    /// Both stations every 5 ms; at every picture if B is on a serial line, where nothing else is
    /// known.
    pub samples: Vec<Sample>,
    /// Per station, A then B.
    pub pulses: [Pulses; 2],
    /// Of B's stage.
    pub steps_per_mm: [f64; 3],
    /// What B was, for people.
    pub station: String,
    /// The fault that B had latched before, and that the start cleared.
    pub cleared: Option<Fault>,
    /// The bound of B's time sync, µs; `None` for a twin.
    pub sync_bound_us: Option<u64>,
}

/// Steps of one station from its zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pulses {
    /// The station's own count.
    pub commanded: [i64; 3],
    /// Edges counted at the pins, where something counts them.
    pub counted: Option<[i64; 3]>,
}

impl Pulses {
    /// No edge is known to be missing.
    pub fn agree(&self) -> bool {
        self.counted.is_none_or(|counted| counted == self.commanded)
    }
}

impl Run {
    /// Pictures that the station used.
    pub fn used(&self) -> usize {
        self.steps
            .iter()
            .filter(|step| matches!(step.outcome, Outcome::Used { .. }))
            .count()
    }

    /// Largest |error| over the stops per axis, mm.
    pub fn worst_mm(&self) -> [f64; 3] {
        let worst = |i: usize| {
            self.stops
                .iter()
                .map(|stop| stop.error_mm()[i].abs())
                .fold(0.0, f64::max)
        };
        std::array::from_fn(worst)
    }

    /// Every stop within [`BOUND_MM`], and every commanded step at the pins that are watched.
    pub fn succeeded(&self) -> bool {
        let within = self
            .worst_mm()
            .iter()
            .zip(BOUND_MM)
            .all(|(worst, bound)| *worst <= bound);
        within && self.pulses.iter().all(Pulses::agree)
    }
}

/// Runs the experiment with B in `place`, moving `stage`. `progress` is told the share done, 0 to
/// 1, after every picture.
///
/// # Errors
/// If a station cannot be reached, refuses or faults, or the first pictures show nothing usable.
pub fn run(
    settings: &Settings,
    stage: &Stage,
    place: Place<'_>,
    mut progress: impl FnMut(f64),
) -> Result<Run, Error> {
    let rig = Rig::paper();
    let texture = Texture::of_kind(settings.texture, settings.seed);
    let mut world = World::new(&rig, stage, place, &texture, settings.scene, settings.seed)?;
    let mut servo = Servo::start(&mut world, &rig, settings.timing, settings.estimator)?;
    let (mut stops, mut steps, mut samples) = (Vec::new(), Vec::new(), Vec::new());
    let total_s = MOVES as f64 * settings.rest_s;
    // How far the moves are behind their times, s.
    let mut late_s = 0.0;
    for (stop, paper_mm) in PAPER_MM.into_iter().enumerate() {
        let true_mm = MOVE_MM.map(|d| d * (stop + 1) as f64);
        world.a.command("setpoint", setpoint(true_mm))?;
        let end_s = (stop + 1) as f64 * settings.rest_s + late_s;
        let latest_s = end_s + LONGEST_RESTS * settings.rest_s;
        let mut used = 0;
        loop {
            let next_s = servo.time_s(&world) + 1.0 / settings.timing.frames_per_s;
            if next_s >= end_s && (used >= LEAST_PICTURES || next_s >= latest_s) {
                late_s += (servo.time_s(&world) - end_s).max(0.0);
                break;
            }
            // Between its reports nobody knows where a station on a line is.
            while world.b.twin().is_some()
                && world.now().plus_micros(5_000) < servo.next_picture(&world)
            {
                world.advance(world.now().plus_micros(5_000));
                samples.push(sample(&servo, &world));
            }
            let step = servo.step(&mut world)?;
            if world.b.twin().is_none() {
                samples.push(Sample {
                    time_s: step.time_s,
                    target_mm: step.target_mm,
                    camera_mm: step.camera_mm,
                });
            }
            used += usize::from(matches!(step.outcome, Outcome::Used { .. }));
            steps.push(step);
            progress((servo.time_s(&world) - late_s) / total_s);
        }
        let [_, tracked_mm] = servo.positions_mm(&world);
        stops.push(Stop {
            true_mm,
            paper_mm,
            tracked_mm,
        });
    }
    // At rest, so that all commanded steps are out.
    world.b.command("stop", Command::Stop)?;
    world.advance(world.now().max(world.b.now()).plus_micros(300_000));
    let pulses = |status: Option<&Status>, counted| Pulses {
        commanded: status.map_or([i64::MIN; 3], |status| status.position_steps.map(i64::from)),
        counted,
    };
    let pulses = [
        pulses(world.a.status(), Some(world.a.steps_from_zero())),
        pulses(world.b.status().as_ref(), world.b.counted_steps()),
    ];
    let sync = world.b.serial().and_then(Serial::offset_us);
    Ok(Run {
        stops,
        steps,
        samples,
        pulses,
        steps_per_mm: stage.steps_per_mm,
        station: world.b.name(),
        cleared: world.b.serial().and_then(Serial::cleared),
        sync_bound_us: sync.map(|(_, bound_us)| bound_us),
    })
}

fn sample(servo: &Servo, world: &World) -> Sample {
    let [target_mm, camera_mm] = servo.positions_mm(world);
    Sample {
        time_s: servo.time_s(world),
        target_mm,
        camera_mm,
    }
}
