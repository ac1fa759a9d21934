//! Coarse search for the displacement, by voting of all points; needs no prior.
//!
//! The depth of every point is known from the stereo match, so one displacement predicts the motion
//! of all points:
//!
//! ```text
//! ξ' = (ξ + ρ Tx) / (1 + ρ Tz)        (ξ normalised position, ρ inverse depth; y alike)
//! ```
//!
//! The search space is therefore three numbers for the whole image, as in a Hough transform. At a
//! coarse level, the window of each voter is correlated (zncc) with all places around it; the score
//! of a displacement is the mean correlation at the places that it predicts. Displacements that
//! score nearly as well as the best are returned too: a finer level decides whether the texture
//! repeats. Where a part of the votes proves that a displacement scores too low, the others are not
//! counted (`tally`). The hypotheses are those of a count of all votes, bit for bit.

mod layer;
mod places;
mod tally;

use crate::matching::geometry::RigGeometry;
use crate::matching::stereo::StereoMatch;
use crate::matching::zncc::{OUTSIDE, ZnccPatch, ZnccPlane};
use crate::thread_pool::ThreadPool;
use places::{DisplacementGrid, Voter};
use tally::Tally;

/// Largest number of points that vote.
const MAX_VOTERS: usize = 60;
/// Number of points whose votes are counted everywhere.
const FIRST_VOTERS: usize = 20;
/// Number of points whose votes are counted before the search is restricted again.
const NEXT_VOTERS: usize = 5;
/// Least number of points that vote.
const MIN_VOTERS: usize = 6;
/// Largest distance of a rival's score from the best.
const RIVAL_MARGIN: f32 = 0.3;
/// Largest number of hypotheses.
const MAX_HYPOTHESES: usize = 4;
/// Least distance between two hypotheses, coarse px.
const MIN_DISTANCE: f64 = 2.5;
/// Relative changes of depth that are tried: from 12 % away to 12 % nearer, in steps small enough
/// for a coarse pixel.
const DEPTH_CHANGES: [f64; 5] = [0.0, -0.06, 0.06, -0.12, 0.12];

/// Displacement that explains the coarse images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hypothesis {
    /// Displacement, mm.
    pub displacement_mm: [f64; 3],
    /// Mean zncc of the voters.
    pub score: f32,
}

/// Coarse images of the reference camera at two instants.
#[derive(Debug)]
pub struct DisplacementSearch<'a> {
    /// Geometry of the active cameras.
    pub geometry: &'a RigGeometry,
    /// Image at the keyframe.
    pub before: &'a ZnccPlane,
    /// Image now.
    pub now: &'a ZnccPlane,
    /// Image pixels per coarse pixel.
    pub scale: f64,
    /// Largest motion of a point along x and along y, coarse px.
    pub range: usize,
    /// Threads that share the work.
    pub thread_pool: &'a ThreadPool,
}

