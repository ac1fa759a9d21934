//! How much of what the reference camera sees moves as a measurement says.
//!
//! Points are where texture is. What covers a part of a plain target may have most of them, and so
//! may what is seen beside it; then the points that agree are not the target's. So the picture is
//! asked, divided into *cells*:
//!
//! * a cell in which a point agrees, or any other corner is found within a pixel of where the
//!   measurement puts it, moves *alike*;
//! * a cell whose best corner is found elsewhere, wherever that may be, and not where the
//!   measurement puts it, moves *otherwise*;
//! * all others are plain, hidden now or gone from view, and nobody can tell.
//!
//! If hardly any cells move otherwise, the measurement is the target's, however small it is. Else
//! the target must be most of the picture, plain cells included: nobody knows what they are a part
//! of.

use std::collections::BTreeMap;

use super::consensus::Sighting;
use super::displacement_search::Search;
use super::keyframe::Reference;
use super::measurement::{Measurement, Track};
use super::refusal::Refusal;
use super::temporal::Follow;
use crate::matching::lucas_kanade::Large;
use crate::matching::stereo::Match;

/// Cells along the longer side of the image.
const CELLS: f64 = 16.0;
/// The level at which corners are looked for where they should be.
const LEVEL: usize = 1;
/// The least likeness of a corner that is found there.
const LIKE: f32 = 0.75;
/// How far from there it may be, px.
const OFF_PX: f64 = 1.0;
/// The least likeness in the coarse image of a place where a corner may be instead.
const ELSEWHERE: f32 = 0.7;
/// The depths that a corner without a match may have, as multiples of its neighbour's, the farthest
/// first.
const DEPTHS: [f64; 2] = [1.2, 0.85];
/// The share of the picture that is most of it. A little more than half: cells are counted whole of
/// which only a part moves alike.
const MOST: f64 = 0.55;
/// One cell that moves otherwise to so many that move alike is no doubt yet.
const FEW: usize = 8;

/// Cells by how they move.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Extent {
    /// As measured.
    pub(super) alike: usize,
    /// Otherwise; 0 if it does not matter.
    pub(super) otherwise: usize,
    /// In view.
    pub(super) all: usize,
}

impl Extent {
    /// Of the reference camera's image, in which `search` looked.
    pub(super) fn of(
        reference: &Reference<'_>,
        follow: &Follow<'_>,
        search: &Search<'_>,
        measurement: &Measurement,
    ) -> Self {
        let own = follow.geometry.reference;
        let look = Look {
            follow,
            search,
            measurement,
        };
        let cells = Cells::of(follow.geometry.rig.image_size_px);
        let cell_of = |track: &Track| cells.of_place(track.pixels[own][0]);
        let mut alike: Vec<usize> = measurement.tracks.iter().map(cell_of).collect();
        alike.sort_unstable();
        alike.dedup();
        let mut extent = Self {
            alike: alike.len(),
            otherwise: 0,
            all: cells.count(),
        };
        // Whatever else there is, and what has left the view.
        if extent.is_most() {
            return extent;
        }
        // The best corner of each other cell, one of known depth if there is any.
        let mut others: BTreeMap<usize, Corner> = BTreeMap::new();
        let is_other = |cell: &usize| alike.binary_search(cell).is_err();
        for matched in reference.matches {
            let cell = cells.of_place(matched.pixels[own]);
            if is_other(&cell) {
                let corner = Corner::matched(matched, own);
                others.entry(cell).or_insert(corner);
            }
        }
        for at in reference.unmatched {
            let cell = cells.of_place(*at);
            if is_other(&cell) {
                others.entry(cell).or_insert_with(|| look.unmatched(*at));
            }
        }
        let others: Vec<Corner> = others.into_values().collect();
        let are_there = (follow.workers).map(others.clone(), |corner| look.is_there(corner));
        extent.alike += are_there.iter().filter(|is| **is).count();
        extent.all = cells.centres().filter(|at| look.stays_in_view(*at)).count();
        if extent.is_most() {
            return extent;
        }
        let doubtful = others.into_iter().zip(are_there);
        let doubtful = doubtful.filter_map(|(corner, is_there)| (!is_there).then_some(corner));
        let are_elsewhere =
            (follow.workers).map(doubtful.collect(), |corner| look.is_elsewhere(corner));
        extent.otherwise = are_elsewhere.into_iter().filter(|is| *is).count();
        extent
    }

    fn is_most(self) -> bool {
        self.alike as f64 >= MOST * self.all as f64
    }

    /// # Errors
    /// [`Refusal::Minority`] if something else moves, and what was measured is not most of the
    /// picture.
    pub(super) fn judge(self) -> Result<(), Refusal> {
        let Self {
            alike,
            otherwise,
            all,
        } = self;
        match self.is_most() || FEW * otherwise <= alike {
            true => Ok(()),
            false => Err(Refusal::Minority {
                alike,
                otherwise,
                all,
            }),
        }
    }
}

/// The part of the image in which corners may be, divided.
struct Cells {
    side_px: f64,
    columns: usize,
    rows: usize,
}

impl Cells {
    const MARGIN_PX: f64 = (Large::MARGIN + 1) as f64;

