//! A station and a moving target, joined by simulated measurements of the cameras with delay and
//! noise.

use std::collections::VecDeque;
use trinocular_client::stage::{configuration, default_stage};
use trinocular_core::frame::encode::encode;
use trinocular_core::frame::message::{
    Command, Denial, Frame, LastRun, Mounting, Outcome, Packet, Report, ResetCause, Status, Sums,
};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::machine::{Board, Machine, Output, SEGMENT_US};
use trinocular_core::safety::Inputs;
use trinocular_core::steps::WordRate;
use trinocular_core::sums::centred::FixedCentredSums;
use trinocular_core::time::Instant;
use trinocular_core::track::pursuit::Settings;
use trinocular_rig::random::Random;
use trinocular_rig::rig_file::{Care, Stage};

/// Delay from a segment to its first word on the pins, µs.
const DELAY_US: u64 = 512;

/// Delay from an image to its flow frame, µs.
const LATENCY_US: u64 = 20_000;

/// Steps per mm of the default stage.
pub const STEPS_PER_MM: f64 = 80.0;

/// Standard deviation of a displacement, mm: that of rendered images with noise of 2 grey levels.
const SIGMA_MM: [f64; 3] = [0.005, 0.005, 0.03];

/// Position of a target in mm as a function of time in s.
pub type Target = fn(f64) -> [f64; 3];

/// Matrix of a correct mount.
pub const RIGHT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// One exposure of the cameras.
#[derive(Clone, Copy, Debug)]
pub struct Shot {
    /// Time since the first exposure, µs.
    pub capture_us: u64,
    /// Delay from the exposure to its flow frame, µs.
    pub latency_us: u64,
}

/// State of a run at one millisecond.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Time since the first image, s.
    pub time_s: f64,
    /// Position of the target, mm.
    pub target_mm: [f64; 3],
    /// Motion at the pins, whole steps.
    pub steps: [i64; 3],
}

impl Sample {
    /// Returns the position of the stage, mm.
    pub fn stage_mm(&self) -> [f64; 3] {
        self.steps.map(|steps| steps as f64 / STEPS_PER_MM)
    }

    /// Returns the position of the stage minus that of the target, mm.
    pub fn error_mm(&self) -> [f64; 3] {
        let stage = self.stage_mm();
        std::array::from_fn(|i| stage[i] - self.target_mm[i])
    }
}

/// Record of a run.
#[derive(Debug, Default)]
pub struct Run {
    /// Samples, one per millisecond.
    pub samples: Vec<Sample>,
    /// Statuses of the station.
    pub statuses: Vec<Status>,
    /// Denials by the station.
    pub denials: Vec<Denial>,
    /// Time of the first fault, s.
    pub faulted_s: Option<f64>,
    /// Planned position at the end of every segment, 2⁻³² steps.
    pub planned: Vec<[i64; 3]>,
}

impl Run {
    fn after(&self, from_s: f64) -> impl Iterator<Item = &Sample> {
        self.samples.iter().filter(move |s| s.time_s >= from_s)
    }

    /// Returns the root mean square error per axis, mm. Like all figures here it is taken from
    /// `from_s` on.
    pub fn rms(&self, from_s: f64) -> [f64; 3] {
        let n = self.after(from_s).count() as f64;
        std::array::from_fn(|i| {
            (self
                .after(from_s)
                .map(|s| s.error_mm()[i].powi(2))
                .sum::<f64>()
                / n)
                .sqrt()
        })
    }

    /// Returns the root mean square of the distance to the target, mm.
    pub fn rms_3d(&self, from_s: f64) -> f64 {
        self.rms(from_s).iter().map(|e| e * e).sum::<f64>().sqrt()
    }

    /// Returns the largest absolute error per axis, mm.
    pub fn worst(&self, from_s: f64) -> [f64; 3] {
        std::array::from_fn(|i| {
            self.after(from_s)
                .map(|s| s.error_mm()[i].abs())
                .fold(0.0, f64::max)
        })
    }