impl DisplacementSearch<'_> {
    /// Returns the best displacements, the best first; none if too few points have contrast.
    pub fn hypotheses(&self, matches: &[StereoMatch]) -> Vec<Hypothesis> {
        self.hypotheses_of(matches, FIRST_VOTERS)
    }

    /// Does the same as [`Self::hypotheses`], and counts the votes of at least `first_voters` for
    /// every displacement. The result does not depend on it.
    fn hypotheses_of(&self, matches: &[StereoMatch], first_voters: usize) -> Vec<Hypothesis> {
        let voters = self.voters(matches);
        if voters.len() < MIN_VOTERS {
            return Vec::new();
        }
        let mut depths: Vec<f64> = voters.iter().map(|v| v.inverse_depth).collect();
        depths.sort_by(f64::total_cmp);
        let median = depths[depths.len() / 2];
        let near = depths[depths.len() * 9 / 10];
        let focal = self.geometry.focal_px / self.scale;
        // Near points move most: they must not skip a coarse pixel between two displacements.
        let step = (median / near).clamp(0.4, 1.0);
        let count = (self.range as f64 / step) as i64;
        let per_px = 1.0 / (focal * median);
        let grid = DisplacementGrid {
            side: (2 * count + 1) as usize,
            first: -(count as f64) * step * per_px,
            step: step * per_px,
        };
        let tally = self.tally(&voters, grid, median, first_voters);
        let peaks = tally.peaks().into_iter().map(|(tz, peak)| {
            // Sub-step position of the peak: vertex of a parabola along each axis.
            let px = [0, 1].map(|axis| {
                let [before, after] = peak.along[axis];
                let shift = 0.5 * (before - after) / (before - 2.0 * peak.score + after);
                let shift = if shift.is_finite() {
                    f64::from(shift.clamp(-0.5, 0.5))
                } else {
                    0.0
                };
                peak.at[axis] as f64 - count as f64 + shift
            });
            Hypothesis {
                displacement_mm: [px[0] * step * per_px, px[1] * step * per_px, tz],
                score: peak.score,
            }
        });
        best_and_rivals(peaks.collect(), focal * median)
    }

    /// Counts votes until the scores of all possible hypotheses are complete.
    fn tally<'b>(
        &'b self,
        voters: &'b [Voter],
        grid: DisplacementGrid,
        median_inverse_depth: f64,
        first_voters: usize,
    ) -> Tally<'b> {
        let changes = DEPTH_CHANGES.map(|c| c / median_inverse_depth);
        let mut tally = Tally::new(self, grid, changes, voters);
        let mut likely_score = None;
        tally.add(first_voters);
        while tally.rest() > 0 {
            likely_score = likely_score.or_else(|| tally.likely_score());
            if let Some(score) = likely_score {
                tally.restrict(score);
            }
            tally.add(NEXT_VOTERS);
        }
        tally
    }

    /// Correlates a patch with all places within the search range of a coarse pixel, row by row.
    fn around(&self, [x, y]: [i64; 2], patch: &ZnccPatch, mut row: impl FnMut(&[f32])) {
        let range = self.range as i64;
        let mut scores = vec![OUTSIDE; 2 * self.range + 1];
        for dy in -range..=range {
            self.now.correlate(patch, x - range, y + dy, &mut scores);
            row(&scores);
        }
    }

    /// Finds the window that correlates best with the keyframe's window at `at`, px, within the
    /// search range. Returns its pixel, exact to a coarse pixel, and its zncc; `None` if the
    /// keyframe's window has no contrast or lies at the border.
    pub fn best_match(&self, at: [f64; 2]) -> Option<([f64; 2], f32)> {
        let centre = at.map(|c| (c / self.scale).round() as i64);
        let patch = self.before.patch(centre[0], centre[1])?;
        let (mut most, mut place, mut row) = (OUTSIDE, [0; 2], 0);
        self.around(centre, &patch, |scores| {
            for (column, found) in scores.iter().enumerate() {
                if *found > most {
                    (most, place) = (*found, [column, row]);
                }
            }
            row += 1;
        });
        let moved = place.map(|c| (c as f64 - self.range as f64) * self.scale);
        Some(([0, 1].map(|i| at[i] + moved[i]), most))
    }

    /// Returns the first points with contrast.
    fn voters(&self, matches: &[StereoMatch]) -> Vec<Voter> {
        let reference = self.geometry.reference;
        let textured = matches.iter().filter_map(|matched| {
            let exact = matched.pixels[reference].map(|p| p / self.scale);
            let centre = exact.map(|p| p.round() as i64);
            Some(Voter {
                at: matched.normalised[reference],
                inverse_depth: matched.ray.inverse_depth,
                off: [0, 1].map(|i| exact[i] - centre[i] as f64),
                centre,
                patch: self.before.patch(centre[0], centre[1])?,
            })
        });
        textured.take(MAX_VOTERS).collect()
    }
}

/// Selects the best of all peaks and its rivals.
fn best_and_rivals(mut peaks: Vec<Hypothesis>, px_per_mm: f64) -> Vec<Hypothesis> {
    peaks.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut kept: Vec<Hypothesis> = Vec::new();
    for peak in peaks {
        let apart = |other: &Hypothesis| {
            let [dx, dy] = [0, 1].map(|i| other.displacement_mm[i] - peak.displacement_mm[i]);
            dx.hypot(dy) * px_per_mm > MIN_DISTANCE
        };
        let close = kept
            .first()
            .is_none_or(|best| peak.score > best.score - RIVAL_MARGIN);
        if close && kept.len() < MAX_HYPOTHESES && kept.iter().all(apart) {
            kept.push(peak);
        }
    }
    kept
}
