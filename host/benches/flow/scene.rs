//! Images whose true flow is known exactly: periodic noise of three octaves, moved by multiplying
//! its spectrum.

use std::f64::consts::{PI, TAU};

use rustfft::FftPlanner;
use rustfft::num_complex::Complex;
use trinocular_core::rig::{Camera, Rig};
use trinocular_rig::random::Random;
use trinocular_vision::images::{FrameSet, Image};

/// Pattern in front of the cameras, with its motion.
#[derive(Clone, Debug)]
pub struct Scene {
    pub name: &'static str,
    pub size_px: [usize; 2],
    /// Shift of the left and of the right camera's image, px.
    pub disparity_px: [f64; 2],
    /// Shift from one frame set to the next, px.
    pub flow_px: [f64; 2],
    /// Standard deviation of the noise, grey levels.
    pub noise_grey: f64,
    pub seed: u64,
}

/// Side of the windows that all programs track, px.
pub const WINDOW_PX: usize = 21;

const FOCAL_PX: f64 = 533.32;
const DEPTH_MM: f64 = 700.0;

impl Scene {
    /// Returns a rig of parallel cameras that see these disparities at [`DEPTH_MM`].
    pub fn rig(&self) -> Rig {
        let centre = self.size_px.map(|s| (s as f64 - 1.0) / 2.0);
        let camera = |shift: f64| {
            let offset = -shift * DEPTH_MM / FOCAL_PX;
            Camera::ideal([FOCAL_PX; 2], centre, [offset, 0.0])
        };
        let [left, right] = self.disparity_px;
        Rig {
            image_size_px: self.size_px.map(|s| s as u32),
            cameras: [left, 0.0, right].map(camera).into_iter().collect(),
        }
    }

    /// Returns two frame sets: left, middle, right, then the same moved by the flow.
    pub fn frame_sets(&self) -> [FrameSet; 2] {
        let spectrum = Spectrum::noise(side(self.size_px), self.seed);
        let mut noise = Random::new(self.seed, 1);
        [0.0, 1.0].map(|moved| {
            let [x, y] = self.flow_px.map(|f| f * moved);
            let shifts = [self.disparity_px[0], 0.0, self.disparity_px[1]];
            let images = shifts
                .map(|shift| {
                    let moved = spectrum.moved([shift + x, y]);
                    self.photograph(&moved, &mut noise)
                })
                .into();
            FrameSet { time_us: 0, images }
        })
    }

    /// Returns true if a position and the window around it lie within the image.
    pub fn holds(&self, at: [f64; 2]) -> bool {
        let margin = WINDOW_PX.div_ceil(2) as f64;
        (at.iter().zip(self.size_px)).all(|(at, size)| *at > margin && *at < size as f64 - margin)
    }

    /// Computes the gradients along x and y of the middle camera's first image without noise, grey
    /// levels per px.
    pub fn gradients(&self) -> [Vec<f64>; 2] {
        let spectrum = Spectrum::noise(side(self.size_px), self.seed);
        [0, 1].map(|axis| {
            let slope = spectrum.filtered(|turn| Complex::new(0.0, TAU * turn[axis]));
            self.part(&slope).collect()
        })
    }

    /// Returns the part of the pattern that is in view.
    fn part(&self, pattern: &[f64]) -> impl Iterator<Item = f64> {
        let [width, height] = self.size_px;
        let n = side(self.size_px);
        let margin = [(n - width) / 2, (n - height) / 2];
        let place = move |i: usize| (i / width + margin[1]) * n + i % width + margin[0];
        (0..width * height).map(move |i| pattern[place(i)])
    }

    /// Returns a part of the pattern, with noise, in 8 bits.
    fn photograph(&self, pattern: &[f64], noise: &mut Random) -> Image {
        let [width, height] = self.size_px;
        let grey = (self.part(pattern))
            .map(|level| (level + self.noise_grey * noise.gaussian()).round() as u8)
            .collect();
        Image {
            width,
            height,
            grey,
        }
    }
}

/// Returns the side of the periodic pattern, px.
fn side(size_px: [usize; 2]) -> usize {
    (size_px[0] + size_px[0] / 2).next_power_of_two()
}

/// Spectrum of a periodic pattern, column by column.
struct Spectrum {
    n: usize,
    values: Vec<Complex<f64>>,
}

impl Spectrum {
    /// Creates white noise blurred to 1.2, 3 and 8 px, added 1 : 1 : 0.8, mean 128, standard
    /// deviation 40 grey levels.
    fn noise(n: usize, seed: u64) -> Self {
        let mut random = Random::new(seed, 0);
        let mut sum = vec![Complex::default(); n * n];
        for (sigma, weight) in [(1.2, 1.0), (3.0, 1.0), (8.0, 0.8)] {
            let mut octave: Vec<Complex<f64>> = (0..n * n)
                .map(|_| Complex::new(random.gaussian(), 0.0))
                .collect();
            transform(&mut octave, n, false);
            for (i, value) in octave.iter_mut().enumerate() {
                let [u, v] = [frequency(i % n, n), frequency(i / n, n)];
                let exponent = PI * sigma;
                *value *= (-2.0 * exponent * exponent * (u * u + v * v)).exp();
            }
            let scale = weight / deviation(&octave, n);
            for (sum, value) in sum.iter_mut().zip(&octave) {
                *sum += value * scale;
            }
        }
        let scale = 40.0 / deviation(&sum, n);
        for value in &mut sum {
            *value *= scale;
        }
        sum[0] = Complex::new(128.0 * (n * n) as f64, 0.0);
        Self { n, values: sum }
    }

    /// Returns the pattern, shifted.
    fn moved(&self, [x, y]: [f64; 2]) -> Vec<f64> {
        self.filtered(|[u, v]| Complex::cis(-TAU * (u * x + v * y)))
    }

    /// Returns the pattern with each pair of frequencies along x and y (cycles per px) multiplied
    /// by its `response`.
    fn filtered(&self, response: impl Fn([f64; 2]) -> Complex<f64>) -> Vec<f64> {
        let n = self.n;
        let mut values = self.values.clone();
        for (i, value) in values.iter_mut().enumerate() {
            // Transposed by the transform: rows are x.
            *value *= response([frequency(i / n, n), frequency(i % n, n)]);
        }
        transform(&mut values, n, true);
        let scale = 1.0 / (n * n) as f64;
        values.iter().map(|v| v.re * scale).collect()
    }
}

/// Computes the standard deviation of the pattern. The mean is left out, as in the pattern.
fn deviation(spectrum: &[Complex<f64>], n: usize) -> f64 {
    let power: f64 = spectrum[1..].iter().map(Complex::norm_sqr).sum();
    power.sqrt() / (n * n) as f64
}

/// Returns the frequency in cycles per px: zero at the Nyquist frequency, where a shift has no
/// meaning and the blur leaves no signal.
fn frequency(index: usize, n: usize) -> f64 {
    let signed = if index < n / 2 {
        index as f64
    } else {
        index as f64 - n as f64
    };
    signed / n as f64
}

/// Transforms both axes, transposing the raster. The inverse is not divided by n².
fn transform(values: &mut Vec<Complex<f64>>, n: usize, inverse: bool) {
    let mut planner = FftPlanner::new();
    let fft = if inverse {
        planner.plan_fft_inverse(n)
    } else {
        planner.plan_fft_forward(n)
    };
    fft.process(values);
    let mut turned: Vec<Complex<f64>> = (0..n * n).map(|i| values[i % n * n + i / n]).collect();
    fft.process(&mut turned);
    *values = turned;
}
