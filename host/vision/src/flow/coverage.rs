//! Coverage of the reference image by inliers.
//!
//! Points lie only on texture. An object that hides part of a plain target may have most of the
//! points, and so may the background beside the target; then the inliers are not the target's. The
//! image is therefore divided into *cells*, each tested separately:
//!
//! * an *inlier cell* holds an inlier, or its best corner is found within a pixel of where the
//!   measurement predicts it;
//! * an *outlier cell* has a best corner that is found elsewhere, but not where the measurement
//!   predicts it;
//! * all other cells are plain, hidden now or out of view, and unknown.
//!
//! If there are hardly any outlier cells, the measurement is the target's, however small the target
//! is. Otherwise inlier cells must be most of the cells in view, unknown ones included.

use std::collections::BTreeMap;

use super::corner_motion::CornerMotion;
use super::keyframe::ActiveKeyframe;
use super::region::Regions;
use super::temporal::TemporalMatcher;
use super::{Correspondence, FlowRefusal};
use crate::matching::lucas_kanade::FineTemplate;
use crate::matching::stereo::StereoMatch;

/// Cells along the longer side of the image.
const CELLS: f64 = 16.0;
/// Pyramid level on which corners are tracked.
const LEVEL: usize = 1;
/// Least correlation of a tracked corner.
const MIN_TRACKED_ZNCC: f32 = 0.75;
/// Largest distance of a corner from its predicted place, px.
const MAX_OFF_PX: f64 = 1.0;
/// Least correlation, in the coarse image, of a place where a corner may be instead.
const MIN_ELSEWHERE_ZNCC: f32 = 0.7;
/// Depths that a corner without a match may have, as multiples of its neighbour's, the farthest
/// first.
const DEPTHS: [f64; 2] = [1.2, 0.85];
/// Least share of inlier cells that counts as most of the image. It is a little more than half,
/// because cells count whole although they may move only in part.
const MOST: f64 = 0.55;
/// Number of places along each side of a cell that a region may allow.
const SAMPLES: usize = 8;
/// Number of inlier cells per outlier cell at which the inliers are accepted without further tests.
const INLIERS_PER_OUTLIER: usize = 8;

/// Number of cells by their motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct InlierCoverage {
    /// Inlier cells.
    pub(super) inlier_cells: usize,
    /// Outlier cells; 0 if they cannot change the decision.
    pub(super) outlier_cells: usize,
    /// Cells in view.
    pub(super) visible_cells: usize,
}

impl InlierCoverage {
    /// Counts the cells of the reference camera's image, given the inliers and the motion that they
    /// share.
    pub(super) fn of(
        keyframe: &ActiveKeyframe<'_>,
        matcher: &TemporalMatcher<'_>,
        motion: &dyn CornerMotion,
        inliers: &[Correspondence],
        regions: &Regions,
    ) -> Self {
        let reference = matcher.geometry.reference;
        let camera = keyframe.active.cameras[reference];
        let start = |inlier: &Correspondence| inlier.pixels[reference][0];
        let tracker = CornerTracker {
            matcher,
            motion,
            inliers,
            starts: inliers.iter().map(start).collect(),
        };

        // Cells that hold an inlier.
        let grid = CellGrid::of(matcher.geometry.rig.image_size_px);
        let cell_of = |inlier: &Correspondence| grid.cell_at(inlier.pixels[reference][0]);
        let mut inlier_cells: Vec<usize> = inliers.iter().map(cell_of).collect();
        inlier_cells.sort_unstable();
        inlier_cells.dedup();
        // The rectangles of the other cameras hold, too: a place is taken to be as far away as the
        // match nearest to it.
        let shifts = RegionShifts::of(keyframe, regions, reference);
        let allows = |at| regions.allow_start(camera, at) && shifts.allow(at);
        let places: Vec<[f64; 2]> = grid.places(allows).collect();
        let mut coverage = Self {
            inlier_cells: inlier_cells.len(),
            outlier_cells: 0,
            visible_cells: places.len(),
        };
        if coverage.is_most() {
            return coverage;
        }

        // The best corner of each other cell, one of known depth if there is any.
        let mut others: BTreeMap<usize, CellCorner> = BTreeMap::new();
        let is_other = |cell: &usize| inlier_cells.binary_search(cell).is_err();
        for matched in keyframe.matches {
            let cell = grid.cell_at(matched.pixels[reference]);
            if is_other(&cell) {
                let corner = CellCorner::matched(matched, reference);
                others.entry(cell).or_insert(corner);
            }
        }
        for at in keyframe.unmatched {
            let cell = grid.cell_at(*at);
            if is_other(&cell) && shifts.allow(*at) {
                others
                    .entry(cell)
                    .or_insert_with(|| tracker.unmatched_corner(*at));
            }
        }

        // Inlier cells by a corner at its predicted place.
        let others: Vec<CellCorner> = others.into_values().collect();
        let is_there = |corner| tracker.is_at_prediction(corner);
        let are_there = matcher.thread_pool.map(others.clone(), is_there);
        coverage.inlier_cells += are_there.iter().filter(|is| **is).count();
        let in_view = places.iter().filter(|at| tracker.stays_in_view(**at));
        coverage.visible_cells = in_view.count();
        if coverage.is_most() {
            return coverage;
        }

        // Outlier cells by a corner that is found elsewhere.
        let lost = others.into_iter().zip(are_there);
        let lost = lost.filter_map(|(corner, is_there)| (!is_there).then_some(corner));
        let is_elsewhere = |corner| tracker.is_elsewhere(corner);
        let are_elsewhere = matcher.thread_pool.map(lost.collect(), is_elsewhere);
        coverage.outlier_cells = are_elsewhere.into_iter().filter(|is| *is).count();
        coverage
    }

