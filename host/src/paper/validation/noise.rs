//! Moves seen by noisy cameras: the error of each estimator against the Cramér-Rao
//! [`super::bound`].
//!
//! Every trial draws its own points and its own noise. The ratio is the root of the mean squared
//! error over the root of the mean bound, per axis; 1 is the optimum.

use super::scene::{point, rig, views};
use super::{bound, estimates, in_parallel};
use serde::Serialize;
use trinocular_core::estimate::Refusal;
use trinocular_core::rig::Rig;
use trinocular_core::sums::View;
use trinocular_rig::random::Random;

/// Number of points in a trial.
pub const POINTS: usize = 100;
/// Standard deviation of the noise in each pixel coordinate of both instants, px.
pub const NOISE_PX: f64 = 0.1;
/// Moves of the trials, mm.
pub const MOVES_MM: [[f64; 3]; 5] = [
    [15.0, 15.0, 0.0],
    [0.0, 0.0, 5.0],
    [15.0, 15.0, 2.0],
    [4.0, 4.0, 1.0],
    [20.0, 20.0, 20.0],
];

const SEED: u64 = 0x6e6f_6973_655f_6331;

/// Returns the rig of the paper's section 4 with its one mean focal length: 533.32 px, 70 and 68
/// mm.
pub fn section_4_rig() -> Rig {
    rig(533.32, 70.0, 68.0)
}

/// Errors of one move.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// True displacement, mm.
    pub true_mm: [f64; 3],
    /// Root of the mean Cramér-Rao bound, mm.
    pub bound_mm: [f64; 3],
    /// Root mean squared error of [`super::ESTIMATORS`], in that order, mm.
    pub error_mm: [[f64; 3]; 3],
}

impl Row {
    /// Returns the ratio of error to bound of one estimator, per axis.
    pub fn ratio(&self, estimator: usize) -> [f64; 3] {
        let error = self
            .error_mm
            .get(estimator)
            .copied()
            .unwrap_or([f64::NAN; 3]);
        std::array::from_fn(|axis| error[axis] / self.bound_mm[axis])
    }
}

/// Errors of all moves.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Noise {
    /// Number of trials of each row.
    pub trials: usize,
    /// Rows, one per move.
    pub rows: Vec<Row>,
}

/// Squared errors of one trial and its bound, mm².
struct Trial {
    bound: [f64; 3],
    squares: [[f64; 3]; 3],
}

/// Runs `trials` trials of every move.
///
/// # Errors
/// If an estimator refuses, which does not happen with trials of this size and noise.
pub fn run(trials: usize) -> Result<Noise, Refusal> {
    let rig = section_4_rig();
    let rows = MOVES_MM.iter().zip(0_u64..).map(|(move_mm, number)| {
        let results = in_parallel(trials, |trial| {
            try_once(&rig, *move_mm, Random::new(SEED + number, trial as u64))
        });
        let results = results.into_iter().collect::<Result<Vec<_>, _>>()?;
        let root_mean = |value: &dyn Fn(&Trial) -> f64| {
            (results.iter().map(value).sum::<f64>() / results.len().max(1) as f64).sqrt()
        };
        Ok(Row {
            true_mm: *move_mm,
            bound_mm: [0, 1, 2].map(|axis| root_mean(&|trial| trial.bound[axis])),
            error_mm: [0, 1, 2].map(|estimator| {
                [0, 1, 2].map(|axis| root_mean(&|trial| trial.squares[estimator][axis]))
            }),
        })
    });
    Ok(Noise {
        trials,
        rows: rows.collect::<Result<_, Refusal>>()?,
    })
}

fn try_once(rig: &Rig, move_mm: [f64; 3], mut random: Random) -> Result<Trial, Refusal> {
    let points: Vec<[f64; 3]> = (0..POINTS)
        .map(|_| point(rig, move_mm, &mut random))
        .collect();
    let seen: Vec<[View; 3]> = points
        .iter()
        .map(|at| blurred(rig, views(rig, *at, move_mm), &mut random))
        .collect();
    let squares = estimates(rig, &seen)?
        .map(|estimate| std::array::from_fn(|axis| (estimate[axis] - move_mm[axis]).powi(2)));
    let bound = bound::variance_mm2(rig, &points, move_mm, NOISE_PX).ok_or(Refusal::Degenerate)?;
    Ok(Trial { bound, squares })
}

/// Returns the views with noise in every coordinate.
fn blurred(rig: &Rig, mut views: [View; 3], random: &mut Random) -> [View; 3] {
    for (view, camera) in views.iter_mut().zip(&rig.cameras) {
        for at in [&mut view.start, &mut view.end] {
            for (value, focal_px) in at.iter_mut().zip(camera.focal_px) {
                *value += NOISE_PX / focal_px * random.gaussian();
            }
        }
    }
    views
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn midpoint_reaches_bound() {
        for row in run(2000).unwrap().rows {
            let ratio = row.ratio(2);
            // Below 1 by more than chance (1.6 % for 2,000 trials) would mean that the bound is
            // wrong.
            assert!(
                ratio.iter().all(|r| (0.94..=1.10).contains(r)),
                "{:?}: {ratio:?}",
                row.true_mm
            );
        }
    }

    #[test]
    fn paper_estimators_miss_bound() {
        let rows = run(300).unwrap().rows;
        for estimator in [0, 1] {
            let ratio: Vec<_> = rows.iter().map(|row| row.ratio(estimator)).collect();
            // Depth comes only from the small difference between two camera pairs.
            assert!(ratio.iter().all(|r| r[2] > 2.5), "{ratio:?}");
            // (20, 20, 20): the bias alone is many times the noise.
            let [x, y, _] = ratio[4];
            assert!(x.min(y) > 20.0, "{ratio:?}");
        }
    }

    #[test]
    fn runs_repeat_to_the_bit() {
        assert_eq!(run(5).unwrap(), run(5).unwrap());
    }
}
