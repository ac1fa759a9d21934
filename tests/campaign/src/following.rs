//! A life that follows a target: simulated cameras see the stage that the pins move.

use crate::frames::displaced;
use crate::judge::Counts;
use crate::laws::{Law, Violation};
use crate::life::Fate;
use crate::pins::{Pins, WIRING};
use crate::random::Random;
use crate::scene::{Cameras, Mm, Plant, Sickness, Target, each};
use crate::shell::{Deed, Shell};
use crate::stages;
use std::collections::VecDeque;
use std::io::Write as _;
use trinocular_core::frame::message::{Command, Config, Frame, Report, Status};
use trinocular_core::safety::State;
use trinocular_core::steps::WordRate;
use trinocular_core::time::Instant;

/// Limit of motion that the cameras do not see, mm: the host's default.
const UNSEEN_MM: f64 = 10.0;

/// Longest time that wrong following may last, s.
const NAMED_WITHIN_S: f64 = 2.0;

/// Smallest motion that counts as wrong following, mm peak to peak within a second.
const WRONG_MM: f64 = 1.0;

/// Share of the target's own motion. Following is useful only while the distance to the target
/// changes by less.
const USELESS: f64 = 0.5;

/// A station that follows a target.
struct Following {
    shell: Shell,
    pins: Pins,
    plant: Plant,
    target: Target,
    cameras: Cameras,
    sickness: Sickness,
    random: Random,
    config: Config,
    ping_us: u64,
    birth_us: u64,
    status: Option<Status>,
    /// Pin positions, target, and distance between stage and target, every 5 ms of the last second.
    recent: VecDeque<[Mm; 3]>,
    /// Time since which following is wrong, s, and the pin positions then.
    wrong: Option<(f64, Mm)>,
    /// Least and greatest position of the target.
    hull: [Mm; 2],
    farthest: f64,
    fate: Fate,
    trace: bool,
}

/// Simulates the life of `seed`. Every second life is healthy.
pub fn live(seed: u64, trace: bool) -> Fate {
    let mut random = Random::new(seed ^ 0x6c6f_6f70);
    let healthy = seed.is_multiple_of(2);
    let mut life = Following::new(&mut random, healthy, trace);
    life.note(0.0, || String::from("begins"));
    let seconds = life.begin(healthy);
    life.follow(seconds);
    life.finish(healthy)
}

impl Following {
    fn new(random: &mut Random, healthy: bool, trace: bool) -> Self {
        let config = config(random);
        let seconds = 5.0;
        let sickness = match healthy {
            true => Sickness::None,
            false => Sickness::any(random, seconds),
        };
        let fastest = f64::from(config.axes[0].max_speed_um_s) / 1000.0;
        let (target, cameras) = match healthy {
            true => healthy_scene(random, seconds, fastest),
            false => sick_scene(random, seconds, fastest, &sickness),
        };
        let rate = WordRate::MHZ_1;
        let birth_us = 1_000_000;
        let mm_per_step = 1e3 / f64::from(config.axes[0].steps_per_m);
        Self {
            shell: Shell::new(rate, 512, birth_us),
            pins: Pins::new(rate.hz()),
            plant: Plant::new(mm_per_step),
            target,
            cameras,
            sickness,
            random: random.clone(),
            config,
            ping_us: birth_us,
            birth_us,
            status: None,
            recent: VecDeque::new(),
            wrong: None,
            hull: [[0.0; 3]; 2],
            farthest: 0.0,
            fate: Fate {
                counts: Counts::default(),
                violations: Vec::new(),
            },
            trace,
        }
    }

    fn note(&self, s: f64, text: impl FnOnce() -> String) {
        if self.trace {
            let _ = writeln!(std::io::stdout(), "{s:8.4} s  {}", text());
        }
    }

    /// Returns the time of the life, s.
    fn now(&self) -> f64 {
        (self.shell.now_us() - self.birth_us) as f64 / 1e6
    }

