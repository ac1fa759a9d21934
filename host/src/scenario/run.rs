//! The loop of a scenario: cameras, host and station on virtual time, in the order of their events.
//!
//! Frames are pipelined: a frame set is taken every period, and each frame arrives after its own
//! latency, so that several may be under way. The true position is sampled every millisecond from
//! the edges at the station's pins.

mod events;
mod look;

use super::cameras::Eyes;
use super::file::{Happening, Scenario};
use super::motion::Way;
use super::trace::{Sample, Trace};
use crate::servo::ServoError;
use crate::servo::recording::{FrameSetTaker, Takers};
use look::Look;
use std::collections::BTreeMap;
use std::sync::Arc;
use trinocular_client::StationError;
use trinocular_client::stage::configuration;
use trinocular_client::twin::Twin;
use trinocular_core::frame::message::{Command, Frame, Mounting, Status};
use trinocular_core::safety::{Fault, State};
use trinocular_core::time::Instant;
use trinocular_recording::recorder::Tap;

/// Time between two samples, µs.
const SAMPLE_US: u64 = 1_000;

/// Time between two inspections of the pins for reversals, µs: a segment of the planner.
const LOOK_US: u64 = 250;

/// Longest time for the stage to come to rest at the end, µs.
const REST_US: u64 = 10_000_000;

/// Options of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScenarioOptions {
    /// True if the station predicts the target's position; otherwise the stage goes to the last
    /// measured position.
    pub prediction: bool,
    /// Name that the station gives in its hello, at most 16 bytes.
    pub board: &'static str,
    /// True if the twin keeps a [`Tape`](trinocular_client::tape::Tape).
    pub record: bool,
}

impl Default for ScenarioOptions {
    fn default() -> Self {
        Self {
            prediction: true,
            board: "twin",
            record: false,
        }
    }
}

/// A scenario that has been run.
#[derive(Debug)]
pub struct Run {
    /// Trace of the run.
    pub trace: Trace,
    /// The station, at rest.
    pub twin: Twin,
}

/// An action that is due. Actions of one instant happen in the order of their rank.
#[derive(Debug)]
enum Due {
    Begin(usize),
    End(usize),
    Capture(u64),
    Arrival(Box<Frame>),
    Sample(u64),
}

impl Due {
    const fn rank(&self) -> u8 {
        match self {
            Self::Begin(_) | Self::End(_) => 0,
            Self::Capture(_) => 1,
            Self::Arrival(_) => 2,
            Self::Sample(_) => 3,
        }
    }
}

/// A command that waits for its answer.
#[derive(Debug)]
enum Asked {
    Frame,
    Zero,
    Other(&'static str),
}

struct RunningScenario<'a> {
    scenario: &'a Scenario,
    way: Way,
    eyes: Eyes,
    twin: Twin,
    /// Instant of the keyframe on the common clock.
    start: Instant,
    /// Position of the cameras at the keyframe, mm from their position at power-up.
    origin_mm: [f64; 3],
    /// Events by instant, rank and number; the number keeps events of equal rank in the order of
    /// their creation.
    agenda: BTreeMap<(u64, u8, u64), Due>,
    made: u64,
    /// Per event: true while it lasts.
    lasts: Vec<bool>,
    /// Per event: number of frame sets that it still affects.
    frames_left: Vec<u32>,
    asked: Vec<(u16, Asked)>,
    /// Steps at the pins when the position was last zeroed.
    zero_steps: [i64; 3],
    looked: Look,
    last_estimate: Option<u16>,
    latched: Option<Fault>,
    trace: Trace,
}

