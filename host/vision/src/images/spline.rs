//! Smooth surface from a wrapped lattice of samples.
//!
//! The uniform cubic B-spline smooths its input by a kernel of variance 1/3 (in squared sample
//! distances) and passes almost nothing of the lattice itself: components that repeat with the
//! samples are damped by `sinc^4`, against `sinc^2` for bilinear sampling. An image that was
//! blurred before therefore moves without any sample-to-sample wobble.

/// Variance that sampling by [`Surface::at`] adds to any blur, in squared sample distances.
pub(super) const VARIANCE: f64 = 1.0 / 3.0;

/// Computes the four weights at the fraction `0 <= t < 1` of the way from the second sample to the
/// third. Their sum is 1.
pub(super) fn weights(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    let (t2, s2) = (t * t, s * s);
    [
        s2 * s / 6.0,
        2.0 / 3.0 - t2 * (2.0 - t) / 2.0,
        2.0 / 3.0 - s2 * (2.0 - s) / 2.0,
        t2 * t / 6.0,
    ]
}

/// Surface whose samples repeat endlessly in both directions.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    width: usize,
    height: usize,
    /// Samples with one more before and two after each row and column, so that no tap wraps.
    padded: Vec<f32>,
}

impl Surface {
    /// Creates the surface from `width * height` samples, row by row.
    pub fn new(width: usize, height: usize, samples: &[f32]) -> Self {
        let mut padded = Vec::with_capacity((width + 3) * (height + 3));
        for y in 0..height + 3 {
            let row = (y + height - 1) % height * width;
            padded.extend((0..width + 3).map(|x| samples[row + (x + width - 1) % width]));
        }
        Self {
            width,
            height,
            padded,
        }
    }

    /// Evaluates the surface at `(x, y)` sample distances from the first sample, anywhere.
    pub fn at(&self, x: f64, y: f64) -> f32 {
        let (column, wx) = Self::split(x, self.width);
        let (row, wy) = Self::split(y, self.height);
        let stride = self.width + 3;
        let mut start = row * stride + column;
        let mut value = 0.0;
        for weight in wy {
            let taps = &self.padded[start..start + 4];
            value +=
                weight * (wx[0] * taps[0] + wx[1] * taps[1] + wx[2] * taps[2] + wx[3] * taps[3]);
            start += stride;
        }
        value
    }

    /// Returns the sample at or before `x` on the wrapped axis, and the weights of the four taps
    /// around `x`.
    fn split(x: f64, count: usize) -> (usize, [f32; 4]) {
        let whole = x.floor();
        let turns = (whole / count as f64).floor();
        // A value that is not finite or beyond 2^53 has no place on the axis; the cast then gives
        // an index in range.
        let index = (whole - turns * count as f64) as usize;
        (index.min(count - 1), weights((x - whole) as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_sum_to_one() {
        for i in 0..100 {
            let t = i as f32 / 100.0;
            let w = weights(t);
            let sum: f32 = w.iter().sum();
            let mean = -w[0] + w[2] + 2.0 * w[3];
            let variance: f32 = (0..4).map(|k| w[k] * (k as f32 - 1.0 - t).powi(2)).sum();
            assert!((sum - 1.0).abs() < 1e-6);
            assert!((mean - t).abs() < 1e-6);
            assert!((f64::from(variance) - VARIANCE).abs() < 1e-6);
        }
    }

    #[test]
    fn surface_repeats_both_ways() {
        let samples: Vec<f32> = (0..35).map(|i| (i * i % 17) as f32).collect();
        let surface = Surface::new(5, 7, &samples);
        for (x, y) in [(0.3, 0.6), (4.9, 6.9), (2.0, 3.5)] {
            let here = surface.at(x, y);
            assert!((surface.at(x + 5.0, y - 7.0) - here).abs() < 1e-4);
            assert!((surface.at(x - 15.0, y + 70.0) - here).abs() < 1e-4);
        }
    }

    #[test]
    fn no_coordinate_panics() {
        let surface = Surface::new(1, 2, &[1.0, 2.0]);
        for x in [f64::NAN, f64::INFINITY, -1e300, 1e300, -0.0] {
            let _ = surface.at(x, x);
        }
    }
}
