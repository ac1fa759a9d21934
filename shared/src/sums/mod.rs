//! Flow sums: the flow of all matched points of one frame set, summed into a few numbers.
//!
//! There are two kinds, one per family of estimators:
//!
//! * [`pair`]: the paper's ten sums over two camera pairs (its eqs. 5-7), for three cameras in a
//!   line;
//! * [`centred`]: weighted means, spread and residual of the midpoint model, for 2 to 8 cameras in
//!   a plane.
//!
//! Each kind has a floating-point form, which accumulates [`View`]s on the host, and a fixed-point
//! form, which crosses the wire. `quantise` converts the first to the second and is the only place
//! where floating point becomes integer.

pub mod centred;
pub mod fixint2;
pub mod pair;

/// Positions of one point in one camera at the keyframe and now, in normalised coordinates
/// (dimensionless, x right, y down; see [`crate::rig`]).
///
/// ```
/// use trinocular_core::rig::Rig;
/// use trinocular_core::sums::View;
///
/// let camera = &Rig::paper().cameras[1];
/// let [start_px, end_px] = [[0.0, 0.0, 850.0], [4.0, 0.0, 850.0]].map(|mm| camera.project(mm));
/// let view = View::from_pixels(camera, start_px, end_px);
/// assert!((view.flow()[0] - 4.0 / 850.0).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct View {
    /// Position at the keyframe.
    pub start: [f64; 2],
    /// Position now.
    pub end: [f64; 2],
}

impl View {
    /// Converts a point's positions at both instants from pixels of `camera`.
    pub fn from_pixels(camera: &crate::rig::Camera, start_px: [f64; 2], end_px: [f64; 2]) -> Self {
        Self {
            start: camera.normalise(start_px),
            end: camera.normalise(end_px),
        }
    }

    /// Returns the flow: the displacement in normalised coordinates.
    pub fn flow(&self) -> [f64; 2] {
        [self.end[0] - self.start[0], self.end[1] - self.start[1]]
    }
}