    fn begin(&mut self, healthy: bool) -> f64 {
        self.note(0.0, || {
            let kind = if healthy { "healthy" } else { "sick" };
            format!(
                "{kind} {:?} {:?} {:?}",
                self.sickness, self.cameras, self.target
            )
        });
        for command in [Command::Hello, Command::Config(self.config), Command::Zero] {
            self.send(command);
            self.run(2_000);
        }
        5.0
    }

    fn send(&mut self, command: Command) {
        let (_, bytes) = self.shell.packet(command);
        self.fate.counts.commands += 1;
        self.shell.receive(&bytes);
    }

    fn follow(&mut self, seconds: f64) {
        let begin = self.now();
        let mut capture = begin + 0.001;
        let mut waiting: VecDeque<f64> = VecDeque::new();
        while capture < begin + seconds && !self.is_over() {
            waiting.push_back(capture);
            let next = capture + self.cameras.interval(&mut self.random).max(0.0005);
            // Handle everything that arrives before the next capture.
            while let Some(&first) = waiting.front()
                && (first + self.cameras.latency_s <= next)
            {
                waiting.pop_front();
                self.arrives(first);
            }
            capture = next;
        }
        self.run(100_000);
    }

    /// Returns true if there is a fault and the stage has come to rest.
    fn is_over(&self) -> bool {
        let state = self.status.as_ref().map(|status| status.state);
        matches!(state, Some(State::Faulted | State::Stopped))
    }

    /// Delivers the flow sums of a frame set.
    fn arrives(&mut self, capture: f64) {
        let at = capture + self.cameras.latency_s;
        let us = ((at - self.now()).max(0.0) * 1e6) as u64;
        self.run(us);
        if !self.cameras.sees(capture) {
            return;
        }
        let (target, stage) = (self.target.at(capture), self.plant.at(capture));
        let displacement = each(|axis| target[axis] - stage[axis]);
        let seen = self.cameras.see(&mut self.random, displacement);
        // The target is out of view.
        if seen.iter().any(|mm| mm.abs() > 60.0) {
            return;
        }
        let stamp = ((capture + self.cameras.stamp_s) * 1e6) as u64 + self.birth_us;
        self.send(Command::Frame(Frame {
            capture: Instant::from_micros(stamp),
            reference: Instant::from_micros(self.birth_us),
            sums: displaced(seen, self.cameras.sigma),
        }));
        self.plant.forget(capture - 0.5);
    }

    fn run(&mut self, us: u64) {
        let end = self.shell.now_us() + us;
        loop {
            // Sample all positions every 5 ms.
            let look = (self.shell.now_us() / 5_000 + 1) * 5_000;
            let next = look.min(end).min(self.ping_us.max(self.shell.now_us()));
            self.play(next);
            if self.shell.now_us() >= self.ping_us {
                self.send(Command::Ping { host_us: next });
                self.ping_us += 20_000;
            }
            if self.shell.now_us() == look {
                self.look();
            }
            if self.shell.now_us() >= end {
                break;
            }
        }
    }

    fn play(&mut self, end: u64) {
        loop {
            match self.shell.step(end) {
                Deed::Report(Report::Status(status)) => self.hear(status),
                Deed::Report(Report::Answer { outcome, .. }) => {
                    self.note(self.now(), || format!("  answer {outcome:?}"));
                }
                Deed::Report(_) => {}
                Deed::Garbage => self.breaks(Law::Report, "bytes that are no report".into()),
                Deed::Refused(fault) => self.breaks(Law::Segment, fault.to_string()),
                Deed::Words => self.words(),
                Deed::Done => break,
            }
        }
    }

