//! Delay of one camera's time stamps, from its images of a stage that goes to and fro.
//!
//! The mean motion of the camera's points is a linear function of the stage's position at the
//! instant of the exposure. A stamp `t` is late by the delay `D`, so that on a pass `p` along the
//! axis `a`
//!
//! ```text
//! u(t) = b(a) s(t - D) + o(p)        u motion, px; s stage, mm; o a constant of each pass
//! ```
//!
//! For a given `D`, `b` and `o` are linear least squares. `D` is where their residuals are least:
//! the best of a scan, then Gauss-Newton iteration with the derivative `-b v` (`v` the speed of the
//! stage). Neither lens, depth nor the matrix of the rig file is used, and no other camera.
//!
//! The standard deviation is the larger one of two: that by the residuals, and that by the scatter
//! of the delays of the single passes. The uncertainty of the station's clock, which is common to
//! all passes and cameras, is added to it.

mod sums;

use super::delay::Path;
use crate::median::median;
use serde::Serialize;
use std::ops::RangeInclusive;
use sums::Fit;
use thiserror::Error;
use trinocular_rig::rig_file::capture::DELAY_MS;

/// Delays that are tried, ms. A result outside the range of a rig file's `delay_ms` is refused.
const SCAN_MS: RangeInclusive<i32> = -120..=320;

/// Step of the scan, ms: the residuals change little over it.
const SCAN_STEP_MS: usize = 4;

/// Number of Gauss-Newton steps.
const STEPS: usize = 10;

/// Fewest passes that count.
const FEWEST_PASSES: usize = 4;

/// Fewest images of a pass that counts.
const FEWEST_IMAGES: usize = 6;

/// Largest share of the passes that may be left out.
const MOST_LEFT_OUT: f64 = 0.25;

/// Least motion of the points, root mean square, px.
const LEAST_MOTION_PX: f64 = 0.1;

/// Least motion of the points over their noise at rest.
const LEAST_OVER_NOISE: f64 = 10.0;

/// Residuals that noise explains, as multiples of the noise at rest and as shares of the motion.
const MOST_OVER_NOISE: f64 = 6.0;
const MOST_OVER_MOTION: f64 = 0.02;

/// Difference of a pass from the others that is accepted beyond the error of the clock: ms, or a
/// multiple of sigma if that is more.
const ACCEPTED_MS: f64 = 0.3;
const ACCEPTED_SIGMA: f64 = 5.0;

/// Largest standard deviation of a usable delay, ms.
const VAGUE_MS: f64 = 1.0;

/// One image of a moving stage.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// Time stamp, s, on the clock of the path.
    pub stamp_s: f64,
    /// Mean motion of the points, px.
    pub moved_px: [f64; 2],
}

/// Pass of the stage along one axis, as one camera saw it.
#[derive(Clone, Debug)]
pub struct Passage<'a> {
    /// Axis of the stage: 0, 1 or 2.
    pub axis: usize,
    /// Path of the stage.
    pub path: &'a Path,
    /// The camera's images.
    pub looks: Vec<Look>,
}

/// Delay of one camera's time stamps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Latency {
    /// Stamp minus middle of the exposure, ms.
    pub delay_ms: f64,
    /// Standard deviation of the delay, ms.
    pub sigma_ms: f64,
    /// Standard deviation without that of the station's clock, for differences between cameras, ms.
    pub own_sigma_ms: f64,
    /// Number of images.
    pub images: usize,
    /// Number of passes that were used.
    pub passes: usize,
    /// Number of passes that were left out, because they disagree with the others, have too few
    /// images, or the station's clock jumped.
    pub left_out: usize,
    /// Root mean square of the residuals, px.
    pub scatter_px: f64,
}

