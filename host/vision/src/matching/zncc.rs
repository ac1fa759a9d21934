//! Zero-mean normalised cross-correlation (ZNCC) at whole pixels of a pyramid level.
//!
//! ```text
//! zncc(x, y) = Σ T' I(x + i, y + j) / sqrt(Σ (I - mean)²)        T' zero-mean with Σ T'² = 1
//! ```
//!
//! The denominator of every window is computed once per image ([`ZnccPlane`]), so that each
//! correlation is one sum of products. OpenCV calls the measure `TM_CCOEFF_NORMED`.

use std::ops::Range;

use pulp::{Arch, NullaryFnOnce};

use super::pyramid::Plane;

/// Side of the window, px of the level.
pub const SIDE: usize = 11;
const RADIUS: usize = SIDE / 2;
/// Number of places correlated together: enough to hide the latency of each sum, few enough to stay
/// in registers.
const MANY: usize = 32;
/// Number of places correlated together at the end of a row.
const LONG: usize = 40;
/// Number of places correlated together if few are left.
const SHORT: usize = 16;
/// Number of windows summed together.
const BLOCK: usize = 64;
/// Middle of the grey levels.
const MIDDLE: f32 = 128.0;
/// Score of a place whose window is not within the image.
pub const OUTSIDE: f32 = f32::NEG_INFINITY;
/// Least contrast of a window (standard deviation of its grey levels). A window below it correlates
/// with nothing.
const LEAST_CONTRAST: f32 = 1.0;

/// Pyramid level with the contrast of every window in it.
#[derive(Clone, Debug, Default)]
pub struct ZnccPlane {
    plane: Plane,
    /// `1 / sqrt(Σ (I - mean)²)` of the window around each pixel; 0 without contrast.
    inverse: Vec<f32>,
}

/// Window to look for: zero-mean, of unit energy.
#[derive(Clone, Debug)]
pub struct ZnccPatch([[f32; SIDE]; SIDE]);

/// Computation of the contrast of all windows.
struct Contrast<'a> {
    plane: &'a Plane,
    inverse: &'a mut [f32],
}

impl NullaryFnOnce for Contrast<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Plane { width, stride, .. } = *self.plane;
        let count = (SIDE * SIDE) as f32;
        let places = width - (SIDE - 1);
        // Box filter, columns first: Σ (I - middle) and Σ (I - middle)² over the window's rows, per
        // column. Deviations from the middle grey level are small numbers, which round little.
        let mut columns = [vec![0.0_f32; width], vec![0.0_f32; width]];
        let mut windows = [vec![0.0_f32; width], vec![0.0_f32; width]];
        for y in RADIUS..self.plane.height - RADIUS {
            let [sums, squares] = &mut columns;
            sums.fill(0.0);
            squares.fill(0.0);
            for r in y - RADIUS..=y + RADIUS {
                let row = &self.plane.grey[r * stride..][..width];
                for ((sum, square), level) in sums.iter_mut().zip(&mut *squares).zip(row) {
                    let level = level - MIDDLE;
                    *sum += level;
                    *square += level * level;
                }
            }
            // Then rows: sums over the window's columns.
            for (column, window) in columns.iter().zip(&mut windows) {
                sums_of_eleven(column, window);
            }
            // Σ (I - mean)² = Σ I² - (Σ I)²/n.
            let out = &mut self.inverse[y * stride + RADIUS..][..places];
            for ((out, sum), square) in out.iter_mut().zip(&windows[0]).zip(&windows[1]) {
                let variation = square - sum * sum / count;
                let inverse = 1.0 / variation.sqrt();
                let enough = variation > count * LEAST_CONTRAST * LEAST_CONTRAST;
                *out = if enough { inverse } else { 0.0 };
            }
        }
    }
}

/// Computes sums of [`SIDE`] values from each place on, by doubling: 1 + 2 + 8. The last places of
/// `out` stay unchanged.
#[inline(always)]
fn sums_of_eleven(values: &[f32], out: &mut [f32]) {
    const { assert!(SIDE == 11) }
    let count = values.len();
    let mut pairs = [0.0_f32; BLOCK + 10];
    let mut fours = [0.0_f32; BLOCK + 8];
    for start in (0..count - (SIDE - 1)).step_by(BLOCK) {
        let places = BLOCK.min(count - (SIDE - 1) - start);
        let values = &values[start..][..places + SIDE - 1];
        for (i, pair) in pairs[..places + 9].iter_mut().enumerate() {
            *pair = values[i] + values[i + 1];
        }
        for i in 0..places + 4 {
            fours[i] = pairs[i] + pairs[i + 2];
        }
        let out = &mut out[start..][..places];
        for (i, out) in out.iter_mut().enumerate() {
            *out = (fours[i] + fours[i + 4]) + (pairs[i + 8] + values[i + 10]);
        }
    }
}

impl ZnccPlane {
    /// Computes the contrast of all windows of `plane`.
    pub fn new(plane: &Plane) -> Self {
        let mut inverse = vec![0.0_f32; plane.stride * plane.height];
        if plane.width >= SIDE && plane.height >= SIDE {
            Arch::new().dispatch(Contrast {
                plane,
                inverse: &mut inverse,
            });
        }
        Self {
            plane: plane.clone(),
            inverse,
        }
    }

    /// Returns the number of columns and of rows.
    pub fn size(&self) -> [usize; 2] {
        [self.plane.width, self.plane.height]
    }

    /// Returns the columns (axis 0) or rows (axis 1) around which a window lies within the image.
    pub fn window_centres(&self, axis: usize) -> Range<i64> {
        RADIUS as i64..self.size()[axis] as i64 - RADIUS as i64
    }