/// Runs a scenario. Calls `progress` with the share done, 0 to 1, at every frame set.
///
/// # Errors
/// If the scene shows nothing usable, or the station refuses the stage. Later faults are part of
/// the trace.
///
/// # Example
/// ```
/// use std::path::Path;
/// use trinocular::scenario::figures::Figures;
/// use trinocular::scenario::file::Scenario;
/// use trinocular::scenario::run::{ScenarioOptions, run};
///
/// let text = r#"
/// title = "A line"
/// seed = 1
///
/// [cameras]
/// kind = "points"
/// frames_per_s = 60.0
/// latency_ms = 20.0
/// depth_mm = 850.0
/// noise_px = 0.01
/// points = 100
///
/// [[target]]
/// motion = "line"
/// velocity_mm_s = [5.0, 0.0, 0.0]
/// seconds = 1.0
///
/// [expect]
/// max_mm = [0.5, 0.1, 0.1]
/// "#;
/// let scenario = Scenario::parse(Path::new("line.toml"), text)?;
/// let run = run(&scenario, ScenarioOptions::default(), |_share| ())?;
/// let figures = Figures::of(&scenario, &run.trace);
/// assert!(scenario.missed(&run.trace, &figures, None).is_empty(), "{:?}", figures.max_mm);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn run(
    scenario: &Scenario,
    options: ScenarioOptions,
    progress: impl FnMut(f64),
) -> Result<Run, ServoError> {
    run_recorded(scenario, options, None, Takers::new(), progress)
}

/// Runs a scenario as [`run`] does, records it with `tap`, and gives its frame sets to `takers`.
///
/// # Errors
/// As [`run`].
pub fn run_recorded(
    scenario: &Scenario,
    options: ScenarioOptions,
    tap: Option<Arc<Tap>>,
    mut takers: Takers,
    mut progress: impl FnMut(f64),
) -> Result<Run, ServoError> {
    takers.extend(tap.clone().map(|tap| tap as Arc<dyn FrameSetTaker>));
    let mut world = RunningScenario::new(scenario, options, tap.clone(), takers)?;
    let end_us = seconds_us(world.way.seconds());
    while let Some(entry) = world.agenda.first_entry() {
        let at_us = entry.key().0;
        if at_us > end_us {
            break;
        }
        let due = entry.remove();
        world.live_until(at_us);
        if matches!(due, Due::Capture(_)) {
            progress(at_us as f64 / end_us as f64);
        }
        world.happen(at_us, due);
    }
    world.come_to_rest();
    if let Some(tap) = tap {
        tap.end(world.twin.now().micros());
    }
    Ok(Run {
        trace: world.trace,
        twin: world.twin,
    })
}

fn seconds_us(seconds: f64) -> u64 {
    (seconds * 1e6).round() as u64
}

impl<'a> RunningScenario<'a> {
    /// Switches the station on, at zero, and takes the keyframe.
    fn new(
        scenario: &'a Scenario,
        options: ScenarioOptions,
        tap: Option<Arc<Tap>>,
        takers: Takers,
    ) -> Result<Self, ServoError> {
        let mut eyes = Eyes::open_recorded(&scenario.cameras, scenario.seed, takers)?;
        let mut config = configuration(&scenario.stage, Mounting::OnStage)?;
        config.tracking.prediction &= options.prediction;
        let (stage, board) = (&scenario.stage, options.board);
        let mut twin = match (tap, options.record) {
            (Some(tap), _) => Twin::power_on_observed(stage, board, tap)?,
            (None, true) => Twin::power_on_recorded(stage, board)?,
            (None, false) => Twin::power_on(stage, board)?,
        };
        twin.command("config", Command::Config(config))?;
        twin.zero()?;
        // On a tick, so that samples show what each tick said; and some time after the first ping.
        let start_us = (twin.now().micros() / SAMPLE_US + 50) * SAMPLE_US;
        let start = Instant::from_micros(start_us);
        twin.advance(start);
        eyes.servo.set_keyframe_time(station_time(&twin)?);
        let mut world = Self {
            way: Way::new(&scenario.legs),
            eyes,
            start,
            origin_mm: twin.position_mm(),
            agenda: BTreeMap::new(),
            made: 0,
            lasts: vec![false; scenario.events.len()],
            frames_left: vec![0; scenario.events.len()],
            asked: Vec::new(),
            zero_steps: twin.steps(),
            looked: Look::at(twin.steps()),
            last_estimate: None,
            latched: None,
            trace: Trace::default(),
            scenario,
            twin,
        };
        for (index, event) in scenario.events.iter().enumerate() {
            world.plan(seconds_us(event.at_s), Due::Begin(index));
            if event.what.seconds() > 0.0 {
                let end_s = event.at_s + event.what.seconds();
                world.plan(seconds_us(end_s), Due::End(index));
            }
            if event.what.is_abrupt() {
                world.trace.abrupt_s.push(event.at_s);
            }
        }
        world.plan(0, Due::Sample(0));
        world.plan_capture(1);
        Ok(world)
    }

