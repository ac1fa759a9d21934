//! Corners of the reference camera's image, as a pose moves them.

use super::predictor::{Anchor, Predictor};
use super::turned_back::TurnedBack;
use crate::flow::corner_motion::CornerMotion;
use crate::flow::displacement_search::DisplacementSearch;
use crate::flow::temporal::TemporalMatcher;

/// Motion of a target that turns.
pub(super) struct PosedCorners<'a> {
    pub matcher: &'a TemporalMatcher<'a>,
    pub predictor: Predictor<'a>,
    /// Searches in the image as it is and, if the target turned, in the image turned back. What is
    /// not the target may rest or turn.
    pub searches: Vec<(DisplacementSearch<'a>, Option<TurnedBack<'a>>)>,
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
            (self.matcher).track_turned_at(level, k, [at, start], &warp)
        });
        let still = (self.matcher).track_corner(level, at, start, inverse_depth, [0.0; 3]);
        turned.into_iter().chain(still).collect()
    }

    fn likely(&self, at: [f64; 2]) -> Vec<([f64; 2], f32)> {
        let likely = self.searches.iter().filter_map(|(search, turned_back)| {
            let (pixel, zncc) = search.best_match(at)?;
            let place = turned_back.map_or(pixel, |turned_back| turned_back.pixel(pixel));
            Some((place, zncc))
        });
        likely.collect()
    }
}
