//! Accuracy that the noise allows.

use crate::scene::{Scene, WINDOW_PX};

/// Least root mean square error, px, that any unbiased estimate of a window's displacement between
/// two images can have (Cramér and Rao), over windows of [`WINDOW_PX`] around `points`. With the
/// gradients `g` of the images without noise, and noise of variance `v` in both:
///
/// ```text
/// E |error|² >= 2 v trace((Σ g g^T)^-1)
/// ```
#[derive(Default)]
pub struct Bound {
    squares: f64,
    count: usize,
}

impl Bound {
    /// Adds windows of the middle camera's first image.
    pub fn add(&mut self, scene: &Scene, points: impl Iterator<Item = [f64; 2]>) {
        let [along, down] = scene.gradients();
        let width = scene.size_px[0];
        // Rounding to whole grey levels is noise as well.
        let variance = scene.noise_grey.powi(2) + 1.0 / 12.0;
        let reach = WINDOW_PX / 2;
        for point in points {
            let [x, y] = point.map(|p| p.round() as usize);
            let rows = y - reach..=y + reach;
            let places = rows.flat_map(|y| (x - reach..=x + reach).map(move |x| y * width + x));
            let [mut xx, mut xy, mut yy] = [0.0; 3];
            for place in places {
                let (x, y) = (along[place], down[place]);
                (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
            }
            self.squares += 2.0 * variance * (xx + yy) / (xx * yy - xy * xy);
            self.count += 1;
        }
    }

    /// Returns the bound, px.
    pub fn rms_px(&self) -> f64 {
        (self.squares / self.count as f64).sqrt()
    }
}