    /// Returns the mean of the stage's position minus the target's, mm.
    pub fn mean_error(&self, from_s: f64) -> [f64; 3] {
        let n = self.after(from_s).count() as f64;
        std::array::from_fn(|i| self.after(from_s).map(|s| s.error_mm()[i]).sum::<f64>() / n)
    }

    /// Returns the largest lead of the stage over a target that moves forwards, mm.
    pub fn farthest(&self, from_s: f64) -> [f64; 3] {
        std::array::from_fn(|i| {
            self.after(from_s)
                .map(|s| s.error_mm()[i])
                .fold(0.0, f64::max)
        })
    }

    /// Returns the reversals of direction per second.
    pub fn reversals(&self, from_s: f64) -> [f64; 3] {
        let last = self.samples.last().map_or(1.0, |s| s.time_s);
        std::array::from_fn(|i| {
            let mut direction = 0;
            let mut count = 0;
            let mut before: Option<i64> = None;
            for sample in self.after(from_s) {
                let now = sample.steps[i];
                let way = now - before.unwrap_or(now);
                before = Some(now);
                if way != 0 {
                    if way.signum() == -direction {
                        count += 1;
                    }
                    direction = way.signum();
                }
            }
            f64::from(count) / (last - from_s)
        })
    }
}

/// Conditions of a run: tracking, cameras, target and disturbances.
pub struct Chase {
    /// Settings of the station's tracker.
    pub tracking: Settings,
    /// Images per second.
    pub frames_per_s: f64,
    /// Interval without frames: start, end, s.
    pub hidden_s: Option<[f64; 2]>,
    /// Wrong frames: number of the first, count, error, mm.
    pub wrong: Option<(u64, u64, [f64; 3])>,
    /// Stall: start, s, and the axes whose motors lose their steps.
    pub stalled: Option<(f64, [bool; 3])>,
    /// Share of the steps that stalled axes still make.
    pub slips: f64,
    /// Matrix from true to measured displacements, by rows; the identity for a correct mount.
    pub mount: [[f64; 3]; 3],
    /// Delay of the time stamps after the capture, µs.
    pub late_us: i64,
    /// Delay from an image to its flow frame, µs.
    pub latency_us: u64,
    /// Exposures with instant and latency; regular ones if `None`.
    pub shots: Option<Vec<Shot>>,
    /// Backlash of every axis that the station does not know, mm.
    pub slack_mm: f64,
    /// Factor on the usual noise.
    pub noise: f64,
    /// Soft limits, mm either way; the stage's own if `None`.
    pub travel_mm: Option<f64>,
    /// Settings of the station's watch over following.
    pub care: Care,
    random: Random,
}

impl Chase {
    /// Returns a run with 60 images per second and no disturbance.
    pub fn new(seed: u64) -> Self {
        Self {
            tracking: Settings::DEFAULT,
            frames_per_s: 60.0,
            hidden_s: None,
            wrong: None,
            stalled: None,
            slips: 0.0,
            mount: RIGHT,
            late_us: 0,
            latency_us: LATENCY_US,
            shots: None,
            slack_mm: 0.0,
            noise: 1.0,
            travel_mm: None,
            care: Care::default(),
            random: Random::new(seed, 0),
        }
    }