/// Reason for a missing delay.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Refusal {
    /// Too few passes have enough images.
    #[error(
        "only {passes} passes of the stage have {FEWEST_IMAGES} images that show its points, \
         {FEWEST_PASSES} are needed: use more images per second, or better light"
    )]
    TooFew {
        /// Number of passes with enough images.
        passes: usize,
    },
    /// The camera does not see the stage move.
    #[error(
        "its image moves by {motion_px:.3} px while the stage moves, noise is {noise_px:.3} px: is \
         it the camera on the stage, and does it see a target at rest? Then use a longer --reach"
    )]
    Still {
        /// Root mean square of the motion that goes with the stage, px.
        motion_px: f64,
        /// Noise at rest, px.
        noise_px: f64,
    },
    /// The image moves otherwise than the stage.
    #[error(
        "its image moves otherwise than the stage: residuals are {scatter_px:.3} px, noise is \
         {noise_px:.3} px. Is the target at rest, the [stage] of the rig file right, and the \
         computer not busy?"
    )]
    Otherwise {
        /// Root mean square of the residuals, px.
        scatter_px: f64,
        /// Noise at rest, px.
        noise_px: f64,
    },
    /// The passes disagree.
    #[error(
        "its delay differs between passes of the stage, from {least_ms:.1} to {greatest_ms:.1} ms. \
         Is the target at rest? Else this computer is too busy: run the command again"
    )]
    Unsteady {
        /// Least delay of a pass, ms.
        least_ms: f64,
        /// Greatest delay of a pass, ms.
        greatest_ms: f64,
    },
    /// No camera has such a delay.
    #[error(
        "its delay would be {delay_ms:.1} ms, but a camera's is {} to {} ms: is the [stage] of the \
         rig file right, and does the stage start at once?",
        DELAY_MS.start(), DELAY_MS.end()
    )]
    Impossible {
        /// The delay, ms.
        delay_ms: f64,
    },
    /// The delay is too uncertain.
    #[error(
        "its delay is known to {sigma_ms:.2} ms only: use a longer --reach, more images per \
         second, or a computer that is not busy"
    )]
    Vague {
        /// Standard deviation of the delay, ms.
        sigma_ms: f64,
    },
}