    fn plan(&mut self, at_us: u64, due: Due) {
        self.made += 1;
        self.agenda.insert((at_us, due.rank(), self.made), due);
    }

    fn plan_capture(&mut self, number: u64) {
        let at_s = number as f64 / self.scenario.cameras.frames_per_s;
        self.plan(seconds_us(at_s), Due::Capture(number));
    }

    /// Advances virtual time to `at_us` and inspects the pins on the way.
    fn live_until(&mut self, at_us: u64) {
        let end = self.start.plus_micros(at_us);
        while self.twin.now() < end {
            let next = self.twin.now().micros() / LOOK_US * LOOK_US + LOOK_US;
            self.twin.advance(Instant::from_micros(next).min(end));
            self.looked.again(self.twin.steps());
        }
    }

    fn happen(&mut self, at_us: u64, due: Due) {
        match due {
            Due::Begin(index) => self.begin(at_us, index),
            Due::End(index) => self.end(index),
            Due::Capture(number) => {
                self.capture(at_us, number);
                self.plan_capture(number + 1);
            }
            Due::Arrival(frame) => match self.is_silent() {
                true => self.trace.frames.lost += 1,
                false => self.send(Asked::Frame, Command::Frame(*frame)),
            },
            Due::Sample(number) => {
                self.sample(at_us);
                self.plan(at_us + SAMPLE_US, Due::Sample(number + 1));
            }
        }
    }

    fn capture(&mut self, at_us: u64, number: u64) {
        let time_s = at_us as f64 * 1e-6;
        self.trace.frames.taken += 1;
        self.trace.captures_s.push(time_s);
        let (mut latency_ms, mut dropped) = (self.scenario.cameras.latency_ms, false);
        let mut view_mm = self.way.at(time_s);
        let camera_mm = self.camera_mm();
        for (axis, mm) in view_mm.iter_mut().enumerate() {
            *mm -= camera_mm[axis];
        }
        for what in self.take_frame_events() {
            match what {
                Happening::Drop { .. } => dropped = true,
                Happening::Late { by_ms, .. } => latency_ms += by_ms,
                Happening::Outlier { by_mm, .. } => {
                    view_mm = std::array::from_fn(|i| view_mm[i] + by_mm[i]);
                }
                _ => {}
            }
        }
        if dropped {
            self.trace.frames.lost += 1;
            return;
        }
        self.eyes.taken(station_time(&self.twin).ok(), camera_mm);
        let occluded = self
            .lasting()
            .any(|what| matches!(what, Happening::Occlusion { .. }));
        let seen = match occluded {
            true => self.eyes.see_occluder(number),
            false => self.eyes.see(number, view_mm),
        };
        match (seen, station_time(&self.twin)) {
            (Ok(sums), Ok(capture)) => {
                let frame = self.eyes.servo.frame(capture, sums);
                let arrival_us = at_us + seconds_us(latency_ms * 1e-3);
                self.plan(arrival_us, Due::Arrival(Box::new(frame)));
            }
            (Err(refusal), _) => self.trace.frames.refuse(&refusal),
            (_, Err(silent)) => self.trace.frames.refuse(&silent),
        }
    }