    /// Follows `target` for `seconds`.
    ///
    /// # Panics
    /// Panics if the station refuses the stage of the experiments.
    pub fn follow(&mut self, target: impl Fn(f64) -> [f64; 3], seconds: f64) -> Run {
        let board = Board {
            name: "chase",
            version: [0, 1, 0],
            word_rate: WordRate::MHZ_1,
            delay_us: DELAY_US as u32,
            session: 1,
            reset_cause: ResetCause::PowerOn,
            last_run: LastRun::UNKNOWN,
            camera_pin: None,
        };
        let mut stage = Stage {
            care: self.care.clone(),
            ..default_stage()
        };
        if let Some(mm) = self.travel_mm {
            stage.travel_mm = [[-mm, mm]; 3];
        }
        let mut config = configuration(&stage, Mounting::OnStage).expect("it fits");
        config.tracking = self.tracking;
        let mut machine = Machine::new(board);
        let mut receiver = Receiver::<Report>::default();
        let mut sequence = 0u16;
        let mut run = Run::default();
        let mut send = |machine: &mut Machine, now: u64, command| {
            sequence = sequence.wrapping_add(1);
            let bytes = encode(&Packet { sequence, command }).unwrap();
            machine.receive(Instant::from_micros(now), &bytes);
        };
        // Pin positions at the end of each segment, from time zero on.
        let mut path: Vec<[i64; 3]> = vec![[0; 3]; 1 + (DELAY_US / SEGMENT_US) as usize];
        let start_us = 100_000u64;
        let mut waiting: VecDeque<(u64, Frame)> = VecDeque::new();
        let mut taken = 0u64;
        let shots = self.shots.clone().unwrap_or_else(|| {
            let period_us = 1e6 / self.frames_per_s;
            let shot = |k: u64| Shot {
                capture_us: (k as f64 * period_us).round() as u64,
                latency_us: self.latency_us,
            };
            (0..(seconds * self.frames_per_s) as u64 + 1)
                .map(shot)
                .collect()
        });
        let mut shots = shots.into_iter().peekable();
        let stamp = |us: u64| Instant::from_micros(us.saturating_add_signed(self.late_us));
        let mut load = [0.0; 3];
        let end_us = start_us + (seconds * 1e6) as u64;
        let at_pins = |path: &[[i64; 3]], us: u64| -> [f64; 3] {
            // path[k] is the pin position at k SEGMENT_US + 12 µs.
            let us = us.saturating_sub(DELAY_US % SEGMENT_US);
            let (k, rest) = ((us / SEGMENT_US) as usize, us % SEGMENT_US);
            let a = path[k.min(path.len() - 1)];
            let b = path[(k + 1).min(path.len() - 1)];
            std::array::from_fn(|i| {
                let share = rest as f64 / SEGMENT_US as f64;
                let fine = a[i] as f64 + (b[i] - a[i]) as f64 * share;
                fine / 4_294_967_296.0 / STEPS_PER_MM
            })
        };
        let mut now = 0u64;
        while now < end_us {
            match now {
                0 => send(&mut machine, now, Command::Hello),
                1_000 => send(&mut machine, now, Command::Config(config)),
                2_000 => send(&mut machine, now, Command::Zero),
                _ => {}
            }
            if now.is_multiple_of(20_000) {
                send(&mut machine, now, Command::Ping { host_us: now });
            }
            machine.sense(Inputs {
                words_emitted: now.saturating_sub(DELAY_US),
                ..Inputs::default()
            });
            loop {
                match machine.poll(Instant::from_micros(now), 1_000) {
                    Output::Send(bytes) => match receiver.next(&mut &bytes[..]) {
                        Some(Ok(Report::Answer {
                            outcome: Outcome::Denied(denial),
                            ..
                        })) => {
                            run.denials.push(denial);
                        }
                        Some(Ok(Report::Status(status))) => run.statuses.push(status),
                        _ => {}
                    },
                    Output::Segment(_) => path.push(machine.position()),
                    Output::Idle(_) => break,
                }
            }
            if machine.fault().is_some() && run.faulted_s.is_none() {
                run.faulted_s = Some((now as f64 - start_us as f64) * 1e-6);
            }
            // Handle everything before the next segment is given out.
            let next = now + SEGMENT_US;
            while let Some(shot) = shots.next_if(|shot| start_us + shot.capture_us < next) {
                let capture = start_us + shot.capture_us;
                let at_s = shot.capture_us as f64 * 1e-6;
                let goal = target(at_s);
                // The motors rest at whole steps.
                let stands = |us| {
                    at_pins(&path, us).map(|mm| (mm * STEPS_PER_MM + 0.5).floor() / STEPS_PER_MM)
                };
                let mut stage = stands(capture);
                if let Some((from_s, axes)) = self.stalled
                    && at_s > from_s
                {
                    let stuck = stands(start_us + (from_s * 1e6) as u64);
                    for axis in (0..3).filter(|axis| axes[*axis]) {
                        stage[axis] = stuck[axis] + self.slips * (stage[axis] - stuck[axis]);
                    }
                }
                // The load rests until the motor has taken up the backlash.
                for (load, motor) in load.iter_mut().zip(stage) {
                    let half = 0.5 * self.slack_mm;
                    *load = f64::clamp(*load, motor - half, motor + half);
                }
                let off: [f64; 3] = std::array::from_fn(|i| goal[i] - load[i]);
                let mut seen: [f64; 3] = std::array::from_fn(|i| {
                    let row = self.mount[i];
                    let view = row[0] * off[0] + row[1] * off[1] + row[2] * off[2];
                    view + self.noise * SIGMA_MM[i] * self.random.gaussian()
                });
                if let Some((first, count, by)) = self.wrong
                    && taken >= first
                    && taken - first < count
                {
                    seen = std::array::from_fn(|i| seen[i] + by[i]);
                }
                let hidden = self
                    .hidden_s
                    .is_some_and(|[from, to]| (from..to).contains(&at_s));
                if shot.capture_us > 0 && !hidden {
                    let frame = Frame {
                        capture: stamp(capture),
                        reference: stamp(start_us),
                        sums: sums(seen, self.noise),
                    };
                    let due = capture + shot.latency_us;
                    let place = waiting.partition_point(|(other, _)| *other <= due);
                    waiting.insert(place, (due, frame));
                }
                taken += 1;
            }
            while waiting.front().is_some_and(|(due, _)| *due < next) {
                let (due, frame) = waiting.pop_front().unwrap();
                send(&mut machine, due, Command::Frame(frame));
            }
            if next.is_multiple_of(1_000) && next > start_us {
                let fine = at_pins(&path, next);
                run.samples.push(Sample {
                    time_s: (next - start_us) as f64 * 1e-6,
                    target_mm: target((next - start_us) as f64 * 1e-6),
                    steps: fine.map(|mm| (mm * STEPS_PER_MM + 0.5).floor() as i64),
                });
            }
            now = next;
        }
        run.planned = path;
        run
    }
}

