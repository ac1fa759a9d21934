//! One axis that follows the target: at rest while the target is still, else at the predicted
//! position.

use super::super::filter::{Filter, KinematicLimits, fine, steps, with_quantisation, within};
use super::Aim;
use super::swing::Swing;
use crate::steps::Position;
use crate::time::Instant;

/// Low-pass gain of the velocity gain, per frame.
const EASE: f32 = 0.4;

/// Speed over sigma, squared, above which a resting axis starts (`START`) and below which a moving
/// one comes to rest (`STOP`).
const START: f32 = 9.0;
const STOP: f32 = 2.25;

/// Distance of the filter's position from the step in sigmas, squared, at which a resting axis
/// starts anew.
const FAR: f32 = 9.0;

/// Weight of the mean over a still target, in measurements: at its beginning (`FEW`) and at most
/// (`MANY`), which is a second's worth.
const FEW: f32 = 4.0;
const MANY: f32 = 64.0;

/// Filter of the target, velocity gain, and state of rest of one axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrackedAxis {
    pub(super) filter: Filter,
    /// State of an axis at rest, while the target is still.
    rest: Option<Rest>,
    /// Velocity gain, 0 to 1.
    velocity_gain: f32,
    /// Oscillator that leads the axis if it predicts better than the filter.
    pub(super) swing: Swing,
    /// True if the last goal came from the oscillator.
    pub(super) swings: bool,
}

/// State of an axis at a still target.
#[derive(Clone, Copy, Debug)]
struct Rest {
    /// Position of the axis: a whole step, in 2⁻³² steps.
    step: i64,
    /// Mean of the measurements, 2⁻³² steps.
    mean: i64,
    /// Number of measurements in the mean.
    count: f32,
    /// Variance of the mean, steps².
    variance: f32,
}

impl Rest {
    /// Rests the axis in the step nearest to the filter's position.
    fn new(filter: &Filter) -> Self {
        Self {
            step: Position::nearest_rest(filter.position()).distance_from_zero(),
            mean: filter.position(),
            count: FEW,
            variance: filter.covariance().position,
        }
    }

    /// Averages another measurement, and goes to another step if the mean requires it.
    fn average(&mut self, position: i64, variance: f32) {
        self.count = within(self.count + 1.0, FEW, MANY);
        let off = steps(position.saturating_sub(self.mean));
        self.mean = self.mean.saturating_add(fine(off / self.count));
        self.variance = with_quantisation(variance) / self.count;
        if !self.holds(self.mean, self.variance, 1.0) {
            self.step = Position::nearest_rest(self.mean).distance_from_zero();
        }
    }

    /// Returns true if `position` is no farther beyond the step than `sigmas` sigmas, squared.
    fn holds(&self, position: i64, variance: f32, sigmas: f32) -> bool {
        let off = steps(position.saturating_sub(self.step));
        let beyond = if off < 0.0 { -off } else { off } - 0.5;
        beyond < 0.0 || beyond * beyond < sigmas * variance
    }
}

impl TrackedAxis {
    pub(super) fn new(filter: Filter, capture: Instant, reach: KinematicLimits) -> Self {
        Self {
            filter,
            rest: None,
            velocity_gain: 0.0,
            swing: Swing::new(&filter, capture, reach),
            swings: false,
        }
    }

    /// Returns the velocity that the stage uses of the filter's, steps/ms.
    pub(super) fn used_velocity(&self) -> f32 {
        self.filter.velocity() * self.velocity_gain
    }

    /// Takes the filter after its update with a measurement.
    pub(super) fn go_on(&mut self, filter: Filter, position: i64, variance: f32) {
        self.filter = filter;
        if let Some(rest) = &mut self.rest {
            rest.average(position, variance);
        }
    }

    /// Decides by the filter whether the axis rests, and how much of the velocity is used. Without
    /// `prediction` it rests.
    pub(super) fn decide(&mut self, prediction: bool, reach: KinematicLimits) {
        let known = self.filter.covariance();
        let (position, velocity) = (self.filter.position(), self.filter.velocity());
        let square = velocity * velocity;
        let sigmas = if self.rest.is_some() { START } else { STOP };
        if !prediction || square < sigmas * known.velocity {
            let resting = self
                .rest
                .filter(|rest| rest.holds(position, known.position, FAR));
            let rest = resting.unwrap_or_else(|| Rest::new(&self.filter));
            self.rest = Some(rest);
            self.velocity_gain = 0.0;
            return;
        }
        self.rest = None;
        let (uncertainty, fourth) = (self.filter.velocity_uncertainty(reach), square * square);
        let wanted = fourth / (fourth + uncertainty * uncertainty);
        self.velocity_gain += (wanted - self.velocity_gain) * EASE;
    }

    /// Returns the goal by the filter, `lead` ms after the capture.
    pub(super) fn plain(&self, lead: f32) -> Aim {
        if let Some(rest) = &self.rest {
            return Aim {
                position: rest.step,
                velocity: 0.0,
            };
        }
        let velocity = self.used_velocity();
        Aim {
            position: self.filter.position().saturating_add(fine(velocity * lead)),
            velocity,
        }
    }
}
