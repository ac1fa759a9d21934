//! Votes for the displacements with one change of depth.

use std::ops::Range;
use std::sync::Arc;

use pulp::NullaryFnOnce;

use super::DisplacementSearch;
use super::places::{DisplacementGrid, Places, Voter, intersection, union};
use crate::matching::zncc::OUTSIDE;

/// Number of votes in the upper bits, sum of their correlations below: both add up in one integer,
/// because there are at most [`super::MAX_VOTERS`].
const ONE_VOTE: u32 = 1 << 20;
/// Vote for a place outside the image.
pub(super) const NO_VOTE: u32 = 0;
/// Fixed-point form of a correlation of 1.
const ONE_ZNCC: f32 = 4096.0;
/// Largest correlation, with far more than what rounding adds.
const MOST_ZNCC: f32 = 1.05;

/// Votes for the displacements with one change of depth.
#[derive(Clone)]
pub(super) struct Layer {
    /// Displacement along z, mm.
    pub(super) tz: f64,
    /// Sums of votes, row by row.
    pub(super) sums: Vec<u32>,
    /// Columns per row in which a hypothesis may be. None is at the border of the grid.
    pub(super) core: Vec<Range<usize>>,
    /// Columns per row in which votes are counted: the core and its neighbours.
    pub(super) counted: Vec<Range<usize>>,
    /// Places that the layer predicts, per voter.
    pub(super) places: Arc<Vec<Places>>,
    /// Number of voters that see each displacement, row by row.
    pub(super) visible: Arc<Vec<u32>>,
}

/// Conversion of correlations to votes.
pub(super) struct Votes<'a>(pub(super) &'a [f32], pub(super) &'a mut [u32]);

impl NullaryFnOnce for Votes<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (zncc, out) in self.0.iter().zip(self.1) {
            *out = vote(*zncc);
        }
    }
}

/// Converts a correlation to a vote.
#[inline(always)]
fn vote(zncc: f32) -> u32 {
    let vote = ONE_VOTE.wrapping_add((ONE_ZNCC * zncc.max(0.0) + 0.5) as u32);
    if zncc > OUTSIDE { vote } else { NO_VOTE }
}

/// Computes the mean correlation of the votes; [`OUTSIDE`] if half of the `voters` see nothing.
pub(super) fn score(sum: u32, voters: usize) -> f32 {
    let (seen, total) = (sum / ONE_VOTE, sum % ONE_VOTE);
    if 2 * (seen as usize) < voters {
        OUTSIDE
    } else {
        total as f32 / (seen as f32 * ONE_ZNCC)
    }
}

/// Computes the largest score that a sum may reach when `visible` voters see the displacement.
pub(super) fn largest_score(sum: u32, visible: u32) -> f32 {
    let (seen, total) = (sum / ONE_VOTE, sum % ONE_VOTE);
    let more = visible - seen.min(visible);
    let most = total as f32 + more as f32 * MOST_ZNCC * ONE_ZNCC;
    most / ((seen + more) as f32 * ONE_ZNCC)
}

/// Counts the voters that see each displacement, row by row, in rows of `side + 1` numbers.
fn visible_voters(places: &[Places], side: usize) -> Vec<u32> {
    let stride = side + 1;
    let mut counts = vec![0_u32; stride * stride];
    // Changes at the corners of what each voter sees, which sums along x and y turn into counts.
    for Places { visible, .. } in places {
        let [columns, rows] = visible;
        for (row, change) in [(rows.start, 1), (rows.end, u32::MAX)] {
            let row = &mut counts[row * stride..][..stride];
            row[columns.start] = row[columns.start].wrapping_add(change);
            row[columns.end] = row[columns.end].wrapping_sub(change);
        }
    }
    for row in counts.chunks_exact_mut(stride) {
        for x in 1..stride {
            row[x] = row[x].wrapping_add(row[x - 1]);
        }
    }
    for index in stride..counts.len() {
        counts[index] = counts[index].wrapping_add(counts[index - stride]);
    }
    counts
}

impl Layer {
    /// Creates a layer without votes.
    pub(super) fn new(
        search: &DisplacementSearch<'_>,
        grid: &DisplacementGrid,
        tz: f64,
        voters: &[Voter],
    ) -> Self {
        let side = grid.side;
        let mut core = vec![1..side.saturating_sub(1); side];
        core[0] = 0..0;
        core[side - 1] = 0..0;
        let places = voters
            .iter()
            .map(|voter| Places::of(search, grid, tz, voter));
        let places: Vec<Places> = places.collect();
        let visible = visible_voters(&places, side);
        Self {
            tz,
            sums: vec![NO_VOTE; side * side],
            core,
            counted: vec![0..side; side],
            places: Arc::new(places),
            visible: Arc::new(visible),
        }
    }

    /// Restricts the core, and counts votes only there and in its neighbourhood.
    pub(super) fn restrict(&mut self, core: Vec<Range<usize>>) {
        let rows = core.len();
        self.counted = (0..rows)
            .map(|y| {
                let near = &core[y.saturating_sub(1)..(y + 2).min(rows)];
                let near = near.iter().fold(0..0, |all, row| union(&all, row));
                if near.is_empty() {
                    near
                } else {
                    near.start - 1..near.end + 1
                }
            })
            .collect();
        self.core = core;
    }

    /// Adds the votes of one point.
    pub(super) fn add(&mut self, voter: usize, map: &[u32], map_side: usize) {
        let side = self.counted.len();
        let Places {
            places: [columns, rows],
            visible,
        } = &self.places[voter];
        for y in visible[1].clone() {
            let counted = intersection(&self.counted[y], &visible[0]);
            if counted.is_empty() {
                continue;
            }
            let row = &map[rows[y] as usize * map_side..][..map_side];
            let sums = &mut self.sums[y * side..][counted.clone()];
            for (sum, column) in sums.iter_mut().zip(&columns[counted]) {
                *sum = sum.wrapping_add(row[*column as usize]);
            }
        }
    }

    /// Returns the local maxima of the core. All votes must be counted there.
    pub(super) fn peaks(&self, voters: usize) -> Vec<Peak> {
        let side = self.core.len();
        let score = |index: usize| score(self.sums[index], voters);
        let mut found = Vec::new();
        for (y, columns) in self.core.iter().enumerate() {
            for x in columns.clone() {
                let index = y * side + x;
                let here = score(index);
                let higher = [index - side, index, index + side]
                    .iter()
                    .flat_map(|row| row - 1..=row + 1)
                    .any(|other| score(other) > here);
                if here > OUTSIDE && !higher {
                    found.push(Peak {
                        at: [x, y],
                        score: here,
                        along: [1, side]
                            .map(|offset| [score(index - offset), score(index + offset)]),
                    });
                }
            }
        }
        found
    }
}

/// Local maximum of the scores of a layer.
pub(super) struct Peak {
    /// Column and row.
    pub(super) at: [usize; 2],
    pub(super) score: f32,
    /// Scores before and after the peak, along x and along y.
    pub(super) along: [[f32; 2]; 2],
}
