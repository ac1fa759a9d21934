//! Motion of a rigid target that most points agree on, even if some are wrong.
//!
//! Random sample consensus (Fischler and Bolles 1981): the pose of three points at a time, the one
//! with the least sum of bounded distances, and then the pose of all points near it.

use trinocular_core::estimate::pose::{self, Estimate, Observation};
use trinocular_core::sums::centred::Geometry;
use trinocular_rig::random::Random;

/// Samples of three points. If a third of 60 points or more is wrong, all samples contain a wrong
/// one with a probability of 1e-7.
const SAMPLES: usize = 50;
/// Largest number of points that judge a sample.
const MOST_JUDGES: usize = 500;
/// Distance of the points that are kept, in multiples of the median.
const NEAR: f64 = 5.0;
/// Rounds of keeping the near points.
const ROUNDS: usize = 3;

/// Returns the pose that most of the points agree on; `None` if the points do not determine one. A
/// point off by more than `far`, in normalised coordinates, counts as simply wrong.
pub fn motion(geometry: &Geometry, all: &[Observation], far: f64) -> Option<Estimate> {
    if all.is_empty() {
        return None;
    }
    let stride = all.len().div_ceil(MOST_JUDGES);
    let judges: Vec<Observation> = all.iter().copied().step_by(stride).collect();
    let mut random = Random::seeded(all.len() as u64);
    let samples = (0..SAMPLES).filter_map(|_| {
        let [a, b, c] = [0; 3].map(|_| random.below(all.len()));
        let are_distinct = a != b && b != c && c != a;
        let sample = are_distinct.then(|| [a, b, c].map(|index| all[index]))?;
        let pose = pose::plain(geometry, &sample).ok()?;
        let score: f64 = judges
            .iter()
            .map(|o| distance(geometry, &pose, o).min(far))
            .sum();
        Some((score, pose))
    });
    let (_, mut best) = samples.min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    for round in 1..=ROUNDS {
        let off: Vec<f64> = all.iter().map(|o| distance(geometry, &best, o)).collect();
        let mut sorted = off.clone();
        let (_, median, _) = sorted.select_nth_unstable_by(all.len() / 2, f64::total_cmp);
        // Without noise the distances are those of rounding.
        let limit = NEAR * median.max(1e-9);
        let near = all.iter().zip(&off).filter(|(_, off)| **off <= limit);
        let near: Vec<Observation> = near.map(|(observation, _)| *observation).collect();
        let solve = match round == ROUNDS {
            true => pose::solve,
            false => pose::plain,
        };
        best = solve(geometry, &near).unwrap_or(best);
    }
    Some(best)
}

/// Returns the distance in the mean camera of a point from where the pose puts it, in normalised
/// coordinates.
fn distance(geometry: &Geometry, pose: &Estimate, observation: &Observation) -> f64 {
    let Some([x, y, _]) = pose.moved(geometry, observation.start) else {
        return f64::INFINITY;
    };
    let [alpha, beta, _] = observation.end;
    let off = ((x - alpha).powi(2) + (y - beta).powi(2)).sqrt();
    if off.is_finite() { off } else { f64::INFINITY }
}
