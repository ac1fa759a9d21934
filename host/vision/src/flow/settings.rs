//! Limits of the flow: counts, thresholds and the search range.

use crate::matching::MatchSettings;

/// Limits of one [`Flow`](super::Flow).
#[derive(Clone, Debug, PartialEq)]
pub struct FlowSettings {
    /// Largest number of corners to try.
    pub max_corners: usize,
    /// Largest number of points to track.
    pub max_points: usize,
    /// Least distance between two corners, px.
    pub min_spacing_px: f64,
    /// Least gradient around a corner, root mean square in its weakest direction, grey levels per
    /// px. At 1, it is three times what noise of 2 grey levels leaves after the filter.
    pub min_gradient: f32,
    /// Tests of one match between two images.
    pub matching: MatchSettings,
    /// Largest motion of a point between the keyframe and now, in widths of the image.
    pub search_range: f64,
    /// Least limit of an inlier's residual, px. Points within it are inliers even if most points
    /// have smaller residuals.
    pub min_inlier_px: f64,
    /// Largest median residual of a consensus, px.
    pub max_median_residual_px: f64,
    /// Least number of corners, matches, tracked points and inliers.
    pub min_points: usize,
    /// Largest rotation of the target, degrees. Below it, sigma grows by the possible error that
    /// the rotation causes.
    pub max_rotation_deg: f64,
    /// Number of threads that share the work, at least 1. Results do not depend on it.
    pub threads: usize,
}

impl Default for FlowSettings {
    fn default() -> Self {
        Self {
            max_corners: 400,
            max_points: 220,
            min_spacing_px: 8.0,
            min_gradient: 1.0,
            matching: MatchSettings::default(),
            search_range: 0.2,
            min_inlier_px: 0.1,
            max_median_residual_px: 0.5,
            min_points: 8,
            max_rotation_deg: 0.15,
            threads: 1,
        }
    }
}
