//! Limits of one match.

/// Tests that a match between two images must pass.
#[derive(Clone, Debug, PartialEq)]
pub struct MatchSettings {
    /// Least zero-mean normalised cross-correlation, -1 to 1.
    pub min_zncc: f32,
    /// Largest difference between the correlations of two explanations that count as equally good.
    pub rival_zncc_margin: f32,
    /// Largest forward-backward error, px: a window tracked there and back must return this near.
    pub max_return_px: f64,
    /// Largest residual of the vertical test and of constraint (3), px. Raise it for rigs that are
    /// not aligned.
    pub max_view_residual_px: f64,
}

impl Default for MatchSettings {
    fn default() -> Self {
        Self {
            min_zncc: 0.8,
            rival_zncc_margin: 0.08,
            max_return_px: 0.3,
            max_view_residual_px: 0.5,
        }
    }
}