    fn of(image_size_px: [u32; 2]) -> Self {
        let [width, height] = image_size_px.map(f64::from);
        let side_px = width.max(height) / CELLS;
        let count = |side: f64| ((side - 2.0 * Self::MARGIN_PX) / side_px).max(1.0) as usize;
        Self {
            side_px,
            columns: count(width),
            rows: count(height),
        }
    }

    /// What is left over at the right and at the bottom belongs to the last ones.
    fn of_place(&self, [x, y]: [f64; 2]) -> usize {
        let place = |c: f64| ((c - Self::MARGIN_PX) / self.side_px).max(0.0) as usize;
        place(y).min(self.rows - 1) * self.columns + place(x).min(self.columns - 1)
    }

    fn count(&self) -> usize {
        self.columns * self.rows
    }

    fn centres(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        let place = |i: usize| Self::MARGIN_PX + (i as f64 + 0.5) * self.side_px;
        (0..self.rows).flat_map(move |y| (0..self.columns).map(move |x| [x, y].map(place)))
    }
}

/// Of the reference image.
#[derive(Clone, Copy, Debug)]
struct Corner {
    /// px.
    at: [f64; 2],
    /// The inverse depths that it may have, 1/mm, the farthest first.
    inverse_depths: [f64; 2],
}

impl Corner {
    fn matched(matched: &Match, camera: usize) -> Self {
        Self {
            at: matched.pixels[camera],
            inverse_depths: [matched.ray.inverse_depth; 2],
        }
    }
}

/// Where corners have gone.
struct Look<'a> {
    follow: &'a Follow<'a>,
    search: &'a Search<'a>,
    measurement: &'a Measurement,
}

impl Look<'_> {
    /// A corner that may be as far away as the point that agrees nearest to it in the image, or
    /// somewhat nearer or farther.
    fn unmatched(&self, at: [f64; 2]) -> Corner {
        let depth = self.inverse_depth_near(at);
        Corner {
            at,
            inverse_depths: DEPTHS.map(|times| depth / times),
        }
    }

    /// Inverse depth of the point that agrees nearest to a place in the image.
    fn inverse_depth_near(&self, at: [f64; 2]) -> f64 {
        let geometry = self.follow.geometry;
        let far = |track: &Track| {
            let [x, y] = track.pixels[geometry.reference][0];
            (x - at[0]).powi(2) + (y - at[1]).powi(2)
        };
        let seen = self.measurement.tracks.iter().zip(&self.measurement.views);
        let nearest = seen.min_by(|(a, _), (b, _)| far(a).total_cmp(&far(b)));
        nearest.map_or(0.0, |(_, views)| {
            let starts: Vec<[f64; 2]> = views.iter().map(|view| view.start).collect();
            geometry.fit(&starts).inverse_depth
        })
    }

    /// Where the measurement puts what is seen at `at`, px.
    fn expected(&self, at: [f64; 2], inverse_depth: f64) -> [f64; 2] {
        let geometry = self.follow.geometry;
        let own = geometry.reference;
        let from = geometry.normalise(own, at);
        let to = Sighting::predicted(from, inverse_depth, self.measurement.displacement_mm);
        geometry.pixel(own, to)
    }

    fn stays_in_view(&self, at: [f64; 2]) -> bool {
        let now = &self.follow.now[self.follow.geometry.reference].levels[0];
        let place = self.expected(at, self.inverse_depth_near(at));
        Large::fits(now, place.map(|c| c as f32))
    }

    /// Distance of a place from where the measurement puts the corner, px.
    fn off_px(&self, corner: Corner, place: [f64; 2]) -> f64 {
        let [far, near] = corner
            .inverse_depths
            .map(|depth| self.expected(corner.at, depth));
        let way = [near[0] - far[0], near[1] - far[1]];
        let to = [place[0] - far[0], place[1] - far[1]];
        let square = way[0] * way[0] + way[1] * way[1];
        let share = ((to[0] * way[0] + to[1] * way[1]) / square.max(1e-9)).clamp(0.0, 1.0);
        (to[0] - share * way[0]).hypot(to[1] - share * way[1])
    }

    /// Whether a corner has gone where the measurement puts it.
    fn is_there(&self, corner: Corner) -> bool {
        let [far, near] = corner.inverse_depths;
        let start = self.expected(corner.at, 0.5 * (far + near));
        let found = self.find(corner, start);
        found.is_some_and(|place| self.off_px(corner, place) <= OFF_PX)
    }

    /// Whether a corner that is not there is found anywhere else.
    fn is_elsewhere(&self, corner: Corner) -> bool {
        let likest = self.search.likest(corner.at);
        let start = likest.filter(|(_, likeness)| *likeness > ELSEWHERE);
        let found = start.and_then(|(start, _)| self.find(corner, start));
        found.is_some_and(|place| self.off_px(corner, place) > OFF_PX)
    }

    /// A corner's place, px, looked for from `start` on; `None` if nothing there is like it.
    fn find(&self, corner: Corner, start: [f64; 2]) -> Option<[f64; 2]> {
        let [far, near] = corner.inverse_depths;
        let (depth, moved) = (0.5 * (far + near), self.measurement.displacement_mm);
        let (place, likeness) = self.follow.corner(LEVEL, corner.at, start, depth, moved)?;
        (likeness >= LIKE).then_some(place)
    }
}