    fn hear(&mut self, status: Status) {
        let before = self
            .status
            .as_ref()
            .map(|status| (status.state, status.fault));
        if before != Some((status.state, status.fault)) {
            self.note(self.now(), || {
                let pins = self.plant.pins;
                format!(
                    "  status {:?} {:?} pins {pins:.2?}",
                    status.state, status.fault
                )
            });
        }
        self.fate.counts.reports += 1;
        self.status = Some(status);
    }

    fn words(&mut self) {
        let (mut edges, mut short) = (Vec::new(), Vec::new());
        let driver = self.config.driver;
        self.pins
            .feed(&self.shell.words, &driver, &mut edges, &mut short);
        let begin = (self.shell.first_us - self.birth_us as f64) / 1e6;
        for edge in edges {
            let s = begin + edge.word as f64 / 1e6;
            let obeyed = match self.sickness {
                Sickness::Stall(axis, from) => axis != edge.axis || s < from,
                _ => true,
            };
            let high = edge.high != WIRING.invert[edge.axis];
            self.plant.step(s, edge.axis, high, obeyed);
        }
    }

    /// Checks for wrong following.
    fn look(&mut self) {
        let s = self.now();
        let target = self.target.at(s);
        let [low, high] = self.hull;
        self.hull = [
            each(|axis| low[axis].min(target[axis])),
            each(|axis| high[axis].max(target[axis])),
        ];
        let [low, high] = self.hull;
        let pins = self.plant.pins;
        let beyond = each(|axis| (low[axis] - pins[axis]).max(pins[axis] - high[axis]));
        self.farthest = beyond.into_iter().fold(self.farthest, f64::max);
        self.fate.counts.comparisons += 3;
        let error = each(|axis| target[axis] - self.plant.stage[axis]);
        self.recent.push_back([self.plant.pins, target, error]);
        if self.recent.len() > 200 {
            self.recent.pop_front();
        }
        let span = |what: usize, axis: usize| {
            let values = self.recent.iter().map(|entry| entry[what][axis]);
            let (low, high) = values.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
            high - low
        };
        // Following is wrong if the stage moves and the distance changes by more than a small lag
        // explains.
        let wrong = (0..3).any(|axis| {
            let useless = WRONG_MM.max(USELESS * span(1, axis));
            span(0, axis) > WRONG_MM && span(2, axis) > useless
        });
        if !wrong || self.is_over() {
            self.wrong = None;
            return;
        }
        let (since, from) = *self.wrong.get_or_insert((s, self.plant.pins));
        // A stall shows in the stage's motion.
        let far = (0..3).any(|axis| (self.plant.pins[axis] - from[axis]).abs() > UNSEEN_MM);
        let due = far || !matches!(self.sickness, Sickness::Stall(..));
        if self.sickness != Sickness::None && due && s - since > NAMED_WITHIN_S {
            let spans = each(|axis| span(0, axis));
            self.breaks(
                Law::Sick,
                format!("{:?}: moves by {spans:.1?} mm for 2 s", self.sickness),
            );
        }
    }

    fn breaks(&mut self, law: Law, text: String) {
        if self
            .fate
            .violations
            .iter()
            .all(|violation| violation.law != law)
        {
            self.note(self.now(), || format!("BREAKS {}: {text}", law.name()));
            let at_ms = self.now() * 1000.0;
            self.fate.violations.push(Violation { law, at_ms, text });
        }
    }

