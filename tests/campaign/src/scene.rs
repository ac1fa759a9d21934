//! A target, the cameras that see it, and motors that may fail: the plant that closes the loop
//! around a station.

use crate::random::Random;
use crate::stages::rotation;
use std::collections::VecDeque;

/// Position or displacement, mm.
pub type Mm = [f64; 3];

/// Computes a vector axis by axis.
pub fn each(f: impl FnMut(usize) -> f64) -> Mm {
    std::array::from_fn(f)
}

/// Motion of a target.
#[derive(Clone, Debug)]
pub struct Target {
    /// Bends of the path: time, s, position, velocity, and the acceleration, mm/s², until the next
    /// bend.
    bends: Vec<(f64, Mm, Mm, Mm)>,
    /// Oscillation of each axis: amplitude mm, frequency Hz, phase.
    swings: [[f64; 3]; 3],
}

impl Target {
    /// Returns a target at rest.
    pub fn still() -> Self {
        Self {
            bends: vec![(0.0, [0.0; 3], [0.0; 3], [0.0; 3])],
            swings: [[0.0; 3]; 3],
        }
    }

    /// Returns a target of a random kind: at rest, uniform, with changes of speed, oscillating, or
    /// with one small jump.
    pub fn any(random: &mut Random, seconds: f64, fastest: f64) -> Self {
        let mut target = Self::still();
        match random.below(5) {
            0 => {}
            1 => {
                let speed = fastest.min(35.0 / seconds) * random.unit();
                let heading = heading(random);
                target.bends[0].2 = heading.map(|part| part * speed);
            }
            2 => target.wanders(random, seconds, fastest),
            3 => {
                target.swings = std::array::from_fn(|_| {
                    let hz = random.decades(0.1, 3.0);
                    let most = (fastest / (hz * std::f64::consts::TAU)).min(20.0);
                    [random.decades(0.01, 1.0) * most, hz, random.range(0.0, 6.3)]
                });
            }
            _ => {
                let at = random.range(0.1, 0.5 * seconds);
                let jump = random.decades(0.05, 4.0);
                let heading = heading(random);
                let place = heading.map(|part| part * jump);
                target.bends.push((at, place, [0.0; 3], [0.0; 3]));
            }
        }
        target
    }

    /// Adds accelerations and decelerations on straight lines and curves, within 35 mm of the
    /// start.
    fn wanders(&mut self, random: &mut Random, seconds: f64, fastest: f64) {
        let (mut at, mut place, mut speed) = (0.0, [0.0; 3], [0.0; 3]);
        self.bends.clear();
        while at < seconds {
            let lasts = random.decades(0.1, 1.5);
            // Aim for a random velocity, and return from far away.
            let wanted = each(|axis| {
                let outward: f64 = place[axis] / 35.0;
                (random.range(-1.0, 1.0) - outward) * fastest / 2.0
            });
            let acceleration =
                each(|axis| ((wanted[axis] - speed[axis]) / lasts).clamp(-400.0, 400.0));
            self.bends.push((at, place, speed, acceleration));
            place =
                each(|axis| place[axis] + (speed[axis] + acceleration[axis] * lasts / 2.0) * lasts);
            speed = each(|axis| speed[axis] + acceleration[axis] * lasts);
            at += lasts;
        }
    }

    /// Returns the target's position at a time.
    pub fn at(&self, s: f64) -> Mm {
        let bend = self.bends.iter().rev().find(|bend| bend.0 <= s);
        let (begin, place, speed, acceleration) = bend.unwrap_or(&self.bends[0]);
        let t = s - begin;
        each(|axis| {
            let [size, hz, phase] = self.swings[axis];
            let swing = |s: f64| size * (s * hz * std::f64::consts::TAU + phase).sin();
            place[axis] + (speed[axis] + acceleration[axis] * t / 2.0) * t + swing(s) - swing(0.0)
        })
    }
}

/// Returns a random unit vector.
fn heading(random: &mut Random) -> Mm {
    let any = each(|axis| match random.one_in(3) && axis > 0 {
        true => 0.0,
        false => random.normal(),
    });
    let length = any.iter().map(|a| a * a).sum::<f64>().sqrt().max(1e-9);
    any.map(|a| a / length)
}

/// Cameras and the computer that evaluates their images.
#[derive(Clone, Debug)]
pub struct Cameras {
    /// Matrix from true to measured displacements; the identity if the mount is as configured.
    pub mount: [[f64; 3]; 3],
    /// Frames per second.
    pub fps: f64,
    /// True if intervals are exponentially distributed, false if they are even.
    pub irregular: bool,
    /// Delay from the capture to the arrival of its sums, s.
    pub latency_s: f64,
    /// Error of the time stamps, s.
    pub stamp_s: f64,
    /// Intervals in which the target is hidden: start, end, s.
    pub hidden: Vec<(f64, f64)>,
    /// Standard deviation of the noise in x and y, mm.
    pub sigma: f64,
    /// Mean number of frames per outlier; 0 means no outliers.
    pub outliers: u64,
}

