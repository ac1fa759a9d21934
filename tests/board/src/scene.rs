//! Scene before the cameras: a dozen moving points in the paper's rig, and the flow frames that the
//! host makes of them.

use crate::station::Station;
use crate::time::MS;
use crate::wiring::steps;
use trinocular_core::frame::message::{Command, Frame};
use trinocular_core::rig::Rig;
use trinocular_core::time::Instant;
use trinocular_rig::random::Random;
use trinocular_vision::flow::Correspondence;
use trinocular_vision::sums::{Estimator, Sums};

/// Steps per mm of the default stage.
const STEPS_PER_MM: f64 = 80.0;

/// Points before the cameras.
#[derive(Debug)]
pub struct Scene {
    rig: Rig,
    points_mm: Vec<[f64; 3]>,
    random: Random,
}

/// Capture of one frame set.
#[derive(Clone, Copy, Debug)]
pub struct Picture {
    /// Capture time, by the station's clock.
    pub at: Instant,
    /// Position of the target minus that of the cameras, mm.
    view_mm: [f64; 3],
}

impl Scene {
    /// Creates the points of a seed.
    pub fn new(seed: u64) -> Self {
        let mut random = Random::seeded(seed);
        let mut point = || {
            let [x, y, z] = [(-120.0, 120.0), (-90.0, 90.0), (780.0, 1_000.0)];
            [x, y, z].map(|(low, high)| random.between(low, high))
        };
        Self {
            rig: Rig::paper(),
            points_mm: (0..12).map(|_| point()).collect(),
            random,
        }
    }

    /// Captures a swinging target, from a stage that has made these steps.
    pub fn picture(&self, at: Instant, steps: [i64; 3]) -> Picture {
        let s = at.micros() as f64 * 1e-6;
        let target = [
            6.0 * (3.1 * s).sin(),
            4.0 * (4.7 * s).cos(),
            5.0 * (2.3 * s).sin(),
        ];
        Picture {
            at,
            view_mm: std::array::from_fn(|i| target[i] - steps[i] as f64 / STEPS_PER_MM),
        }
    }

    /// Returns the flow frame between two frame sets, with a fifth of a pixel of noise.
    pub fn frame(&mut self, from: Picture, to: Picture, estimator: Estimator) -> Command {
        let shift: [f64; 3] = std::array::from_fn(|i| to.view_mm[i] - from.view_mm[i]);
        let (rig, random) = (&self.rig, &mut self.random);
        let tracks: Vec<Correspondence> = (self.points_mm.iter())
            .map(|point| {
                let moved = std::array::from_fn(|i| point[i] + shift[i]);
                let pixels = rig.cameras.iter().map(|camera| {
                    let end = camera.project(moved);
                    let noisy = end.map(|px| px + random.between(-0.2, 0.2));
                    [camera.project(*point), noisy]
                });
                Correspondence::from_pixels(rig, pixels.collect())
            })
            .collect();
        let sums = Sums::new(rig, &tracks).expect("the paper's rig");
        Command::Frame(Frame {
            capture: to.at,
            reference: from.at,
            sums: sums.frame(estimator).expect("in range"),
        })
    }
}

/// Sends flow frames at 200 Hz of a swinging target, seen from where the edges at the pins have
/// moved the stage; every fourth one for the closed form.
pub fn follow(station: &mut Station, frames: usize) {
    let mut scene = Scene::new(7);
    let now = Instant::from_micros(station.clock_us());
    let first = scene.picture(now, steps(&station.edges()).0);
    for number in 0..frames {
        station.run(4 * MS);
        let now = Instant::from_micros(station.clock_us());
        let picture = scene.picture(now, steps(&station.edges()).0);
        // The image processing takes a millisecond.
        station.run(MS);
        let estimator = match number % 4 {
            0 => Estimator::ClosedForm,
            _ => Estimator::Midpoint,
        };
        let frame = scene.frame(first, picture, estimator);
        station.send(frame);
    }
}