    fn is_most(self) -> bool {
        self.inlier_cells as f64 >= MOST * self.visible_cells as f64
    }

    /// Decides whether the inliers are the target.
    ///
    /// # Errors
    /// [`FlowRefusal::Minority`] if something else moves, and the inliers are not most of the
    /// image.
    pub(super) fn judge(self) -> Result<(), FlowRefusal> {
        if self.is_most() || INLIERS_PER_OUTLIER * self.outlier_cells <= self.inlier_cells {
            return Ok(());
        }
        Err(FlowRefusal::Minority {
            alike: self.inlier_cells,
            otherwise: self.outlier_cells,
            all: self.visible_cells,
        })
    }
}

/// Regions of the cameras beside the reference camera, for places in the reference image.
struct RegionShifts<'a> {
    regions: &'a Regions,
    /// Cameras with a rectangle: index in the rig, and among the active ones.
    cameras: Vec<(usize, usize)>,
    matches: &'a [StereoMatch],
    reference: usize,
}

impl<'a> RegionShifts<'a> {
    fn of(keyframe: &ActiveKeyframe<'a>, regions: &'a Regions, reference: usize) -> Self {
        let cameras = keyframe.active.cameras.iter().copied().enumerate();
        let cameras = cameras.filter(|(index, camera)| {
            let region = regions.0.get(*camera);
            *index != reference && region.is_some_and(|region| region.rectangle_px.is_some())
        });
        Self {
            regions,
            cameras: cameras.map(|(index, camera)| (camera, index)).collect(),
            matches: keyframe.matches,
            reference,
        }
    }

    /// Returns true if the point at this pixel of the reference image would be in all rectangles,
    /// were it as far away as the match nearest in the image.
    fn allow(&self, at: [f64; 2]) -> bool {
        if self.cameras.is_empty() {
            return true;
        }
        let distance = |matched: &&StereoMatch| {
            let [x, y] = matched.pixels[self.reference];
            (x - at[0]).powi(2) + (y - at[1]).powi(2)
        };
        let nearest = self.matches.iter();
        let nearest = nearest.min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let Some(nearest) = nearest else {
            return true;
        };
        let from = nearest.pixels[self.reference];
        self.cameras.iter().all(|(camera, index)| {
            let to = nearest.pixels[*index];
            let there = [0, 1].map(|i| at[i] + to[i] - from[i]);
            self.regions.allow_start(*camera, there)
        })
    }
}

/// Grid of cells over the part of the image in which corners may be.
struct CellGrid {
    side_px: f64,
    columns: usize,
    rows: usize,
}

impl CellGrid {
    const MARGIN_PX: f64 = (FineTemplate::MARGIN + 1) as f64;

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

    /// Returns the cell of a pixel. The last cells of rows and columns include the remainder.
    fn cell_at(&self, [x, y]: [f64; 2]) -> usize {
        let index = |c: f64| ((c - Self::MARGIN_PX) / self.side_px).max(0.0) as usize;
        index(y).min(self.rows - 1) * self.columns + index(x).min(self.columns - 1)
    }

    /// Returns a place in each cell that has an allowed one: its centre if that is allowed.
    fn places(&self, allows: impl Fn([f64; 2]) -> bool) -> impl Iterator<Item = [f64; 2]> {
        let place = move |cell: [usize; 2]| {
            let at = |share: [f64; 2]| {
                [0, 1].map(|i| Self::MARGIN_PX + (cell[i] as f64 + share[i]) * self.side_px)
            };
            let shares = (0..SAMPLES * SAMPLES)
                .map(|i| [i % SAMPLES, i / SAMPLES].map(|i| (i as f64 + 0.5) / SAMPLES as f64));
            let mut places = std::iter::once([0.5; 2]).chain(shares).map(at);
            places.find(|at| allows(*at))
        };
        let cells = (0..self.rows).flat_map(|y| (0..self.columns).map(move |x| [x, y]));
        cells.filter_map(place)
    }
}

/// Corner that represents a cell of the keyframe's image.
#[derive(Clone, Copy, Debug)]
struct CellCorner {
    /// Pixel at the keyframe.
    at: [f64; 2],
    /// Least and largest inverse depth, 1/mm.
    inverse_depths: [f64; 2],
}

