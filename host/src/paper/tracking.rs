//! The paper's section 4.3 in closed loop: A moves five times by (4, 4, 1) mm, and B follows by its
//! cameras.

use crate::servo::ServoError;
use crate::servo::recording::{FrameSetTaker, Takers, observers_of};
use crate::servo::simulated::{ServoTiming, SimulatedServo, SimulatedStep};
use crate::servo::station_link::StationPlace;
use crate::servo::world::SimulatedWorld;
use serde::Serialize;
use std::sync::Arc;
use trinocular_client::observer::StationObserver;
use trinocular_client::serial::Serial;
use trinocular_client::stage::setpoint;
use trinocular_core::frame::message::{Command, Status};
use trinocular_core::rig::Rig;
use trinocular_core::safety::Fault;
use trinocular_recording::recorder::Tap;
use trinocular_rig::rig_file::Stage;
use trinocular_vision::images::{SceneSettings, Texture, TextureKind};
use trinocular_vision::sums::Estimator;

/// One move of station A, mm.
pub const MOVE_MM: [f64; 3] = [4.0, 4.0, 1.0];

/// Number of moves.
pub const MOVES: usize = 5;

/// Positions of the paper's station B after each move, mm (its Table 6).
pub const PAPER_MM: [[f64; 3]; MOVES] = [
    [4.1351, 4.1724, 1.0168],
    [7.7655, 7.7374, 1.8914],
    [11.8837, 11.963, 2.8144],
    [15.9714, 15.974, 4.1645],
    [19.9192, 19.7846, 4.9699],
];

/// Returns the largest error of the paper's station B over its stops, mm.
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

/// Least number of used images before a stop ends. It is half of the number within the usual rest,
/// and matters only if time is real and the computer loaded.
const LEAST_PICTURES: usize = 15;

/// Longest duration of a stop, in rests.
const LONGEST_RESTS: f64 = 10.0;

/// Settings of the experiment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Texture of the poster on A.
    pub texture: TextureKind,
    /// Seed of poster and noise.
    pub seed: u64,
    /// Depth, tilt, blur and noise of the scene.
    pub scene: SceneSettings,
    /// Frame rate and latency.
    pub timing: ServoTiming,
    /// Rest of A after each move, s.
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
            timing: ServoTiming::default(),
            rest_s: 1.0,
            estimator: Estimator::Midpoint,
        }
    }
}

/// Target and cameras at one stop, mm from the keyframe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stop {
    /// Commanded position of A.
    #[serde(rename = "true")]
    pub true_mm: [f64; 3],
    /// Position of the paper's B.
    #[serde(rename = "paper")]
    pub paper_mm: [f64; 3],
    /// Position of this program's B: edges counted at its step pins, or its own report if it is on
    /// a serial line.
    #[serde(rename = "tracked")]
    pub tracked_mm: [f64; 3],
}

impl Stop {
    /// Returns the tracked minus the true position, mm.
    pub fn error_mm(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.tracked_mm[i] - self.true_mm[i])
    }
}

/// Positions of both stations at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time since the keyframe, s.
    pub time_s: f64,
    /// Position of the poster, mm.
    pub target_mm: [f64; 3],
    /// Position of the cameras, mm.
    pub camera_mm: [f64; 3],
}

/// Result of the experiment.
#[derive(Clone, Debug)]
pub struct Run {
    /// Positions after each move.
    pub stops: Vec<Stop>,
    /// Steps of the servo, one per frame set.
    pub steps: Vec<SimulatedStep>,
    /// Positions of both stations every 5 ms. If B is on a serial line, its position is known only
    /// at its status reports, and there is one sample per frame set.
    pub samples: Vec<Sample>,
    /// Pulses per station, A then B.
    pub pulses: [Pulses; 2],
    /// Steps per mm of B's stage.
    pub steps_per_mm: [f64; 3],
    /// Description of B for the reader.
    pub station: String,
    /// Fault that B had latched before the run and that the start cleared.
    pub cleared: Option<Fault>,
    /// Bound of B's time synchronisation, µs; `None` for a twin.
    pub sync_bound_us: Option<u64>,
}

