//! Judges a life by the laws.
//!
//! The judge has the data of an outside observer: the packets sent, the switches, the port words,
//! and the reports. It shares no code with the station except the message types.

mod commands;
mod kinematics;
mod motion;
mod statuses;

use crate::laws::{Law, Violation};
use crate::pins::Pins;
use kinematics::Bounds;
use kinematics::Trail;
pub use statuses::hide_faults;
use std::collections::HashMap;
use std::io::Write as _;
use trinocular_core::frame::message::{Command, Config, Outcome, Report, Side, Status};
use trinocular_core::safety::{Fault, Inputs, State, Trust};

/// A command in flight.
#[derive(Clone, Copy, Debug)]
struct Sent {
    command: Command,
    /// Number of the command within the life.
    order: u64,
}

/// Directions in which a command may move an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Ways {
    backward: bool,
    forward: bool,
}

/// Motion that a command asks for.
#[derive(Clone, Copy, Debug)]
struct Request {
    sequence: u16,
    ways: [Ways; 3],
    /// True if every step from rest must be in these directions.
    strict: bool,
}

/// A stop that is in force.
#[derive(Clone, Copy, Debug)]
struct Stop {
    order: u64,
    /// Latest time at which a control tick has taken the stop in, µs.
    obeyed_us: u64,
    /// Latest end of the ramp, µs.
    ended_us: f64,
}

/// Duration for which a cause of an abrupt stop has been sensed.
#[derive(Clone, Copy, Debug, Default)]
struct Cause {
    /// Instant at which the cause appeared, µs.
    since_us: Option<u64>,
    /// Segments given out since then.
    segments: u32,
}

impl Cause {
    /// Updates the cause with the switch's state as a segment is given out.
    fn sense(&mut self, present: bool) {
        match present {
            true => self.segments = self.segments.max(1),
            false => *self = Self::default(),
        }
    }

    /// Counts one more segment.
    fn age(&mut self) {
        self.segments += u32::from(self.segments > 0);
    }

    /// Returns true if a control tick has taken the cause in.
    fn is_seen(&self) -> bool {
        self.segments >= SEGMENTS
    }
}

/// Segments in a control tick.
const SEGMENTS: u32 = 4;

/// Counts of one life or several.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    /// Commands sent as whole packets.
    pub commands: u64,
    /// Rising STEP edges.
    pub edges: u64,
    /// DIR edges.
    pub turns: u64,
    /// Reports received.
    pub reports: u64,
    /// Comparisons of a number with its bound or its expected value.
    pub comparisons: u64,
    /// Simulated time of the station, µs.
    pub us: u64,
}

impl Counts {
    /// Adds the counts of another life.
    pub fn add(&mut self, other: &Self) {
        self.commands += other.commands;
        self.edges += other.edges;
        self.turns += other.turns;
        self.reports += other.reports;
        self.comparisons += other.comparisons;
        self.us += other.us;
    }
}

/// The judge of one life.
pub struct Judge {
    pub violations: Vec<Violation>,
    pub counts: Counts,
    trace: bool,
    birth_us: u64,
    now_us: u64,
    pins: Pins,
    segments: u64,

    config: Option<Config>,
    bounds: [Bounds; 3],
    /// Least bounds that ramps may use.
    ramps: [Bounds; 3],
    /// Unit of which the station's speed, acceleration and jerk are multiples, steps and ticks.
    quantum: f64,
    /// Highest speed at present, and the end of the time for which a higher previous limit may
    /// last.
    caps: [(f64, f64); 3],
    trails: [Trail; 3],
    /// Motor positions and load positions, steps.
    steps: [i64; 3],
    load: [i64; 3],
    /// Reported position minus load position; `None` before the first status.
    origin: Option<[i64; 3]>,
    /// Motion of the axes by the pins, mm, in the scale of its time; DIR high is forwards.
    mm: [f64; 3],
    /// Coarsest step of each axis so far, mm.
    grain: [f64; 3],
    /// Largest backlash of each axis so far, mm.
    slack: [f64; 3],
    /// Reported position at the last rest, steps.
    rested: [i64; 3],
    /// Possible centres of the window, mm.
    anchors: Vec<[f64; 3]>,