impl CellCorner {
    fn matched(matched: &StereoMatch, camera: usize) -> Self {
        Self {
            at: matched.pixels[camera],
            inverse_depths: [matched.ray.inverse_depth; 2],
        }
    }

    /// Returns the middle of the inverse depths, 1/mm.
    fn inverse_depth(self) -> f64 {
        let [far, near] = self.inverse_depths;
        0.5 * (far + near)
    }
}

/// Tracker of the corners that represent cells.
struct CornerTracker<'a> {
    matcher: &'a TemporalMatcher<'a>,
    motion: &'a dyn CornerMotion,
    inliers: &'a [Correspondence],
    /// Pixel of each inlier at the keyframe.
    starts: Vec<[f64; 2]>,
}

impl CornerTracker<'_> {
    /// Creates the corner of an unmatched pixel. Its depth may be that of the nearest inlier in the
    /// image, or somewhat more or less.
    fn unmatched_corner(&self, at: [f64; 2]) -> CellCorner {
        let inverse_depth = self.inverse_depth_near(at);
        CellCorner {
            at,
            inverse_depths: DEPTHS.map(|times| inverse_depth / times),
        }
    }

    /// Returns the inverse depth of the inlier that is nearest in the image.
    fn inverse_depth_near(&self, at: [f64; 2]) -> f64 {
        let geometry = self.matcher.geometry;
        let mut least = f64::INFINITY;
        let mut nearest = None;
        for (inlier, [x, y]) in self.inliers.iter().zip(&self.starts) {
            let square = (x - at[0]).powi(2) + (y - at[1]).powi(2);
            if square < least {
                (least, nearest) = (square, Some(inlier));
            }
        }
        nearest.map_or(0.0, |inlier| {
            let starts: Vec<[f64; 2]> = inlier.views.iter().map(|view| view.start).collect();
            geometry.fit(&starts).inverse_depth
        })
    }

    fn stays_in_view(&self, at: [f64; 2]) -> bool {
        let now = self.matcher.now[self.matcher.geometry.reference].finest();
        let predicted = self.motion.predicted(at, self.inverse_depth_near(at));
        predicted.is_some_and(|to| FineTemplate::fits(now, to.map(|c| c as f32)))
    }

    /// Returns the distance of a pixel from the segment of predictions between the two depths, px.
    fn off_px(&self, corner: CellCorner, pixel: [f64; 2]) -> f64 {
        let predictions = corner
            .inverse_depths
            .map(|inverse_depth| self.motion.predicted(corner.at, inverse_depth));
        let [Some(far), Some(near)] = predictions else {
            return f64::INFINITY;
        };
        let segment = [near[0] - far[0], near[1] - far[1]];
        let to = [pixel[0] - far[0], pixel[1] - far[1]];
        let square = segment[0] * segment[0] + segment[1] * segment[1];
        let dot = to[0] * segment[0] + to[1] * segment[1];
        let share = (dot / square.max(1e-9)).clamp(0.0, 1.0);
        (to[0] - share * segment[0]).hypot(to[1] - share * segment[1])
    }

    /// Returns true if the corner is found where the measurement predicts it.
    fn is_at_prediction(&self, corner: CellCorner) -> bool {
        let start = self.motion.predicted(corner.at, corner.inverse_depth());
        start.is_some_and(|start| {
            let mut found = self.track(corner, start);
            found.any(|pixel| self.off_px(corner, pixel) <= MAX_OFF_PX)
        })
    }

    /// Returns true if a corner that is not at its prediction is found anywhere else.
    fn is_elsewhere(&self, corner: CellCorner) -> bool {
        let likely = self.motion.likely(corner.at).into_iter();
        let mut likely = likely.filter(|(_, zncc)| *zncc > MIN_ELSEWHERE_ZNCC);
        likely.any(|(start, _)| {
            let mut found = self.track(corner, start);
            found.any(|pixel| self.off_px(corner, pixel) > MAX_OFF_PX)
        })
    }

    /// Tracks a corner from `start` on and returns the pixels where its window correlates.
    fn track(&self, corner: CellCorner, start: [f64; 2]) -> impl Iterator<Item = [f64; 2]> {
        let found = (self.motion).track(LEVEL, corner.at, start, corner.inverse_depth());
        let alike = found
            .into_iter()
            .filter(|(_, zncc)| *zncc >= MIN_TRACKED_ZNCC);
        alike.map(|(pixel, _)| pixel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn narrow_region_has_visible_cells() {
        let grid = CellGrid::of([320, 240]);
        let all = grid.places(|_| true).count();
        assert_eq!(all, grid.rows * grid.columns);
        // Narrower than a cell, and beside its centre.
        let narrow = |[x, _]: [f64; 2]| (154.0..158.0).contains(&x);
        let places: Vec<[f64; 2]> = grid.places(narrow).collect();
        assert_eq!(places.len(), grid.rows, "{places:?}");
        assert!(places.iter().all(|at| narrow(*at)));
    }
}
