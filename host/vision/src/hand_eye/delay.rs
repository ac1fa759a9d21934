//! Delay of the cameras' time stamps, from images that are taken while the stage moves.
//!
//! At rest an image stamped `t` shows the displacement `d = c - A s(t)` of the stage's position
//! `s` (see [`fit`](mod@super::fit)). With stamps that are late by `D`, the image is older than
//! its stamp. With the matrix `M`, the inverse of `A`, the cameras give the position
//!
//! ```text
//! q = -M d = s(t - D) + o
//! ```
//!
//! `D` and the offset `o` are the least-squares solution by Gauss-Newton iteration, with the
//! stage's velocity `v` as the derivative: `q - s(t - D)` changes by `v` with `D`. A stage at rest
//! gives no information.

use super::fit::Sample;
use serde::Serialize;
use thiserror::Error;

/// Number of Gauss-Newton steps: the velocity changes little within a delay.
const STEPS: usize = 20;

/// Fewest images of a moving stage.
const FEWEST: usize = 8;

/// Slowest motion that counts, mm/s.
const SLOWEST_MM_S: f64 = 2.0;

/// Largest standard deviation of a usable delay, ms.
const VAGUE_MS: f64 = 2.0;

/// Half of the time over which a velocity is taken, s.
const HALF_S: f64 = 0.001;

/// Path of the stage: ascending times, s, and positions, mm.
#[derive(Clone, Debug, Default)]
pub struct Path(Vec<(f64, [f64; 3])>);

impl Path {
    /// Appends a position. Times must ascend.
    pub fn push(&mut self, time_s: f64, position_mm: [f64; 3]) {
        self.0.push((time_s, position_mm));
    }

    /// Returns the position at a time, by linear interpolation; beyond the ends, that of the end.
    pub fn at(&self, time_s: f64) -> [f64; 3] {
        let after = self.0.partition_point(|(time, _)| *time < time_s);
        let (Some(later), Some(earlier)) = (self.0.get(after), self.0.get(after.wrapping_sub(1)))
        else {
            let end = if after == 0 {
                self.0.first()
            } else {
                self.0.last()
            };
            return end.map_or([0.0; 3], |(_, position_mm)| *position_mm);
        };
        let share = (time_s - earlier.0) / (later.0 - earlier.0);
        std::array::from_fn(|i| earlier.1[i] + share * (later.1[i] - earlier.1[i]))
    }

    /// Returns the velocity at a time, mm/s.
    pub fn speed_mm_s(&self, time_s: f64) -> [f64; 3] {
        let (a, b) = (self.at(time_s - HALF_S), self.at(time_s + HALF_S));
        std::array::from_fn(|i| (b[i] - a[i]) / (2.0 * HALF_S))
    }
}

/// Displacement in one frame set of a moving stage.
#[derive(Clone, Debug, Serialize)]
pub struct Passing {
    /// Time stamp, s.
    pub stamp_s: f64,
    /// Displacement along camera axes, mm.
    pub displacement_mm: [f64; 3],
    /// Standard deviation of the displacement, mm.
    pub sigma_mm: [f64; 3],
}

impl Passing {
    /// Takes the displacement of a sample with the stamp `stamp_s`.
    pub fn new(stamp_s: f64, sample: &Sample) -> Self {
        Self {
            stamp_s,
            displacement_mm: sample.displacement_mm,
            sigma_mm: sample.sigma_mm,
        }
    }
}

/// Delay of the time stamps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Delay {
    /// Stamp minus capture time, ms, as `track --delay` takes it.
    pub delay_ms: f64,
    /// Standard deviation of the delay, ms.
    pub sigma_ms: f64,
    /// Number of frame sets with a moving stage.
    pub pictures: usize,
    /// Root mean square of the residuals, mm.
    pub scatter_mm: f64,
}

/// Reason for a missing delay.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Refusal {
    /// The stage rested in most images.
    #[error(
        "only {used} images show a stage that moves, {FEWEST} are needed: use a longer --reach, \
         or more images per second"
    )]
    TooFew {
        /// Number of frame sets with a moving stage.
        used: usize,
    },
    /// The delay is too uncertain.
    #[error(
        "the cameras' delay is known to {sigma_ms:.2} ms only: use a longer --reach or better \
         images"
    )]
    Vague {
        /// Standard deviation of the delay, ms.
        sigma_ms: f64,
    },
}

