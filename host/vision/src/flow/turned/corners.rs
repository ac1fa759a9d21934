//! Corners of the reference camera's image, as a pose moves them.

use super::predictor::{Anchor, Predictor};
use super::search::turned_pixel;
use crate::flow::corner_motion::CornerMotion;
use crate::flow::displacement_search::DisplacementSearch;
use crate::flow::temporal::TemporalMatcher;

/// Motion of a target that turns.
pub(super) struct PosedCorners<'a> {
    pub matcher: &'a TemporalMatcher<'a>,
    pub predictor: Predictor<'a>,
    /// Searches in the image as it is and, if the target turned, in the image turned back, with the
    /// angles, rad. What is not the target may rest or turn.
    pub searches: Vec<(DisplacementSearch<'a>, f64)>,
}

impl CornerMotion for PosedCorners<'_> {
    fn predicted(&self, at: [f64; 2], inverse_depth: f64) -> Option<[f64; 2]> {
        let k = self.predictor.geometry.reference;
        let anchor = Anchor::at(self.predictor.geometry, k, at, inverse_depth);
        self.predictor.to(k, &anchor, at)
    }

    /// Tries the window as it was and as the pose turns it.
    fn track(
        &self,
        level: usize,
        at: [f64; 2],
        start: [f64; 2],
        inverse_depth: f64,
    ) -> Vec<([f64; 2], f32)> {
        let k = self.predictor.geometry.reference;
        let anchor = Anchor::at(self.predictor.geometry, k, at, inverse_depth);
        let turned = self.predictor.to(k, &anchor, at).and_then(|to| {
            let warp = self.predictor.warp(k, &anchor, to)?;
            (self.matcher).track_turned_corner(level, at, start, &warp)
        });
        let still = (self.matcher).track_corner(level, at, start, inverse_depth, [0.0; 3]);
        turned.into_iter().chain(still).collect()
    }

    fn likely(&self, at: [f64; 2]) -> Vec<([f64; 2], f32)> {
        let geometry = self.predictor.geometry;
        let likely = self.searches.iter().filter_map(|(search, turn_rad)| {
            let (pixel, zncc) = search.best_match(at)?;
            Some((turned_pixel(geometry, pixel, *turn_rad), zncc))
        });
        likely.collect()
    }
}
