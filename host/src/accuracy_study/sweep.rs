//! Runs all conditions with all seeds on a few threads.

use super::condition::Condition;
use super::tally::Tally;
use super::trial::{Outcome, Posters, TrialBench};
use std::sync::atomic::{AtomicU64, Ordering};
use trinocular_vision::images::SceneError;
use trinocular_vision::thread_pool::ThreadPool;

/// Result of one condition.
#[derive(Clone, Debug)]
pub struct Row {
    /// The condition.
    pub condition: &'static Condition,
    /// Counts over all noise levels.
    pub tally: Tally,
    /// Counts per noise level; noise in grey levels.
    pub by_noise: Vec<(f64, Tally)>,
}

/// Results of one seed and one condition: noise and outcome of each trial.
type Outcomes = Vec<(f64, Outcome)>;
/// Results of one seed and all conditions.
type OfSeed = Result<Vec<Outcomes>, SceneError>;

/// Runs `conditions` with the seeds `1..=seeds` on `threads` threads. Calls `told` with the
/// progress, 0 to 1.
///
/// # Errors
/// If a condition's scene cannot be rendered.
pub fn run(
    conditions: &[&'static Condition],
    seeds: u64,
    threads: usize,
    told: impl Fn(f64) + Sync,
) -> Result<Vec<Row>, SceneError> {
    let done = AtomicU64::new(0);
    let all = (seeds * conditions.len() as u64).max(1) as f64;
    let of_seed = |seed| -> OfSeed {
        let mut posters = Posters::new(seed);
        let outcomes = conditions.iter().map(|condition| {
            let outcomes = TrialBench::new(condition, &mut posters).map(|mut b| b.run());
            told((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / all);
            outcomes
        });
        outcomes.collect()
    };
    // In the order of the seeds, so that the result has the same bits for any number of threads.
    let found = ThreadPool::new(threads).map((1..=seeds).collect(), of_seed);
    let mut rows: Vec<Row> = (conditions.iter())
        .map(|condition| Row {
            condition,
            tally: Tally::default(),
            by_noise: (condition.noise_grey.iter())
                .map(|noise| (*noise, Tally::default()))
                .collect(),
        })
        .collect();
    for outcomes in found {
        for (row, outcomes) in rows.iter_mut().zip(outcomes?) {
            for (noise, outcome) in outcomes {
                row.tally.add(&outcome);
                for (of, tally) in &mut row.by_noise {
                    if *of == noise {
                        tally.add(&outcome);
                    }
                }
            }
        }
    }
    Ok(rows)
}
