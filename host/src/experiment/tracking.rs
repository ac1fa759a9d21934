//! The paper's section 4.3 in closed loop: A moves five times by (4, 4, 1) mm, B follows what its cameras see.

use super::Error;
use super::servo::{Outcome, Servo, Step, Timing};
use super::world::World;
use crate::images::{SceneSettings, Texture, TextureKind};
use crate::station::stage::default_stage;
use crate::sums::Estimator;
use serde::Serialize;
use shared::frame::message::Command;
use shared::rig::Rig;

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

/// Bounds on |B - A| at each stop, mm.
pub const BOUND_MM: [f64; 3] = [0.02, 0.02, 0.05];

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
    /// Our B: edges counted at its step pins.
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
    /// Both stations every 5 ms.
    pub samples: Vec<Sample>,
    /// Per station, A then B: steps commanded (the station's own count) and edges counted at the pins.
    pub pulses: [[[i64; 3]; 2]; 2],
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

    /// Every stop within [`BOUND_MM`], and every commanded step at the pins.
    pub fn succeeded(&self) -> bool {
        let within = self
            .worst_mm()
            .iter()
            .zip(BOUND_MM)
            .all(|(worst, bound)| *worst <= bound);
        within
            && self
                .pulses
                .iter()
                .all(|[commanded, counted]| commanded == counted)
    }
}

/// Runs the experiment. `progress` is told the share done, 0 to 1, after every picture.
///
/// # Errors
/// If a station refuses or faults, or the first pictures show nothing usable.
pub fn run(settings: &Settings, mut progress: impl FnMut(f64)) -> Result<Run, Error> {
    let rig = Rig::paper();
    let texture = Texture::of_kind(settings.texture, settings.seed);
    let mut world = World::new(
        &rig,
        &default_stage(),
        &texture,
        settings.scene,
        settings.seed,
    )?;
    let mut servo = Servo::start(&mut world, &rig, settings.timing, settings.estimator)?;
    let (mut stops, mut steps, mut samples) = (Vec::new(), Vec::new(), Vec::new());
    let total_s = MOVES as f64 * settings.rest_s;
    for (stop, paper_mm) in PAPER_MM.into_iter().enumerate() {
        let true_mm = MOVE_MM.map(|d| d * (stop + 1) as f64);
        let position_um = true_mm.map(|mm| (mm * 1e3).round() as i32);
        world
            .a
            .command("setpoint", Command::Setpoint { position_um })?;
        let end_s = (stop + 1) as f64 * settings.rest_s;
        while servo.time_s(&world) + 1.0 / settings.timing.frames_per_s < end_s {
            while world.now().plus_micros(5_000) < servo.next_picture() {
                world.advance(world.now().plus_micros(5_000));
                samples.push(sample(&servo, &world));
            }
            steps.push(servo.step(&mut world)?);
            progress(servo.time_s(&world) / total_s);
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
    world.advance(world.now().plus_micros(300_000));
    let pulses = [&world.a, &world.b].map(|station| {
        let commanded = station
            .status()
            .map_or([i64::MIN; 3], |status| status.position_steps.map(i64::from));
        [commanded, station.steps_from_zero()]
    });
    Ok(Run {
        stops,
        steps,
        samples,
        pulses,
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