    sent: HashMap<u16, Sent>,
    stale: Vec<u16>,
    requests: Vec<Request>,
    stop: Option<Stop>,
    /// Number of pings and hellos not answered yet.
    greetings: i64,
    dropped: u64,
    pinged_us: u64,
    /// Latest end of the ramp after a heartbeat timeout; `None` while the heartbeat holds.
    silent_until_us: Option<f64>,

    status: Option<Status>,
    /// State in which nothing may move before a reset or a configuration.
    resting: Option<State>,
    trust: Trust,
    homing: bool,
    emergency: Cause,
    driver: Cause,
    limits: [[Cause; 2]; 3],
    /// Instant at which a cause of an abrupt stop was last sensed.
    excused_us: Option<u64>,
    /// True if motion ended abruptly and no zero followed.
    abrupt: bool,
    /// True if the drivers hold the motors.
    motors: bool,
    /// Instant of an abrupt end that no status has named yet.
    unnamed_us: Option<u64>,
    named_us: Option<u64>,
    reset_us: Option<u64>,
    zeroed_us: Option<u64>,
    /// Faults that a status has named since the last reset.
    told: Vec<Fault>,
    /// Causes that have gone without being named.
    owed: Vec<Fault>,
}

impl Judge {
    /// Returns the judge of a station that is switched on at `birth_us`.
    pub fn new(hz: u32, birth_us: u64, trace: bool) -> Self {
        Self {
            violations: Vec::new(),
            counts: Counts::default(),
            trace,
            birth_us,
            now_us: birth_us,
            pins: Pins::new(hz),
            segments: 0,
            config: None,
            bounds: [Bounds::default(); 3],
            ramps: [Bounds::default(); 3],
            quantum: 2.0 * (f64::from(hz) / 2_000.0).powi(2) / 4_294_967_296.0,
            caps: [(0.0, 0.0); 3],
            trails: Default::default(),
            steps: [0; 3],
            load: [0; 3],
            origin: None,
            mm: [0.0; 3],
            grain: [0.0; 3],
            slack: [0.0; 3],
            rested: [0; 3],
            anchors: vec![[0.0; 3]],
            sent: HashMap::new(),
            stale: Vec::new(),
            requests: Vec::new(),
            stop: None,
            greetings: 0,
            dropped: 0,
            pinged_us: birth_us,
            silent_until_us: None,
            status: None,
            resting: Some(State::Unconfigured),
            trust: Trust::Unknown,
            homing: false,
            emergency: Cause::default(),
            driver: Cause::default(),
            limits: [[Cause::default(); 2]; 3],
            excused_us: None,
            abrupt: false,
            motors: false,
            unnamed_us: None,
            named_us: None,
            reset_us: None,
            zeroed_us: None,
            told: Vec::new(),
            owed: Vec::new(),
        }
    }

    /// Prints a line of the trace.
    pub fn note(&self, now_us: u64, text: impl FnOnce() -> String) {
        if self.trace {
            // A reader that closes the pipe is no reason to stop.
            let _ = writeln!(std::io::stdout(), "{:10.3} ms  {}", self.ms(now_us), text());
        }
    }

    fn ms(&self, now_us: u64) -> f64 {
        (now_us - self.birth_us) as f64 / 1000.0
    }

    /// Records a broken law; only the first time of each law counts.
    pub fn breaks(&mut self, law: Law, text: impl FnOnce() -> String) {
        if self.violations.iter().any(|violation| violation.law == law) {
            return;
        }
        let violation = Violation {
            law,
            at_ms: self.ms(self.now_us),
            text: text(),
        };
        self.note(self.now_us, || {
            format!("BREAKS {}: {}", law.name(), violation.text)
        });
        self.violations.push(violation);
    }

    /// Takes in a change of the switches.
    pub fn switched(&mut self, now_us: u64, inputs: &Inputs) {
        self.note(now_us, || {
            let (stop, driver) = (inputs.emergency_stop, inputs.driver_fault);
            format!(
                "switches {:?} emergency stop {stop} driver {driver}",
                inputs.limits
            )
        });
        let causes = [
            (
                &mut self.emergency,
                inputs.emergency_stop,
                Fault::EmergencyStop,
            ),
            (&mut self.driver, inputs.driver_fault, Fault::Driver),
        ];
        for (cause, present, fault) in causes {
            match (present, cause.since_us) {
                (true, None) => cause.since_us = Some(now_us),
                (true, Some(_)) => {}
                (false, since_us) => {
                    // The shell has sensed even a short press, unless it fell between two polls.
                    let lasted = since_us.is_some_and(|since_us| since_us < now_us);
                    if lasted && !self.told.contains(&fault) {
                        self.owed.push(fault);
                    }
                    if since_us.is_some() {
                        self.excused_us = Some(now_us);
                    }
                    *cause = Cause::default();
                }
            }
        }
    }

