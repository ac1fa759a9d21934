//! From captures to matched, tracked points.

/// One scene point, followed in every camera.
#[derive(Clone, Debug)]
pub struct Track {
    /// Per camera, in the rig's order: pixel at the reference instant, pixel now (as seen, principal
    /// point and distortion not removed).
    pub pixels: Vec<[[f64; 2]; 2]>,
}
