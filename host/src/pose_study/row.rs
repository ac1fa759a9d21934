//! Many trials of one target, noise and rotation.

use super::scene::{self, Motion, TARGETS, Target};
use super::trial::{self, Trial};
use nalgebra::Vector6;
use trinocular_core::estimate::pose::Refusal;
use trinocular_rig::random::Random;

/// Largest error over the bound, root mean square.
pub const MOST_OVER_BOUND: f64 = 1.06;
/// Squared error over stated variance.
pub const STATED: [f64; 2] = [0.8, 1.3];
/// Largest mean error of a displacement, mm.
pub const MOST_BIAS_MM: f64 = 0.010;
/// Largest mean error of a rotation, degrees.
pub const MOST_BIAS_DEG: f64 = 0.020;
/// Standard deviations of chance that a claim allows for.
const CHANCE: f64 = 3.0;

/// Noises of the study, px.
const NOISES_PX: [f64; 3] = [0.02, 0.05, 0.1];
/// Rotations of the study, degrees.
const ANGLES_DEG: [f64; 4] = [0.0, 1.0, 5.0, 20.0];

/// Results of one target, noise and rotation: of displacement and of rotation, all axes together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// The target.
    pub target: Target,
    /// Number of points.
    pub points: usize,
    /// Noise of every coordinate, px.
    pub noise_px: f64,
    /// Rotation, degrees.
    pub angle_deg: f64,
    /// Number of trials.
    pub trials: usize,
    /// Root of the mean bound per axis: displacement x, y, z, mm, and rotation, rad.
    pub bound: Vector6<f64>,
    /// Root mean square error over the bound of the pose estimator.
    pub pose: [f64; 2],
    /// Root mean square error over the bound of Kabsch's alignment.
    pub kabsch: [f64; 2],
    /// Mean squared error over the stated variance.
    pub stated: [f64; 2],
    /// Largest mean error of an axis beyond chance: mm and degrees.
    pub bias: [f64; 2],
}

/// Runs all rows of the study. `progress` gets the share that is done.
pub fn all(trials: usize, mut progress: impl FnMut(f64)) -> Result<Vec<Row>, Refusal> {
    let counts = |noise_px: f64, angle_deg: f64| match (noise_px, angle_deg) {
        (0.05, 5.0) => &[50, 100, 200][..],
        _ => &[100][..],
    };
    let mut todo = Vec::new();
    for target in TARGETS {
        for noise_px in NOISES_PX {
            for angle_deg in ANGLES_DEG {
                let counts = counts(noise_px, angle_deg).iter();
                todo.extend(counts.map(|points| (target, *points, noise_px, angle_deg)));
            }
        }
    }
    let count = todo.len() as f64;
    let rows = todo
        .into_iter()
        .enumerate()
        .map(|(i, (target, points, noise_px, angle_deg))| {
            progress(i as f64 / count);
            let mut random = Random::new(1, i as u64);
            Row::run(target, points, noise_px, angle_deg, trials, &mut random)
        });
    rows.collect()
}

impl Row {
    /// Runs the trials of one row.
    pub fn run(
        target: Target,
        points: usize,
        noise_px: f64,
        angle_deg: f64,
        trials: usize,
        random: &mut Random,
    ) -> Result<Self, Refusal> {
        let (rig, motion) = (scene::rig(), Motion::slanted(angle_deg));
        let [mut bound, mut pose, mut kabsch, mut stated, mut sum] = [Vector6::zeros(); 5];
        for _ in 0..trials {
            let found: Trial = trial::run(&rig, (&target, points), &motion, noise_px, random)?;
            let square = found.pose.component_mul(&found.pose);
            bound += found.bound;
            pose += square;
            kabsch += found.kabsch.component_mul(&found.kabsch);
            stated += square.component_div(&found.stated);
            sum += found.pose;
        }
        let count = trials as f64;
        let halves = |all: Vector6<f64>| [0, 3].map(|first| all.fixed_rows::<3>(first).mean());
        let chance = pose.map(|square| CHANCE * square.sqrt() / count);
        let bias = (sum / count).abs() - chance;
        let largest = |first: usize| bias.fixed_rows::<3>(first).max().max(0.0);
        Ok(Self {
            target,
            points,
            noise_px,
            angle_deg,
            trials,
            bound: (bound / count).map(f64::sqrt),
            pose: halves(pose.component_div(&bound)).map(f64::sqrt),
            kabsch: halves(kabsch.component_div(&bound)).map(f64::sqrt),
            stated: halves(stated / count),
            bias: [largest(0), largest(3).to_degrees()],
        })
    }

    /// Returns the claims that the row contradicts by more than chance.
    pub fn failures(&self) -> Vec<String> {
        // Three axes, so three times as many squares.
        let chance = CHANCE / (6.0 * self.trials as f64).sqrt();
        let mut failures = Vec::new();
        for (i, kind) in ["displacement", "rotation"].into_iter().enumerate() {
            let over = self.pose[i];
            if over > MOST_OVER_BOUND + chance {
                failures.push(format!(
                    "{self}: error of the {kind} {over:.2} times the bound"
                ));
            }
            let stated = self.stated[i];
            if !(STATED[0] - 2.0 * chance..=STATED[1] + 2.0 * chance).contains(&stated) {
                failures.push(format!(
                    "{self}: error²/sigma² of the {kind} is {stated:.2}"
                ));
            }
            if self.bias[i] > [MOST_BIAS_MM, MOST_BIAS_DEG][i] {
                let (bias, unit) = (self.bias[i], ["mm", "degrees"][i]);
                failures.push(format!("{self}: bias of the {kind} {bias:.4} {unit}"));
            }
        }
        failures
    }
}

impl std::fmt::Display for Row {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            target,
            points,
            noise_px,
            angle_deg,
            ..
        } = self;
        let name = target.name;
        write!(
            f,
            "{name}, {points} points, {noise_px} px, {angle_deg} degrees"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pose_errors_are_near_bound() {
        let mut random = Random::seeded(3);
        for target in TARGETS {
            let row = Row::run(target, 100, 0.05, 20.0, 200, &mut random).expect("100 points");
            assert_eq!(row.failures(), [""; 0], "{row:?}");
            assert!(row.kabsch.iter().all(|over| *over > 1.2), "{row:?}");
        }
    }
}