    /// Records that the shell stalled for `us`: everything expected may come later by as much.
    pub fn stalled(&mut self, now_us: u64, us: u64) {
        self.note(now_us, || format!("the shell stalls for {us} us"));
        self.now_us = now_us;
        if let Some(stop) = &mut self.stop {
            stop.obeyed_us += us;
            stop.ended_us += us as f64;
        }
        if let Some(until) = &mut self.silent_until_us {
            *until += us as f64;
        }
        for (_, until) in &mut self.caps {
            *until += us as f64;
        }
        self.excused_us = Some(now_us);
    }

    /// Checks a report of the station.
    pub fn heard(&mut self, now_us: u64, report: &Report) {
        self.now_us = now_us;
        self.counts.reports += 1;
        match report {
            Report::Answer {
                sequence, outcome, ..
            } => {
                self.note(now_us, || format!("  answer {sequence}: {outcome:?}"));
                self.answered(*sequence, *outcome);
            }
            Report::Status(status) => self.told(status),
            Report::Pong { .. } => self.greetings -= 1,
            Report::Hello(_) => self.greetings -= 1,
            Report::LastRun(_) | Report::Triggered(_) => {}
        }
    }

    /// Returns the station's last status.
    pub fn status(&self) -> Option<&Status> {
        self.status.as_ref()
    }

    /// Returns the steps counted at the pins since the last zero.
    pub fn place(&self) -> Option<[i64; 3]> {
        let origin = self.origin?;
        Some(std::array::from_fn(|axis| self.load[axis] - origin[axis]))
    }

    /// Ends the life. Commands without an answer must have been counted by the station.
    pub fn end(&mut self, now_us: u64) {
        self.now_us = now_us;
        self.counts.us = now_us - self.birth_us;
        self.counts.turns = self.pins.turns;
        self.counts.edges = self.pins.rises;
        self.counts.comparisons += self.trails.iter().map(|trail| trail.compared).sum::<u64>();
        let (missing, dropped) = (self.sent.len() as u64, self.dropped);
        self.counts.comparisons += 2;
        if missing > dropped {
            let kinds: Vec<_> = self
                .sent
                .values()
                .take(6)
                .map(|sent| kind(&sent.command))
                .collect();
            self.breaks(Law::Answered, || {
                format!("{missing} commands have no answer ({kinds:?}), {dropped} are counted")
            });
        }
        let greetings = self.greetings.max(0) as u64;
        if greetings + missing.min(dropped) > dropped {
            self.breaks(Law::Pong, || {
                format!("{greetings} pings and hellos have no answer, {dropped} are counted")
            });
        }
    }

    /// Returns the backlash of an axis, steps.
    fn play(&self, axis: usize) -> i64 {
        self.config.as_ref().map_or(0, |config| {
            let um = f64::from(config.stage.backlash_um[axis]);
            (um * f64::from(config.axes[axis].steps_per_m) / 1e6).round() as i64
        })
    }

    /// Returns the switch that homing seeks on this axis.
    fn sought(&self, axis: usize) -> Option<Side> {
        let home = self.config.as_ref()?.stage.home[axis]?;
        self.homing.then_some(home.side)
    }
}

/// Returns the command's name.
pub fn kind(command: &Command) -> &'static str {
    match command {
        Command::Hello => "hello",
        Command::Config(_) => "config",
        Command::Frame(_) => "frame",
        Command::Setpoint { .. } => "setpoint",
        Command::Jog { .. } => "jog",
        Command::Zero => "zero",
        Command::Stop => "stop",
        Command::Reset => "reset",
        Command::Ping { .. } => "ping",
        Command::Home { .. } => "home",
        Command::Motors { .. } => "motors",
        Command::Trigger(_) => "trigger",
    }
}

/// Returns true if the station accepted a command.
fn accepted(outcome: Outcome) -> bool {
    outcome == Outcome::Accepted
}
