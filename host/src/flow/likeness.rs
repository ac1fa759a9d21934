//! Zero-mean normalised cross-correlation at whole pixels of a coarse level: what the searches are made of.
//!
//! ```text
//! likeness(x, y) = Σ T' I(x + i, y + j) / sqrt(Σ (I - mean)²)       T' zero-mean with Σ T'² = 1
//! ```

use super::pyramid::Plane;

/// Side of the window, px of the level.
pub const SIDE: usize = 11;
const REACH: usize = SIDE / 2;
/// Positions that are computed together.
const LANES: usize = 8;
/// Likeness of a position whose window is not within the image.
pub const OUTSIDE: f32 = f32::NEG_INFINITY;
/// Windows with less contrast than this (grey levels, standard deviation) are like nothing.
const LEAST_CONTRAST: f64 = 1.0;

/// A coarse level and the contrast of every window in it.
#[derive(Clone, Debug, Default)]
pub struct Field {
    plane: Plane,
    /// `1 / sqrt(Σ (I - mean)²)` of the window around each pixel; 0 where there is no contrast.
    inverse: Vec<f32>,
}

/// A window that is looked for: zero-mean, of unit energy.
#[derive(Clone, Debug)]
pub struct Probe([[f32; SIDE]; SIDE]);

impl Field {
    /// Sums up all windows of `plane`.
    pub fn new(plane: &Plane) -> Self {
        let (width, height) = (plane.width, plane.height);
        let mut inverse = vec![0.0_f32; plane.stride * height];
        if width < SIDE || height < SIDE {
            return Self {
                plane: plane.clone(),
                inverse,
            };
        }
        let count = (SIDE * SIDE) as f64;
        // Column sums of I and I² over the rows of the window.
        let mut sums = vec![[0.0_f64; 2]; width];
        for y in 0..height {
            let row = &plane.grey[y * plane.stride..][..width];
            for (sum, level) in sums.iter_mut().zip(row) {
                let level = f64::from(*level);
                *sum = [sum[0] + level, sum[1] + level * level];
            }
            if y + 1 < SIDE {
                continue;
            }
            let mut total = [0.0_f64; 2];
            for x in 0..width {
                total = [total[0] + sums[x][0], total[1] + sums[x][1]];
                if x + 1 < SIDE {
                    continue;
                }
                let variation = total[1] - total[0] * total[0] / count;
                if variation > count * LEAST_CONTRAST * LEAST_CONTRAST {
                    inverse[(y - REACH) * plane.stride + x - REACH] =
                        (1.0 / variation.sqrt()) as f32;
                }
                let gone = sums[x + 1 - SIDE];
                total = [total[0] - gone[0], total[1] - gone[1]];
            }
            let first = &plane.grey[(y + 1 - SIDE) * plane.stride..][..width];
            for (sum, level) in sums.iter_mut().zip(first) {
                let level = f64::from(*level);
                *sum = [sum[0] - level, sum[1] - level * level];
            }
        }
        Self {
            plane: plane.clone(),
            inverse,
        }
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.plane.width, self.plane.height]
    }

    /// Whether the window around `(x, y)` lies within the image.
    pub fn holds(&self, x: i64, y: i64) -> bool {
        let inside = |at: i64, size: usize| at >= REACH as i64 && at + (REACH as i64) < size as i64;
        inside(x, self.plane.width) && inside(y, self.plane.height)
    }

    /// The window around `(x, y)` as a probe. `None` if it leaves the image or has no contrast.
    pub fn probe(&self, x: i64, y: i64) -> Option<Probe> {
        if !self.holds(x, y) {
            return None;
        }
        let (x, y) = (x as usize, y as usize);
        let inverse = self.inverse[y * self.plane.stride + x];
        if inverse == 0.0 {
            return None;
        }
        let mut window = [[0.0; SIDE]; SIDE];
        for (r, row) in window.iter_mut().enumerate() {
            row.copy_from_slice(
                &self.plane.grey[(y + r - REACH) * self.plane.stride + x - REACH..][..SIDE],
            );
        }
        let mean = window.as_flattened().iter().sum::<f32>() / (SIDE * SIDE) as f32;
        for value in window.as_flattened_mut() {
            *value = (*value - mean) * inverse;
        }
        Some(Probe(window))
    }

    /// Likeness of `probe` at `(x, y), (x + 1, y), ...`, one per entry of `out`; [`OUTSIDE`] where the window leaves the image.
    pub fn compare(&self, probe: &Probe, x: i64, y: i64, out: &mut [f32]) {
        out.fill(OUTSIDE);
        if !self.holds(REACH as i64, y) {
            return;
        }
        let first = x.max(REACH as i64);
        let end = (x + out.len() as i64).min(self.plane.width as i64 - REACH as i64);
        if first >= end {
            return;
        }
        let (start, y) = (first as usize, y as usize);
        let inverse = &self.inverse[y * self.plane.stride..][..self.plane.stride];
        let out = &mut out[(first - x) as usize..(end - x) as usize];
        for (block, out) in out.chunks_mut(LANES).enumerate() {
            let column = start + block * LANES;
            let mut sums = [0.0_f32; LANES];
            for (r, taps) in probe.0.iter().enumerate() {
                let from = (y + r - REACH) * self.plane.stride + column - REACH;
                let row: &[f32; SIDE + LANES - 1] = match self.plane.grey[from..].first_chunk() {
                    Some(row) => row,
                    None => return,
                };
                for (i, tap) in taps.iter().enumerate() {
                    for l in 0..LANES {
                        sums[l] += tap * row[i + l];
                    }
                }
            }
            for (l, out) in out.iter_mut().enumerate() {
                *out = sums[l] * inverse[column + l];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::pyramid::Pyramid;
    use crate::images::Image;
    use crate::random::Random;

    fn field() -> Field {
        let mut random = Random::new(4, 0);
        let grey = (0..60 * 40)
            .map(|_| (128.0 + 50.0 * random.gaussian()) as u8)
            .collect();
        let image = Image {
            width: 60,
            height: 40,
            grey,
        };
        Field::new(&Pyramid::new(&image, 1).levels[0])
    }

    #[test]
    fn a_window_is_like_itself_and_nothing_else() {
        let field = field();
        let probe = field.probe(30, 20).unwrap();
        let mut row = [0.0; 60];
        for y in 0..40 {
            field.compare(&probe, 0, y, &mut row);
            for (x, likeness) in row.iter().enumerate() {
                let outside = !(5..55).contains(&x) || !(5..35).contains(&y);
                assert_eq!(outside, *likeness == OUTSIDE, "{x} {y}");
                let here = (x, y) == (30, 20);
                assert!(here == (*likeness > 0.999) && *likeness < 1.001);
                assert!(here || *likeness < 0.9);
            }
        }
    }

    #[test]
    fn parts_of_a_row_agree_with_the_whole() {
        let field = field();
        let probe = field.probe(12, 9).unwrap();
        let mut whole = [0.0; 70];
        field.compare(&probe, -5, 14, &mut whole);
        for (from, length) in [(0, 1), (3, 9), (17, 20), (60, 10)] {
            let mut part = vec![0.0; length];
            field.compare(&probe, from as i64 - 5, 14, &mut part);
            assert_eq!(part, whole[from..from + length]);
        }
        field.compare(&probe, 1000, 14, &mut whole);
        assert!(whole.iter().all(|l| *l == OUTSIDE));
    }
}
