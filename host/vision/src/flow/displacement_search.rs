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
//! repeats.

use crate::matching::geometry::RigGeometry;
use crate::matching::stereo::StereoMatch;
use crate::matching::zncc::{OUTSIDE, ZnccPatch, ZnccPlane};
use crate::thread_pool::ThreadPool;

/// Largest number of points that vote.
const MAX_VOTERS: usize = 60;
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

/// Correlations around one point.
struct Voter {
    at: [f64; 2],
    inverse_depth: f64,
    /// [`vote`]s at offsets from `-range` to `range`, row by row. Each row ends with one
    /// [`NO_VOTE`].
    map: Vec<u32>,
    /// Offset of the point from the middle of the map, less than a pixel.
    off: [f64; 2],
}

/// Number of votes in the upper bits, sum of their correlations below: both add up in one integer,
/// because there are at most [`MAX_VOTERS`].
const ONE_VOTE: u32 = 1 << 20;
/// Vote for a place outside the image.
const NO_VOTE: u32 = 0;
/// Fixed-point form of a correlation of 1.
const ONE_ZNCC: f32 = 4096.0;

/// Converts a correlation to a vote.
fn vote(zncc: f32) -> u32 {
    if zncc > OUTSIDE {
        ONE_VOTE + (ONE_ZNCC * zncc.max(0.0) + 0.5) as u32
    } else {
        NO_VOTE
    }
}

/// Grid of displacements along x and y, mm.
struct DisplacementGrid {
    side: usize,
    first: f64,
    step: f64,
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
        let side = (2 * count + 1) as usize;
        let per_px = 1.0 / (focal * median);
        let peaks = |change: f64| {
            let tz = change / median;
            let mut peaks: Vec<Hypothesis> = Vec::new();
            let grid = DisplacementGrid {
                side,
                first: -(count as f64) * step * per_px,
                step: step * per_px,
            };
            let scores = self.scores(&voters, &grid, tz, focal);
            for index in local_peaks(&scores, side) {
                // Sub-step position of the peak: vertex of a parabola along each axis.
                let (x, y) = (index % side, index / side);
                let along = |offset: usize| {
                    let [before, after] = [index - offset, index + offset].map(|n| scores[n]);
                    let shift = 0.5 * (before - after) / (before - 2.0 * scores[index] + after);
                    if shift.is_finite() {
                        f64::from(shift.clamp(-0.5, 0.5))
                    } else {
                        0.0
                    }
                };
                let px = [
                    x as f64 - count as f64 + along(1),
                    y as f64 - count as f64 + along(side),
                ];
                peaks.push(Hypothesis {
                    displacement_mm: [px[0] * step * per_px, px[1] * step * per_px, tz],
                    score: scores[index],
                });
            }
            peaks
        };
        let peaks = self.thread_pool.map(DEPTH_CHANGES.to_vec(), peaks).concat();
        self.best_and_rivals(peaks, focal * median)
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

    /// Computes correlation maps of the first points with contrast.
    fn voters(&self, matches: &[StereoMatch]) -> Vec<Voter> {
        let reference = self.geometry.reference;
        let side = 2 * self.range + 1;
        let textured = matches.iter().filter_map(|matched| {
            let exact = matched.pixels[reference].map(|p| p / self.scale);
            let centre = exact.map(|p| p.round() as i64);
            let patch = self.before.patch(centre[0], centre[1])?;
            Some((matched, exact, centre, patch))
        });
        type Job<'a> = (&'a StereoMatch, [f64; 2], [i64; 2], ZnccPatch);
        let voter = |(matched, exact, centre, patch): Job<'_>| {
            let mut map = Vec::with_capacity(side * (side + 1));
            self.around(centre, &patch, |scores| {
                map.extend(scores.iter().map(|zncc| vote(*zncc)));
                map.push(NO_VOTE);
            });
            Voter {
                at: matched.normalised[reference],
                inverse_depth: matched.ray.inverse_depth,
                map,
                off: [0, 1].map(|i| exact[i] - centre[i] as f64),
            }
        };
        self.thread_pool
            .map(textured.take(MAX_VOTERS).collect(), voter)
    }

    /// Computes the mean zncc of the voters at the places that each displacement of the grid
    /// predicts, row by row; [`OUTSIDE`] if half of the places are out of view.
    fn scores(&self, voters: &[Voter], grid: &DisplacementGrid, tz: f64, focal: f64) -> Vec<f32> {
        let side = 2 * self.range + 1;
        let middle = self.range as f64 + 0.5;
        let mut sums = vec![NO_VOTE; grid.side * grid.side];
        for voter in voters {
            let shrink = 1.0 / (1.0 + voter.inverse_depth * tz);
            // x and y are not coupled, so every column of the grid has a column of the map, and
            // every row a row.
            let places = |axis: usize| {
                let (at, off) = (voter.at[axis], voter.off[axis] * (shrink - 1.0));
                (0..grid.side).map(move |i| {
                    let t = grid.first + grid.step * i as f64;
                    let moved = focal * ((at + voter.inverse_depth * t) * shrink - at);
                    let place = moved + off + middle;
                    (place >= 0.0 && place < side as f64).then_some(place as usize)
                })
            };
            let columns: Vec<usize> = places(0).map(|x| x.unwrap_or(side)).collect();
            for (y, sums) in places(1).zip(sums.chunks_exact_mut(grid.side)) {
                let Some(y) = y else { continue };
                let row = &voter.map[y * (side + 1)..][..=side];
                for (sum, column) in sums.iter_mut().zip(&columns) {
                    *sum = sum.wrapping_add(row[*column]);
                }
            }
        }
        let score = |sum: &u32| {
            let (seen, total) = (sum / ONE_VOTE, sum % ONE_VOTE);
            if 2 * (seen as usize) < voters.len() {
                OUTSIDE
            } else {
                total as f32 / (seen as f32 * ONE_ZNCC)
            }
        };
        sums.iter().map(score).collect()
    }

    /// Selects the best of all peaks and its rivals.
    fn best_and_rivals(&self, mut peaks: Vec<Hypothesis>, px_per_mm: f64) -> Vec<Hypothesis> {
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
}

/// Returns the indices of local maxima of a square raster, away from its border.
fn local_peaks(plane: &[f32], side: usize) -> Vec<usize> {
    let mut found = Vec::new();
    for y in 1..side.saturating_sub(1) {
        for x in 1..side - 1 {
            let here = plane[y * side + x];
            let higher = (y - 1..=y + 1)
                .flat_map(|row| &plane[row * side + x - 1..=row * side + x + 1])
                .any(|other| *other > here);
            if here > OUTSIDE && !higher {
                found.push(y * side + x);
            }
        }
    }
    found
}
