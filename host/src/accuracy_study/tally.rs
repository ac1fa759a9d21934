//! Counts of outcomes and the limits they are judged by.

use super::condition::Condition;
use super::trial::Outcome;
use std::collections::BTreeMap;

/// Counts over many trials.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    /// Number of measurements.
    pub measured: u32,
    /// Number of refusals by name.
    pub refused: BTreeMap<&'static str, u32>,
    /// Sum of squared errors per axis, mm².
    pub squares_mm2: [f64; 3],
    /// Sum of (error / sigma)² per axis.
    pub normalised: [f64; 3],
    /// Number of measurements within three sigma, per axis.
    pub within: [u32; 3],
    /// Number of measurements with an error on any axis above five sigma and [`GROSS_MM`].
    pub gross: u32,
    /// Sum of the points of all measurements.
    pub points: usize,
    /// Number of measurements whose refused cameras are the required ones.
    pub said: u32,
}

impl Tally {
    /// Counts one outcome.
    pub fn add(&mut self, outcome: &Outcome) {
        let (error, sigma, points, said) = match outcome {
            Outcome::Refused(name) => {
                *self.refused.entry(name).or_default() += 1;
                return;
            }
            Outcome::Measured {
                error_mm,
                sigma_mm,
                points,
                said,
            } => (error_mm, sigma_mm, points, said),
        };
        self.measured += 1;
        self.points += points;
        self.said += u32::from(*said);
        let mut gross = false;
        for axis in 0..3 {
            let normalised = error[axis] / sigma[axis];
            self.squares_mm2[axis] += error[axis].powi(2);
            self.normalised[axis] += normalised.powi(2);
            self.within[axis] += u32::from(normalised.abs() <= 3.0);
            gross |= !(error[axis].abs() <= 5.0 * sigma[axis] + GROSS_MM);
        }
        self.gross += u32::from(gross);
    }

    /// Adds the counts of `other`.
    pub fn merge(&mut self, other: &Self) {
        self.measured += other.measured;
        for (name, count) in &other.refused {
            *self.refused.entry(name).or_default() += count;
        }
        for axis in 0..3 {
            self.squares_mm2[axis] += other.squares_mm2[axis];
            self.normalised[axis] += other.normalised[axis];
            self.within[axis] += other.within[axis];
        }
        self.gross += other.gross;
        self.points += other.points;
        self.said += other.said;
    }

    /// Returns the number of trials.
    pub fn trials(&self) -> u32 {
        self.measured + self.refused.values().sum::<u32>()
    }

    /// Returns the root mean square error per axis, mm. NaN without a measurement.
    pub fn rms_mm(&self) -> [f64; 3] {
        self.squares_mm2
            .map(|s| (s / f64::from(self.measured)).sqrt())
    }

    /// Returns the mean of (error / sigma)² per axis: 1 if sigma is right.
    pub fn normalised(&self) -> [f64; 3] {
        self.normalised.map(|s| s / f64::from(self.measured))
    }

    /// Returns the share of measurements within three sigma, on the worst axis.
    pub fn within(&self) -> f64 {
        let least = self.within.iter().min().copied().unwrap_or(0);
        f64::from(least) / f64::from(self.measured)
    }

    /// Returns the mean number of points.
    pub fn mean_points(&self) -> f64 {
        self.points as f64 / f64::from(self.measured)
    }

    /// Returns the unmet expectations of a condition, in words.
    pub fn failures(&self, condition: &Condition) -> Vec<String> {
        let expected = &condition.expected;
        let mut failures = Vec::new();
        let mut fail = |what: String| failures.push(format!("{}: {what}", condition.name));
        let share = f64::from(self.measured) / f64::from(self.trials().max(1));
        let [least, most] = expected.measured;
        if !(least..=most).contains(&share) {
            fail(format!(
                "{:.0} % measured, not {:.0} to {:.0} %",
                100.0 * share,
                100.0 * least,
                100.0 * most
            ));
        }
        for (name, count) in &self.refused {
            let few = f64::from(*count) <= (1.0 - least) * f64::from(self.trials());
            let allowed = expected.refusals.contains(name) || expected.refusals.is_empty() && few;
            if !allowed {
                fail(format!("{count} refused as \"{name}\""));
            }
        }
        if condition.change.is_of_one_camera() && self.said < self.measured {
            let silent = self.measured - self.said;
            fail(format!("{silent} did not name the camera"));
        }
        failures
    }
}

/// Limits of the mean of (error / sigma)², per axis over all measurements.
pub const HONEST: [f64; 2] = [0.8, 1.3];
/// Least share of measurements within three sigma, per axis.
pub const WITHIN: f64 = 0.99;
/// Margin beyond five sigma above which an error is gross, mm.
pub const GROSS_MM: f64 = 0.02;
/// Number of measurements in which one gross error may occur.
pub const GROSS_IN: u32 = 10_000;

/// Returns the unmet claims about all measurements together, in words. `looseness` widens the
/// statistical limits for sweeps of few measurements; 1 leaves them unchanged.
pub fn failures_of_all(total: &Tally, looseness: f64) -> Vec<String> {
    let mut failures = Vec::new();
    let [low, high] = [HONEST[0] / looseness, HONEST[1] * looseness];
    for (axis, mean) in ["x", "y", "z"].into_iter().zip(total.normalised()) {
        if !(low..=high).contains(&mean) {
            failures.push(format!(
                "all: error²/sigma² along {axis} is {mean:.2} on average, not {low:.2} to {high:.2}"
            ));
        }
    }
    let least = 1.0 - (1.0 - WITHIN) * looseness;
    if !(total.within() >= least) {
        failures.push(format!(
            "all: {:.2} % within three sigma, not {:.1} %",
            100.0 * total.within(),
            100.0 * least
        ));
    }
    if total.gross.saturating_mul(GROSS_IN) > total.measured {
        failures.push(format!(
            "all: {} gross errors in {} measurements, not one in {GROSS_IN}",
            total.gross, total.measured
        ));
    }
    failures
}