impl Cameras {
    /// Returns a displacement as measured by the cameras.
    pub fn see(&self, random: &mut Random, displacement: Mm) -> Mm {
        let noise =
            [self.sigma, self.sigma, self.sigma * 5.66].map(|sigma| sigma * random.normal());
        let far = match self.outliers > 0 && random.one_in(self.outliers) {
            true => [0.0; 3].map(|_: f64| 5.0 * random.normal()),
            false => [0.0; 3],
        };
        each(|row| {
            let sum: f64 = (0..3).map(|i| self.mount[row][i] * displacement[i]).sum();
            sum + noise[row] + far[row]
        })
    }

    /// Returns true if a frame set at this time shows the target.
    pub fn sees(&self, s: f64) -> bool {
        !self
            .hidden
            .iter()
            .any(|(from, to)| (*from..*to).contains(&s))
    }

    /// Returns the time to the next capture, s.
    pub fn interval(&self, random: &mut Random) -> f64 {
        match self.irregular {
            true => -random.unit().max(1e-9).ln() / self.fps,
            false => 1.0 / self.fps,
        }
    }
}

/// Defect of the loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sickness {
    /// No defect.
    None,
    /// One axis has the wrong sign, or all of them (3).
    Sign(usize),
    /// Mount rotated by an angle, degrees.
    Turned(f64),
    /// Axes swapped.
    Swapped,
    /// Distances measured too large on one axis, or on all of them (3), by a factor.
    Scale(usize, f64),
    /// Error of the time stamps, ms.
    Stamps(f64),
    /// An axis that loses all its steps from a time on, s.
    Stall(usize, f64),
}

impl Sickness {
    /// Returns a random defect.
    pub fn any(random: &mut Random, seconds: f64) -> Self {
        match random.below(6) {
            0 => Self::Sign(random.below(4) as usize),
            1 => Self::Turned(random.range(60.0, 180.0)),
            2 => Self::Swapped,
            3 => Self::Scale(random.below(4) as usize, random.range(2.0, 4.0)),
            4 => Self::Stamps(match random.one_in(2) {
                true => -random.range(20.0, 70.0),
                false => random.range(20.0, 60.0),
            }),
            _ => Self::Stall(random.below(3) as usize, random.range(0.0, 0.4 * seconds)),
        }
    }

    /// Returns the mount matrix of the defect.
    pub fn mount(&self, random: &mut Random) -> [[f64; 3]; 3] {
        let one = |axis: usize, value: f64| {
            std::array::from_fn(|row| {
                std::array::from_fn(|column| match (row == column, axis == row || axis == 3) {
                    (true, true) => value,
                    (true, false) => 1.0,
                    _ => 0.0,
                })
            })
        };
        match *self {
            Self::Sign(axis) => one(axis, -1.0),
            Self::Scale(axis, scale) => one(axis, scale),
            Self::Turned(degrees) => {
                let axis = random.pick(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
                rotation(axis, degrees.to_radians())
            }
            Self::Swapped => random.pick(&[
                [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
                [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
                [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
            ]),
            Self::None | Self::Stamps(_) | Self::Stall(..) => one(3, 1.0),
        }
    }
}

/// True positions of the stage during the last second.
#[derive(Clone, Debug)]
pub struct Plant {
    mm_per_step: f64,
    /// Positions with the time each was reached, s.
    past: VecDeque<(f64, Mm)>,
    /// Position that the pins commanded.
    pub pins: Mm,
    /// True position of the stage.
    pub stage: Mm,
}

impl Plant {
    /// Returns a stage at zero.
    pub fn new(mm_per_step: f64) -> Self {
        Self {
            mm_per_step,
            past: VecDeque::from([(f64::NEG_INFINITY, [0.0; 3])]),
            pins: [0.0; 3],
            stage: [0.0; 3],
        }
    }

    /// Makes a step on an axis; the motor follows it if `obeyed` is true.
    pub fn step(&mut self, s: f64, axis: usize, forward: bool, obeyed: bool) {
        let by = if forward {
            self.mm_per_step
        } else {
            -self.mm_per_step
        };
        self.pins[axis] += by;
        if obeyed {
            self.stage[axis] += by;
            self.past.push_back((s, self.stage));
        }
    }

    /// Returns the stage's position at a time.
    pub fn at(&self, s: f64) -> Mm {
        let after = self.past.partition_point(|(at, _)| *at <= s);
        self.past[after.saturating_sub(1)].1
    }

    /// Forgets positions before a time; no later call may ask for them.
    pub fn forget(&mut self, s: f64) {
        while self.past.len() > 1 && self.past[1].0 <= s {
            self.past.pop_front();
        }
    }
}