    /// Returns true if the window around `(x, y)` lies within the image.
    pub fn contains_window(&self, x: i64, y: i64) -> bool {
        self.window_centres(0).contains(&x) && self.window_centres(1).contains(&y)
    }

    /// Takes the window around `(x, y)`. Returns `None` if it leaves the image or has no contrast.
    pub fn patch(&self, x: i64, y: i64) -> Option<ZnccPatch> {
        if !self.contains_window(x, y) {
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
                &self.plane.grey[(y + r - RADIUS) * self.plane.stride + x - RADIUS..][..SIDE],
            );
        }
        let mean = window.as_flattened().iter().sum::<f32>() / (SIDE * SIDE) as f32;
        for value in window.as_flattened_mut() {
            *value = (*value - mean) * inverse;
        }
        Some(ZnccPatch(window))
    }

    /// Correlates `patch` with the windows around `(x, y), (x + 1, y), ...`, one per entry of
    /// `out`; [`OUTSIDE`] where the window leaves the image.
    pub fn correlate(&self, patch: &ZnccPatch, x: i64, y: i64, out: &mut [f32]) {
        out.fill(OUTSIDE);
        if !self.contains_window(RADIUS as i64, y) {
            return;
        }
        let first = x.max(RADIUS as i64);
        let end = (x + out.len() as i64).min(self.plane.width as i64 - RADIUS as i64);
        if first >= end {
            return;
        }
        Arch::new().dispatch(Correlate {
            plane: self,
            patch,
            start: first as usize,
            y: y as usize,
            out: &mut out[(first - x) as usize..(end - x) as usize],
        });
    }
}

/// Correlation of a patch with consecutive places of a row, all within the image.
struct Correlate<'a> {
    plane: &'a ZnccPlane,
    patch: &'a ZnccPatch,
    start: usize,
    y: usize,
    out: &'a mut [f32],
}

impl Correlate<'_> {
    /// Correlates `PLACES` consecutive places at once.
    #[inline(always)]
    fn block<const PLACES: usize>(&self, column: usize) -> [f32; PLACES] {
        let Plane { stride, grey, .. } = &self.plane.plane;
        let mut sums = [0.0_f32; PLACES];
        for (r, taps) in self.patch.0.iter().enumerate() {
            let from = (self.y + r - RADIUS) * stride + column - RADIUS;
            // The padding lets the last block read on; what it computes there is dropped.
            let Some(row) = grey.get(from..from + SIDE - 1 + PLACES) else {
                return sums;
            };
            for (i, tap) in taps.iter().enumerate() {
                let row = &row[i..][..PLACES];
                for (sum, level) in sums.iter_mut().zip(row) {
                    *sum += tap * level;
                }
            }
        }
        sums
    }
}

impl NullaryFnOnce for Correlate<'_> {
    type Output = ();

    #[inline(always)]
    fn call(mut self) {
        let inverse = &self.plane.inverse[self.y * self.plane.plane.stride..];
        let out = std::mem::take(&mut self.out);
        let mut done = 0;
        while done < out.len() {
            let column = self.start + done;
            let rest = &mut out[done..];
            let inverse = &inverse[column..];
            let finish = |sums: &[f32], rest: &mut [f32]| {
                for ((out, sum), inverse) in rest.iter_mut().zip(sums).zip(inverse) {
                    *out = sum * inverse;
                }
            };
            done += if rest.len() > LONG {
                finish(&self.block::<MANY>(column), rest);
                MANY
            } else if rest.len() > SHORT {
                finish(&self.block::<LONG>(column), rest);
                LONG
            } else {
                finish(&self.block::<SHORT>(column), rest);
                SHORT
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::Image;
    use crate::matching::pyramid::Pyramid;
    use trinocular_rig::random::Random;

    fn plane() -> ZnccPlane {
        let mut random = Random::new(4, 0);
        let grey = (0..60 * 40)
            .map(|_| (128.0 + 50.0 * random.gaussian()) as u8)
            .collect();
        let image = Image {
            width: 60,
            height: 40,
            grey,
        };
        ZnccPlane::new(&Pyramid::new(&image, 1).levels[0])
    }

    #[test]
    fn window_correlates_with_itself() {
        let plane = plane();
        let patch = plane.patch(30, 20).unwrap();
        let mut row = [0.0; 60];
        for y in 0..40 {
            plane.correlate(&patch, 0, y, &mut row);
            for (x, zncc) in row.iter().enumerate() {
                let outside = !(5..55).contains(&x) || !(5..35).contains(&y);
                assert_eq!(outside, *zncc == OUTSIDE, "{x} {y}");
                let here = (x, y) == (30, 20);
                assert!(here == (*zncc > 0.999) && *zncc < 1.001);
                assert!(here || *zncc < 0.9);
            }
        }
    }

    #[test]
    fn row_parts_equal_the_whole() {
        let plane = plane();
        let patch = plane.patch(12, 9).unwrap();
        let mut whole = [0.0; 70];
        plane.correlate(&patch, -5, 14, &mut whole);
        for (from, length) in [(0, 1), (3, 9), (17, 20), (60, 10)] {
            let mut part = vec![0.0; length];
            plane.correlate(&patch, from as i64 - 5, 14, &mut part);
            assert_eq!(part, whole[from..from + length]);
        }
        plane.correlate(&patch, 1000, 14, &mut whole);
        assert!(whole.iter().all(|l| *l == OUTSIDE));
    }
}