/// Fits the delay to the images of a moving stage. `matrix` maps camera axes to stage axes.
///
/// # Errors
/// [`Refusal`].
pub fn delay(passings: &[Passing], path: &Path, matrix: &[[f64; 3]; 3]) -> Result<Delay, Refusal> {
    let apply = |d: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|i| -(0..3).map(|j| matrix[i][j] * d[j]).sum::<f64>())
    };
    let variance = |sigma: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|i| {
            (0..3)
                .map(|j| (matrix[i][j] * sigma[j]).powi(2))
                .sum::<f64>()
        })
    };
    // Position seen, and weight, per frame set and axis.
    let seen: Vec<(f64, [f64; 3], [f64; 3])> = passings
        .iter()
        .map(|passing| {
            let weights = variance(passing.sigma_mm).map(|v| 1.0 / v.max(1e-12));
            (passing.stamp_s, apply(passing.displacement_mm), weights)
        })
        .collect();
    let mut delay_s = 0.0;
    let mut information = 0.0;
    for _ in 0..STEPS {
        // Per axis the offset is eliminated: weighted means of speeds and of residuals are taken
        // off.
        let mut gradient = 0.0;
        information = 0.0;
        for axis in 0..3 {
            let (mut w, mut wv, mut wr, mut wvv, mut wvr) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for (stamp_s, position_mm, weights) in &seen {
                let at_s = stamp_s - delay_s;
                let weight = weights[axis];
                let speed = path.speed_mm_s(at_s)[axis];
                let residual = path.at(at_s)[axis] - position_mm[axis];
                w += weight;
                wv += weight * speed;
                wr += weight * residual;
                wvv += weight * speed * speed;
                wvr += weight * speed * residual;
            }
            if w > 0.0 {
                information += wvv - wv * wv / w;
                gradient += wvr - wv * wr / w;
            }
        }
        if !(information > 0.0) {
            break;
        }
        delay_s += gradient / information;
    }
    let moves = |stamp_s: f64| {
        let speed = path.speed_mm_s(stamp_s - delay_s);
        speed.iter().map(|v| v * v).sum::<f64>().sqrt() >= SLOWEST_MM_S
    };
    let used = seen.iter().filter(|(stamp_s, ..)| moves(*stamp_s)).count();
    if used < FEWEST {
        return Err(Refusal::TooFew { used });
    }
    let (mut squares, mut weighted) = (0.0, 0.0);
    for axis in 0..3 {
        let residual = |(stamp_s, position_mm, _): &(f64, [f64; 3], [f64; 3])| {
            path.at(stamp_s - delay_s)[axis] - position_mm[axis]
        };
        let weight: f64 = seen.iter().map(|seen| seen.2[axis]).sum();
        let mean = seen
            .iter()
            .map(|seen| seen.2[axis] * residual(seen))
            .sum::<f64>()
            / weight;
        for seen in &seen {
            let off = residual(seen) - mean;
            squares += off * off;
            weighted += seen.2[axis] * off * off;
        }
    }
    // Three offsets and the delay are fitted. Stated noise that is too small is scaled up.
    let freedom = (3 * seen.len()) as f64 - 4.0;
    let larger = (weighted / freedom).max(1.0);
    let sigma_ms = 1e3 * (larger / information).sqrt();
    if !(sigma_ms <= VAGUE_MS) {
        return Err(Refusal::Vague { sigma_ms });
    }
    Ok(Delay {
        delay_ms: 1e3 * delay_s,
        sigma_ms,
        pictures: used,
        scatter_mm: (squares / (3 * seen.len()) as f64).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use trinocular_rig::random::Random;

    const MATRIX: [[f64; 3]; 3] = [[0.98, -0.17, 0.0], [0.17, 0.98, 0.0], [0.0, 0.0, -1.02]];

    /// Makes a path to and fro by 5 mm, in 0.4 s each way.
    fn path() -> Path {
        let mut path = Path::default();
        for ms in 0..1_600 {
            let time_s = f64::from(ms) * 1e-3;
            let x = 2.5 - 2.5 * (time_s * std::f64::consts::PI / 0.4).cos();
            path.push(time_s, [x, 0.8 * x, -0.5 * x]);
        }
        path
    }

    fn passings(path: &Path, delay_s: f64, noise_mm: f64, seed: u64) -> Vec<Passing> {
        let mut random = Random::seeded(seed);
        let matrix = nalgebra::Matrix3::from_fn(|i, j| MATRIX[i][j]);
        let inverse = matrix.try_inverse().expect("a mounting");
        (6..90)
            .map(|k| {
                let stamp_s = f64::from(k) / 60.0;
                let stage = nalgebra::Vector3::from(path.at(stamp_s - delay_s));
                let seen = -(inverse * stage);
                Passing {
                    stamp_s,
                    displacement_mm: std::array::from_fn(|i| {
                        seen[i] + 0.3 + noise_mm * random.gaussian()
                    }),
                    sigma_mm: [noise_mm; 3],
                }
            })
            .collect()
    }

    #[test]
    fn delay_is_found_within_three_sigma() {
        let path = path();
        let (mut squares, mut count) = (0.0, 0.0);
        for delay_ms in [-40.0, -5.0, 0.0, 12.5, 60.0] {
            for seed in 0..40 {
                let passings = passings(&path, delay_ms * 1e-3, 0.01, seed);
                let found = delay(&passings, &path, &MATRIX).expect("a delay");
                let off = (found.delay_ms - delay_ms) / found.sigma_ms;
                assert!(off.abs() < 4.0, "{delay_ms} ms: {found:?}");
                assert!(found.sigma_ms < 0.2, "{found:?}");
                squares += off * off;
                count += 1.0;
            }
        }
        let ratio = f64::sqrt(squares / count);
        println!("error over sigma {ratio:.3}");
        assert!((0.8..=1.1).contains(&ratio), "{ratio}");
    }

    #[test]
    fn stage_at_rest_gives_no_delay() {
        let mut path = Path::default();
        (0..1_600).for_each(|ms| path.push(f64::from(ms) * 1e-3, [1.0; 3]));
        let passings = passings(&path, 0.01, 0.01, 1);
        let refused = delay(&passings, &path, &MATRIX);
        assert_eq!(refused, Err(Refusal::TooFew { used: 0 }));
    }

    #[test]
    fn noisy_pictures_give_no_delay() {
        let path = path();
        let refused = delay(&passings(&path, 0.01, 2.0, 1), &path, &MATRIX);
        assert!(matches!(refused, Err(Refusal::Vague { .. })), "{refused:?}");
    }
}