/// Steps of one station from its zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pulses {
    /// Steps counted by the station itself.
    pub commanded: [i64; 3],
    /// Edges counted at the pins; `None` if nothing counts them.
    pub counted: Option<[i64; 3]>,
}

impl Pulses {
    /// Returns true unless counted edges differ from the station's count.
    pub fn agree(&self) -> bool {
        self.counted.is_none_or(|counted| counted == self.commanded)
    }
}

impl Run {
    /// Returns the number of frame sets that the station used.
    pub fn used(&self) -> usize {
        self.steps
            .iter()
            .filter(|step| step.turn.outcome.is_used())
            .count()
    }

    /// Returns the largest |error| over the stops per axis, mm.
    pub fn worst_mm(&self) -> [f64; 3] {
        let worst = |i: usize| {
            self.stops
                .iter()
                .map(|stop| stop.error_mm()[i].abs())
                .fold(0.0, f64::max)
        };
        std::array::from_fn(worst)
    }

    /// Returns true if every stop is within [`BOUND_MM`] and no counted step is missing.
    pub fn succeeded(&self) -> bool {
        let within = self
            .worst_mm()
            .iter()
            .zip(BOUND_MM)
            .all(|(worst, bound)| *worst <= bound);
        within && self.pulses.iter().all(Pulses::agree)
    }
}

/// Runs the experiment with B in `place`, moving `stage`. Calls `progress` with the share done, 0
/// to 1, after every frame set.
///
/// # Errors
/// If a station cannot be reached, refuses or faults, or the keyframe shows nothing usable.
pub fn run(
    settings: &Settings,
    stage: &Stage,
    place: StationPlace<'_>,
    progress: impl FnMut(f64),
) -> Result<Run, ServoError> {
    run_recorded(settings, stage, place, None, Takers::new(), progress)
}

/// Runs the experiment as [`run`] does, records it with `tap`, and gives its frame sets to
/// `takers`.
///
/// # Errors
/// As [`run`].
pub fn run_recorded(
    settings: &Settings,
    stage: &Stage,
    place: StationPlace<'_>,
    tap: Option<Arc<Tap>>,
    mut takers: Takers,
    mut progress: impl FnMut(f64),
) -> Result<Run, ServoError> {
    takers.extend(tap.clone().map(|tap| tap as Arc<dyn FrameSetTaker>));
    let rig = Rig::paper();
    let texture = Texture::of_kind(settings.texture, settings.seed);
    let mut world = SimulatedWorld::new_observed(
        &rig,
        stage,
        place,
        &texture,
        settings.scene,
        settings.seed,
        tap.clone().map(|tap| tap as Arc<dyn StationObserver>),
    )?;
    let mut servo = SimulatedServo::start_observed(
        &mut world,
        &rig,
        settings.timing,
        settings.estimator,
        observers_of(takers, &rig),
    )?;
    let (mut stops, mut steps, mut samples) = (Vec::new(), Vec::new(), Vec::new());
    let total_s = MOVES as f64 * settings.rest_s;
    // Delay of the moves behind their schedule, s.
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
            // A remote station's position is known only at its status reports.
            while world.b.twin().is_some()
                && world.now().plus_micros(5_000) < servo.next_capture(&world)
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
            used += usize::from(step.turn.outcome.is_used());
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
    // Read at rest, so that all commanded steps are out.
    world.b.command("stop", Command::Stop)?;
    world.advance(world.now().max(world.b.now()).plus_micros(300_000));
    if let Some(tap) = tap {
        tap.end(world.b.now().micros());
    }
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

fn sample(servo: &SimulatedServo, world: &SimulatedWorld) -> Sample {
    let [target_mm, camera_mm] = servo.positions_mm(world);
    Sample {
        time_s: servo.time_s(world),
        target_mm,
        camera_mm,
    }
}