/// Returns the flow sums of a target displaced by `mm`, with their stated variance.
fn sums(mm: [f64; 3], noise: f64) -> Sums {
    let spread = (SIGMA_MM[0] / SIGMA_MM[2]).powi(2);
    let exponent = spread.log2().floor() as i32 + 1;
    let mantissa = spread / f64::from(exponent).exp2();
    let freedom = 597u16;
    let residual = noise * SIGMA_MM[0] * 1e6 * f64::from(freedom).sqrt();
    Sums::Midpoint(FixedCentredSums {
        points: 100,
        freedom,
        mean_nm: [(mm[0] * 1e6).round() as i32, (mm[1] * 1e6).round() as i32],
        centroid: [0, 0],
        spread: (mantissa * 2f64.powi(32)) as u32,
        exponent: exponent as i8,
        coupling: (mm[2] * mantissa * 8e6).round() as i32,
        residual_nm: residual.round() as u32,
    })
}

/// Returns a Lissajous figure of ±20, 20 and 5 mm, up to 20 mm/s.
pub fn lissajous(time_s: f64) -> [f64; 3] {
    let angle = 0.47 * time_s;
    [
        20.0 * angle.sin(),
        20.0 * (2.0 * angle).sin(),
        5.0 * (3.0 * angle).sin(),
    ]
}

/// Returns the progress, 0 to 1, of a move of 4 mm at 50,000 mm/s³.
pub fn smooth(t: f64) -> f64 {
    let quarter = (4.0f64 / 100_000.0).cbrt();
    let j = 50_000.0 / 4.0;
    let u = (t / quarter).clamp(0.0, 4.0);
    let q3 = quarter.powi(3);
    let half = |u: f64| {
        // First half: jerk +, then -.
        if u <= 1.0 {
            j * q3 * u.powi(3) / 6.0
        } else {
            let x = u - 1.0;
            j * q3 * (1.0 / 6.0 + x / 2.0 + x * x / 2.0 - x.powi(3) / 6.0)
        }
    };
    if u <= 2.0 {
        half(u)
    } else {
        1.0 - half(4.0 - u)
    }
}