/// Fits the delay of one camera's time stamps, -100 to 300 ms. `noise_px` is the standard deviation
/// of the points' mean motion at rest, `clock_ms` the bound of the error of the station's clock.
/// The error stays within four of the stated sigma (test `delay_is_found_within_four_sigma`), which
/// is at most 1 ms.
///
/// # Errors
/// [`Refusal`].
pub fn latency(passages: &[Passage<'_>], noise_px: f64, clock_ms: f64) -> Result<Latency, Refusal> {
    let enough = |passage: &&Passage<'_>| passage.looks.len() >= FEWEST_IMAGES;
    let all: Vec<&Passage<'_>> = passages.iter().filter(enough).collect();
    if all.len() < FEWEST_PASSES {
        return Err(Refusal::TooFew { passes: all.len() });
    }
    let start_s = scanned_s(&all);
    let whole = refined(&all, start_s);
    let motion_px = whole.motion_px();
    if !(motion_px >= LEAST_MOTION_PX.max(LEAST_OVER_NOISE * noise_px)) {
        return Err(Refusal::Still {
            motion_px,
            noise_px,
        });
    }
    let (used, own_ms) = agreeing(&all, whole.delay_s, noise_px, clock_ms)?;
    let fit = refined(&used, whole.delay_s);
    let scatter_px = fit.scatter_px();
    if !(scatter_px <= (MOST_OVER_NOISE * noise_px).max(MOST_OVER_MOTION * motion_px)) {
        return Err(Refusal::Otherwise {
            scatter_px,
            noise_px,
        });
    }
    let delay_ms = 1e3 * fit.delay_s;
    if !DELAY_MS.contains(&delay_ms) {
        return Err(Refusal::Impossible { delay_ms });
    }
    let count = own_ms.len() as f64;
    let mean_ms = own_ms.iter().sum::<f64>() / count;
    let squares: f64 = own_ms.iter().map(|ms| (ms - mean_ms).powi(2)).sum();
    let by_passes_ms = (squares / (count - 1.0) / count).sqrt();
    let own_sigma_ms = (1e3 * fit.sigma_s(noise_px)).max(by_passes_ms);
    // The error of the clock is anywhere within its bound.
    let sigma_ms = own_sigma_ms.hypot(clock_ms / f64::sqrt(3.0));
    if !(sigma_ms <= VAGUE_MS) {
        return Err(Refusal::Vague { sigma_ms });
    }
    Ok(Latency {
        delay_ms,
        sigma_ms,
        own_sigma_ms,
        images: used.iter().map(|passage| passage.looks.len()).sum(),
        passes: used.len(),
        left_out: passages.len() - used.len(),
        scatter_px,
    })
}

/// Returns the delay with the least residuals in the scan, s.
fn scanned_s(passages: &[&Passage<'_>]) -> f64 {
    let delays_s = SCAN_MS.step_by(SCAN_STEP_MS).map(|ms| f64::from(ms) * 1e-3);
    let fits = delays_s.map(|delay_s| Fit::at(passages, delay_s));
    let best = fits.min_by(|a, b| a.squares().total_cmp(&b.squares()));
    best.map_or(0.0, |fit| fit.delay_s)
}

/// Refines a delay by Gauss-Newton iteration.
fn refined(passages: &[&Passage<'_>], start_s: f64) -> Fit {
    let mut fit = Fit::at(passages, start_s);
    for _ in 0..STEPS {
        let next = Fit::at(passages, fit.delay_s + fit.step_s());
        if !(next.squares() <= fit.squares()) {
            break;
        }
        fit = next;
    }
    fit
}

/// Returns the passes whose own delays agree, and these delays, ms.
fn agreeing<'a>(
    passages: &[&'a Passage<'a>],
    start_s: f64,
    noise_px: f64,
    clock_ms: f64,
) -> Result<(Vec<&'a Passage<'a>>, Vec<f64>), Refusal> {
    let alone = passages.iter().map(|passage| refined(&[passage], start_s));
    let alone: Vec<Fit> = alone.collect();
    let all_ms: Vec<f64> = alone.iter().map(|fit| 1e3 * fit.delay_s).collect();
    let middle_ms = median(all_ms.clone());
    let agrees = |fit: &Fit| {
        let by_noise_ms = ACCEPTED_SIGMA * 1e3 * fit.sigma_s(noise_px);
        let accepted_ms = ACCEPTED_MS.max(by_noise_ms) + clock_ms;
        (1e3 * fit.delay_s - middle_ms).abs() <= accepted_ms
    };
    let (mut used, mut own_ms) = (Vec::new(), Vec::new());
    for (passage, fit) in passages.iter().zip(&alone) {
        if agrees(fit) {
            used.push(*passage);
            own_ms.push(1e3 * fit.delay_s);
        }
    }
    let left_out = (passages.len() - used.len()) as f64;
    if left_out > MOST_LEFT_OUT * passages.len() as f64 || used.len() < FEWEST_PASSES {
        return Err(Refusal::Unsteady {
            least_ms: all_ms.iter().copied().fold(f64::INFINITY, f64::min),
            greatest_ms: all_ms.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        });
    }
    Ok((used, own_ms))
}

/// Returns how far apart two cameras expose, ms, from the instants of their exposures, s: nine of
/// ten images are at most this far from the nearest one of the other camera. Images whose partner
/// was lost do not count, as long as fewer than half were. `None` without pairs.
pub fn apart_ms(first_s: &[f64], other_s: &[f64]) -> Option<f64> {
    let periods = first_s.windows(2).map(|pair| pair[1] - pair[0]);
    let half_s = median(periods.collect()) / 2.0;
    let nearest = |at_s: &f64| {
        let after = first_s.partition_point(|first| first < at_s);
        let near = first_s[after.saturating_sub(1)..].iter().take(2);
        near.map(|first| (first - at_s).abs())
            .min_by(f64::total_cmp)
    };
    let mut apart_s: Vec<f64> = other_s.iter().filter_map(nearest).collect();
    apart_s.retain(|apart_s| *apart_s <= 1.01 * half_s);
    apart_s.sort_by(f64::total_cmp);
    let most_s = apart_s.get(apart_s.len() * 9 / 10);
    most_s.map(|apart_s| 1e3 * apart_s)
}

#[cfg(test)]
mod tests;