    fn send(&mut self, asked: Asked, command: Command) {
        let sequence = self.twin.send(command);
        self.asked.push((sequence, asked));
    }

    fn camera_mm(&self) -> [f64; 3] {
        let now = self.twin.position_mm();
        std::array::from_fn(|i| now[i] - self.origin_mm[i])
    }

    fn sample(&mut self, at_us: u64) {
        let time_s = at_us as f64 * 1e-6;
        self.collect_answers(time_s);
        let status = self.twin.status().copied();
        if let Some(status) = &status {
            self.watch(time_s, status);
        }
        self.trace.samples.push(Sample {
            time_s,
            target_mm: self.way.at(time_s),
            camera_mm: self.camera_mm(),
            reversals: self.looked.reversals,
            state: status.map_or(State::Unconfigured, |status| status.state),
        });
    }

    fn watch(&mut self, time_s: f64, status: &Status) {
        let (trace, latched) = (&mut self.trace, &mut self.latched);
        if trace.states.last() != Some(&status.state) {
            trace.states.push(status.state);
        }
        if trace.sights.last() != Some(&status.sight) {
            trace.sights.push(status.sight);
        }
        if *latched != status.fault {
            trace.faults.extend(status.fault);
            trace.faults_s.extend(status.fault.map(|_| time_s));
            *latched = status.fault;
        }
        if let Some(estimate) = status.estimate
            && self.last_estimate != Some(estimate.sequence)
        {
            self.last_estimate = Some(estimate.sequence);
            trace.latencies_us.push(estimate.latency_us);
        }
    }

    fn collect_answers(&mut self, time_s: f64) {
        for (sequence, asked) in std::mem::take(&mut self.asked) {
            let Some(answer) = self.twin.answer(sequence) else {
                self.asked.push((sequence, asked));
                continue;
            };
            match (asked, answer) {
                (Asked::Frame, answer) => self.trace.frames.answer(answer),
                (Asked::Zero, Ok(())) => self.zero_steps = self.twin.steps(),
                (Asked::Other(_), Ok(())) => {}
                (asked, Err(denial)) => {
                    let name = match asked {
                        Asked::Other(name) => name,
                        Asked::Frame | Asked::Zero => "zero",
                    };
                    let text = format!("{name} at {time_s:.3} s: {denial}");
                    self.trace.refused_commands.push(text);
                }
            }
        }
    }

    /// Stops the stage, and compares the planned steps with those at the pins.
    fn come_to_rest(&mut self) {
        let waiting = self.asked.iter();
        let waiting = waiting.filter(|(_, asked)| matches!(asked, Asked::Frame));
        self.trace.frames.unanswered = waiting.count() as u32;
        self.trace.frames.under_way = self
            .agenda
            .values()
            .filter(|due| matches!(due, Due::Arrival(_)))
            .count() as u32;
        self.twin.set_pings(true);
        self.twin.send(Command::Stop);
        let end = self.twin.now().plus_micros(REST_US);
        let moves = |twin: &Twin| twin.status().is_none_or(|status| status.state.is_moving());
        // Wait at least until the next status, and until all words are out.
        loop {
            self.twin.advance(self.twin.now().plus_micros(200_000));
            if !moves(&self.twin) || self.twin.now() >= end {
                break;
            }
        }
        let steps = self.twin.steps();
        self.trace.steps = steps;
        let planned = self.twin.status().map_or([0; 3], |s| s.position_steps);
        self.trace.missing_steps =
            std::array::from_fn(|i| i64::from(planned[i]) - (steps[i] - self.zero_steps[i]));
    }
}

/// Returns the present instant on the station's clock, as the host knows it.
fn station_time(twin: &Twin) -> Result<Instant, StationError> {
    let there = twin.station_time(twin.now());
    there.ok_or(StationError::Silent {
        command: "ping",
        waited_ms: 0,
    })
}
