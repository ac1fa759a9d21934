//! Runs all layouts with all seeds on a few threads, and judges the counts.

use super::scene::{Bench, LAYOUTS, Layout};
use super::trial::{self, Trial, VAGUE_MM};
use crate::accuracy_study::tally::{HONEST, Tally, WITHIN};
use crate::accuracy_study::trial::Outcome;
use trinocular_vision::images::SceneError;
use trinocular_vision::thread_pool::ThreadPool;

/// Noises of the study, grey levels.
pub const NOISES_GREY: [f64; 3] = [2.0, 5.0, 10.0];
/// Scenes per seed, layout and noise.
const SCENES: usize = 2;
/// Standard deviations of chance that a claim allows for.
const CHANCE: f64 = 3.0;
/// Least share of targets that are alone and must be measured.
const LEAST_ALONE: f64 = 0.95;

/// Counts of one layout.
#[derive(Clone, Debug)]
pub struct Row {
    /// The layout.
    pub layout: &'static Layout,
    /// Noise, grey levels; `None` for all.
    pub noise_grey: Option<f64>,
    /// Displacements measured with a rotation.
    pub moved: Tally,
    /// Rotations, in degrees instead of mm.
    pub turned: Tally,
    /// Displacements measured as if nothing turned.
    pub displaced: Tally,
    /// Number of displacements, with and without a rotation, whose standard deviation is above
    /// [`VAGUE_MM`].
    pub vague: u32,
}

impl Row {
    fn new(layout: &'static Layout, noise_grey: Option<f64>) -> Self {
        Self {
            layout,
            noise_grey,
            moved: Tally::default(),
            turned: Tally::default(),
            displaced: Tally::default(),
            vague: 0,
        }
    }

    fn add(&mut self, trial: &Trial) {
        self.moved.add(&trial.moved);
        self.turned.add(&trial.turned);
        self.displaced.add(&trial.displaced);
        for outcome in [&trial.moved, &trial.displaced] {
            if let Outcome::Measured { sigma_mm, .. } = outcome {
                self.vague += u32::from(sigma_mm.iter().any(|sigma| *sigma > VAGUE_MM));
            }
        }
    }
}

/// Runs the seeds `1..=seeds` on `threads` threads. Returns a row per layout, each followed by one
/// per noise. Calls `told` with the progress, 0 to 1.
///
/// # Errors
/// If a scene cannot be rendered.
pub fn run(seeds: u64, threads: usize, told: impl Fn(f64) + Sync) -> Result<Vec<Row>, SceneError> {
    let done = std::sync::atomic::AtomicU64::new(0);
    let of_seed = |seed| -> Result<Vec<Trial>, SceneError> {
        let mut bench = Bench::new(seed)?;
        let rig = bench.rig().clone();
        let mut trials = Vec::new();
        for layout in &LAYOUTS {
            for noise_grey in NOISES_GREY {
                for _ in 0..SCENES {
                    trials.push(trial::run(&rig, &bench.render(layout, noise_grey)));
                }
            }
        }
        let done = 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        told(done as f64 / seeds.max(1) as f64);
        Ok(trials)
    };
    let found = ThreadPool::new(threads).map((1..=seeds).collect(), of_seed);
    let mut rows = Vec::new();
    for layout in &LAYOUTS {
        rows.push(Row::new(layout, None));
        rows.extend(NOISES_GREY.map(|noise| Row::new(layout, Some(noise))));
    }
    let per_layout = NOISES_GREY.len() + 1;
    for trials in found {
        for (i, trial) in trials?.iter().enumerate() {
            let (layout, noise) = (
                i / (NOISES_GREY.len() * SCENES),
                i / SCENES % NOISES_GREY.len(),
            );
            rows[layout * per_layout].add(trial);
            rows[layout * per_layout + 1 + noise].add(trial);
        }
    }
    Ok(rows)
}

/// Returns the claims that do not hold, in words. `looseness` widens the statistical limits for
/// sweeps of few scenes; 1 leaves them unchanged.
pub fn failures(rows: &[Row], looseness: f64) -> Vec<String> {
    let mut failures = Vec::new();
    let claimed = |row: &&Row| row.noise_grey.is_none() && !row.layout.is_close();
    for row in rows.iter().filter(claimed) {
        let name = row.layout.name;
        for (what, tally) in [("displacement", &row.moved), ("rotation", &row.turned)] {
            if tally.gross > 0 {
                failures.push(format!("{name}: {} gross errors of {what}", tally.gross));
            }
        }
        if row.layout.share == [1.0; 2] {
            failures.extend(failures_alone(row, looseness));
        }
    }
    failures
}

fn failures_alone(row: &Row, looseness: f64) -> Vec<String> {
    let name = row.layout.name;
    let mut failures = Vec::new();
    let share = f64::from(row.moved.measured) / f64::from(row.moved.trials().max(1));
    if share < LEAST_ALONE {
        failures.push(format!("{name}: only {:.0} % measured", 100.0 * share));
    }
    let [low, high] = [HONEST[0] / looseness, HONEST[1] * looseness];
    for (what, tally) in [("displacement", &row.moved), ("rotation", &row.turned)] {
        let mean = tally.normalised().iter().sum::<f64>() / 3.0;
        if !(low..=high).contains(&mean) {
            failures.push(format!("{name}: error²/sigma² of {what} is {mean:.2}"));
        }
        let outside = (1.0 - WITHIN) * looseness;
        let chance = (outside / f64::from(tally.measured.max(1))).sqrt();
        let least = 1.0 - outside - CHANCE * chance;
        if !(tally.within() >= least) {
            let within = 100.0 * tally.within();
            failures.push(format!("{name}: {what} {within:.1} % within three sigma"));
        }
    }
    failures
}