    fn finish(mut self, healthy: bool) -> Fate {
        let fault = self.status.as_ref().and_then(|status| status.fault);
        if healthy && let Some(fault) = fault {
            let (fps, hidden) = (self.cameras.fps, self.cameras.hidden.len());
            let text = format!("{fault:?} at {fps:.0} frames/s, {hidden} occlusions");
            self.breaks(Law::Healthy, text);
        }
        let axis = &self.config.axes[0];
        let [v, a, j] = [
            axis.max_speed_um_s,
            axis.max_acceleration_um_s2,
            axis.max_jerk_um_s3,
        ]
        .map(|um| f64::from(um) / 1000.0);
        // The planner's bound on the ramp from full speed while the axis still accelerates.
        let top = v + a * a / (2.0 * j);
        let stop = v * a / j + a.powi(3) / (3.0 * j * j) + top / 2.0 * (top / a + a / j);
        let most = UNSEEN_MM + stop;
        if !healthy && self.farthest > most {
            let (far, what) = (self.farthest, self.sickness);
            self.breaks(
                Law::Runaway,
                format!("{what:?}: {far:.1} mm beyond the target, {most:.1} allowed"),
            );
        }
        let us = self.shell.now_us() - self.birth_us;
        self.fate.counts.us = us;
        self.fate.counts.edges = self.pins.rises;
        self.fate.counts.turns = self.pins.turns;
        self.fate
    }
}

fn config(random: &mut Random) -> Config {
    let mut config = stages::usual();
    if random.one_in(2) {
        let speed = random.decades(30_000.0, 200_000.0);
        let acceleration = speed * random.range(8.0, 40.0);
        for axis in &mut config.axes {
            axis.max_speed_um_s = speed as u32;
            axis.max_acceleration_um_s2 = acceleration as u32;
            axis.max_jerk_um_s3 = (acceleration * random.range(15.0, 40.0)).max(1e7) as u32;
        }
    }
    config.stage.unseen_um = (UNSEEN_MM * 1000.0) as u32;
    config.stage.longest_error_ms = 1_000;
    config
}

/// Returns a scene with 5 to 1,000 frames per second, even or irregular, with gaps now and then,
/// and small errors of mount and clock.
fn healthy_scene(random: &mut Random, seconds: f64, fastest: f64) -> (Target, Cameras) {
    let target = Target::any(random, seconds, 0.8 * fastest);
    let fps = random.pick(&[5.0, 10.0, 30.0, 60.0, 60.0, 120.0, 1000.0, 0.0]);
    let fps = if fps > 0.0 {
        fps
    } else {
        random.decades(5.0, 1000.0)
    };
    let hidden = (0..random.below(4)).map(|_| {
        let from = random.range(0.2, seconds);
        (from, from + random.decades(0.05, 0.8))
    });
    let hidden = hidden.collect();
    let axis = each(|_| random.normal());
    let cameras = Cameras {
        mount: rotated(axis, random.range(-3.0, 3.0), random.range(0.97, 1.03)),
        fps,
        irregular: random.one_in(3),
        latency_s: random.decades(0.005, 0.1),
        stamp_s: random.range(-0.002, 0.002),
        hidden,
        sigma: random.decades(0.001, 0.02),
        outliers: random.pick(&[0, 0, 0, 100]),
    };
    (target, cameras)
}

fn sick_scene(
    random: &mut Random,
    seconds: f64,
    fastest: f64,
    sickness: &Sickness,
) -> (Target, Cameras) {
    let target = match sickness {
        // A stall shows only in motion.
        Sickness::Stall(..) => Target::any(random, seconds, 0.8 * fastest),
        _ => match random.one_in(3) {
            true => Target::still(),
            false => Target::any(random, seconds, 0.5 * fastest),
        },
    };
    let stamp_s = match sickness {
        Sickness::Stamps(ms) => ms / 1000.0,
        _ => 0.0,
    };
    let cameras = Cameras {
        mount: sickness.mount(random),
        fps: random.pick(&[30.0, 60.0, 60.0, 120.0, 200.0]),
        irregular: random.one_in(6),
        // A stamp must not lie in the future.
        latency_s: random.decades(0.008, 0.06).max(stamp_s + 0.003),
        stamp_s,
        hidden: Vec::new(),
        sigma: random.decades(0.002, 0.01),
        outliers: 0,
    };
    (target, cameras)
}

fn rotated(axis: Mm, degrees: f64, scale: f64) -> [[f64; 3]; 3] {
    stages::rotation(axis, degrees.to_radians()).map(|row| row.map(|element| element * scale))
}
