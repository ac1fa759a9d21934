//! Level 1 straight from an image, without level 0 in memory.
//!
//! Two binomial filters in a row are one filter of nine taps, `[1 8 28 56 70 56 28 8 1]/256`. In
//! whole numbers, the sums over columns fit 16 bits and those over the window fit the 24 bits of an
//! `f32`, so that nothing is rounded: level 1 has the bits that it would have with level 0 between.

use pulp::NullaryFnOnce;

use super::{PADDING, narrow};
use crate::images::Image;

/// Number of pixels beyond either end that the nine taps reach.
const REACH: usize = 4;
/// Number of grey levels that the sum of all weights stands for.
const SCALE: f32 = 65_536.0;

/// Computation of some rows of level 1.
pub(super) struct FirstLevel<'a> {
    pub(super) image: &'a Image,
    /// First of the rows.
    pub(super) first: usize,
    /// Grey levels of the rows, with their padding.
    pub(super) out: &'a mut [f32],
}

impl NullaryFnOnce for FirstLevel<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { image, first, out } = self;
        let (width, half) = (image.width, image.width.div_ceil(2));
        // Columns beyond both ends, and one more if that makes their number even.
        let mut sums = vec![0_u16; (width + 2 * REACH).next_multiple_of(2)];
        let mut parts = [(); 2].map(|()| vec![0.0_f32; sums.len() / 2]);
        let ends = [0, half - 1].map(|x| End::of_level(x, width));
        for (r, row) in (first..).zip(out.chunks_exact_mut(half + PADDING)) {
            column_sums(image, r, &mut sums[REACH..REACH + width]);
            let [first, last] = [sums[REACH], sums[REACH + width - 1]];
            sums[..REACH].fill(first);
            sums[REACH + width..].fill(last);
            split(&sums, parts.each_mut().map(Vec::as_mut_slice));
            let (inside, beyond) = row.split_at_mut(half);
            along(parts.each_ref().map(Vec::as_slice), inside);
            // At both ends, level 0 repeats its own last pixel, not the image's.
            let columns = &sums[REACH..REACH + width];
            for end in &ends {
                inside[end.x] = end.of(columns);
            }
            beyond.fill(inside[half - 1]);
        }
    }
}

/// Returns the places of the five taps around `centre`; beyond the border, the outermost place.
fn taps(centre: usize, count: usize) -> [usize; 5] {
    [0, 1, 2, 3, 4].map(|i| (centre + i).saturating_sub(2).min(count - 1))
}

/// Weights of the five taps.
const WEIGHTS: [u16; 5] = [1, 4, 6, 4, 1];

/// Filters across the nine rows around row `2 r` of the image.
#[inline(always)]
fn column_sums(image: &Image, r: usize, out: &mut [u16]) {
    let (width, height) = (image.width, image.height);
    let count = out.len();
    let row = |y: usize| &image.grey[y * width..][..count];
    if r == 0 || 2 * r + 2 >= height {
        // Level 0 repeats its own outermost row, not the image's.
        out.fill(0);
        for (weight, y) in WEIGHTS.into_iter().zip(taps(2 * r, height)) {
            let [a, b, c, d, e] = taps(y, height).map(row);
            for x in 0..count {
                let smooth = narrow([a[x], b[x], c[x], d[x], e[x]].map(u16::from));
                out[x] = out[x].wrapping_add(smooth.wrapping_mul(weight));
            }
        }
        return;
    }
    let near = |i: usize| row((2 * r + i).saturating_sub(REACH).min(height - 1));
    let (a, b, c, d) = (near(0), near(1), near(2), near(3));
    let (e, f, g, h, i) = (near(4), near(5), near(6), near(7), near(8));
    for x in 0..count {
        let sum = |p: &[u8], q: &[u8]| u16::from(p[x]).wrapping_add(u16::from(q[x]));
        out[x] = sum(a, i)
            .wrapping_add(sum(b, h) << 3)
            .wrapping_add(sum(c, g).wrapping_mul(28))
            .wrapping_add(sum(d, f).wrapping_mul(56))
            .wrapping_add(u16::from(e[x]).wrapping_mul(70));
    }
}

/// Sorts the sums of a row by even and odd index.
#[inline(always)]
fn split(sums: &[u16], [even, odd]: [&mut [f32]; 2]) {
    let (pairs, _) = sums.as_chunks::<2>();
    for ((even, odd), pair) in even.iter_mut().zip(odd).zip(pairs) {
        (*even, *odd) = (f32::from(pair[0]), f32::from(pair[1]));
    }
}

/// Filters along a row, which comes as its sums with even and with odd index, at every second
/// place.
#[inline(always)]
fn along([even, odd]: [&[f32]; 2], out: &mut [f32]) {
    let count = out.len();
    let (a, c, e) = (&even[..count], &even[1..][..count], &even[2..][..count]);
    let (g, i) = (&even[3..][..count], &even[4..][..count]);
    let (b, d) = (&odd[..count], &odd[1..][..count]);
    let (f, h) = (&odd[2..][..count], &odd[3..][..count]);
    for x in 0..count {
        let outer = (a[x] + i[x]) + 8.0 * (b[x] + h[x]);
        let inner = 28.0 * (c[x] + g[x]) + 56.0 * (d[x] + f[x]);
        out[x] = (outer + inner + 70.0 * e[x]) * (1.0 / SCALE);
    }
}

/// Both filters, one after the other, at a pixel of level 1 whose taps leave the image.
struct End {
    /// Pixel of level 1.
    x: usize,
    /// First of the columns.
    first: usize,
    /// Weights of the columns from `first` on.
    weights: [u32; 2 * REACH + 1],
}

impl End {
    /// Computes the weights for an image of `count` columns.
    fn of_level(x: usize, count: usize) -> Self {
        let first = (2 * x).saturating_sub(REACH);
        let mut weights = [0; 2 * REACH + 1];
        for (outer, smooth) in WEIGHTS.into_iter().zip(taps(2 * x, count)) {
            for (inner, column) in WEIGHTS.into_iter().zip(taps(smooth, count)) {
                weights[column - first] += u32::from(outer * inner);
            }
        }
        Self { x, first, weights }
    }

    /// Filters a row.
    #[inline(always)]
    fn of(&self, columns: &[u16]) -> f32 {
        let mut sum = 0_u32;
        for (weight, column) in self.weights.iter().zip(&columns[self.first..]) {
            sum = sum.wrapping_add(weight.wrapping_mul(u32::from(*column)));
        }
        sum as f32 * (1.0 / SCALE)
    }
}
