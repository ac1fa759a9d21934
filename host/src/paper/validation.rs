//! The paper's section 3 as numbers: its Tables 1 and 2 for all three estimators, its Figs. 3 and
//! 4, and the error of each estimator with noisy images relative to the Cramér-Rao bound.
//!
//! All data are drawn from seeded streams, one per set of points, and summed up in the order of the
//! sets: the results are the same bits on one core and on many.
//!
//! - [`recovery`]: noise-free moves of random point sets, recovered (Tables 1 and 2);
//! - [`noise`]: the same moves through noisy cameras, against the Cramér-Rao bound;
//! - [`scene`]: the random points themselves (Figs. 3 and 4);
//! - [`present`]: these results as tables and figures, for the screen and the page.

pub mod bound;
pub mod noise;
pub mod present;
pub mod recovery;
pub mod scene;

use serde::Serialize;
use trinocular_core::estimate::{Refusal, closed_form, least_squares, midpoint};
use trinocular_core::rig::Rig;
use trinocular_core::sums::View;
use trinocular_core::sums::centred::CentredSums;
use trinocular_core::sums::pair::PairSums;

/// Names of the estimators, in the order of every array of three in this module.
pub const ESTIMATORS: [&str; 3] = ["closed form", "least squares", "midpoint"];

/// The whole of section 3, for `--json`, the screen and the page.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Validation {
    /// Tables 1 and 2.
    pub recovery: recovery::Recovery,
    /// Errors with noisy cameras against the bound.
    pub noise: noise::Noise,
    /// One set of points, in space and in the three images.
    pub sample: scene::Sample,
}

impl Validation {
    /// Runs section 3 with the paper's sizes: 1,000 sets of 50 points, and 4,000 noisy trials of
    /// each move.
    ///
    /// # Errors
    /// If an estimator refuses, which does not happen with sets of this size.
    pub fn run() -> Result<Self, Refusal> {
        Ok(Self {
            recovery: recovery::run(1000)?,
            noise: noise::run(4000)?,
            sample: scene::Sample::draw(),
        })
    }
}

/// Computes the estimate of every estimator from the same views: target in the camera frame, mm.
/// `points` holds the views of each point in the left, the middle and the right camera.
fn estimates(rig: &Rig, points: &[[View; 3]]) -> Result<[[f64; 3]; 3], Refusal> {
    let mut pair = PairSums::new(rig)?;
    let mut centred = CentredSums::new(rig)?;
    for views in points {
        pair.add(*views);
        // A point behind the cameras shows as too few points.
        let _ = centred.add(views);
    }
    Ok([
        closed_form::solve(&pair)?,
        least_squares::solve(&pair)?,
        midpoint::solve(&centred)?.displacement_mm,
    ])
}

/// Runs `job(0)` to `job(count - 1)` on all cores and returns the results in that order.
fn in_parallel<T: Send>(count: usize, job: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let share = count.div_ceil(threads).max(1);
    let job = &job;
    std::thread::scope(|scope| {
        let shares = (0..count).step_by(share).map(|first| {
            let last = (first + share).min(count);
            scope.spawn(move || (first..last).map(job).collect::<Vec<T>>())
        });
        // Start all jobs before joining the first.
        let shares: Vec<_> = shares.collect();
        let results = shares.into_iter().map(|handle| {
            handle
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        });
        results.flatten().collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parallel_results_keep_order() {
        for count in [0, 1, 2, 3, 1000] {
            let squares: Vec<usize> = (0..count).map(|i| i * i).collect();
            assert_eq!(in_parallel(count, |i| i * i), squares);
        }
    }
}
