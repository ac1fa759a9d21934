//! Gaussian blur of an image that repeats endlessly.

/// Blurs by `sigma` samples. The kernel reaches to 4 sigma, beyond which lie 6e-5 of a Gaussian.
pub(super) fn gaussian(width: usize, height: usize, samples: &[f32], sigma: f64) -> Vec<f32> {
    if !(sigma > 0.05) {
        return samples.to_vec();
    }
    let kernel = kernel(sigma);
    let reach = kernel.len() / 2;
    let mut across = Vec::with_capacity(samples.len());
    let mut line = Vec::with_capacity(width + 2 * reach);
    for row in samples.chunks_exact(width) {
        line.clear();
        // Row, extended by the kernel's half width at both ends.
        line.extend((0..width + 2 * reach).map(|x| row[(x + width * reach - reach) % width]));
        across.extend(line.windows(kernel.len()).map(|taps| {
            let product = |(a, b): (&f32, &f32)| a * b;
            taps.iter().zip(&kernel).map(product).sum::<f32>()
        }));
    }
    let mut down = vec![0.0; samples.len()];
    for (y, row) in down.chunks_exact_mut(width).enumerate() {
        for (k, weight) in kernel.iter().enumerate() {
            let from = (y + k + height * reach - reach) % height * width;
            for (value, sample) in row.iter_mut().zip(&across[from..from + width]) {
                *value += weight * sample;
            }
        }
    }
    down
}

fn kernel(sigma: f64) -> Vec<f32> {
    let reach = (4.0 * sigma).ceil() as i32;
    let bell = |i: i32| (-0.5 * (f64::from(i) / sigma).powi(2)).exp();
    let sum: f64 = (-reach..=reach).map(bell).sum();
    (-reach..=reach).map(|i| (bell(i) / sum) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn point_becomes_gaussian() {
        let (width, height, sigma) = (64, 50, 3.0);
        let mut point = vec![0.0; width * height];
        point[20 * width + 30] = 1.0;
        let bell = gaussian(width, height, &point, sigma);
        let mut moments = [0.0; 5];
        for (i, &value) in bell.iter().enumerate() {
            let (x, y) = ((i % width) as f64 - 30.0, (i / width) as f64 - 20.0);
            for (moment, power) in moments.iter_mut().zip([1.0, x, y, x * x, y * y]) {
                *moment += f64::from(value) * power;
            }
        }
        let expected = [1.0, 0.0, 0.0, sigma * sigma, sigma * sigma];
        for (moment, expected) in moments.iter().zip(expected) {
            assert!((moment - expected).abs() < 0.02, "{moments:?}");
        }
    }

    #[test]
    fn wide_kernel_wraps() {
        let blurred = gaussian(3, 2, &[6.0, 0.0, 0.0, 0.0, 0.0, 0.0], 10.0);
        assert!(
            blurred.iter().all(|v| (v - 1.0).abs() < 1e-4),
            "{blurred:?}"
        );
    }
}
