//! Which displacement, roughly, explains what all points did: found without any idea of it.
//!
//! Since every point's depth is known from the spatial match, one displacement predicts the motion
//! of all points:
//!
//! ```text
//! ξ' = (ξ + ρ Tx) / (1 + ρ Tz)        (ξ normalised position, ρ inverse depth; y alike)
//! ```
//!
//! So displacements are tried, not pixels: at a coarse level each voter's window is compared with
//! all places around it, and a displacement's score is the mean likeness at the places it predicts.
//! Displacements that score nearly as well as the best are handed on too: whether the texture
//! repeats is decided at a finer level.

use crate::matching::geometry::Geometry;
use crate::matching::stereo::Match;
use crate::matching::zncc::{Field, OUTSIDE, Probe};
use crate::thread_pool::Workers;

/// How many points vote, at most.
const VOTERS: usize = 60;
/// Displacements within this of the best score are rivals.
const RIVAL: f32 = 0.3;
/// How many rivals are looked at.
const MOST_RIVALS: usize = 4;
/// Two peaks nearer than this, coarse px, are one.
const APART: f64 = 2.5;
/// Magnifications that are tried: from 12 % away to 12 % nearer, in steps small enough for a coarse
/// pixel.
const DEPTH_CHANGES: [f64; 5] = [0.0, -0.06, 0.06, -0.12, 0.12];

/// A displacement that explains the coarse images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guess {
    /// mm.
    pub displacement_mm: [f64; 3],
    /// Mean likeness of the voters.
    pub score: f32,
}

/// The places around one point.
struct Voter {
    at: [f64; 2],
    inverse_depth: f64,
    /// [`vote`]s at offsets from `-reach` to `reach`, row by row, each followed by one [`NO_VOTE`].
    map: Vec<u32>,
    /// Part of a pixel between the point and the middle of the map.
    off: [f64; 2],
}

/// Votes and their sums in one number: how many in the upper bits, their likenesses below. There
/// are at most [`VOTERS`].
const ONE_VOTE: u32 = 1 << 20;
/// Of a place that is not in the image.
const NO_VOTE: u32 = 0;
/// A likeness of 1.
const FULL: f32 = 4096.0;

/// What a voter says of a place.
fn vote(likeness: f32) -> u32 {
    if likeness > OUTSIDE {
        ONE_VOTE + (FULL * likeness.max(0.0) + 0.5) as u32
    } else {
        NO_VOTE
    }
}

/// Displacements along x and y that are tried, mm.
struct Grid {
    side: usize,
    first: f64,
    step: f64,
}

/// The coarse level at two instants.
#[derive(Debug)]
pub struct Search<'a> {
    /// The rig.
    pub geometry: &'a Geometry,
    /// The reference camera's image at the reference instant.
    pub before: &'a Field,
    /// The same now.
    pub now: &'a Field,
    /// Image pixels per coarse pixel.
    pub scale: f64,
    /// How far points may move, coarse px.
    pub reach: usize,
    /// Who does it.
    pub workers: &'a Workers,
}

