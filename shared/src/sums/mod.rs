//! What one frame says: the flow of all matched points, summed into a few numbers.
//!
//! Two kinds, one per family of estimators:
//!
//! * [`pair`]: the paper's ten sums over two camera pairs (its eqs. 5-7), for three cameras in a
//!   line;
//! * [`centred`]: weighted means, spread and residual of the midpoint model, for 2 to 8 cameras in
//!   a plane.
//!
//! Each has a floating-point form, which accumulates [`View`]s on the host, and a fixed-point form,
//! which crosses the wire. `quantise` goes from one to the other, and is the only place where float
//! becomes integer.

pub mod centred;
pub mod pair;

/// One camera's view of one point at the reference instant and now: normalised coordinates
/// (dimensionless, x right, y down; see [`crate::rig`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct View {
    /// At the reference instant.
    pub start: [f64; 2],
    /// Now.
    pub end: [f64; 2],
}

impl View {
    /// Pixels as seen at both instants, seen by `camera`.
    pub fn from_pixels(camera: &crate::rig::Camera, start_px: [f64; 2], end_px: [f64; 2]) -> Self {
        Self {
            start: camera.normalise(start_px),
            end: camera.normalise(end_px),
        }
    }

    /// Displacement in normalised coordinates.
    pub fn flow(&self) -> [f64; 2] {
        [self.end[0] - self.start[0], self.end[1] - self.start[1]]
    }
}
