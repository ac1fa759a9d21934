//! Votes of all points for the displacements of a grid, counted only where the best may be.
//!
//! Correlations are at most 1, so the votes counted so far bound every score from above. A
//! displacement whose bound is below the least score of a rival cannot become a hypothesis, and the
//! voters that are left are not correlated there. The scores of all others are complete: the
//! hypotheses have the bits that a count of all votes everywhere would give.

use std::ops::Range;

use pulp::Arch;

use super::layer::{Layer, NO_VOTE, Peak, Votes, largest_score, score};
use super::places::{DisplacementGrid, Voter};
use super::{DisplacementSearch, RIVAL_MARGIN};
use crate::matching::zncc::OUTSIDE;

/// Largest distance of the local maximum of all votes from that of the first, steps of the grid.
const REACH: usize = 1;

/// Votes for all displacements.
#[derive(Clone)]
pub(super) struct Tally<'a> {
    search: &'a DisplacementSearch<'a>,
    voters: &'a [Voter],
    side: usize,
    layers: Vec<Layer>,
    /// Number of voters whose votes are counted.
    counted: usize,
}

impl<'a> Tally<'a> {
    /// Creates a tally without votes, with a layer for each displacement along z.
    pub(super) fn new(
        search: &'a DisplacementSearch<'a>,
        grid: DisplacementGrid,
        tz: impl IntoIterator<Item = f64>,
        voters: &'a [Voter],
    ) -> Self {
        let layer = |tz| Layer::new(search, &grid, tz, voters);
        Self {
            search,
            voters,
            side: grid.side,
            layers: search.thread_pool.map(tz.into_iter().collect(), layer),
            counted: 0,
        }
    }

    /// Returns the number of voters that are not counted yet.
    pub(super) fn rest(&self) -> usize {
        self.voters.len() - self.counted
    }

    /// Returns the local maxima that may become hypotheses, with their displacement along z.
    pub(super) fn peaks(&self) -> Vec<(f64, Peak)> {
        let peaks = |layer: &Layer| {
            let (tz, peaks) = (layer.tz, layer.peaks(self.counted));
            peaks.into_iter().map(move |peak| (tz, peak))
        };
        self.layers.iter().flat_map(peaks).collect()
    }

    /// Counts the votes of the next points.
    pub(super) fn add(&mut self, count: usize) {
        let thread_pool = self.search.thread_pool;
        let next = self.counted..(self.counted + count).min(self.voters.len());
        let map = |voter| (voter, self.map(voter));
        let maps = thread_pool.map(next.clone().collect(), map);
        let map_side = 2 * self.search.range + 1;
        let add = |layer: &mut Layer| {
            for (voter, map) in &maps {
                layer.add(*voter, map, map_side);
            }
        };
        thread_pool.map(self.layers.iter_mut().collect(), add);
        self.counted = next.end;
    }

    /// Correlates a point's window with all places that have a displacement whose votes are
    /// counted. Returns the votes at offsets from `-range` to `range`, row by row.
    fn map(&self, voter: usize) -> Vec<u32> {
        let range = self.search.range;
        let map_side = 2 * range + 1;
        // Columns of each row of the map at which the window is correlated.
        let mut spans = vec![0..0; map_side];
        for layer in &self.layers {
            layer.places[voter].widen(&mut spans, &layer.counted);
        }
        let Voter { centre, patch, .. } = &self.voters[voter];
        let mut map = vec![NO_VOTE; map_side * map_side];
        let mut scores = vec![OUTSIDE; map_side];
        let [left, top] = centre.map(|c| c - range as i64);
        for (y, span) in spans.into_iter().enumerate() {
            if span.is_empty() {
                continue;
            }
            let scores = &mut scores[..span.len()];
            let x = left + span.start as i64;
            (self.search.now).correlate(patch, x, top + y as i64, scores);
            Arch::new().dispatch(Votes(scores, &mut map[y * map_side..][span]));
        }
        map
    }

    /// Returns the complete score of a local maximum. It is near the displacement that scores best
    /// so far, so it is likely to be the best. Returns `None` if there is no maximum nearby.
    pub(super) fn likely_score(&self) -> Option<f32> {
        let side = self.side;
        let mut best = (OUTSIDE, 0, [0; 2]);
        for (index, layer) in self.layers.iter().enumerate() {
            for (y, columns) in layer.core.iter().enumerate() {
                for x in columns.clone() {
                    let score = score(layer.sums[y * side + x], self.counted);
                    if score > best.0 {
                        best = (score, index, [x, y]);
                    }
                }
            }
        }
        let (_, index, [x, y]) = best;
        let mut window = self.layers.get(index).filter(|_| best.0 > OUTSIDE)?.clone();
        let near = |at: usize| at.saturating_sub(REACH).max(1)..(at + REACH + 1).min(side - 1);
        let rows = near(y);
        let core = |row: usize| if rows.contains(&row) { near(x) } else { 0..0 };
        window.restrict((0..side).map(core).collect());
        let mut window = Self {
            layers: vec![window],
            ..*self
        };
        window.add(window.rest());
        let scores = window.peaks().into_iter().map(|(_, peak)| peak.score);
        scores.max_by(f32::total_cmp)
    }

    /// Stops counting votes for displacements that cannot become hypotheses, given the score of one
    /// local maximum.
    pub(super) fn restrict(&mut self, likely_score: f32) {
        let least = likely_score - RIVAL_MARGIN;
        let side = self.side;
        for layer in &mut self.layers {
            let narrowed = |(y, columns): (usize, &Range<usize>)| {
                let sums = &layer.sums[y * side..][..side];
                let visible = &layer.visible[y * (side + 1)..][..side];
                let may_win = |x: &usize| largest_score(sums[*x], visible[*x]) >= least;
                let first = columns.clone().find(may_win);
                let last = columns.clone().rev().find(may_win);
                first
                    .zip(last)
                    .map_or(0..0, |(first, last)| first..last + 1)
            };
            let core = layer.core.iter().enumerate().map(narrowed).collect();
            layer.restrict(core);
        }
    }
}

#[cfg(test)]
mod tests;