impl Search<'_> {
    /// The best displacements, the best first; empty if too few points are in view.
    pub fn guesses(&self, matches: &[Match]) -> Vec<Guess> {
        let voters = self.voters(matches);
        if voters.len() < 6 {
            return Vec::new();
        }
        let mut depths: Vec<f64> = voters.iter().map(|v| v.inverse_depth).collect();
        depths.sort_by(f64::total_cmp);
        let median = depths[depths.len() / 2];
        let near = depths[depths.len() * 9 / 10];
        let focal = self.geometry.focal_px / self.scale;
        // So fine that near points move by one coarse pixel per step.
        let step = (median / near).clamp(0.4, 1.0);
        let count = (self.reach as f64 / step) as i64;
        let side = (2 * count + 1) as usize;
        let per_px = 1.0 / (focal * median);
        let peaks = |change: f64| {
            let tz = change / median;
            let mut peaks: Vec<Guess> = Vec::new();
            let grid = Grid {
                side,
                first: -(count as f64) * step * per_px,
                step: step * per_px,
            };
            let plane = self.scores(&voters, &grid, tz, focal);
            for index in local_peaks(&plane, side) {
                let (x, y) = (index % side, index / side);
                let along = |offset: usize| {
                    let [before, after] = [index - offset, index + offset].map(|n| plane[n]);
                    let shift = 0.5 * (before - after) / (before - 2.0 * plane[index] + after);
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
                peaks.push(Guess {
                    displacement_mm: [px[0] * step * per_px, px[1] * step * per_px, tz],
                    score: plane[index],
                });
            }
            peaks
        };
        let peaks = self.workers.map(DEPTH_CHANGES.to_vec(), peaks).concat();
        self.rivals(peaks, focal * median)
    }

    /// Likenesses of a probe within reach of a coarse pixel, row by row.
    fn around(&self, [x, y]: [i64; 2], probe: &Probe, mut row: impl FnMut(&[f32])) {
        let reach = self.reach as i64;
        let mut likeness = vec![OUTSIDE; 2 * self.reach + 1];
        for dy in -reach..=reach {
            self.now.compare(probe, x - reach, y + dy, &mut likeness);
            row(&likeness);
        }
    }

    /// Where within reach is what is most like that which the reference camera saw at `at`, px, to
    /// a coarse pixel, and how like it is. `None` if that had no contrast, or lay at the border.
    pub fn likest(&self, at: [f64; 2]) -> Option<([f64; 2], f32)> {
        let centre = at.map(|c| (c / self.scale).round() as i64);
        let probe = self.before.probe(centre[0], centre[1])?;
        let (mut most, mut place, mut row) = (OUTSIDE, [0; 2], 0);
        self.around(centre, &probe, |likeness| {
            for (column, found) in likeness.iter().enumerate() {
                if *found > most {
                    (most, place) = (*found, [column, row]);
                }
            }
            row += 1;
        });
        let moved = place.map(|c| (c as f64 - self.reach as f64) * self.scale);
        Some(([0, 1].map(|i| at[i] + moved[i]), most))
    }

    fn voters(&self, matches: &[Match]) -> Vec<Voter> {
        let reference = self.geometry.reference;
        let side = 2 * self.reach + 1;
        let probed = matches.iter().filter_map(|matched| {
            let exact = matched.pixels[reference].map(|p| p / self.scale);
            let centre = exact.map(|p| p.round() as i64);
            let probe = self.before.probe(centre[0], centre[1])?;
            Some((matched, exact, centre, probe))
        });
        let voter = |(matched, exact, centre, probe): (&Match, [f64; 2], [i64; 2], Probe)| {
            let mut map = Vec::with_capacity(side * (side + 1));
            self.around(centre, &probe, |likeness| {
                map.extend(likeness.iter().map(|l| vote(*l)));
                map.push(NO_VOTE);
            });
            Voter {
                at: matched.views[reference],
                inverse_depth: matched.ray.inverse_depth,
                map,
                off: [0, 1].map(|i| exact[i] - centre[i] as f64),
            }
        };
        self.workers.map(probed.take(VOTERS).collect(), voter)
    }

    /// Mean likeness of the voters where each displacement of the grid puts them, row by row;
    /// [`OUTSIDE`] if that is out of view for half of them.
    fn scores(&self, voters: &[Voter], grid: &Grid, tz: f64, focal: f64) -> Vec<f32> {
        let side = 2 * self.reach + 1;
        let middle = self.reach as f64 + 0.5;
        let mut sums = vec![NO_VOTE; grid.side * grid.side];
        for voter in voters {
            let shrink = 1.0 / (1.0 + voter.inverse_depth * tz);
            // Since x and y do not mix, a column and a row of the map for every column and row of
            // the grid.
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
            let (seen, likeness) = (sum / ONE_VOTE, sum % ONE_VOTE);
            if 2 * (seen as usize) < voters.len() {
                OUTSIDE
            } else {
                likeness as f32 / (seen as f32 * FULL)
            }
        };
        sums.iter().map(score).collect()
    }

    /// The best of all peaks and its rivals.
    fn rivals(&self, mut peaks: Vec<Guess>, px_per_mm: f64) -> Vec<Guess> {
        peaks.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut kept: Vec<Guess> = Vec::new();
        for peak in peaks {
            let apart = |other: &Guess| {
                let [dx, dy] = [0, 1].map(|i| other.displacement_mm[i] - peak.displacement_mm[i]);
                dx.hypot(dy) * px_per_mm > APART
            };
            let close = kept
                .first()
                .is_none_or(|best| peak.score > best.score - RIVAL);
            if close && kept.len() < MOST_RIVALS && kept.iter().all(apart) {
                kept.push(peak);
            }
        }
        kept
    }
}

/// Indices of values that no neighbour exceeds, away from the border of a square raster.
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
