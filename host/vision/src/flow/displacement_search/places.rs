//! Places around a point that the displacements of a grid predict.

use std::ops::Range;

use super::DisplacementSearch;
use crate::matching::zncc::ZnccPatch;

/// Point that votes.
pub(super) struct Voter {
    /// Normalised position.
    pub(super) at: [f64; 2],
    /// Inverse depth, 1/mm.
    pub(super) inverse_depth: f64,
    /// Offset of the point from the middle of the window, less than a coarse pixel.
    pub(super) off: [f64; 2],
    /// Coarse pixel in the middle of the window.
    pub(super) centre: [i64; 2],
    /// Window of the keyframe around it.
    pub(super) patch: ZnccPatch,
}

/// Places in the map of a voter that the displacements of one layer predict.
pub(super) struct Places {
    /// Columns for the columns of the grid, and rows for its rows.
    pub(super) places: [Vec<u32>; 2],
    /// Columns and rows of the grid whose places are within map and image.
    pub(super) visible: [Range<usize>; 2],
}

/// Grid of displacements along x and y, mm.
#[derive(Clone, Copy)]
pub(super) struct DisplacementGrid {
    /// Number of displacements along each axis.
    pub(super) side: usize,
    /// First displacement.
    pub(super) first: f64,
    /// Distance between two displacements.
    pub(super) step: f64,
}

impl Places {
    /// Predicts the places of one voter for the displacement `tz` along z.
    pub(super) fn of(
        search: &DisplacementSearch<'_>,
        grid: &DisplacementGrid,
        tz: f64,
        voter: &Voter,
    ) -> Self {
        let middle = search.range as f64 + 0.5;
        let map_side = 2 * search.range + 1;
        let focal = search.geometry.focal_px / search.scale;
        let shrink = 1.0 / (1.0 + voter.inverse_depth * tz);
        // x and y are not coupled, so every column of the grid has a column of the map, and every
        // row a row.
        let along = |axis: usize| {
            let (at, off) = (voter.at[axis], voter.off[axis] * (shrink - 1.0));
            // Least and largest place whose window lies within map and image.
            let seen = search.now.window_centres(axis);
            let first = voter.centre[axis] - search.range as i64;
            let least = (seen.start - first).max(0) as f64;
            let end = (seen.end - first).min(map_side as i64) as f64;
            // Places grow or fall with the displacement, so those in view are consecutive.
            let mut visible = 0..0;
            let mut places = Vec::with_capacity(grid.side);
            for i in 0..grid.side {
                let t = grid.first + grid.step * i as f64;
                let moved = focal * ((at + voter.inverse_depth * t) * shrink - at);
                let place = moved + off + middle;
                if place >= least && place < end {
                    let start = if visible.is_empty() { i } else { visible.start };
                    visible = start..i + 1;
                }
                places.push(place as u32);
            }
            (places, visible)
        };
        let ((columns, across), (rows, down)) = (along(0), along(1));
        Self {
            places: [columns, rows],
            visible: [across, down],
        }
    }

    /// Widens the spans, columns per row of the map, by the places of the columns `counted` per
    /// row of the grid.
    pub(super) fn widen(&self, spans: &mut [Range<usize>], counted: &[Range<usize>]) {
        let [columns, rows] = &self.places;
        for y in self.visible[1].clone() {
            let counted = intersection(&counted[y], &self.visible[0]);
            if counted.is_empty() {
                continue;
            }
            let ends = [counted.start, counted.end - 1].map(|x| columns[x] as usize);
            let span = ends[0].min(ends[1])..ends[0].max(ends[1]) + 1;
            let row = &mut spans[rows[y] as usize];
            *row = union(row, &span);
        }
    }
}

/// Returns the places that both ranges contain.
pub(super) fn intersection(a: &Range<usize>, b: &Range<usize>) -> Range<usize> {
    a.start.max(b.start)..a.end.min(b.end)
}

/// Returns the smallest range that contains both.
pub(super) fn union(a: &Range<usize>, b: &Range<usize>) -> Range<usize> {
    match (a.is_empty(), b.is_empty()) {
        (true, _) => b.clone(),
        (_, true) => a.clone(),
        _ => a.start.min(b.start)..a.end.max(b.end),
    }
}
