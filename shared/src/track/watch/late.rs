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

/// Sign of a delay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sign {
    /// The stamps are early.
    Early,
    /// The stamps are late.
    Late,
}

/// Delays of the stamps, µs, of one sign. A delay between two of them is off the nearer one by 15 %
/// at most, which leaves some 2 % of the energy.
const DELAYS_US: [u64; 5] = [23_000, 30_000, 39_000, 50_000, 64_000];

/// Running sums of one figure, steps.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Sums of the position times 1, t, t².
    moments: [f32; 3],
    /// Sum of its square.
    square: f32,
}

/// Running sums of the target's position for each delay.
type Delayed = [[Sums; 3]; DELAYS_US.len()];

/// Running sums for all delays of both signs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Late {
    /// Position of the stage and error of the first frame.
    first: Option<(Coarse, StepVector)>,
    early: Delayed,
    late: Delayed,
}

impl Late {
    /// Takes in a frame at the time `t`, for the delays of one sign. A position that the station
    /// does not remember is that at the stamp, which makes the hypothesis no better than none.
    pub fn add(&mut self, sign: Sign, t: f32, sample: &Sample, history: &History) {
        let stamped = history::coarse(sample.stage);
        let start = || (stamped, sample.error);
        let (origin, error) = *self.first.get_or_insert_with(start);
        let (square, error) = (t * t, from(sample.error, error));
        let capture = sample.capture.micros();
        let delayed = match sign {
            Sign::Early => &mut self.early,
            Sign::Late => &mut self.late,
        };
        for (axes, delay) in delayed.iter_mut().zip(DELAYS_US) {
            let us = match sign {
                Sign::Early => capture.saturating_add(delay),
                Sign::Late => capture.saturating_sub(delay),
            };
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

    /// Returns the smallest variance of the target's residual over all delays of one sign, summed
    /// over the axes, steps².
    pub fn least(&self, sign: Sign, basis: &Basis) -> f32 {
        let delayed = match sign {
            Sign::Early => &self.early,
            Sign::Late => &self.late,
        };
        let mut least = f32::MAX;
        for axes in delayed {
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
