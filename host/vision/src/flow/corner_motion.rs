//! Corners of the reference camera's image, as a measurement moves them.

use super::consensus::PointFlow;
use super::displacement_search::DisplacementSearch;
use super::temporal::TemporalMatcher;

/// Motion of the target as measured, applied to corners whose depth is known roughly.
pub(super) trait CornerMotion: Sync {
    /// Predicts the pixel now of the pixel `at` at the keyframe; `None` if it would not be in front
    /// of the cameras.
    fn predicted(&self, at: [f64; 2], inverse_depth: f64) -> Option<[f64; 2]>;

    /// Looks at the pyramid's `level`, from `start` on, for the window that was at `at`. Returns
    /// pixel and zncc for each form that the window may have.
    fn track(
        &self,
        level: usize,
        at: [f64; 2],
        start: [f64; 2],
        inverse_depth: f64,
    ) -> Vec<([f64; 2], f32)>;

    /// Returns the places where the coarse images look most like the window at `at`, and the zncc
    /// there.
    fn likely(&self, at: [f64; 2]) -> Vec<([f64; 2], f32)>;
}

/// Motion of a target that does not turn.
pub(super) struct DisplacedCorners<'a> {
    pub(super) matcher: &'a TemporalMatcher<'a>,
    pub(super) search: &'a DisplacementSearch<'a>,
    pub(super) displacement_mm: [f64; 3],
}

impl CornerMotion for DisplacedCorners<'_> {
    fn predicted(&self, at: [f64; 2], inverse_depth: f64) -> Option<[f64; 2]> {
        let geometry = self.matcher.geometry;
        let reference = geometry.reference;
        let from = geometry.normalise(reference, at);
        let to = PointFlow::predicted(from, inverse_depth, self.displacement_mm);
        Some(geometry.pixel(reference, to))
    }

    fn track(
        &self,
        level: usize,
        at: [f64; 2],
        start: [f64; 2],
        inverse_depth: f64,
    ) -> Vec<([f64; 2], f32)> {
        let moved_mm = self.displacement_mm;
        let found = (self.matcher).track_corner(level, at, start, inverse_depth, moved_mm);
        found.into_iter().collect()
    }

    fn likely(&self, at: [f64; 2]) -> Vec<([f64; 2], f32)> {
        self.search.best_match(at).into_iter().collect()
    }
}
