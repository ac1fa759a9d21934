//! Wrong time stamps: the target's motion under the hypothesis that all stamps are late by a delay.
//!
//! The cameras see `e = target - stage` at the capture. If its stamp is late by `d`, the stage was
//! where it was at `t - d`, and `e + s(t - d)` is the target; with any other delay the stage's
//! motion remains in it. So the right delay is the one with which the target moves most smoothly:
//! the residual about a parabola in time is smallest. The station remembers where its stage was, so
//! each delay needs only the sums of one more figure per axis.

use super::super::StepVector;
use super::super::history::{self, Coarse, History};
use super::Sample;
use super::window::{Basis, from};
use crate::time::Instant;

/// Delays of the stamps, µs; negative for stamps that are early. A delay between two of them is off
/// the nearer one by 15 % at most, which leaves some 2 % of the energy.
pub(super) const DELAYS_US: [i64; 10] = [
    -64_000, -50_000, -39_000, -30_000, -23_000, 23_000, 30_000, 39_000, 50_000, 64_000,
];

/// Running sums of one figure, steps.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Sums of the position times 1, t, t².
    moments: [f32; 3],
    /// Sum of its square.
    square: f32,
}

/// Running sums of the target's position for each delay.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Late {
    /// Position of the stage and error of the first frame.
    first: Option<(Coarse, StepVector)>,
    sums: [[Sums; 3]; DELAYS_US.len()],
}

impl Late {
    /// Takes in a frame at the time `t`. A position that the station does not remember is that at
    /// the stamp, which makes the hypothesis no better than none.
    pub fn add(&mut self, t: f32, sample: &Sample, history: &History) {
        let stamped = history::coarse(sample.stage);
        let start = || (stamped, sample.error);
        let (origin, error) = *self.first.get_or_insert_with(start);
        let (square, error) = (t * t, from(sample.error, error));
        for (axes, delay) in self.sums.iter_mut().zip(DELAYS_US) {
            let us = sample.capture.micros().saturating_add_signed(-delay);
            let stage = history.coarsely_at(Instant::from_micros(us));
            let stage = stage.unwrap_or(stamped);
            let positions = error.into_iter().zip(stage.into_iter().zip(origin));
            for (sums, (error, (stage, origin))) in axes.iter_mut().zip(positions) {
                let y = error + stage.wrapping_sub(origin) as f32 * history::COARSE;
                let [a, b, c] = sums.moments;
                sums.moments = [a + y, b + y * t, c + y * square];
                sums.square += y * y;
            }
        }
    }

    /// Returns the smallest variance of the target's residual over all delays, summed over the
    /// axes, steps².
    pub fn least(&self, basis: &Basis) -> f32 {
        let mut least = f32::MAX;
        for axes in &self.sums {
            let mut sum = 0.0;
            for sums in axes {
                let y = basis.project(sums.moments);
                sum += basis.covariance(sums.square, y, y);
            }
            if sum < least {
                least = sum;
            }
        }
        least
    }
}
